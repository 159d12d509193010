//! The drives: what moves the contact point at a fixed tool position (MODEL 4). A slip rule is its drive and nothing else.
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
//!
//! Friction works along the tool's way M t, D is by the contact point's ([`palpate_body::law::tool_motion`]): it holds g as long as
//! g·t ≤ L |M t| for every t, so that the drives of the first two are M⁻¹ g; and what they drive goes along M⁻² g.

use crate::force_law::{ForceLaw, ToolMotion};
use crate::kernel::{ElementKernel, Evaluation};
use crate::walk::Pull;
use glam::{DVec3, Vec3A};
use palpate_body::ContactModel;

/// A drive, to be brought within the friction limit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drive {
    /// Its direction, a unit vector, or zero: that of the tool's way.
    pub along: DVec3,
    /// The contact point's way, likewise.
    pub way: DVec3,
    /// Its size, N.
    pub force: f64,
    /// Bound on the distance that the contact point may have to move, m.
    pub step_bound: f64,
    /// The part of its size that may be rounding, N.
    pub noise: f64,
}

impl Drive {
    #[inline(always)]
    fn of(vector: DVec3, noise: f64, f: &Evaluation) -> Self {
        let force = vector.length();
        let along = if force > 0.0 { vector * (1.0 / force) } else { DVec3::ZERO };
        // The lateral deflection may have to grow to what balances the rest.
        let step_bound = f.lateral + if f.lateral_slope > 0.0 { force / f.lateral_slope } else { 0.0 };
        Drive { along, way: along, force, step_bound, noise }
    }

    /// Of a drive by the contact point's way.
    #[inline(always)]
    fn by_contact_point(vector: DVec3, noise: f64, f: &Evaluation, motion: Option<ToolMotion>) -> Self {
        let Some(motion) = motion else { return Drive::of(vector, noise, f) };
        let (inverse, least) = (motion.inverse(), motion.bounds[0]);
        let drive = Drive::of(inverse.moved(vector), noise / least, f).moving_by(&inverse);
        Drive { step_bound: drive.step_bound / least, ..drive }
    }

    /// The same drive, with the contact point's way by M⁻¹.
    #[inline(always)]
    fn moving_by(self, inverse: &ToolMotion) -> Self {
        Drive { way: inverse.direction(self.along), ..self }
    }

    /// What it pulls, where the tool moves so with the contact point.
    #[inline(always)]
    pub fn pull(&self, motion: Option<ToolMotion>) -> Pull {
        Pull { way: self.way, drive: self.along, motion }
    }
}

/// A slip rule.
pub(crate) trait Rule {
    /// Whether the drive agrees on the two sides of every edge that is no crease, where the law does.
    const CONTINUOUS: bool;
    /// Whether slip must not raise the energy: a displacement that does is too long.
    const PASSIVE: bool = false;
    /// Whether it drives along f_t.
    const LATERAL: bool = false;

    /// Whether `body` has what the rule reads.
    #[inline(always)]
    fn is_ready(_body: &ContactModel) -> bool {
        true
    }

    /// Decides whether the contact point slips from where it was, and the first direction to try: a cheaper drive where
    /// it is sure to be within the limit or beyond it. `last_reaction` is f_t less the drive in the last slip.
    #[inline(always)]
    fn first<L: ForceLaw>(
        kernel: &mut ElementKernel<L>,
        n: [f64; 3],
        f: &Evaluation,
        _last_reaction: DVec3,
    ) -> Drive {
        Self::drive(kernel, n, f)
    }

    /// The drive at area coordinates `n`, where `f` was just evaluated.
    fn drive<L: ForceLaw>(kernel: &mut ElementKernel<L>, n: [f64; 3], f: &Evaluation) -> Drive;

    /// How the tool moves with the contact point there, in the plane of the drive; the seed's rule does not ask.
    #[inline(always)]
    fn motion<L: ForceLaw>(_: &ElementKernel<L>, _: [f64; 3], _: &Evaluation) -> Option<ToolMotion> {
        None
    }
}

/// f_t: the seed paper's section 3.2.
pub(crate) struct Paper;

impl Rule for Paper {
    const CONTINUOUS: bool = true;
    const LATERAL: bool = true;

