//! How fast the force can change: the Lipschitz bound of MODEL 5 at one state, for measuring clicks against.

use crate::field::{Field, Law};
use crate::walk::rates;
use glam::DVec3;
use palpate_body::{Body, SurfacePoint};

/// L = K in stick, K + |∂_s f| |∂_x φ| / η in slip, N/m; the slip term is included wherever the lateral force is
/// near its limit, since the next step may slip.
pub(crate) fn lipschitz(body: &Body, law: &Law, at: SurfacePoint, tip: DVec3) -> Option<f64> {
    let f = law.evaluate(body, at, tip);
    let secant = if f.lateral > 0.0 { f.pull.value / f.lateral } else { f.pull.slope };
    let stick = f.normal.slope.max(f.pull.slope).max(secant);
    if f.lateral == 0.0 {
        return Some(stick);
    }
    let (force_rate, eta) = along_slip(body, law, at, &f);
    let limit_rate = f.pull.slope.hypot(f.limit_slope());
    (eta > 0.0).then(|| stick + force_rate.length() * limit_rate / eta)
}

/// ∂_s f and η = −dφ/ds along the slip direction, for unit drive u_r; MODEL 5, certificate S.
fn along_slip(body: &Body, law: &Law, at: SurfacePoint, f: &Field) -> (DVec3, f64) {
    let nodes = body.element_nodes(at.element);
    let corners = nodes.map(|n| n.position);
    let r = rates(corners, f.u_r);
    let t = (corners[1] - corners[0]) * r[1] + (corners[2] - corners[0]) * r[2];
    let turn = law.frame(nodes, r);
    let du = if law.is_continuous() { (turn - f.u * f.u.dot(turn)) / f.u_length } else { DVec3::ZERO };
    let height = f.depth - law.radius_m;

    // δ = p − c changes by −t; its parts follow.
    let d_depth = f.lateral * f.u_r.dot(du) - t.dot(f.u);
    let d_tangential = -t - f.u * d_depth - du * height;
    let d_lateral = f.u_r.dot(d_tangential);
    let du_r = if f.lateral > 0.0 { (d_tangential - f.u_r * d_lateral) / f.lateral } else { DVec3::ZERO };

    // The mix is linear in the area coordinates: their rates mix the responses' own gradient along t.
    let gradient = Body::mixture(nodes, if law.is_continuous() { r } else { [0.0; 3] });
    let (normal_gradient, friction_gradient) = body.responses().normal_and_friction(&gradient, f.depth);
    let pull_gradient = body.responses().lateral(&gradient, f.lateral);

    let d_normal = f.normal.slope * d_depth + normal_gradient.value;
    let d_pull = f.pull.slope * d_lateral + pull_gradient.value;
    let d_limit = f.limit_slope() * d_depth
        + friction_gradient.value * f.normal.value
        + f.friction.value * normal_gradient.value;
    let force_rate = f.u * d_normal + du * f.normal.value + f.u_r * d_pull + du_r * f.pull.value;
    (force_rate, d_limit - d_pull)
}
