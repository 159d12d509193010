//! How a body gives way at rest, anywhere on its surface: for little, since the factor at rest is there.

use crate::contact::rule;
use crate::factor::LANES;
use crate::model::Model;
use glam::{DMat3, DVec3};

impl Model {
    /// Mean displacement over force, m/N, in the body's axes, of a small force that is spread over the surface within
    /// `radius_m` of `point` as under a sphere, p ∝ √(1 − r²/a²) (Hertz): Pᵀ K⁻¹ P. Symmetric; 0 along axes where supports take
    /// all of it. `inward` says which side of a thin part is meant.
    ///
    /// It costs one substitution, in single precision: a few digits are right.
    pub fn compliance_at(&self, point: DVec3, inward: DVec3, radius_m: f64) -> DMat3 {
        let mut load = vec![0.0; self.pattern.nodes()];
        let (mut total, mut nearest) = (0.0, (f64::INFINITY, 0));
        let mut push = |node: u32, force: f64| {
            // Supports take theirs.
            if let Some(sum) = load.get_mut(self.rank[node as usize] as usize) {
                *sum += force;
            }
        };
        let rule = rule();
        for face in &self.boundary().faces {
            let p = face.map(|n| self.mesh().positions[n as usize]);
            for (p, &n) in p.iter().zip(face) {
                let distance = p.distance(point);
                if distance < nearest.0 {
                    nearest = (distance, n);
                }
            }
            let normal = (p[1] - p[0]).cross(p[2] - p[0]);
            // Not the far side of a thin part.
            if normal.dot(inward) >= 0.0 {
                continue;
            }
            let area = 0.5 * normal.length();
            for (weight, shape) in rule {
                let at: DVec3 = shape.iter().zip(&p).map(|(n, p)| *p * *n).sum();
                let pressure = (1.0 - at.distance_squared(point) / (radius_m * radius_m)).max(0.0).sqrt();
                let force = pressure * weight * area;
                total += force;
                face.iter().zip(shape).for_each(|(&n, shape)| push(n, force * shape));
            }
        }
        if total == 0.0 {
            // The patch is smaller than a face.
            total = 1.0;
            push(nearest.1, 1.0);
        }
        let mut moved = vec![[0.0f32; LANES]; 3 * load.len()];
        for (n, force) in load.iter().enumerate() {
            for axis in (0..3).filter(|axis| !self.held[3 * n + axis]) {
                moved[3 * n + axis][axis] = (force / total) as f32;
            }
        }
        self.symbolic.solve_several(&self.rest_factor, &mut moved);
        let mut compliance = DMat3::ZERO;
        for (n, force) in load.iter().enumerate() {
            for axis in (0..3).filter(|axis| !self.held[3 * n + axis]) {
                let by = moved[3 * n + axis];
                let by = DVec3::new(f64::from(by[0]), f64::from(by[1]), f64::from(by[2]));
                *compliance.col_mut(axis) += by * (force / total);
            }
        }
        (compliance + compliance.transpose()) * 0.5
    }
}
