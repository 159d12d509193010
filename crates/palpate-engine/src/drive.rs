//! The drives: what moves the contact point at a fixed tip (MODEL 4). A slip rule is its drive and nothing else.
//!
//! While c moves with the velocity t, D = −dW/dt is dissipated. With b = (f_z − g û·A δ_t) δ_t − (δ·û) f_t, g = f_r/ρ,
//!
//! ```text
//! D = [f_c − Σ_l (W_l + b·u_l/|Σnu| + ½ g δ_t·A_l δ_t) ∇n_l]·t
//! ```
//!
//! (for an isotropic body the bracket's sum is that of E2). Its vector is the drive of [`Exact`]; [`Consistent`] leaves out
//! f_z û, which is at right angles to a smooth surface, and takes the gradients of the nodes for those of the element;
//! [`Paper`] leaves out all but f_t.

use crate::field::{Field, Site};
use crate::lateral::Lateral;
use glam::{DVec3, Vec3A};
use palpate_body::{ContactModel, Node};

/// A drive, to be brought within the friction limit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drive {
    /// Its direction, a unit vector, or zero.
    pub along: DVec3,
    /// Its size, N.
    pub force: f64,
    /// About how far it may have to take the contact point, m.
    pub reach: f64,
    /// How much of its size may be rounding, N.
    pub noise: f64,
}

impl Drive {
    #[inline(always)]
    fn of(vector: DVec3, noise: f64, f: &Field) -> Self {
        let force = vector.length();
        let along = if force > 0.0 { vector * (1.0 / force) } else { DVec3::ZERO };
        // The lateral deflection may have to grow to what balances the rest.
        let reach = f.lateral + if f.pull_slope > 0.0 { force / f.pull_slope } else { 0.0 };
        Drive { along, force, reach, noise }
    }
}

/// A slip rule.
pub(crate) trait Rule {
    /// Whether the drive agrees on the two sides of every edge that is no crease, where the law does.
    const CONTINUOUS: bool;
    /// Whether slip must not raise the energy: a way that does has gone too far.
    const PASSIVE: bool = false;
    /// Whether it drives along f_t.
    const LATERAL: bool = false;

    /// Whether `body` has what the rule reads.
    #[inline(always)]
    fn is_ready(_body: &ContactModel) -> bool {
        true
    }

    /// What tells whether the contact point slips from where it stood, and which way to try first: a cheaper drive where
    /// it is sure to be within the limit or beyond it. `taken` is what the rule last took from f_t.
    #[inline(always)]
    fn first<L: Lateral>(site: &mut Site<L>, n: [f64; 3], f: &Field, _taken: DVec3) -> Drive {
        Self::drive(site, n, f)
    }

    /// The drive at area coordinates `n`, where `f` was just evaluated.
    fn drive<L: Lateral>(site: &mut Site<L>, n: [f64; 3], f: &Field) -> Drive;
}

/// f_t: the seed paper's section 3.2.
pub(crate) struct Paper;

impl Rule for Paper {
    const CONTINUOUS: bool = true;
    const LATERAL: bool = true;

    #[inline(always)]
    fn drive<L: Lateral>(_: &mut Site<L>, _: [f64; 3], f: &Field) -> Drive {
        // A coupled potential pulls aside without any lateral deflection.
        let further = if L::COUPLED && f.pull_slope > 0.0 { f.pull / f.pull_slope } else { 0.0 };
        Drive { along: f.u_t, force: f.pull, reach: f.lateral + further, noise: 0.0 }
    }
}

/// g̃ (E3).
pub(crate) struct Consistent;

impl Rule for Consistent {
    const CONTINUOUS: bool = true;

    #[inline(always)]
    fn is_ready(body: &ContactModel) -> bool {
        body.gradients().is_some()
    }

    #[inline(always)]
    fn first<L: Lateral>(site: &mut Site<L>, n: [f64; 3], f: &Field, taken: DVec3) -> Drive {
        let most = greatest(site, n, f);
        if f.pull + most <= f.limit {
            return Paper::drive(site, n, f);
        }
        let guess = Drive::of(f.u_t * f.pull - taken, 0.0, f);
        let inside = n[0] != 0.0 && n[1] != 0.0 && n[2] != 0.0;
        // Beyond the limit by more than the search's tolerance.
        if inside && f.pull - most > 1.001 * f.limit && guess.force > 1.001 * f.limit {
            return guess;
        }
        Self::drive(site, n, f)
    }

