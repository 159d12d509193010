//! A body as CSV tables, and the numbers of a node that tables and pictures show.

use anyhow::Result;
use palpate_body::potential::QUANTITY_NAMES;
use palpate_body::{Body, CoupledLaw, Curve, Potential, Response};
use palpate_runtime::Record;
use std::io::Write;

/// Numbers of one response, or a blend of several's.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Figures {
    /// Slope of the normal force 1 mm deep, N/m.
    pub stiffness_at_1_mm_n_per_m: f64,
    /// Slope of the normal force at the last knot, N/m.
    pub stiffness_at_full_depth_n_per_m: f64,
    /// Normal force at the last knot, N.
    pub largest_normal_force_n: f64,
    /// Slope of the lateral force at 0, N/m.
    pub lateral_stiffness_n_per_m: f64,
    /// Friction coefficient at 0.
    pub friction: f64,
}

impl Figures {
    /// Names with units, in the order of [`Figures::values`].
    pub const NAMES: [&str; 5] = [
        "stiffness_at_1_mm_n_per_m",
        "stiffness_at_full_depth_n_per_m",
        "largest_normal_force_n",
        "lateral_stiffness_n_per_m",
        "friction",
    ];

    /// All of them.
    pub fn values(&self) -> [f64; 5] {
        let Figures {
            stiffness_at_1_mm_n_per_m: at_1_mm,
            stiffness_at_full_depth_n_per_m: at_full_depth,
            largest_normal_force_n: force,
            lateral_stiffness_n_per_m: lateral,
            friction,
        } = *self;
        [at_1_mm, at_full_depth, force, lateral, friction]
    }

    fn of(response: &Response) -> Self {
        let Response { normal, lateral, friction } = response;
        let end = normal.knots().last().copied().unwrap_or_default();
        Figures {
            stiffness_at_1_mm_n_per_m: normal.slope(1e-3),
            stiffness_at_full_depth_n_per_m: normal.slope(end),
            largest_normal_force_n: normal.value(end),
            lateral_stiffness_n_per_m: lateral.slope(0.0),
            friction: friction.value(0.0),
        }
    }

    /// Of a press straight in; the lateral stiffness is the mean over the directions 1 mm deep, since that at depth 0 is no
    /// place's that is touched.
    fn of_potential(potential: &Potential) -> Self {
        let Potential { press, stiffness: [k11, _, k22], friction, .. } = potential;
        let end = press.knots().last().copied().unwrap_or_default();
        Figures {
            stiffness_at_1_mm_n_per_m: press.bend(1e-3),
            stiffness_at_full_depth_n_per_m: press.bend(end),
            largest_normal_force_n: press.slope(end),
            lateral_stiffness_n_per_m: 0.5 * (k11.value(1e-3) + k22.value(1e-3)),
            friction: friction.value(0.0),
        }
    }

    /// Those of every node: like curves, they blend linearly.
    pub fn of_nodes(body: &Body) -> Vec<Self> {
        let responses = body.curves().iter().map(Figures::of);
        let potentials = body.coupled_law().into_iter().flat_map(|law| &law.potentials);
        let figures = responses.chain(potentials.map(Figures::of_potential));
        let of_points: Vec<[f64; 5]> = figures.map(|f| f.values()).collect();
        let blend = |node: &palpate_body::Node| {
            let mut sum = [0.0; 5];
            for (point, weight) in node.test_points.iter().zip(node.weights) {
                let Some(values) = of_points.get(*point as usize) else { continue };
                sum.iter_mut().zip(values).for_each(|(s, v)| *s += weight * v);
            }
            let [at_1_mm, at_full_depth, force, lateral, friction] = sum;
            Figures {
                stiffness_at_1_mm_n_per_m: at_1_mm,
                stiffness_at_full_depth_n_per_m: at_full_depth,
                largest_normal_force_n: force,
                lateral_stiffness_n_per_m: lateral,
                friction,
            }
        };
        body.nodes().iter().map(blend).collect()
    }
}

