//! Displacement fields from a simulation to pictures: in the body, off the simulation by little, and in glTF.

use palpate_body::{Body, ContactState, Deformer};
use palpate_build::paths_file::PathsRecord;
use palpate_build::precompute::assemble;
use palpate_build::precompute::fields::displacement_fields;
use palpate_build::spec::Spec;

mod common;

use common::{TestDirectory, said};

#[test]
fn a_simulated_body_deforms_as_it_was_simulated() {
    let directory = TestDirectory::new(20);
    directory.write("ball.toml", include_str!("../../../examples/ball.toml"));
    let out = directory.done("precompute ball.toml -o ball.body --json");
    let report: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let body = Body::open(&directory.path("ball.body")).unwrap();
    assert!(body.has_partial_slip(), "a coupled body of a simulation has two contact points");
    let fields = body.displacement_fields().unwrap().expect("a small body keeps its fields");
    assert_eq!(report["displacement_bytes"].as_u64(), Some(fields.bytes() as u64));
    assert_eq!((fields.press().places(), fields.lateral().places()), (6, 6));

    // At each place, at the depths that are kept, the surface is the simulated one.
    let record = PathsRecord::open(&directory.path("ball.body.paths")).unwrap();
    let scene = record.scene.as_ref().unwrap();
    let mut deformer = Deformer::new(&body).unwrap();
    let mut positions = Vec::new();
    let mut compared = 0;
    for point in record.points.values() {
        let (place, paths) = (point.test_point(), point.paths_with_displacements().unwrap());
        let at = body.nearest(place.plan.point, 1e-4).unwrap().at;
        for state in [paths.press.states.first().unwrap(), paths.press.states.last().unwrap()] {
            let contact = ContactState::pressed(&body, at, state.depth_m);
            deformer.displace(&body, &contact, &mut positions);
            let (mut squares, mut count) = (0.0, 0.0);
            for (x, u) in scene.boundary_m.iter().zip(&state.displacement_m) {
                let u = glam::DVec3::from_array(u.map(f64::from));
                let there = body.nearest(*x, 1e-3).unwrap().at;
                let nodes = body.element_node_numbers(there.element);
                let moved: glam::DVec3 = nodes
                    .into_iter()
                    .zip(there.n)
                    .map(|(n, share)| (positions[n as usize] - body.nodes()[n as usize].position) * share)
                    .sum();
                if u.length() > 0.01 * state.depth_m {
                    squares += moved.distance_squared(u);
                    count += 1.0;
                }
            }
            let rms = f64::sqrt(squares / count) / state.depth_m;
            assert!(rms < 0.03, "test point {} at {} m: {rms} of the depth", point.index(), state.depth_m);
            compared += 1;
        }
    }
    assert_eq!(compared, 12);

    // Where room is short it has those of some places, spread over the surface, dragged ones first, and blends them.
    let nodes: Vec<u32> = record.points.values().map(|p| p.test_point().node).collect();
    let surface = assemble::surface(
        &Spec::parse("ball.toml".as_ref(), record.plan.spec.clone()).unwrap(),
        &scene.surface,
    )
    .unwrap();
    let of = |most: usize| displacement_fields(&record, scene, &surface, &nodes, most).unwrap();
    let (all, count) = of(usize::MAX);
    let all = all.unwrap();
    assert_eq!((all.press().places(), count), (6, 6));
    let (some, count) = of(all.bytes() - 1);
    let some = some.unwrap();
    assert_eq!((some.press().places(), some.lateral().places(), count), (5, 5, 6));
    assert!(
        some.bytes() < all.bytes() && some.press().points().iter().all(|p| all.press().points().contains(p))
    );
    assert_eq!(of(all.bytes() / 10).0, None);

    // A spec may do without, and a record makes that body too.
    let mut without = record.clone();
    without.plan.spec =
        without.plan.spec.replacen("[body.shape]", "[body]\ndisplacements = false\n[body.shape]", 1);
    let plain = assemble::body(&without).unwrap().body;
    assert!(plain.displacement_fields().unwrap().is_none());
    assert_eq!(assemble::body(&record).unwrap().body, body);

    let said = said(&directory.done("export ball.body --glb ball.glb --targets 3"));
    assert!(said.contains("3 morph targets of displacement fields"), "{said}");
    let file = gltf::Gltf::open(directory.path("ball.glb")).unwrap();
    let mesh = file.meshes().next().unwrap();
    assert_eq!(mesh.primitives().next().unwrap().morph_targets().count(), 3);
    assert!(mesh.extras().as_ref().unwrap().get().contains("3.00 mm"));

    // A law has no fields, and says that the key is not for it.
    directory.write("law.toml", &format!("[body]\ndisplacements = true\n{}", common::spec(20)));
    let told = common::said(&directory.done("fit --spec law.toml -o law.body"));
    assert!(told.contains("[body] displacements is for simulations"), "{told}");
}
