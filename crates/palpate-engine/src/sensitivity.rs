//! How fast the force can change: the Lipschitz bound of MODEL 5 at one state, for measuring clicks against.

use crate::coupled::Coupled;
use crate::decoupled::{Anisotropic, Isotropic};
use crate::drive::{Consistent, Exact, Paper, Rule};
use crate::force_law::ForceLaw;
use crate::kernel::{ElementKernel, Setting};
use crate::walk::Rates;
use glam::DVec3;
use palpate_body::{ContactModel, SlipRule, SurfacePoint};

/// L = K + |∂_s f| |∂_x φ| / η, N/m, with K the greatest stiffness in stick, max(f_z', f_r', f_r/δr) on an isotropic
/// body; `None` where η ≤ 0.
///
/// The slip term is there in stick too: the next step may slip. For `exact` it is the bound within an element: from one to
/// the next that rule's force may jump.
pub(crate) fn lipschitz(
    body: &ContactModel,
    setting: Setting,
    rule: SlipRule,
    at: SurfacePoint,
    tool_position: DVec3,
) -> Option<f64> {
    if body.is_coupled() {
        let kernel = ElementKernel::<Coupled>::new(body, setting, at.element);
        return match rule {
            SlipRule::Consistent => measured::<_, Consistent>(kernel, at, tool_position),
            SlipRule::Exact => measured::<_, Exact>(kernel, at, tool_position),
            _ => measured::<_, Paper>(kernel, at, tool_position),
        };
    }
    match (rule, body.is_isotropic()) {
        (SlipRule::Consistent, true) => measured::<_, Consistent>(
            ElementKernel::<Isotropic>::new(body, setting, at.element),
            at,
            tool_position,
        ),
        (SlipRule::Consistent, false) => measured::<_, Consistent>(
            ElementKernel::<Anisotropic>::new(body, setting, at.element),
            at,
            tool_position,
        ),
        (SlipRule::Exact, true) => measured::<_, Exact>(
            ElementKernel::<Isotropic>::new(body, setting, at.element),
            at,
            tool_position,
        ),
        (SlipRule::Exact, false) => measured::<_, Exact>(
            ElementKernel::<Anisotropic>::new(body, setting, at.element),
            at,
            tool_position,
        ),
        (_, true) => bound(ElementKernel::<Isotropic>::new(body, setting, at.element), at, tool_position),
        (_, false) => bound(ElementKernel::<Anisotropic>::new(body, setting, at.element), at, tool_position),
    }
}

/// For the paper's rule, in closed form where the lateral force has a direction.
fn bound<L: ForceLaw>(mut kernel: ElementKernel<L>, at: SurfacePoint, tool_position: DVec3) -> Option<f64> {
    let f = kernel.evaluate(at.n, tool_position);
    if f.lateral_force <= NO_DRIVE * f.lateral_slope {
        return measured::<L, Paper>(kernel, at, tool_position);
    }
    let drift = kernel.drift(at.n, &f, f.u_t);
    let stick = drift.normal_slope.max(drift.lateral_stiffness);
    // φ = |f_t| − μ f_z; its gradient in x has a part in the tangent plane and one along û.
    let gradient = drift.lateral_force_gradient.hypot(drift.limit_slope);
    (drift.eta > 0.0).then(|| stick + drift.force.length() * gradient / drift.eta)
}

/// Steps of the differences, m: below what curves and frames are smooth over, far above rounding.
const STEP: f64 = 1e-7;
/// A drive that would move c by no more than this (m) has no direction: rounding, and the search's tolerance.
const NO_DRIVE: f64 = 1e-9;