    #[inline(always)]
    fn drive<L: Lateral>(site: &mut Site<L>, n: [f64; 3], f: &Field) -> Drive {
        let reaction = reaction(site, n, f);
        let noise = NOISE * (reaction.x.abs() + reaction.y.abs() + reaction.z.abs());
        Drive::of(f.u_t * f.pull - reaction, noise, f)
    }
}

/// g (E2).
pub(crate) struct Exact;

impl Rule for Exact {
    const CONTINUOUS: bool = false;
    const PASSIVE: bool = true;

    #[inline(always)]
    fn drive<L: Lateral>(site: &mut Site<L>, n: [f64; 3], f: &Field) -> Drive {
        Drive::of(exact(site, n, f), 0.0, f)
    }
}

/// The most that |f_t − g̃| can be, N.
#[inline(always)]
fn greatest<L: Lateral>(site: &mut Site<L>, n: [f64; 3], f: &Field) -> f64 {
    let Some(gradients) = site.body.gradients() else { return 0.0 };
    let numbers = site.body.element_node_numbers(site.element);
    let [a, b, c] = numbers.map(|node| gradients.most(node));
    let mixed = |x: f32, y: f32, z: f32| n[0] * f64::from(x) + n[1] * f64::from(y) + n[2] * f64::from(z);
    let mut sum = 0.0;
    if site.law.interpolates_responses() {
        sum += site.stretch.greatest_gradient(&site.coefficients, gradients, numbers, f);
        if let Some((deflection, half)) = site.stretch.tensor_gradient(f) {
            sum += mixed(a.tensor, b.tensor, c.tensor) * half * deflection.length_squared();
        }
        // What turning it from the nodes' planes into c's may add.
        sum *= 1.1;
    }
    if site.law.interpolates_frames() {
        sum += mixed(a.turn, b.turn, c.turn) * site.leverage(n, f).length() / f.frame_length;
    }
    // Not a number where an infinite bound meets no energy.
    if sum >= 0.0 { sum } else { f64::INFINITY }
}

/// Of the gradients in single precision, and their sums.
const NOISE: f64 = 5e-7;

/// f_t − g̃ = P_û Σ_l n_l [∇̄W_l + ∇̄(u·b)_l/|Σnu| + ½ g ∇̄(δ_t·A δ_t)_l] (E3), N.
///
/// Continuous over edges, the frame's turning like the energies': with an element's own ∇n_l it would jump wherever the
/// elements at an edge are curved differently. P_û and not the element's plane for the same reason.
#[inline(always)]
fn reaction<L: Lateral>(site: &mut Site<L>, n: [f64; 3], f: &Field) -> DVec3 {
    let Some(gradients) = site.body.gradients() else { return DVec3::ZERO };
    let numbers = site.body.element_node_numbers(site.element);
    let [a, b, c] = n.map(|n| n as f32);
    let u = f.u();
    let mut sum = Vec3A::ZERO;
    if site.law.interpolates_responses() {
        let energies = site.stretch.energies(&site.coefficients, site.body, site.nodes, f);
        let tensors = site.stretch.tensor_gradient(f);
        let (single, nodes) = (u.as_vec3a(), site.nodes);
        let one = |number: u32, node: &Node| {
            let mut gradient = gradients.energy(number, node.test_points[0], &energies);
            if let Some((deflection, half)) = tensors {
                gradient += gradients.tensor(number, deflection) * half as f32;
            }
            // Turned from the node's plane into c's without losing length, up to the fourth order.
            gradient - node.inward.as_vec3a() * (0.5 * single.dot(gradient))
        };
        sum = one(numbers[0], nodes[0]) * a + one(numbers[1], nodes[1]) * b + one(numbers[2], nodes[2]) * c;
    }
    if site.law.interpolates_frames() {
        let lever = (site.leverage(n, f) * (1.0 / f.frame_length)).as_vec3a();
        let [x, y, z] = numbers.map(|node| gradients.turn(node, lever));
        sum += x * a + y * b + z * c;
    }
    let sum = sum.as_dvec3();
    sum - u * u.dot(sum)
}

