use super::*;
use crate::contact::Friction;
use crate::material::Material;
use crate::mesh::TetMesh;
use crate::model::Fixed;
use crate::tool::{Placement, RigidTool};

/// A block of 40 × 30 × 20 mm on its support.
pub(crate) fn block() -> Model {
    let cells = [8, 6, 4];
    let index = |at: [usize; 3]| ((at[0] * (cells[1] + 1) + at[1]) * (cells[2] + 1) + at[2]) as u32;
    let (mut positions, mut tetrahedra) = (Vec::new(), Vec::new());
    for i in 0..=cells[0] {
        for j in 0..=cells[1] {
            for k in 0..=cells[2] {
                positions.push(DVec3::new(i as f64, j as f64, k as f64) * 0.005);
                if i < cells[0] && j < cells[1] && k < cells[2] {
                    for [a, b] in [[0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2]] {
                        let mut at = [i, j, k];
                        at[a] += 1;
                        let second = index(at);
                        at[b] += 1;
                        tetrahedra.push([index([i, j, k]), second, index(at), index([i + 1, j + 1, k + 1])]);
                    }
                }
            }
        }
    }
    let mesh = TetMesh::from_corners(positions, &tetrahedra);
    let support = (0..mesh.positions.len() as u32).filter(|&n| mesh.positions[n as usize].z == 0.0);
    let fixed: Vec<Fixed> = support.map(|node| Fixed { node, axes: [true; 3] }).collect();
    Model::new(mesh, vec![Material::neo_hookean(5000.0, 0.45).unwrap()], &fixed).unwrap()
}

/// A sphere of 5 mm that is pressed in 1.5 mm while the body has not moved yet; what it touches sticks.
fn pressed<'t>(model: &Model, tool: &'t RigidTool) -> ToolContact<'t> {
    let placement = Placement::pressing(DVec3::new(0.019, 0.016, 0.0185), DVec3::NEG_Z);
    let mut contact = ToolContact::new(model, tool, placement);
    contact.catch(model, &vec![0.0; model.unknowns()], None, Friction::Sticking);
    contact
}

#[test]
fn the_near_field_answers_as_all_of_the_body() {
    let (model, tool) = (block(), RigidTool::Sphere { radius_m: 0.005 });
    let contact = pressed(&model, &tool);
    let mut solver = Solver::new(&model, model.held.clone());
    let mut columns: [Vec<f64>; 6] = std::array::from_fn(|_| vec![0.0; model.unknowns()]);
    contact.motion(&model, &solver.u, &mut columns);
    let load = Load::Tool(Box::new(contact));
    let whole = solver.condensed_whole(&load, &columns).unwrap();
    assert!(solver.prepare_near_field(&load));
    let near = solver.condensed_near(&load, &columns).unwrap();
    for i in 0..6 {
        for j in 0..6 {
            let scale = (whole[i][i] * whole[j][j]).sqrt();
            let error = (near[i][j] - whole[i][j]).abs() / scale;
            assert!(error < 1e-6, "({i}, {j}): {} and {}", near[i][j], whole[i][j]);
        }
    }
}

#[test]
fn rounds_end_in_the_equilibrium_of_all_of_the_body() {
    let (model, tool) = (block(), RigidTool::Sphere { radius_m: 0.005 });
    let mut load = Load::Tool(Box::new(pressed(&model, &tool)));
    let mut solver = Solver::new(&model, model.held.clone());
    let mut shares = Vec::new();
    for _ in 0..20 {
        assert!(solver.prepare_near_field(&load));
        let (share, reaction) = solver.imbalance(&load).unwrap();
        shares.push(share);
        if share < 1e-6 {
            break;
        }
        // At rest the factor is soon too old.
        if matches!(shares.len(), 4 | 8 | 12) {
            assert!(solver.refactor_near_field(&load));
        }
        let Load::Tool(contact) = &mut load else { unreachable!("it is a tool") };
        solver.near_field_round(contact, 1e-7 * reaction, |_, _| true).unwrap();
    }
    assert!(shares.last().unwrap() < &1e-6, "{shares:?}");
    // As the whole body's own assembly has it.
    assert!(solver.assemble(&load).is_finite());
    let residual = solver.free_norm(&solver.gradient);
    let force = load.force(&model, &solver.u, &solver.gradient);
    assert!(residual < 2e-6 * force.length(), "{residual} N of {force} N");
    assert!(force.z < -0.01, "{force} N");
}

