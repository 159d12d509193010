//! A body as a VTK XML unstructured grid, for ParaView: the header as text, the arrays behind it as raw bytes.

use crate::tables::Figures;
use anyhow::Result;
use palpate_body::stiffness::principals;
use palpate_body::tensor::Principal;
use palpate_body::{Body, Node};
use std::io::Write;

/// Puts an array's bytes out.
type Writer<'a> = dyn Fn(&mut dyn Write) -> std::io::Result<()> + 'a;

/// One array of the file.
struct Array<'a> {
    name: &'static str,
    kind: &'static str,
    components: usize,
    /// Bytes of all of it.
    size: u64,
    write: Box<Writer<'a>>,
}

/// VTK's number for a triangle.
const TRIANGLE: u8 = 5;

/// Writes the surface with, at each node, its inward normal, the [`Figures`], the test points it blends, and its lateral
/// tensor if the body is anisotropic; and at each element what `elements_hold` says, by name.
///
/// # Errors
/// `out` can't be written.
pub fn write(body: &Body, elements_hold: &[(&'static str, Vec<f64>)], out: &mut dyn Write) -> Result<()> {
    let figures: Vec<[f64; 5]> = Figures::of_nodes(body).iter().map(Figures::values).collect();
    let principals: Vec<Principal> = principals(body).collect();
    let (nodes, elements) = (body.nodes(), body.elements());
    let mut point_data = vec![
        doubles("inward_normal", 3, nodes.len(), move |i| nodes[i].inward.to_array().to_vec()),
        doubles("weights", 3, nodes.len(), move |i| nodes[i].weights.to_vec()),
        integers("test_points", 3, nodes.len(), move |i| nodes[i].test_points.to_vec()),
        integers("test_point", 1, nodes.len(), move |i| {
            // The one that counts most.
            let most =
                (0..3).max_by(|&a, &b| nodes[i].weights[a].total_cmp(&nodes[i].weights[b]).then(b.cmp(&a)));
            vec![nodes[i].test_points[most.unwrap_or(0)]]
        }),
    ];
    let figures = &figures;
    for (k, name) in Figures::NAMES.into_iter().enumerate() {
        point_data.push(doubles(name, 1, nodes.len(), move |i| vec![figures[i][k]]));
    }
    if let Some(tensors) = body.lateral_tensors() {
        let principals = &principals;
        // ParaView takes six components for a symmetric tensor in this order.
        point_data.push(doubles("lateral_tensor_xx_yy_zz_xy_yz_xz", 6, nodes.len(), move |i| {
            let [xx, yy, zz, xy, xz, yz] = tensors[i];
            vec![xx, yy, zz, xy, yz, xz]
        }));
        point_data.push(doubles("lateral_ratio", 1, nodes.len(), move |i| vec![principals[i].ratio()]));
        point_data.push(doubles("lateral_axis", 3, nodes.len(), move |i| {
            principals[i].axes[0].to_array().to_vec()
        }));
    }
    if let Some(law) = body.coupled_law() {
        // The blends of eigenvalues bound those of the blend.
        let mixed = move |node: &Node, depth: f64, which: usize| {
            let parts = node.test_points.iter().zip(node.weights);
            let of = |(t, w): (&u32, f64)| {
                Some(w * law.potentials.get(*t as usize)?.principal_stiffness(depth)[which])
            };
            parts.filter_map(of).sum::<f64>()
        };
        for (name, depth, which) in [
            ("k_least_at_1_mm_n_per_m", 1e-3, 0),
            ("k_greatest_at_1_mm_n_per_m", 1e-3, 1),
            ("k_least_at_full_depth_n_per_m", f64::MAX, 0),
            ("k_greatest_at_full_depth_n_per_m", f64::MAX, 1),
        ] {
            point_data.push(doubles(name, 1, nodes.len(), move |i| vec![mixed(&nodes[i], depth, which)]));
        }
    }
    let points = [doubles("position_m", 3, nodes.len(), move |i| nodes[i].position.to_array().to_vec())];
    let cells = [
        integers("connectivity", 1, elements.len() * 3, move |i| vec![elements[i / 3].nodes[i % 3]]),
        Array {
            name: "offsets",
            kind: "Int64",
            components: 1,
            size: 8 * elements.len() as u64,
            write: Box::new(move |out| {
                (1..=elements.len() as i64).try_for_each(|i| out.write_all(&(3 * i).to_le_bytes()))
            }),
        },
        Array {
            name: "types",
            kind: "UInt8",
            components: 1,
            size: elements.len() as u64,
            write: Box::new(move |out| (0..elements.len()).try_for_each(|_| out.write_all(&[TRIANGLE]))),
        },
    ];

    let cell_data: Vec<Array> = elements_hold
        .iter()
        .map(|(name, values)| doubles(name, 1, elements.len(), move |i| vec![values[i]]))
        .collect();

    let mut offset = 0;
    let sections = [
        ("PointData", &point_data[..]),
        ("CellData", &cell_data[..]),
        ("Points", &points[..]),
        ("Cells", &cells[..]),
    ];
    writeln!(out, r#"<?xml version="1.0"?>"#)?;
    writeln!(
        out,
        r#"<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">"#
    )?;
    writeln!(out, "<UnstructuredGrid>")?;
    writeln!(out, r#"<Piece NumberOfPoints="{}" NumberOfCells="{}">"#, nodes.len(), elements.len())?;
    for (section, arrays) in &sections {
        writeln!(out, "<{section}>")?;
        for Array { name, kind, components, size, .. } in *arrays {
            writeln!(
                out,
                r#"<DataArray type="{kind}" Name="{name}" NumberOfComponents="{components}" format="appended" offset="{offset}"/>"#
            )?;
            offset += 8 + size;
        }
        writeln!(out, "</{section}>")?;
    }
    write!(out, "</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_")?;
    for array in sections.iter().flat_map(|(_, arrays)| *arrays) {
        out.write_all(&array.size.to_le_bytes())?;
        (array.write)(out)?;
    }
    writeln!(out, "\n</AppendedData>\n</VTKFile>")?;
    Ok(())
}

fn doubles<'a>(
    name: &'static str,
    components: usize,
    rows: usize,
    row: impl Fn(usize) -> Vec<f64> + 'a,
) -> Array<'a> {
    array("Float64", f64::to_le_bytes, name, components, rows, row)
}

fn integers<'a>(
    name: &'static str,
    components: usize,
    rows: usize,
    row: impl Fn(usize) -> Vec<u32> + 'a,
) -> Array<'a> {
    array("UInt32", u32::to_le_bytes, name, components, rows, row)
}

/// An array of VTK's type `kind`, whose numbers are `WIDTH` bytes each.
fn array<'a, T: Copy + 'a, const WIDTH: usize>(
    kind: &'static str,
    bytes: fn(T) -> [u8; WIDTH],
    name: &'static str,
    components: usize,
    rows: usize,
    row: impl Fn(usize) -> Vec<T> + 'a,
) -> Array<'a> {
    Array {
        name,
        kind,
        components,
        size: (WIDTH * components * rows) as u64,
        write: Box::new(move |out| {
            (0..rows).try_for_each(|i| row(i).iter().try_for_each(|v| out.write_all(&bytes(*v))))
        }),
    }
}