    #[inline(always)]
    fn drive<L: ForceLaw>(_: &mut ElementKernel<L>, _: [f64; 3], f: &Evaluation) -> Drive {
        // A coupled potential acts laterally without any lateral deflection.
        let further =
            if L::COUPLED && f.lateral_slope > 0.0 { f.lateral_force / f.lateral_slope } else { 0.0 };
        let step_bound = f.lateral + further;
        Drive { along: f.u_t, way: f.u_t, force: f.lateral_force, step_bound, noise: 0.0 }
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
    fn first<L: ForceLaw>(
        kernel: &mut ElementKernel<L>,
        n: [f64; 3],
        f: &Evaluation,
        last_reaction: DVec3,
    ) -> Drive {
        let most = greatest(kernel, n, f);
        let motion = Self::motion(kernel, n, f);
        let [least, farthest] = motion.map_or([1.0; 2], |motion| motion.bounds);
        if f.lateral_force + most <= f.limit * least {
            return Paper::drive(kernel, n, f);
        }
        let guess = Drive::of(f.u_t * f.lateral_force - last_reaction, 0.0, f);
        let inside = n[0] != 0.0 && n[1] != 0.0 && n[2] != 0.0;
        // Beyond the limit by more than the search's tolerance.
        if inside && f.lateral_force - most > 1.001 * f.limit * farthest && guess.force > 1.001 * f.limit {
            return motion.map_or(guess, |motion| guess.moving_by(&motion.inverse()));
        }
        Self::drive(kernel, n, f)
    }

    #[inline(always)]
    fn drive<L: ForceLaw>(kernel: &mut ElementKernel<L>, n: [f64; 3], f: &Evaluation) -> Drive {
        let reaction = reaction(kernel, n, f);
        let noise = NOISE * (reaction.x.abs() + reaction.y.abs() + reaction.z.abs());
        let motion = Self::motion(kernel, n, f);
        Drive::by_contact_point(f.u_t * f.lateral_force - reaction, noise, f, motion)
    }

    #[inline(always)]
    fn motion<L: ForceLaw>(kernel: &ElementKernel<L>, n: [f64; 3], f: &Evaluation) -> Option<ToolMotion> {
        if L::COUPLED { kernel.tool_motion(n, f, f.u()) } else { None }
    }
}

/// g (E2).
pub(crate) struct Exact;

impl Rule for Exact {
    const CONTINUOUS: bool = false;
    const PASSIVE: bool = true;

    #[inline(always)]
    fn drive<L: ForceLaw>(kernel: &mut ElementKernel<L>, n: [f64; 3], f: &Evaluation) -> Drive {
        let motion = Self::motion(kernel, n, f);
        Drive::by_contact_point(exact(kernel, n, f), 0.0, f, motion)
    }