/// One row a node: place, inward normal, whose responses it blends, and its figures.
///
/// # Errors
/// `out` can't be written.
pub fn write_nodes(body: &Body, out: &mut dyn Write) -> Result<()> {
    write!(out, "node,x_m,y_m,z_m,inward_x,inward_y,inward_z")?;
    write!(out, ",test_point_0,test_point_1,test_point_2,weight_0,weight_1,weight_2")?;
    write!(out, ",{}", Figures::NAMES.join(","))?;
    let tensors = body.lateral_tensors();
    if tensors.is_some() {
        for component in ["xx", "yy", "zz", "xy", "xz", "yz"] {
            write!(out, ",lateral_{component}")?;
        }
    }
    writeln!(out)?;
    for (i, (node, figures)) in body.nodes().iter().zip(Figures::of_nodes(body)).enumerate() {
        let ([x, y, z], [u, v, w]) = (node.position.to_array(), node.inward.to_array());
        let ([a, b, c], [p, q, r]) = (node.test_points, node.weights);
        write!(out, "{i},{x:?},{y:?},{z:?},{u:?},{v:?},{w:?},{a},{b},{c},{p:?},{q:?},{r:?}")?;
        for value in figures.values() {
            write!(out, ",{value:?}")?;
        }
        for component in tensors.and_then(|a| a.get(i)).into_iter().flatten() {
            write!(out, ",{component:?}")?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// One row an element: its nodes, anticlockwise seen from outside.
///
/// # Errors
/// `out` can't be written.
pub fn write_elements(body: &Body, out: &mut dyn Write) -> Result<()> {
    writeln!(out, "element,node_0,node_1,node_2")?;
    for (i, element) in body.elements().iter().enumerate() {
        let [a, b, c] = element.nodes;
        writeln!(out, "{i},{a},{b},{c}")?;
    }
    Ok(())
}

/// Points between two knots, so that straight lines between rows show the curve.
const BETWEEN_KNOTS: usize = 8;

/// The test points' curves in rows of a samples file, with the slope beside: `value` is in N for `normal` and
/// `lateral`, without unit for `friction`; `slope_per_m` is that per metre.
///
/// # Errors
/// `out` can't be written.
pub fn write_curves(body: &Body, out: &mut dyn Write) -> Result<()> {
    writeln!(out, "point,x_m,y_m,z_m,component,deflection_m,value,slope_per_m")?;
    for (t, (response, node)) in body.curves().iter().zip(body.test_point_nodes()).enumerate() {
        let Some(node) = body.nodes().get(*node as usize) else { continue };
        let [x, y, z] = node.position.to_array();
        let Response { normal, lateral, friction } = response;
        for (component, curve) in [("normal", normal), ("lateral", lateral), ("friction", friction)] {
            for d in deflections(curve) {
                let (value, slope) = (curve.value(d), curve.slope(d));
                writeln!(out, "{t},{x:?},{y:?},{z:?},{component},{d:?},{value:?},{slope:?}")?;
            }
        }
    }
    Ok(())
}

/// The test points' potentials: a row for each depth with F (J), b (N), K (N/m), C (N/m²), Q (N/m³), μ and their slopes
/// per metre, and the tangents t₁ and t₂ of the test point.
///
/// # Errors
/// `out` can't be written.
pub fn write_potentials(body: &Body, law: &CoupledLaw, out: &mut dyn Write) -> Result<()> {
    write!(out, "point,node,x_m,y_m,z_m,t1_x,t1_y,t1_z,t2_x,t2_y,t2_z,depth_m")?;
    let units =
        ["j", "n", "n", "n_per_m", "n_per_m", "n_per_m", "n_per_m2", "n_per_m2", "n_per_m2", "n_per_m2"];
    let units = units.into_iter().chain(["n_per_m3", ""]);
    for (name, unit) in QUANTITY_NAMES.iter().zip(units) {
        write!(out, ",{name}{}{unit}", if unit.is_empty() { "" } else { "_" })?;
    }
    for name in QUANTITY_NAMES {
        write!(out, ",{name}_slope_per_m")?;
    }
    writeln!(out)?;
    for (t, (potential, &n)) in law.potentials.iter().zip(body.test_point_nodes()).enumerate() {
        let Some(node) = body.nodes().get(n as usize) else { continue };
        let curves = potential.curves();
        for d in deflections(&potential.press) {
            write!(out, "{t},{n}")?;
            let vectors = [node.position, potential.tangents[0], potential.tangents[1]];
            let numbers = vectors.into_iter().flat_map(|v| v.to_array()).chain([d]);
            let quantities = curves.iter().map(|c| c.value(d)).chain(curves.iter().map(|c| c.slope(d)));
            for x in numbers.chain(quantities) {
                write!(out, ",{x:?}")?;
            }
            writeln!(out)?;
        }
    }
    Ok(())
}

fn deflections(curve: &Curve) -> impl Iterator<Item = f64> + '_ {
    let within = |k: &[f64]| {
        let (from, width) = (k[0], k[1] - k[0]);
        (0..BETWEEN_KNOTS).map(move |i| from + width * i as f64 / BETWEEN_KNOTS as f64)
    };
    curve.knots().windows(2).flat_map(within).chain(curve.knots().last().copied())
}
/// Writes a row for each record: all that the loop saw and did.
///
/// # Errors
/// `out` can't be written.
pub fn write_periods(records: &mut dyn Iterator<Item = Record>, out: &mut dyn Write) -> Result<()> {
    writeln!(out, "{}", Record::columns().join(","))?;
    for record in records {
        writeln!(out, "{}", record.row().join(","))?;
    }
    Ok(())
}
