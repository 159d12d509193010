//! How fast the force can change: the Lipschitz bound of MODEL 5 at one state, for measuring clicks against.

use crate::field::{Law, Site};
use glam::DVec3;
use palpate_body::{Body, SurfacePoint};

/// L = K + |∂_s f| |∂_x φ| / η, N/m, with K = max(f_z', f_r', f_r/δr) the bound in stick; `None` where η ≤ 0.
///
/// The slip term is there in stick too: the next step may slip.
pub(crate) fn lipschitz(body: &Body, law: Law, at: SurfacePoint, tip: DVec3) -> Option<f64> {
    let mut site = Site::new(body, law, at.element);
    let f = site.evaluate(at.n, tip);
    let drift = site.drift(at.n, &f, f.u_r);
    // Below a picometre the lateral deflection is rounding, and its direction noise.
    if f.lateral < 1e-12 {
        return Some(drift.normal_slope.max(f.pull_slope));
    }
    let stick = drift.normal_slope.max(f.pull_slope).max(f.pull / f.lateral);
    // φ = f_r − μ f_z; its gradient in x lies along u_r and û.
    let gradient = f.pull_slope.hypot(drift.limit_slope);
    (drift.eta > 0.0).then(|| stick + drift.force.length() * gradient / drift.eta)
}