/// For any rule, by differences of its drive d: f, d and L while c or x moves.
fn measured<L: ForceLaw, R: Rule>(
    mut kernel: ElementKernel<L>,
    at: SurfacePoint,
    tool_position: DVec3,
) -> Option<f64> {
    let body = kernel.body;
    let f = kernel.evaluate(at.n, tool_position);
    let drift = kernel.drift(at.n, &f, f.u_t);
    let stick = drift.normal_slope.max(drift.lateral_stiffness);
    let f = kernel.evaluate(at.n, tool_position);
    let drive = R::drive(&mut kernel, at.n, &f);
    // By the contact point's way it is W's slope, and its own slope symmetric where W is all.
    let free = drive.force <= NO_DRIVE * f.lateral_slope;
    let mut slope = |rates: [f64; 3], dx: DVec3| {
        let [up, down] = [STEP, -STEP].map(|s| {
            let n = [at.n[0] + s * rates[0], at.n[1] + s * rates[1], at.n[2] + s * rates[2]];
            let f = kernel.evaluate(n, tool_position + dx * s);
            let drive = R::drive(&mut kernel, n, &f);
            let by_contact_point = R::motion(&kernel, n, &f).filter(|_| free);
            let d = drive.along * drive.force;
            (f.force(), by_contact_point.map_or(d, |motion| motion.moved(d)), f.limit)
        });
        let per = 0.5 / STEP;
        ((up.0 - down.0) * per, (up.1 - down.1) * per, (up.2 - down.2) * per)
    };
    let corners = body.corners(at.element);
    let over = |v: DVec3| Rates::new(corners, v).each();
    let in_tool_position = DVec3::AXES.map(|axis| slope([0.0; 3], axis));

    if !free {
        // φ = d·v − L, v the drive's direction, while c goes its way.
        let v = drive.along;
        let (force, d, limit) = slope(over(drive.way), DVec3::ZERO);
        let eta = limit - d.dot(v);
        let gradient = DVec3::from_array(in_tool_position.map(|(_, d, limit)| d.dot(v) - limit)).length();
        return (eta > 0.0).then(|| stick + force.length() * gradient / eta);
    }
    // Without friction c goes to where the drive is zero, in both directions of the plane: −∂d/∂c dc = ∂d/∂x dx.
    let s = (corners[1] - corners[0]).normalize_or_zero();
    let t = body.outward(at.element).cross(s);
    let [(force_s, d_s, _), (force_t, d_t, _)] = [s, t].map(|v| slope(over(v), DVec3::ZERO));
    let [a, b, c, d] = [-d_s.dot(s), -d_t.dot(s), -d_s.dot(t), -d_t.dot(t)];
    let (determinant, skew) = (a * d - b * c, 0.5 * (b + c));
    if !(a + d > 0.0 && a * d > skew * skew) {
        return None;
    }
    let follow = |(held, dx, _): (DVec3, DVec3, f64)| {
        let (x, y) = (dx.dot(s), dx.dot(t));
        held + (force_s * (d * x - b * y) + force_t * (a * y - c * x)) / determinant
    };
    let square: f64 = in_tool_position.map(|x| follow(x).length_squared()).iter().sum();
    // Where friction holds at all, the next step may also stick.
    let held = if f.limit > NO_DRIVE * f.lateral_slope { stick } else { 0.0 };
    Some(held.max(square.sqrt()))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::kernel::{Ablation, Evaluation};
    use palpate_body::shape::{Resolution, Shape};
    use palpate_body::{BlendWeights, Body, BodyParts, Provenance, Response, Tool, tensor};

    /// A ball with responses, and tensors up to `ratio`, that differ from node to node; softening laterally.
    pub(crate) fn ball(ratio: f64) -> Body {
        let shape = Shape::Sphere { radius_mm: 30.0 };
        let edge = Resolution { edge_length_mm: Some(8.0), ..Default::default() };
        let surface = shape.surface(edge).unwrap();
        let response = |(n, p): (usize, &DVec3)| {
            let k = 600.0 * (1.0 + 0.4 * libm::sin(n as f64) + 5.0 * p.x);
            let lateral = palpate_body::Curve::hermite(
                &[0.0, 4e-3],
                &[0.0, 2e-3 * k],
                &[k, 0.3 * k],
                palpate_body::Extension::Linear,
            );
            let paper = Response::paper(k, k, 0.2 + p.y, 8e-3, 4e-3).unwrap();
            Response { lateral: lateral.unwrap(), ..paper }
        };
        let tensor = |(n, u): (usize, &DVec3)| {
            let axis = DVec3::new(libm::sin(n as f64), libm::cos(2.0 * n as f64), 0.3);
            tensor::along(axis, 1.0 + (ratio - 1.0) * libm::sin(3.0 * n as f64).abs(), *u).unwrap()
        };
        let count = surface.positions().len() as u32;
        Body::new(BodyParts {
            blends: (0..count).map(BlendWeights::own).collect(),
            responses: surface.positions().iter().enumerate().map(response).collect(),
            test_point_nodes: (0..count).collect(),
            coupled: None,
            lateral_tensors: Some(surface.inward_normals().iter().enumerate().map(tensor).collect()),
            surface,
            tool: Tool::Sphere { radius_m: 2e-3 },
            slip: SlipRule::Paper,
            tank: true,
            partial_slip: false,
            provenance: Provenance::default(),
        })
        .unwrap()
    }

    /// The ball with a coupled law: potentials that differ from node to node, found up to 2 mm laterally.
    pub(crate) fn coupled_ball() -> Body {
        let mut parts = ball(1.0).parts();
        let at = parts.surface.positions().iter().zip(parts.surface.inward_normals()).enumerate();
        let potential = |(n, (p, u)): (usize, (&DVec3, &DVec3))| {
            let knots = [0.0, 1e-3, 3e-3, 8e-3];
            let curve = |values: [f64; 4], slopes: [f64; 4], extension| {
                palpate_body::Curve::hermite(&knots, &values, &slopes, extension).unwrap()
            };
            let wave = |k: f64| 1.0 + 0.4 * libm::sin(k * n as f64) + 5.0 * p.x;
            // From 0 or from a share of itself to its full size, slopes 0 at both ends.
            let ramp = |start: f64, size: f64, k: f64| {
                let size = size * wave(k);
                let [a, b] = [start + 0.3 * (1.0 - start), start + 0.8 * (1.0 - start)];
                let slopes = [0.0, 200.0, 100.0, 0.0].map(|s| s * (1.0 - start) * size);
                let flat = palpate_body::Extension::Constant;
                curve([start, a, b, 1.0].map(|s| s * size), slopes, flat)
            };
            let k = 6e4 * wave(1.0);
            let press = |d: f64| k * d * d * d / 3.0;
            let t1 = u.any_orthonormal_vector();
            palpate_body::Potential {
                tangents: [t1, u.cross(t1)],
                press: curve(knots.map(press), knots.map(|d| k * d * d), palpate_body::Extension::Quadratic),
                offset: [ramp(0.0, 0.2, 2.0), ramp(0.0, -0.1, 3.0)],
                stiffness: [ramp(0.4, 500.0, 4.0), ramp(0.2, 100.0, 5.0), ramp(0.4, 700.0, 6.0)],
                cubic: [1.0, -0.5, 0.7, 0.3].map(|c| ramp(0.3, 1e4 * c, 7.0 + c)),
                quartic: ramp(0.5, 1e7, 8.0),
                friction: curve([0.2 + p.y; 4], [0.0; 4], palpate_body::Extension::Constant),
                curvature: [20.0, 8.0, -30.0],
            }
        };
        parts.coupled =
            Some(palpate_body::CoupledLaw { range_m: 2e-3, potentials: at.map(potential).collect() });
        (parts.responses, parts.lateral_tensors) = (Vec::new(), None);
        Body::new(parts).unwrap()
    }

    #[test]
    fn differences_give_the_closed_form() {
        for (body, isotropic) in [(ball(1.0), true), (ball(4.0), false)] {
            let setting = Setting::new(Ablation::None, 2e-3);
            for element in 0..body.elements().len() as u32 {
                let at = SurfacePoint { element, n: [0.3, 0.5, 0.2] };
                let tool_position =
                    body.point(at) - body.outward(element) * 5e-4 + DVec3::new(3e-4, -4e-4, 5e-4);
                let [a, b] = if isotropic {
                    let kernel = ElementKernel::<Isotropic>::new(&body, setting, element);
                    [
                        bound(kernel, at, tool_position),
                        measured::<_, crate::drive::Paper>(kernel, at, tool_position),
                    ]
                } else {
                    let kernel = ElementKernel::<Anisotropic>::new(&body, setting, element);
                    [
                        bound(kernel, at, tool_position),
                        measured::<_, crate::drive::Paper>(kernel, at, tool_position),
                    ]
                };
                let (a, b) = (a.unwrap(), b.unwrap());
                assert!((a - b).abs() < 1e-4 * a, "{a} {b}");
            }
        }
    }

    /// Numbers in [0, 1).
    pub(crate) fn random(mut seed: u64) -> impl FnMut() -> f64 {
        move || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        }
    }

    /// |x − y| within 10⁻⁵ of the larger, or of 1 N/m.
    fn alike(x: DVec3, y: DVec3) -> bool {
        (x - y).length() < 1e-5 * (1.0 + x.length().max(y.length()))
    }

    #[test]
    fn derivatives_are_those_of_finite_differences() {
        compare::<Isotropic>(&[1.0].map(ball));
        compare::<Anisotropic>(&[3.0, 60.0].map(ball));
        compare::<Coupled>(&[coupled_ball()]);
    }

    fn compare<L: ForceLaw>(bodies: &[Body]) {
        let mut unit = random(7);
        for case in 0..1000 {
            let body = &bodies[case % bodies.len()];
            let ablation = [Ablation::None, Ablation::Coordinates, Ablation::Responses, Ablation::Both];
            let setting = Setting::new(ablation[case / 3 % 4], 2e-3);
            let element = (unit() * body.elements().len() as f64) as u32;
            let (a, b) = (0.2 + 0.3 * unit(), 0.2 + 0.3 * unit());
            let n = [a, b, 1.0 - a - b];
            let mut kernel = ElementKernel::<L>::new(body, setting, element);
            let u = kernel.evaluate(n, DVec3::ZERO).u();
            let c = body.point(SurfacePoint { element, n });
            let aside = DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5) * 3e-3;
            let tool_position = c + u * (1e-3 * unit() - 1e-3) + (aside - u * aside.dot(u));
            let f = kernel.evaluate(n, tool_position);
            if f.lateral < 3e-4 {
                continue;
            }

            // f = ∂W/∂x, and its own derivative in x.
            let h = 5e-8;
            let mut at = |tool_position: DVec3| kernel.evaluate(n, tool_position);
            let mut gradient = DVec3::ZERO;
            let mut lateral_force_gradient = DVec3::ZERO;
            let mut stiffness = [DVec3::ZERO; 3];
            for (i, e) in DVec3::AXES.into_iter().enumerate() {
                let (up, down) = (at(tool_position + e * h), at(tool_position - e * h));
                gradient += e * ((up.energy - down.energy) / (2.0 * h));
                lateral_force_gradient += e * ((up.lateral_force - down.lateral_force) / (2.0 * h));
                stiffness[i] = (up.force() - down.force()) / (2.0 * h);
            }
            assert!((gradient - f.force()).length() < 1e-6 * (1.0 + f.force().length()));

            let v = if case % 2 == 0 { f.u_t } else { (f.u_t + u.cross(f.u_t) * 0.7).normalize() };
            let f = kernel.evaluate(n, tool_position);
            let drift = kernel.drift(n, &f, v);
            assert!(
                L::COUPLED
                    || (lateral_force_gradient.length() - drift.lateral_force_gradient).abs()
                        < 1e-5 * (1.0 + drift.lateral_force_gradient)
            );
            let bound = drift.lateral_stiffness.max(drift.normal_slope);
            for _ in 0..4 {
                let e = DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5).normalize();
                let change = stiffness[0] * e.x + stiffness[1] * e.y + stiffness[2] * e.z;
                assert!(change.length() <= bound * (1.0 + 1e-6));
            }
            // Which is what moving along it meets, but for the direction's turning.
            let change = stiffness[0] * f.u_t.x + stiffness[1] * f.u_t.y + stiffness[2] * f.u_t.z;
            assert!(L::COUPLED || change.dot(f.u_t) > 0.999 * f.lateral_slope);

            // Along the surface.
            let rates = kernel.rates(v).each();
            let mut moved = |s: f64| kernel.evaluate([0, 1, 2].map(|i| n[i] + s * rates[i]), tool_position);
            let (up, down) = (moved(h), moved(-h));
            let force = (up.force() - down.force()) / (2.0 * h);
            assert!(alike(force, drift.force), "case {case}: {force} {}", drift.force);
            let left = |f: &Evaluation| f.limit - f.lateral_force * f.u_t.dot(v);
            let eta = (left(&up) - left(&down)) / (2.0 * h);
            // An isotropic search asks along u_t, or for a first guess only.
            if !L::ISOTROPIC || case % 2 == 0 {
                assert!((eta - drift.eta).abs() < 1e-5 * (1.0 + drift.force.length()), "{eta} {}", drift.eta);
            }
        }
    }
}
