//! The coupled law: one potential W(δz, δ_t) a test point (LAW 2).
//!
//! W = Σ w_j W_j(δz, ξ_j), ξ_j the one deflection δ_t in the tangents of test point j; the weights are the nodes' blends,
//! blended once more by the area coordinates. So f_z = Σ w_j ∂W_j/∂δz and p = Σ w_j ∂W_j/∂δ_t, in the body's frame, need no
//! transport from one test point to another.

use crate::drive::Drive;
use crate::force_law::{Blend, ForceLaw, NO_DIRECTION, ToolMotion};
use crate::kernel::{Change, Deflection, Drift, Evaluation, Reading};
use glam::{DMat3, DVec3};
use palpate_body::law::{QUANTITIES, Reach, at_depth, coupled, tool_motion};
use palpate_body::{
    ContactModel, CoupledEnergies, Dual, EnergyCache, Gradients, Interval, Node, PointEnergies, PotentialAt,
};

/// No eigenvalue of a [`ToolMotion`] is less ([`palpate_body::law::curvature_bounds`]).
const LEAST_MOTION: f64 = 0.5;

/// The potentials that an element blends, in the current interval of δz; those of its [`Blend::points`] unless it blends widely.
#[derive(Clone, Copy)]
pub(crate) struct PointsOfElement<'a> {
    blend: Blend,
    interval: Interval,
    potentials: [PotentialAt<'a>; 3],
}

impl<'a> PointsOfElement<'a> {
    /// Looks the potentials up where the depth has left its interval.
    #[inline(always)]
    fn look_up(&mut self, model: &'a ContactModel, nodes: [&Node; 3], depth: f64) {
        if !self.interval.holds(depth) {
            self.interval = model.responses().depth_knots().interval(depth);
            self.potentials = self.found(model, nodes);
        }
    }

    /// The potentials in the current interval.
    #[inline(always)]
    fn found(&self, model: &'a ContactModel, nodes: [&Node; 3]) -> [PotentialAt<'a>; 3] {
        self.blend.points(nodes).map(|point| model.potentials().at(point, self.interval.index))
    }

    /// Shows every test point that is blended, with its weights where the area coordinates are each of `n`; and which of the
    /// [`Blend::points`] it is, or in a wide blend which node's.
    #[inline(always)]
    fn each<const N: usize>(
        &self,
        model: &'a ContactModel,
        nodes: [&Node; 3],
        n: [[f64; 3]; N],
        mut visit: impl FnMut(&PotentialAt<'a>, [f64; N], usize),
    ) {
        if self.blend == Blend::Wide {
            for (l, node) in nodes.into_iter().enumerate() {
                let blended = node.test_points.into_iter().zip(node.weights).filter(|(_, w)| *w != 0.0);
                for (point, w) in blended {
                    let potential = model.potentials().at(point, self.interval.index);
                    visit(&potential, n.map(|n| n.get(l).copied().unwrap_or(0.0) * w), l);
                }
            }
            return;
        }
        let ([a, b, c], weights) = (self.potentials, n.map(|n| self.blend.weights(nodes, n)));
        visit(&a, weights.map(|w| w[0]), 0);
        visit(&b, weights.map(|w| w[1]), 1);
        visit(&c, weights.map(|w| w[2]), 2);
    }
}

/// What an evaluation of the coupled law leaves.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Coupled {
    /// δ_t, m.
    deflection: DVec3,
    /// How that lies to the range.
    reach: Reach<f64>,
    /// p = ∂W/∂δ_t, N, in the body's frame.
    gradient: DVec3,
    /// Energies of the potentials that the element blends, J.
    energies: [f64; 3],
}

impl ForceLaw for Coupled {
    const ISOTROPIC: bool = false;
    const COUPLED: bool = true;
    type Element<'a> = PointsOfElement<'a>;
    type Energies<'a> = CoupledEnergies<'a>;