#[test]
fn a_load_anywhere_moves_the_body_as_its_stiffness_says() {
    let (model, tool) = (block(), RigidTool::Sphere { radius_m: 0.005 });
    let load = Load::Tool(Box::new(ToolContact::new(
        &model,
        &tool,
        Placement::pressing(DVec3::new(0.019, 0.016, 0.0201), DVec3::NEG_Z),
    )));
    let mut solver = Solver::new(&model, model.held.clone());
    assert!(solver.prepare_near_field(&load));
    let mut near = solver.near.take().unwrap();
    // Nothing touches: the body's stiffness at rest is all.
    let b: Vec<f64> =
        (0..model.unknowns()).map(|n| if model.held[n] { 0.0 } else { (n as f64 * 0.7).sin() }).collect();
    let condensed = near.condense(&b, &model.held);
    near.tangent.copy_from(&near.body);
    assert!(near.factor_tangent());
    let moved = near.solve(&condensed);
    let mut x = vec![0.0; model.unknowns()];
    for (&node, moved) in near.nodes.iter().zip(moved.chunks_exact(3)) {
        x[3 * node as usize..][..3].copy_from_slice(moved);
    }
    near.expand(&moved, &model.held, &mut x);
    let mut product = vec![0.0; x.len()];
    model.rest_stiffness.multiply(&model.pattern, &x, &mut product);
    let free = || (0..x.len()).filter(|&n| !model.held[n]);
    let error = free().map(|n| (product[n] - b[n]).powi(2)).sum::<f64>().sqrt();
    let size = free().map(|n| b[n] * b[n]).sum::<f64>().sqrt();
    assert!(error < 1e-4 * size, "{error} of {size}");
}

/// A tool a thousand times as hard as its penalties make it, as skin on fat has it, comes upon a body that knows nothing of it yet; with
/// friction. Newton's method alone finds no balance from there.
#[test]
fn a_hard_contact_is_found_by_way_of_softer_ones() {
    let (model, tool, friction) = (block(), RigidTool::Sphere { radius_m: 0.005 }, Friction::Coulomb(0.3));
    let force = |depth: f64, penalty_scale: f64| {
        let placement = Placement::pressing(DVec3::new(0.019, 0.016, 0.02 - depth), DVec3::NEG_Z);
        let mut contact = ToolContact::new(&model, &tool, placement);
        contact.penalty_scale = penalty_scale;
        let mut load = Load::Tool(Box::new(contact));
        let mut solver = Solver::new(&model, model.held.clone());
        for _ in 0..40 {
            assert!(solver.prepare_near_field(&load) && solver.refactor_near_field(&load));
            let (share, reaction) = solver.imbalance(&load).unwrap();
            if share < 1e-5 {
                break;
            }
            let Load::Tool(contact) = &mut load else { unreachable!("it is a tool") };
            let mut regrips = 0;
            let round = solver.near_field_round(contact, 1e-6 * reaction, |contact, u| {
                regrips += 1;
                let changed = contact.limit(&model, u, friction) + contact.catch(&model, u, None, friction);
                changed < 1e-5 * reaction || regrips > 100
            });
            round.unwrap();
            assert_eq!(contact.penalty_scale, penalty_scale);
        }
        assert!(solver.assemble(&load).is_finite());
        let residual = solver.free_norm(&solver.gradient);
        let force = load.force(&model, &solver.u, &solver.gradient);
        assert!(residual < 1e-4 * force.length(), "{residual} N of {force} N");
        force
    };
    for depth in [2e-4, 4e-4] {
        let [hard, harder] = [30.0, 1000.0].map(|scale| force(depth, scale));
        assert!(hard.distance(harder) < 0.01 * harder.length(), "{depth} m: {hard} {harder}");
    }
}
