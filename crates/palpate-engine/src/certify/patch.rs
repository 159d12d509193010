//! An element as the certificates see it, and the states of slip on it.

use super::Assumptions;
use super::coupled::Coupled;
use super::curves::Corners;
use super::interval::{Interval, IntervalVector};
use super::law::Law;
use super::slopes::Slopes;
use glam::{DMat3, DVec2, DVec3};
use palpate_body::{Body, SlipRule, Tensor, tensor};
use std::f64::consts::PI;

/// Friction that holds beyond this many times the lateral curves' end is not followed farther.
const FARTHEST: f64 = 10.0;

/// A set of slip states on one element: where, how deep, which way, how far laterally.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Area coordinates of the corners of the part of the element that the contact point is in.
    pub corners: [[f64; 3]; 3],
    /// δz, from and to, m.
    pub depth_m: [f64; 2],
    /// Direction of the lateral deflection, as its projection on the element: the angle from the first edge, round the
    /// inward normal, rad.
    pub azimuth: [f64; 2],
    /// ρ (δr on an isotropic body), m.
    pub reach_m: [f64; 2],
}

/// A direction of a [`Cell`] to cut it in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cut {
    Place,
    Depth,
    Azimuth,
    Reach,
}

impl Cut {
    pub const ALL: [Cut; 4] = [Cut::Place, Cut::Depth, Cut::Azimuth, Cut::Reach];
}

impl Cell {
    /// The state in its middle.
    pub fn middle(&self) -> Cell {
        Cut::ALL.into_iter().fold(*self, |cell, cut| cell.flat(cut))
    }

    /// The same without extent in one direction.
    pub(super) fn flat(&self, cut: Cut) -> Cell {
        let mut cell = *self;
        let middle = |[a, b]: [f64; 2]| [0.5 * (a + b); 2];
        match cut {
            Cut::Place => {
                let [a, b, c] = self.corners;
                cell.corners = [std::array::from_fn(|i| (a[i] + b[i] + c[i]) / 3.0); 3];
            }
            Cut::Depth => cell.depth_m = middle(self.depth_m),
            Cut::Azimuth => cell.azimuth = middle(self.azimuth),
            Cut::Reach => cell.reach_m = middle(self.reach_m),
        }
        cell
    }

    /// Its two halves.
    pub(super) fn halves(&self, cut: Cut) -> [Cell; 2] {
        let (mut low, mut high) = (*self, *self);
        let middle = |[a, b]: [f64; 2]| 0.5 * (a + b);
        match cut {
            Cut::Place => {
                // Across the longest side, in area coordinates: good enough for elements that aren't slivers.
                let side = |i: usize| {
                    let (a, b) = (self.corners[i], self.corners[(i + 1) % 3]);
                    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>()
                };
                let i = (0..3).max_by(|&i, &j| side(i).total_cmp(&side(j))).unwrap_or(0);
                let (a, b) = (self.corners[i], self.corners[(i + 1) % 3]);
                let between = std::array::from_fn(|k| 0.5 * (a[k] + b[k]));
                low.corners[i] = between;
                high.corners[(i + 1) % 3] = between;
            }
            Cut::Depth => {
                low.depth_m[1] = middle(self.depth_m);
                high.depth_m[0] = middle(self.depth_m);
            }
            Cut::Azimuth => {
                low.azimuth[1] = middle(self.azimuth);
                high.azimuth[0] = middle(self.azimuth);
            }
            Cut::Reach => {
                low.reach_m[1] = middle(self.reach_m);
                high.reach_m[0] = middle(self.reach_m);
            }
        }
        [low, high]
    }

    /// Its width in one direction, as a share of the most there can be.
    pub(super) fn width(&self, cut: Cut, patch: &ElementStates) -> f64 {
        let wide = |[a, b]: [f64; 2], most: f64| (b - a) / most;
        match cut {
            Cut::Place => {
                let spread = |i: usize| Interval::hull(self.corners.map(|n| n[i]));
                (0..3).map(|i| spread(i).hi - spread(i).lo).fold(0.0, f64::max)
            }
            Cut::Depth => wide(self.depth_m, patch.depth_end_m),
            Cut::Azimuth => wide(self.azimuth, PI),
            Cut::Reach => wide(self.reach_m, patch.reach_m),
        }
    }
}

/// A slip state in the body's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlipState {
    /// c, m.
    pub contact: DVec3,
    /// û.
    pub inward: DVec3,
    /// The lateral deflection's direction in the element, a unit vector.
    pub along: DVec3,
    /// δ_t, m.
    pub lateral: DVec3,
    /// x, m.
    pub tool_position: DVec3,
}