    #[inline(always)]
    fn element<'a>(
        model: &'a ContactModel,
        _: u32,
        nodes: [&'a Node; 3],
        [depth, _]: [u32; 2],
    ) -> Self::Element<'a> {
        let (interval, blend) = (model.responses().depth_knots().interval_at(depth), Blend::of(nodes));
        let potentials = blend.points(nodes).map(|point| model.potentials().at(point, interval.index));
        PointsOfElement { blend, interval, potentials }
    }

    #[inline(always)]
    fn intervals(points: &Self::Element<'_>) -> [u32; 2] {
        [points.interval.index as u32, 0]
    }

    #[inline]
    fn change_element<'a>(
        points: &mut Self::Element<'a>,
        model: &'a ContactModel,
        _: u32,
        [before, nodes]: [[&'a Node; 3]; 2],
    ) {
        if !points.blend.change_element(before, nodes) {
            points.potentials = points.found(model, nodes);
        }
    }

    #[inline(always)]
    fn read<'a>(
        points: &mut Self::Element<'a>,
        model: &'a ContactModel,
        nodes: [&'a Node; 3],
        n: [f64; 3],
        at: &Deflection,
    ) -> (Self, Reading) {
        points.look_up(model, nodes, at.depth);
        let t = points.interval.distance(at.depth);
        let reach = Reach::new(at.lateral * at.lateral, model.potentials().range_m());
        let (mut energy, mut normal, mut friction, mut slope, mut radial) = (0.0, 0.0, 0.0, 0.0, 0.0);
        let mut left = Coupled { deflection: at.tangential, reach, ..Coupled::default() };
        points.each(model, nodes, [n], |potential, [w], which| {
            let quantities = potential.at_depth(t);
            let law = coupled(&quantities, potential.xi(at.tangential), &reach);
            let [_, _, _, k1, _, k2, .., q, mu] = quantities.value;
            let [t1, t2] = *potential.tangents;
            energy += w * law.energy;
            normal += w * law.normal;
            friction += w * mu;
            slope += w * (0.5 * (k1 + k2) + 4.0 * q * at.lateral * at.lateral);
            radial += w * law.radial;
            left.gradient += t1 * (w * law.lateral[0]) + t2 * (w * law.lateral[1]);
            if let Some(slot) = left.energies.get_mut(which) {
                *slot = law.energy;
            }
        });
        left.gradient += at.tangential * radial;
        let f_t = at.project(left.gradient);
        let lateral_force = f_t.length();
        let u_t = if lateral_force > 0.0 { f_t * (1.0 / lateral_force) } else { DVec3::ZERO };
        // Where the body is dragged away from under the tool f_z can fall below zero: nothing is held then.
        let limit = friction * normal.max(0.0);
        (left, Reading { u_t, normal, lateral_force, lateral_slope: slope, limit, energy })
    }

    #[inline(always)]
    fn rho(&self, f: &Evaluation) -> f64 {
        f.lateral
    }

    #[inline(always)]
    fn deflection(&self, _: &Evaluation) -> DVec3 {
        self.deflection
    }

    #[inline(always)]
    fn along_deflection(&self, _: &Evaluation, v: DVec3) -> f64 {
        self.deflection.dot(v)
    }

    #[inline(always)]
    fn normal_coupling(&self, _: &Self::Element<'_>, _: [f64; 3], f: &Evaluation) -> f64 {
        f.u().dot(self.gradient)
    }

    #[inline]
    fn node_energies(
        &self,
        points: &Self::Element<'_>,
        model: &ContactModel,
        nodes: [&Node; 3],
        f: &Evaluation,
    ) -> [f64; 3] {
        if points.blend == Blend::Own {
            return self.energies;
        }
        let energies = self.energies(points, model, nodes, f);
        nodes.map(|node| {
            let [a, b, c] = node.test_points.map(|t| energies.energy(t));
            let [x, y, z] = node.weights;
            x * a + y * b + z * c
        })
    }

    #[inline(always)]
    fn energies<'a>(
        &self,
        points: &Self::Element<'a>,
        model: &'a ContactModel,
        nodes: [&Node; 3],
        f: &Evaluation,
    ) -> CoupledEnergies<'a> {
        let known = EnergyCache { points: points.blend.points(nodes), energies: self.energies };
        CoupledEnergies {
            potentials: model.potentials(),
            depth: (points.interval.index, points.interval.distance(f.depth)),
            tangential: self.deflection,
            reach: self.reach,
            // A wide blend leaves only the last of each node's.
            cache: if points.blend == Blend::Wide { EnergyCache::NONE } else { known },
        }
    }

    #[inline(always)]
    fn greatest_gradient(
        &self,
        points: &Self::Element<'_>,
        gradients: &Gradients,
        nodes: [u32; 3],
        f: &Evaluation,
    ) -> f64 {
        let bounds = nodes.map(|node| gradients.coupled_bound(node, points.interval.index));
        let [a, b, c] = bounds.map(|bound| bound.at(f.lateral, &self.reach));
        a.max(b).max(c)
    }

    #[inline(always)]
    fn tensor_gradient(&self, _: &Evaluation) -> Option<(DVec3, f64)> {
        None
    }

    fn drift<'a>(
        &self,
        points: &mut Self::Element<'a>,
        model: &'a ContactModel,
        nodes: [&'a Node; 3],
        f: &Evaluation,
        change: &Change,
    ) -> Drift {
        let Change { u, du, d_depth, d_tangential, v, friction_scale, .. } = *change;
        points.look_up(model, nodes, f.depth);
        let (t, deflection) = (points.interval.distance(f.depth), self.deflection);
        // Derivatives by δz and by the three directions of space; and the change of what the place blends.
        let along = |v: DVec3, value: f64| Dual { value, partials: [0.0, v.x, v.y, v.z] };
        let deep = Dual { value: t, partials: [if f.depth > 0.0 { 1.0 } else { 0.0 }, 0.0, 0.0, 0.0] };
        let square = along(deflection * 2.0, deflection.length_squared());
        let reach = Reach::<Dual<f64, 4>>::new(square, model.potentials().range_m());
        let (mut hessian_zz, mut hessian_zt, mut hessian_tt) = (0.0, DVec3::ZERO, DMat3::ZERO);
        let (mut mu, mut mu_slope, mut d_mu) = (0.0, 0.0, 0.0);
        let (mut d_normal, mut d_gradient) = (0.0, DVec3::ZERO);
        points.each(model, nodes, [change.blending, change.along], |potential, [w, dw], _| {
            let [t1, t2] = *potential.tangents;
            let xi = potential.tangents.map(|t| along(t, t.dot(deflection)));
            let quantities = at_depth(potential.row, deep);
            let law = coupled(&quantities, xi, &reach);
            let ([nz, nx, ny, nt], [p, q]) = (law.normal.partials, law.lateral);
            hessian_zz += w * nz;
            hessian_zt += DVec3::new(nx, ny, nt) * w;
            let [p_t, q_t, radial_t] = [p, q, law.radial].map(|n| {
                let [_, x, y, z] = n.partials;
                DVec3::new(x, y, z)
            });
            let radial = law.radial.value;
            hessian_tt += (outer(t1, p_t) + outer(t2, q_t) + outer(deflection, radial_t)) * w
                + DMat3::from_diagonal(DVec3::splat(w * radial));
            d_normal += dw * law.normal.value;
            d_gradient += (t1 * p.value + t2 * q.value + deflection * radial) * dw;
            let Dual { value, partials } = quantities.value[QUANTITIES - 1];
            (mu, mu_slope, d_mu) = (mu + w * value, mu_slope + w * partials[0], d_mu + dw * value);
        });
        d_normal += hessian_zz * d_depth + hessian_zt.dot(d_tangential);
        d_gradient += hessian_zt * d_depth + hessian_tt * d_tangential;
        let p = self.gradient;
        let d_lateral = d_gradient - u * u.dot(d_gradient) - u * du.dot(p) - du * u.dot(p);
        let (normal, d_pushed) = if f.normal > 0.0 { (f.normal, d_normal) } else { (0.0, 0.0) };
        let d_limit = (mu_slope * d_depth + d_mu) * normal + mu * d_pushed;
        // ∂f/∂x in stick: W's Hessian in û and the tangent plane. Its norm bounds both stiffnesses.
        let across = hessian_zt - u * u.dot(hessian_zt);
        let plane = DMat3::IDENTITY - outer(u, u);
        let stiffness =
            plane * hessian_tt * plane + outer(u, u) * hessian_zz + outer(u, across) + outer(across, u);
        let greatest = greatest_eigenvalue(&stiffness);
        let limit_slope = mu_slope * normal + mu * if f.normal > 0.0 { hessian_zz } else { 0.0 };
        Drift {
            force: u * d_normal + du * f.normal + d_lateral,
            normal_slope: greatest,
            limit_slope: limit_slope * friction_scale,
            lateral_stiffness: greatest,
            lateral_force_gradient: (stiffness * f.u_t).length(),
            eta: d_limit * friction_scale - d_lateral.dot(v),
        }
    }

    #[inline(always)]
    fn implicit_direction(&self, f: &Evaluation) -> DVec3 {
        f.u_t
    }

    #[inline(always)]
    fn implicit_drive_direction(_: &Self::Element<'_>, _: [f64; 3], _: &Evaluation, drive: &Drive) -> DVec3 {
        drive.way
    }

    #[inline(always)]
    fn slope_ratio(_: &Self::Element<'_>, _: [f64; 3], _: DVec3, _: DVec3) -> f64 {
        1.0
    }

    #[inline(always)]
    fn tool_motion(
        points: &Self::Element<'_>,
        model: &ContactModel,
        nodes: [&Node; 3],
        n: [f64; 3],
        normal: DVec3,
        [above, radius]: [f64; 2],
    ) -> Option<ToolMotion> {
        if radius == 0.0 || !model.potentials().is_curved() {
            return None;
        }
        let mut curvature = [0.0; 6];
        points.each(model, nodes, [n], |potential, [w], _| {
            curvature.iter_mut().zip(potential.curvature).for_each(|(sum, k)| *sum += w * k);
        });
        let tensor = tool_motion(curvature, normal.to_array(), above, radius);
        // No eigenvalue is farther from 1 than the tensor less 1 is long.
        let [xx, xy, xz, yy, yz, zz] = tensor;
        let diagonal = [xx, yy, zz].map(|x| (x - 1.0) * (x - 1.0)).iter().sum::<f64>();
        let off = (diagonal + 2.0 * (xy * xy + xz * xz + yz * yz)).sqrt();
        Some(ToolMotion { tensor, bounds: [(1.0 - off).max(LEAST_MOTION), 1.0 + off] })
    }
}

/// a bᵀ.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

/// No less than the greatest |eigenvalue| of a symmetric matrix, and hardly more: by powers of its square.
fn greatest_eigenvalue(m: &DMat3) -> f64 {
    let size = |m: &DMat3| {
        (m.x_axis.length_squared() + m.y_axis.length_squared() + m.z_axis.length_squared()).sqrt()
    };
    let scale = size(m);
    if !(scale > NO_DIRECTION && scale.is_finite()) {
        return scale;
    }
    // |m|³² by five squarings: the Frobenius norm exceeds the spectral one by a factor of 3^(1/64) at most.
    let (mut power, mut factor) = (*m * (1.0 / scale), scale);
    for squaring in 1..=5 {
        power *= power;
        let s = size(&power);
        power *= 1.0 / s;
        factor *= (0..squaring).fold(s, |root, _| root.sqrt());
    }
    factor
}
