//! Small solids that a scene is drawn with besides the body: balls, tubes, arrows, a tool.

use crate::palette::Rgb;
use glam::Vec3;

/// A corner of a triangle.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Vertex {
    /// m from the scene's origin.
    pub position: [f32; 3],
    /// Unit vector.
    pub normal: [f32; 3],
    /// Red, green, blue, and how opaque, 0 to 255.
    pub colour: [u8; 4],
}

/// A colour as vertices have it.
pub fn bytes(colour: Rgb) -> [u8; 4] {
    let [r, g, b] = colour.map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8);
    [r, g, b, 255]
}

/// Triangles, three vertices each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Solids(pub Vec<Vertex>);

/// Sides of what is round.
const SIDES: usize = 20;
/// Sides of what is thin.
const THIN: usize = 7;

impl Solids {
    fn triangle(&mut self, corners: [(Vec3, Vec3); 3], colour: [u8; 4]) {
        self.0.extend(corners.map(|(p, n)| Vertex { position: p.to_array(), normal: n.to_array(), colour }));
    }

    /// A flat triangle; nothing where it has no area.
    pub fn flat(&mut self, [a, b, c]: [Vec3; 3], colour: Rgb) {
        if let Some(n) = (b - a).cross(c - a).try_normalize() {
            self.triangle([(a, n), (b, n), (c, n)], bytes(colour));
        }
    }

    /// A ball.
    pub fn ball(&mut self, centre: Vec3, radius: f32, colour: Rgb) {
        self.ball_of(SIDES, centre, radius, colour);
    }

    /// A ball that is seen as a dot.
    pub fn dot(&mut self, centre: Vec3, radius: f32, colour: Rgb) {
        self.ball_of(THIN + 1, centre, radius, colour);
    }

    fn ball_of(&mut self, sides: usize, centre: Vec3, radius: f32, colour: Rgb) {
        let colour = bytes(colour);
        let rings = sides / 2;
        let at = |i: usize, j: usize| {
            let (sin_e, cos_e) = (std::f32::consts::PI * i as f32 / rings as f32).sin_cos();
            let (sin_a, cos_a) = (std::f32::consts::TAU * j as f32 / sides as f32).sin_cos();
            let n = Vec3::new(sin_e * cos_a, sin_e * sin_a, cos_e);
            (centre + n * radius, n)
        };
        for i in 0..rings {
            for j in 0..sides {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                self.triangle([a, b, c], colour);
                self.triangle([a, c, d], colour);
            }
        }
    }

    /// A cone's frustum from one place to another, with the radii there, closed at both ends; nothing where both places are one.
    pub fn frustum(&mut self, from: Vec3, to: Vec3, radii: [f32; 2], colour: Rgb) {
        self.frustum_of(SIDES, from, to, radii, colour);
    }

    fn frustum_of(&mut self, sides: usize, from: Vec3, to: Vec3, radii: [f32; 2], colour: Rgb) {
        let Some(axis) = (to - from).try_normalize() else { return };
        let colour = bytes(colour);
        let (u, v) = axis.any_orthonormal_pair();
        let slope = (radii[0] - radii[1]) / from.distance(to);
        let around = |j: usize| {
            let (sin, cos) = (std::f32::consts::TAU * j as f32 / sides as f32).sin_cos();
            u * cos + v * sin
        };
        for j in 0..sides {
            let (a, b) = (around(j), around(j + 1));
            let [na, nb] = [a, b].map(|r| (r + axis * slope).normalize());
            let [pa, pb] = [a, b].map(|r| from + r * radii[0]);
            let [qa, qb] = [a, b].map(|r| to + r * radii[1]);
            self.triangle([(pa, na), (pb, nb), (qb, nb)], colour);
            self.triangle([(pa, na), (qb, nb), (qa, na)], colour);
            self.triangle([(from, -axis), (pb, -axis), (pa, -axis)], colour);
            self.triangle([(to, axis), (qa, axis), (qb, axis)], colour);
        }
    }

    /// A straight tube.
    pub fn tube(&mut self, from: Vec3, to: Vec3, radius: f32, colour: Rgb) {
        self.frustum(from, to, [radius, radius], colour);
    }

    /// A thin tube through these places.
    pub fn line(&mut self, places: &[Vec3], radius: f32, colour: Rgb) {
        for pair in places.windows(2) {
            // A little longer at both ends, so that joints have no gap.
            let way = (pair[1] - pair[0]).normalize_or_zero() * (0.6 * radius);
            self.frustum_of(THIN, pair[0] - way, pair[1] + way, [radius; 2], colour);
        }
    }

    /// An arrow of this thickness; its head is no longer than it.
    pub fn arrow(&mut self, from: Vec3, to: Vec3, radius: f32, colour: Rgb) {
        let length = from.distance(to);
        let head = (5.0 * radius).min(0.6 * length);
        let neck = to - (to - from).normalize_or_zero() * head;
        self.tube(from, neck, radius, colour);
        self.frustum(neck, to, [2.4 * radius * (head / (5.0 * radius)), 0.0], colour);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The volume inside of a closed surface by the divergence theorem: all triangles look outwards.
    fn volume(solids: &Solids) -> f32 {
        let p = |v: &Vertex| Vec3::from_array(v.position);
        solids.0.chunks(3).map(|t| p(&t[0]).dot(p(&t[1]).cross(p(&t[2]))) / 6.0).sum()
    }

    #[test]
    fn solids_are_closed_and_look_outwards() {
        let mut ball = Solids::default();
        ball.ball(Vec3::new(1.0, 2.0, 3.0), 2.0, [1.0; 3]);
        let whole = 4.0 / 3.0 * std::f32::consts::PI * 8.0;
        assert!((volume(&ball) / whole - 1.0).abs() < 0.06, "{}", volume(&ball));
        let mut cone = Solids::default();
        cone.frustum(Vec3::ZERO, Vec3::new(0.0, 3.0, 0.0), [2.0, 1.0], [1.0; 3]);
        let whole = std::f32::consts::PI * 3.0 / 3.0 * (4.0 + 2.0 + 1.0);
        assert!((volume(&cone) / whole - 1.0).abs() < 0.04, "{}", volume(&cone));
        let mut nothing = Solids::default();
        nothing.arrow(Vec3::ONE, Vec3::ONE, 0.1, [1.0; 3]);
        assert!(nothing.0.is_empty());
    }
}