/// An element, its frames and its curves.
#[derive(Debug, Clone)]
pub struct ElementStates {
    /// In the element: x along the first edge, z its inward normal; all vectors below are in this basis.
    axes: [DVec3; 3],
    /// In the body's frame, m.
    corners: [DVec3; 3],
    /// ∇n of the three nodes, 1/m.
    gradients: [DVec2; 3],
    /// Of the three nodes.
    frames: [DVec3; 3],
    /// A of the three nodes, and the least and greatest eigenvalue of any.
    tensors: Option<([DMat3; 3], [f64; 2])>,
    /// Forces, friction and energies; of a coupled body nothing,
    pub(super) law: Law,
    /// and this instead.
    pub(super) coupled: Option<Coupled>,
    /// Which rule's slips.
    pub(super) slip: SlipRule,
    /// What its drive takes off the lateral force; none for `paper`.
    pub(super) slopes: Option<Slopes>,
    /// R, m.
    pub(super) radius_m: f64,
    /// Deepest δz, m.
    pub(super) depth_end_m: f64,
    /// Greatest ρ that is looked at, m.
    pub(super) reach_m: f64,
    /// Whether friction holds farther than that.
    pub(super) beyond: bool,
    /// The tool's longest step, m.
    pub(super) step_m: f64,
    /// How far the way of a slip may be off the drive, rad.
    pub(super) aside: f64,
    /// What η is proved to be at least, N/m.
    pub(super) least_eta: f64,
}

impl ElementStates {
    /// Element `element` of `body`, which must exist.
    pub fn new(body: &Body, element: u32, assumptions: &Assumptions) -> Self {
        let nodes = body.element_nodes(element);
        let [p, q, r] = nodes.map(|n| n.position);
        let x = (q - p).normalize();
        let z = -body.outward(element);
        let axes = [x, z.cross(x), z];
        let local = |v: DVec3| DVec3::from_array(axes.map(|a| a.dot(v)));
        let (e1, e2) = (local(q - p), local(r - p));
        // n_1 and n_2 are the solution of x = n_1 e1 + n_2 e2.
        let area2 = e1.x * e2.y - e1.y * e2.x;
        let (g1, g2) = (DVec2::new(e2.y, -e2.x) / area2, DVec2::new(-e1.y, e1.x) / area2);

        let gradients = [-g1 - g2, g1, g2];
        let law = Law::new(body, nodes, assumptions.friction_factor);
        let slip = assumptions.slip;
        let mut patch = ElementStates {
            axes,
            corners: [p, q, r],
            gradients,
            frames: nodes.map(|n| local(n.inward)),
            tensors: (!body.is_isotropic()).then(|| {
                let azimuth = DMat3::from_cols(axes[0], axes[1], axes[2]);
                let tensors = body.element_tensors(element);
                let values = [0, 1, 2].map(|l| tensor::Principal::of(tensors[l], nodes[l].inward).values);
                let least = values.iter().fold(f64::INFINITY, |v, [_, low]| v.min(*low));
                let greatest = values.iter().fold(0.0f64, |v, [high, _]| v.max(*high));
                (tensors.map(|a| azimuth.transpose() * matrix(a) * azimuth), [least, greatest])
            }),
            coupled: body
                .is_coupled()
                .then(|| Coupled::new(body, element, slip, axes, assumptions.friction_factor)),
            slopes: (slip != SlipRule::Paper && !body.is_coupled())
                .then(|| Slopes::new(body, element, slip, axes, gradients, law.curves())),
            slip,
            law,
            radius_m: body.tool().radius_m(),
            depth_end_m: 0.0,
            reach_m: 0.0,
            beyond: false,
            step_m: assumptions.step_m,
            aside: assumptions.aside_rad,
            least_eta: 0.0,
        };
        let [depth_end, lateral_end] = patch.law.ends();
        patch.depth_end_m = assumptions.depth_m.unwrap_or(depth_end).min(depth_end);
        if let Some(law) = &patch.coupled {
            // What was found, and no farther.
            patch.reach_m = law.range_m;
            return patch;
        }
        // Within the limit before the step, a step deeper: the limit then is the most that friction can hold.
        let [least, greatest] = patch.stretch().map(f64::sqrt);
        let held = patch.law.farthest(patch.depth_end_m + patch.step_m, least);
        let (reach, farthest) = (held + patch.step_m * greatest, FARTHEST * lateral_end);
        patch.beyond = reach > farthest;
        patch.reach_m = reach.min(farthest);
        if patch.slopes.is_some() {
            // The energy's gradients can hold the point too, in principle at any deflection: to the curves' end it is seen to.
            patch.reach_m = patch.reach_m.max(lateral_end);
        }
        patch
    }

    /// Of which S was proved with this bound of η, N/m: L and the pace have bounds then wherever cells of
    /// their own give none.
    pub fn snap_free(self, proved: f64) -> Self {
        ElementStates { least_eta: proved.max(0.0), ..self }
    }

    /// All of its slip states, in sectors of 45°.
    pub fn cells(&self) -> Vec<Cell> {
        (0..8)
            .map(|i| Cell {
                corners: WHOLE,
                depth_m: [0.0, self.depth_end_m],
                azimuth: [f64::from(i) * PI / 4.0, f64::from(i + 1) * PI / 4.0],
                reach_m: [0.0, self.reach_m],
            })
            .collect()
    }

    /// Whether the drive is the lateral curve's force, so that its limit is a root of that curve.
    pub(super) fn drives_by_curve(&self) -> bool {
        self.slopes.is_none() && self.coupled.is_none()
    }