/// g = P f_c − Σ_l [W_l + b·u_l/|Σnu| + ½ g δ_t·A_l δ_t] ∇n_l (E2), P on the element's plane, N.
pub(crate) fn exact<L: Lateral>(site: &mut Site<L>, n: [f64; 3], f: &Field) -> DVec3 {
    let mut share = [0.0; 3];
    if site.law.interpolates_responses() {
        share = site.stretch.node_energies(&site.coefficients, site.body, site.nodes, f);
    }
    if site.law.interpolates_frames() {
        let b = site.leverage(n, f) * (1.0 / f.frame_length);
        let turns = site.nodes.map(|node| node.inward.dot(b));
        share = [0, 1, 2].map(|l: usize| pick(share, l) + pick(turns, l));
    }
    // Σ ∇n_l = 0, so two differences are left. e1, e2 are the edges to corners 1 and 2.
    let [p, q, r] = site.corners();
    let (e1, e2) = (q - p, r - p);
    let (s1, s2) = (share[1] - share[0], share[2] - share[0]);
    let (a, b, c) = (e1.length_squared(), e1.dot(e2), e2.length_squared());
    let gradient = (e1 * (c * s1 - b * s2) + e2 * (a * s2 - b * s1)) * (1.0 / (a * c - b * b));
    let (force, normal) = (f.force(), e1.cross(e2));
    force - normal * (normal.dot(force) / normal.length_squared()) - gradient
}

