//! How stiff a body is at rest, anywhere on its surface: for little, since the factor at rest is there.

use crate::contact::rule;
use crate::model::Model;
use glam::DVec3;

impl Model {
    /// Force over mean displacement, N/m, of a small force along `inward` that is spread over the surface within
    /// `radius_m` of `point` as under a sphere, p ∝ √(1 − r²/a²) (Hertz): 1/(pᵀ K⁻¹ p). Infinite where supports take
    /// all of it.
    ///
    /// It costs one substitution, in single precision: a few digits are right.
    pub fn stiffness_at(&self, point: DVec3, inward: DVec3, radius_m: f64) -> f64 {
        let free = 3 * self.pattern.nodes();
        let mut load = vec![0.0f32; free];
        let (mut total, mut nearest) = (0.0, (f64::INFINITY, 0));
        for face in &self.boundary().faces {
            let p = face.map(|n| self.mesh().positions[n as usize]);
            for (p, &n) in p.iter().zip(face) {
                let distance = p.distance(point);
                if distance < nearest.0 {
                    nearest = (distance, n);
                }
            }
            let area = 0.5 * (p[1] - p[0]).cross(p[2] - p[0]).length();
            for (weight, shape) in rule() {
                let at: DVec3 = shape.iter().zip(&p).map(|(n, p)| *p * *n).sum();
                let pressure = (1.0 - at.distance_squared(point) / (radius_m * radius_m)).max(0.0).sqrt();
                let force = pressure * weight * area;
                total += force;
                for (&n, shape) in face.iter().zip(shape) {
                    self.push(&mut load, n, inward * (force * shape));
                }
            }
        }
        if total == 0.0 {
            // The patch is smaller than a face.
            total = 1.0;
            self.push(&mut load, nearest.1, inward);
        }
        let scale = (1.0 / total) as f32;
        load.iter_mut().for_each(|f| *f *= scale);
        let mut moved = load.clone();
        self.symbolic.solve(&self.rest_factor, &mut moved, &mut Vec::new());
        let compliance: f64 = load.iter().zip(&moved).map(|(f, u)| f64::from(*f) * f64::from(*u)).sum();
        if compliance > 0.0 { 1.0 / compliance } else { f64::INFINITY }
    }

    /// Adds a force on one of the mesh's nodes; supports take theirs.
    fn push(&self, load: &mut [f32], node: u32, force: DVec3) {
        let first = 3 * self.rank[node as usize] as usize;
        for axis in 0..3 {
            if first + axis < load.len() && !self.held[first + axis] {
                load[first + axis] += force[axis] as f32;
            }
        }
    }
}