    /// Whether the lateral force depends on the direction.
    pub(super) fn is_stretched(&self) -> bool {
        self.tensors.is_some()
    }

    /// Least and greatest eigenvalue of A in the tangent plane.
    pub(super) fn stretch(&self) -> [f64; 2] {
        self.tensors.as_ref().map_or([1.0; 2], |(_, range)| *range)
    }

    /// A [`Cell`] without extent, as a place and a deflection.
    pub fn state(&self, cell: &Cell) -> SlipState {
        let n = cell.corners[0];
        let body = |v: DVec3| self.axes[0] * v.x + self.axes[1] * v.y + self.axes[2] * v.z;
        let (sin, cos) = cell.azimuth[0].sin_cos();
        let d = DVec3::new(cos, sin, 0.0);
        let frame: DVec3 = (0..3).map(|l| self.frames[l] * n[l]).sum();
        let u = frame.normalize();
        let e = (d - DVec3::Z * (d.dot(u) / u.z)).normalize();
        let q = self
            .tensors
            .as_ref()
            .map_or(1.0, |(tensors, _)| (0..3).map(|l| n[l] * e.dot(tensors[l] * e)).sum::<f64>().sqrt());
        let contact: DVec3 = (0..3).map(|l| self.corners[l] * n[l]).sum();
        let lateral = body(e) * (cell.reach_m[0] / q);
        let tool_position = contact + body(u) * (cell.depth_m[0] - self.radius_m) + lateral;
        SlipState { contact, inward: body(u), along: body(d), lateral, tool_position }
    }

    /// The same place and depth, as far laterally in the same direction as friction just holds.
    pub fn at_limit(&self, cell: &Cell) -> Cell {
        Cell { reach_m: [super::criteria::limit_reach(self, cell); 2], ..*cell }
    }

    /// The contact point moved along the element, by `way` (m) in the direction of the lateral deflection; none beyond
    /// its sides.
    pub fn moved(&self, cell: &Cell, way: f64) -> Option<Cell> {
        let (sin, cos) = cell.azimuth[0].sin_cos();
        let n: [f64; 3] = std::array::from_fn(|i| {
            cell.corners[0][i] + way * (cos * self.gradients[i].x + sin * self.gradients[i].y)
        });
        n.iter().all(|n| *n >= 0.0).then_some(Cell { corners: [n; 3], ..*cell })
    }

    /// Whether friction can hold deflections beyond ten times what the lateral curves know; those are not followed.
    pub fn holds_too_far(&self) -> bool {
        self.beyond
    }

    /// The cell's vectors, in a basis turned to its middle direction.
    pub(super) fn view(&self, cell: &Cell) -> View {
        let middle = 0.5 * (cell.azimuth[0] + cell.azimuth[1]);
        let (sin, cos) = middle.sin_cos();
        let turned = |v: DVec3| DVec3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z);
        let gx = self.gradients.map(|g| cos * g.x + sin * g.y);
        let gy = self.gradients.map(|g| cos * g.y - sin * g.x);
        let frames = self.frames.map(turned);
        let blend = |n: [f64; 3]| frames[0] * n[0] + frames[1] * n[1] + frames[2] * n[2];
        let u = cell.corners.map(blend);
        let half = 0.5 * (cell.azimuth[1] - cell.azimuth[0]);
        let stretch = self.tensors.as_ref().map(|(tensors, _)| {
            let r = DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::Z);
            let tensors = tensors.map(|a| r.transpose() * a * r);
            let blend = |n: [f64; 3]| tensors[0] * n[0] + tensors[1] * n[1] + tensors[2] * n[2];
            let at = cell.corners.map(blend);
            let entry = |i: usize, j: usize| Interval::hull(at.map(|a| a.col(j)[i]));
            let blended = std::array::from_fn(|i| std::array::from_fn(|j| entry(i, j)));
            (blended, [blend(gx), blend(gy)])
        });
        View { gx, gy, u, du: [blend(gx), blend(gy)], frames, azimuth: [cos, sin], half, stretch }
    }
}

/// The whole element.
pub(super) const WHOLE: Corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// See [`ElementStates::view`].
pub(super) struct View {
    /// Components of ∇n, 1/m.
    pub gx: [f64; 3],
    pub gy: [f64; 3],
    /// Σ n u at the corners.
    pub u: [DVec3; 3],
    /// Its gradient along x and y, 1/m.
    pub du: [DVec3; 2],
    /// Of the nodes.
    pub frames: [DVec3; 3],
    /// Cosine and sine of the middle direction.
    pub azimuth: [f64; 2],
    /// Half the angle between the cell's directions, rad.
    pub half: f64,
    /// A, by rows, and its gradient along x and y; none where the body is isotropic.
    pub stretch: Option<([IntervalVector; 3], [DMat3; 2])>,
}

pub(super) fn matrix([xx, yy, zz, xy, xz, yz]: &Tensor) -> DMat3 {
    DMat3::from_cols(DVec3::new(*xx, *xy, *xz), DVec3::new(*xy, *yy, *yz), DVec3::new(*xz, *yz, *zz))
}