    #[inline(always)]
    fn motion<L: ForceLaw>(kernel: &ElementKernel<L>, n: [f64; 3], f: &Evaluation) -> Option<ToolMotion> {
        if L::COUPLED { kernel.tool_motion(n, f, kernel.body.outward(kernel.element)) } else { None }
    }
}

/// Bound on |f_t − g̃|, N.
#[inline(always)]
fn greatest<L: ForceLaw>(kernel: &mut ElementKernel<L>, n: [f64; 3], f: &Evaluation) -> f64 {
    let Some(gradients) = kernel.body.gradients() else { return 0.0 };
    let numbers = kernel.body.element_node_numbers(kernel.element);
    let [a, b, c] = numbers.map(|node| gradients.bound(node));
    let blended = |x: f32, y: f32, z: f32| n[0] * f64::from(x) + n[1] * f64::from(y) + n[2] * f64::from(z);
    let mut sum = 0.0;
    if kernel.setting.interpolates_responses() {
        sum += kernel.stretch.greatest_gradient(&kernel.coefficients, gradients, numbers, f);
        if let Some((deflection, half)) = kernel.stretch.tensor_gradient(f) {
            sum += blended(a.tensor, b.tensor, c.tensor) * half * deflection.length_squared();
        }
        // What turning it from the nodes' planes into c's may add.
        sum *= 1.1;
    }
    if kernel.setting.interpolates_frames() {
        sum += blended(a.frame_gradient, b.frame_gradient, c.frame_gradient) * kernel.couple_length(n, f)
            / f.frame_length;
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
#[inline(never)]
fn reaction<L: ForceLaw>(kernel: &ElementKernel<L>, n: [f64; 3], f: &Evaluation) -> DVec3 {
    let Some(gradients) = kernel.body.gradients() else { return DVec3::ZERO };
    let (setting, u) = (kernel.setting, f.u());
    let lever = if setting.interpolates_frames() {
        (kernel.couple(n, f) * (1.0 / f.frame_length)).as_vec3a()
    } else {
        Vec3A::ZERO
    };
    let energies = kernel.stretch.energies(&kernel.coefficients, kernel.body, kernel.nodes, f);
    let (tensors, single) = (kernel.stretch.tensor_gradient(f), u.as_vec3a());
    let numbers = kernel.body.element_node_numbers(kernel.element);
    let mut sum = Vec3A::ZERO;
    for ((number, node), n) in numbers.into_iter().zip(kernel.nodes).zip(n) {
        let mut gradient = Vec3A::ZERO;
        if setting.interpolates_responses() {
            gradient = gradients.energy(number, node.test_points[0], &energies);
            if let Some((deflection, half)) = tensors {
                gradient += gradients.tensor(number, deflection) * half as f32;
            }
            // Turned from the node's plane into c's without losing length, up to the fourth order.
            gradient -= node.inward.as_vec3a() * (0.5 * single.dot(gradient));
        }
        sum += (gradient + gradients.frame_gradient(number, lever)) * n as f32;
    }
    let sum = sum.as_dvec3();
    sum - u * u.dot(sum)
}

/// g = P f_c − Σ_l [W_l + b·u_l/|Σnu| + ½ g δ_t·A_l δ_t] ∇n_l (E2), P on the element's plane, N.
pub(crate) fn exact<L: ForceLaw>(kernel: &mut ElementKernel<L>, n: [f64; 3], f: &Evaluation) -> DVec3 {
    let mut share = [0.0; 3];
    if kernel.setting.interpolates_responses() {
        share = kernel.stretch.node_energies(&kernel.coefficients, kernel.body, kernel.nodes, f);
    }
    if kernel.setting.interpolates_frames() {
        let b = kernel.couple(n, f) * (1.0 / f.frame_length);
        let frame_terms = kernel.nodes.map(|node| node.inward.dot(b));
        share = [0, 1, 2].map(|l: usize| pick(share, l) + pick(frame_terms, l));
    }
    // Σ ∇n_l = 0, so two differences are left. e1, e2 are the edges to corners 1 and 2.
    let [p, q, r] = kernel.corners();
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
    use crate::decoupled::{Anisotropic, Isotropic};
    use crate::kernel::{Ablation, Setting};
    use crate::sensitivity::tests::{ball, coupled_ball, random};
    use palpate_body::{BlendWeights, Body, SurfacePoint};

    fn bodies(ratio: f64) -> Vec<Body> {
        own_and_mixed(ball(ratio))
    }

    fn coupled_bodies() -> Vec<Body> {
        own_and_mixed(coupled_ball())
    }

    /// A body, and the same with nodes that blend three neighbours' responses.
    fn own_and_mixed(own: Body) -> Vec<Body> {
        let mut blended = own.parts();
        let count = blended.test_point_nodes.len() as u32;
        for (n, blend) in blended.blends.iter_mut().enumerate() {
            let n = n as u32;
            *blend = match n % 3 {
                0 => BlendWeights { test_points: [0, 7, 19], weights: [0.2, 0.5, 0.3] },
                1 => BlendWeights { test_points: [0, 7, 19], weights: [0.7, 0.0, 0.3] },
                _ => BlendWeights {
                    test_points: [n, (n + 5) % count, (n + 9) % count],
                    weights: [0.25, 0.25, 0.5],
                },
            };
        }
        vec![own, Body::new(blended).unwrap()]
    }

    /// g̃, N.
    fn consistent<L: ForceLaw>(kernel: &mut ElementKernel<L>, n: [f64; 3], f: &Evaluation) -> DVec3 {
        f.u_t * f.lateral_force - reaction(kernel, n, f)
    }

    #[test]
    fn the_exact_drive_is_the_slope_of_the_energy() {
        slopes::<Isotropic>(&bodies(1.0));
        slopes::<Anisotropic>(&bodies(3.0));
        slopes::<Anisotropic>(&bodies(30.0));
        slopes::<Coupled>(&coupled_bodies());
    }

    fn slopes<L: ForceLaw>(bodies: &[Body]) {
        let mut unit = random(11);
        for case in 0..1000 {
            let body = &bodies[case % bodies.len()];
            let ablation = [Ablation::None, Ablation::Coordinates, Ablation::Responses, Ablation::Both];
            let setting = Setting::new(ablation[case / 2 % 4], 2e-3);
            let element = (unit() * body.elements().len() as f64) as u32;
            let (a, b) = (0.2 + 0.3 * unit(), 0.2 + 0.3 * unit());
            let n = [a, b, 1.0 - a - b];
            let mut kernel = ElementKernel::<L>::new(body, setting, element);
            let u = kernel.evaluate(n, DVec3::ZERO).u();
            let c = body.point(SurfacePoint { element, n });
            let aside = DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5) * 3e-3;
            let tool_position = c + u * (2e-3 * unit() - 5e-4) + (aside - u * aside.dot(u));
            let f = kernel.evaluate(n, tool_position);
            let drive = exact(&mut kernel, n, &f);
            assert!(drive.dot(body.outward(element)).abs() < 1e-12 * (1.0 + drive.length()));
            for _ in 0..3 {
                let v = DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5).normalize();
                let (h, rates) = (1e-7, kernel.rates(v).each());
                let mut energy =
                    |s: f64| kernel.evaluate([0, 1, 2].map(|i| n[i] + s * rates[i]), tool_position).energy;
                let slope = (energy(-h) - energy(h)) / (2.0 * h);
                let error = (slope - drive.dot(v)).abs();
                assert!(error < 1e-6 * (0.01 + drive.length()), "case {case}: {slope} {}", drive.dot(v));
            }
        }
    }

    #[test]
    fn the_consistent_drive_is_continuous_over_edges() {
        continuity::<Isotropic>(&bodies(1.0));
        continuity::<Anisotropic>(&bodies(3.0));
        continuity::<Coupled>(&coupled_bodies());
    }

    fn continuity<L: ForceLaw>(bodies: &[Body]) {
        for body in bodies {
            body.prepared_gradients();
            let setting = Setting::new(Ablation::None, 0.0);
            let mut jumps = 0.0f64;
            for element in 0..body.elements().len() as u32 {
                for edge in 0..3 {
                    let (beyond, other) = body.across(element, edge).unwrap();
                    let mut n = [0.0; 3];
                    (n[edge], n[(edge + 1) % 3]) = (0.3, 0.7);
                    let mut m = [0.0; 3];
                    (m[other], m[(other + 1) % 3]) = (0.7, 0.3);
                    let c = body.point(SurfacePoint { element, n });
                    let tool_position = c - body.outward(element) * 3e-3 + DVec3::new(1e-3, -5e-4, 7e-4);
                    let read = |element, n| {
                        let mut kernel = ElementKernel::<L>::new(body, setting, element);
                        let f = kernel.evaluate(n, tool_position);
                        (consistent(&mut kernel, n, &f), exact(&mut kernel, n, &f))
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
        parts.blends = vec![BlendWeights { test_points: [3, 4, 5], weights: [0.5, 0.25, 0.25] }; 5];
        parts.responses.truncate(6);
        parts.test_point_nodes = vec![0; 6];
        let body = Body::new(parts).unwrap();
        body.prepared_gradients();
        let setting = Setting::new(Ablation::None, 0.0);
        let mut kernel = ElementKernel::<Isotropic>::new(&body, setting, 1);
        let n = [0.3, 0.3, 0.4];
        let f = kernel.evaluate(n, DVec3::new(0.014, 0.009, -3e-3));
        assert!(f.lateral_force > 0.1);
        assert!((exact(&mut kernel, n, &f) - f.u_t * f.lateral_force).length() < 1e-13);
        assert_eq!(consistent(&mut kernel, n, &f), f.u_t * f.lateral_force);
    }
}