#[inline(always)]
fn pick(of: [f64; 3], i: usize) -> f64 {
    of.get(i).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coupled::Coupled;
    use crate::decoupled::{Isotropic, Stretch};
    use crate::field::{Ablation, Law};
    use crate::sensitivity::tests::{ball, chance, coupled_ball};
    use palpate_body::{Body, NodeMix, SurfacePoint};

    fn bodies(ratio: f64) -> Vec<Body> {
        own_and_mixed(ball(ratio))
    }

    fn coupled_bodies() -> Vec<Body> {
        own_and_mixed(coupled_ball())
    }

    /// A body, and the same with nodes that mix three neighbours' responses.
    fn own_and_mixed(own: Body) -> Vec<Body> {
        let mut mixed = own.parts();
        let count = mixed.test_point_nodes.len() as u32;
        for (n, mix) in mixed.mixes.iter_mut().enumerate() {
            let n = n as u32;
            *mix = match n % 3 {
                0 => NodeMix { test_points: [0, 7, 19], weights: [0.2, 0.5, 0.3] },
                1 => NodeMix { test_points: [0, 7, 19], weights: [0.7, 0.0, 0.3] },
                _ => {
                    NodeMix { test_points: [n, (n + 5) % count, (n + 9) % count], weights: [0.25, 0.25, 0.5] }
                }
            };
        }
        vec![own, Body::new(mixed).unwrap()]
    }

    /// g̃, N.
    fn consistent<L: Lateral>(site: &mut Site<L>, n: [f64; 3], f: &Field) -> DVec3 {
        f.u_t * f.pull - reaction(site, n, f)
    }

    #[test]
    fn the_exact_drive_is_the_slope_of_the_energy() {
        slopes::<Isotropic>(&bodies(1.0));
        slopes::<Stretch>(&bodies(3.0));
        slopes::<Stretch>(&bodies(30.0));
        slopes::<Coupled>(&coupled_bodies());
    }

    fn slopes<L: Lateral>(bodies: &[Body]) {
        let mut unit = chance(11);
        for case in 0..1000 {
            let body = &bodies[case % bodies.len()];
            let ablation = [Ablation::None, Ablation::Coordinates, Ablation::Responses, Ablation::Both];
            let law = Law { ablation: ablation[case / 2 % 4], radius_m: 2e-3 };
            let element = (unit() * body.elements().len() as f64) as u32;
            let (a, b) = (0.2 + 0.3 * unit(), 0.2 + 0.3 * unit());
            let n = [a, b, 1.0 - a - b];
            let mut site = Site::<L>::new(body, law, element);
            let u = site.evaluate(n, DVec3::ZERO).u();
            let c = body.point(SurfacePoint { element, n });
            let aside = DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5) * 3e-3;
            let tip = c + u * (2e-3 * unit() - 5e-4) + (aside - u * aside.dot(u));
            let f = site.evaluate(n, tip);
            let drive = exact(&mut site, n, &f);
            assert!(drive.dot(body.outward(element)).abs() < 1e-12 * (1.0 + drive.length()));
            for _ in 0..3 {
                let v = DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5).normalize();
                let (h, rates) = (1e-7, site.rates(v).each());
                let mut energy = |s: f64| site.evaluate([0, 1, 2].map(|i| n[i] + s * rates[i]), tip).energy;
                let slope = (energy(-h) - energy(h)) / (2.0 * h);
                let error = (slope - drive.dot(v)).abs();
                assert!(error < 1e-6 * (0.01 + drive.length()), "case {case}: {slope} {}", drive.dot(v));
            }
        }
    }

    #[test]
    fn the_consistent_drive_is_continuous_over_edges() {
        continuity::<Isotropic>(&bodies(1.0));
        continuity::<Stretch>(&bodies(3.0));
        continuity::<Coupled>(&coupled_bodies());
    }

    fn continuity<L: Lateral>(bodies: &[Body]) {
        for body in bodies {
            body.prepared_gradients();
            let law = Law { ablation: Ablation::None, radius_m: 0.0 };
            let mut jumps = 0.0f64;
            for element in 0..body.elements().len() as u32 {
                for edge in 0..3 {
                    let (beyond, other) = body.across(element, edge).unwrap();
                    let mut n = [0.0; 3];
                    (n[edge], n[(edge + 1) % 3]) = (0.3, 0.7);
                    let mut m = [0.0; 3];
                    (m[other], m[(other + 1) % 3]) = (0.7, 0.3);
                    let c = body.point(SurfacePoint { element, n });
                    let tip = c - body.outward(element) * 3e-3 + DVec3::new(1e-3, -5e-4, 7e-4);
                    let read = |element, n| {
                        let mut site = Site::<L>::new(body, law, element);
                        let f = site.evaluate(n, tip);
                        (consistent(&mut site, n, &f), exact(&mut site, n, &f))
                    };
                    let ((here, g), (there, h)) = (read(element, n), read(beyond, m));
                    assert!((here - there).length() < 1e-7, "{here} {there}");
                    jumps = jumps.max((g - h).length());
                }
            }
            assert!(jumps > 1e-2, "the exact drive jumps");
        }
    }

    /// Where nothing varies and the surface is flat, all rules are the paper's.
    #[test]
    fn on_a_uniform_plane_the_drives_agree() {
        let positions = [(0.0, 0.0), (0.02, 0.001), (0.018, 0.02), (-0.003, 0.017), (0.008, 0.009)];
        let mesh = palpate_body::TriangleMesh {
            positions: positions.iter().map(|&(x, y)| DVec3::new(x, y, 0.0)).collect(),
            triangles: vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]],
        };
        let mut parts = ball(1.0).parts();
        parts.surface = palpate_body::Surface::build(&mesh, f64::INFINITY).unwrap();
        parts.mixes = vec![NodeMix { test_points: [3, 4, 5], weights: [0.5, 0.25, 0.25] }; 5];
        parts.responses.truncate(6);
        parts.test_point_nodes = vec![0; 6];
        let body = Body::new(parts).unwrap();
        body.prepared_gradients();
        let law = Law { ablation: Ablation::None, radius_m: 0.0 };
        let mut site = Site::<Isotropic>::new(&body, law, 1);
        let n = [0.3, 0.3, 0.4];
        let f = site.evaluate(n, DVec3::new(0.014, 0.009, -3e-3));
        assert!(f.pull > 0.1);
        assert!((exact(&mut site, n, &f) - f.u_t * f.pull).length() < 1e-13);
        assert_eq!(consistent(&mut site, n, &f), f.u_t * f.pull);
    }
}
