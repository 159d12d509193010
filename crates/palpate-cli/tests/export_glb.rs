//! `palpate export --glb`, read back by another reader than ours.

use palpate_body::{Body, ContactState, Deformer, SurfacePoint};
use std::collections::BTreeMap;

mod common;

use common::{TestDirectory, said};

/// The vectors of an accessor.
fn vectors(accessor: &gltf::Accessor<'_>, bytes: &[u8]) -> Vec<[f32; 3]> {
    assert_eq!(
        (accessor.data_type(), accessor.dimensions()),
        (gltf::accessor::DataType::F32, gltf::accessor::Dimensions::Vec3)
    );
    gltf::accessor::Iter::new(accessor.clone(), |_| Some(bytes)).unwrap().collect()
}

fn normalized(v: [f32; 3]) -> [f32; 3] {
    let length = v.iter().map(|c| c * c).sum::<f32>().sqrt();
    v.map(|c| c / length)
}

fn near(a: [f32; 3], b: [f64; 3], within: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (f64::from(*a) - b).abs() <= within)
}

#[test]
fn another_reader_finds_the_body_and_its_targets() {
    let directory = TestDirectory::new(10);
    let said = said(&directory.done("export block.body --glb block.glb --targets 5 --depth-mm 3"));
    assert!(said.contains("5 morph targets of a dimple"), "{said}");
    let body = Body::open(&directory.path("block.body")).unwrap();
    // Checks the whole document besides.
    let file = gltf::Gltf::open(directory.path("block.glb")).unwrap();
    let bytes = file.blob.as_deref().unwrap();
    let node = file.default_scene().unwrap().nodes().next().unwrap();
    assert_eq!(node.name(), Some("block"));
    let mesh = node.mesh().unwrap();
    let extras: serde_json::Value = serde_json::from_str(mesh.extras().as_ref().unwrap().get()).unwrap();
    assert_eq!(mesh.weights().unwrap(), [0.0; 5]);
    let primitive = mesh.primitives().next().unwrap();
    let reader = primitive.reader(|_| Some(bytes));

    let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
    let normals: Vec<[f32; 3]> = reader.read_normals().unwrap().collect();
    let colours: Vec<[u8; 4]> = reader.read_colors(0).unwrap().into_rgba_u8().collect();
    let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
    assert_eq!([positions.len(), normals.len(), colours.len()], [body.nodes().len(); 3]);
    let y_up = |v: glam::DVec3| [v.x, v.z, -v.y];
    for (i, n) in body.nodes().iter().enumerate() {
        assert!(near(positions[i], y_up(n.position), 1e-8), "{i}");
        assert!(near(normals[i], y_up(-n.inward), 1e-6), "{i}");
    }
    // The block is 40 mm high and stands upright.
    let bounds = primitive.bounding_box();
    assert!(near(bounds.min, [-0.04, -0.02, -0.04], 1e-8) && near(bounds.max, [0.04, 0.02, 0.04], 1e-8));
    let nodes: Vec<u32> = body.elements().iter().flat_map(|e| e.nodes).collect();
    assert_eq!(indices, nodes);
    // Anticlockwise from outside.
    for triangle in indices.as_chunks::<3>().0 {
        let [a, b, c] = triangle.map(|i| glam::DVec3::from_array(positions[i as usize].map(f64::from)));
        assert!((b - a).cross(c - a).dot(a + b + c) > 0.0);
    }

    let targets: Vec<_> = primitive.morph_targets().collect();
    assert_eq!(targets.len(), 5);
    let about = extras["targets"].as_array().unwrap();
    let names = extras["targetNames"].as_array().unwrap();
    let mut deformer = Deformer::new(&body).unwrap();
    let (mut moved, mut chosen) = (Vec::new(), BTreeMap::new());
    for ((target, about), name) in targets.iter().zip(about).zip(names) {
        let test_point = about["test_point"].as_u64().unwrap();
        assert_eq!(name.as_str().unwrap(), format!("test point {test_point}, 3.00 mm"));
        chosen.insert(test_point, ());
        let node = about["node"].as_u64().unwrap() as u32;
        let (element, corner) = (0..)
            .zip(body.elements())
            .find_map(|(e, element)| Some((e, element.nodes.iter().position(|&n| n == node)?)))
            .unwrap();
        let mut n = [0.0; 3];
        n[corner] = 1.0;
        deformer.displace(
            &body,
            &ContactState::pressed(&body, SurfacePoint { element, n }, 3e-3),
            &mut moved,
        );
        let by = vectors(&target.positions().unwrap(), bytes);
        let turned = vectors(&target.normals().unwrap(), bytes);
        let mut deepest = 0.0f64;
        for (i, (node, p)) in body.nodes().iter().zip(&moved).enumerate() {
            assert!(near(by[i], y_up(*p - node.position), 1e-8), "{i}");
            deepest = deepest.max(p.distance(node.position));
            let there: [f32; 3] = std::array::from_fn(|c| normals[i][c] + turned[i][c]);
            assert!(normalized(there).iter().all(|c| c.is_finite()));
        }
        assert!((deepest - 3e-3).abs() < 1e-4, "{deepest}");
    }
    assert_eq!(chosen.len(), 5, "each at another test point");
}

#[test]
fn it_says_what_is_wrong() {
    let directory = TestDirectory::new(20);
    directory.done("export block.body --glb plain.glb --targets 0");
    let plain = gltf::Gltf::open(directory.path("plain.glb")).unwrap();
    assert!(plain.meshes().next().unwrap().primitives().next().unwrap().morph_targets().next().is_none());
    directory.refused("export block.body --glb block.body", 1, &["block.body"]);
    directory.refused("export block.body --glb x.glb --depth-mm 0", 2, &["above 0"]);
    directory.refused("export block.body --targets 3 --vtu x.vtu", 2, &["--glb"]);
    assert!(!directory.path("x.glb").exists());
}
