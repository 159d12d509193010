//! Where the body is looked at from.

use glam::{DVec2, DVec3, Mat4, Vec3};
use std::f64::consts::{FRAC_PI_2, PI};
use std::str::FromStr;

/// From the picture's lower edge to its upper one, rad: as through a lens that shows things as hands know them.
const FIELD_OF_VIEW: f64 = 0.5;
/// The camera never looks straight along its own upward direction: rad from there.
const POLE: f64 = 1e-3;

/// Directions to look from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StandardView {
    /// From the front left, somewhat above.
    Oblique,
    /// Along +y.
    Front,
    /// Along −y.
    Back,
    /// Along +x.
    Left,
    /// Along −x.
    Right,
    /// Along −z.
    Top,
    /// Along +z.
    Bottom,
}

impl StandardView {
    /// All, in the order of their keys 1 to 7.
    pub const ALL: [StandardView; 7] = [
        StandardView::Oblique,
        StandardView::Front,
        StandardView::Back,
        StandardView::Left,
        StandardView::Right,
        StandardView::Top,
        StandardView::Bottom,
    ];

    /// As buttons and options name it.
    pub fn name(self) -> &'static str {
        match self {
            StandardView::Oblique => "oblique",
            StandardView::Front => "front",
            StandardView::Back => "back",
            StandardView::Left => "left",
            StandardView::Right => "right",
            StandardView::Top => "top",
            StandardView::Bottom => "bottom",
        }
    }

    /// Azimuth and elevation of the camera, rad.
    fn angles(self) -> [f64; 2] {
        match self {
            StandardView::Oblique => [-FRAC_PI_2 + 0.6, 0.45],
            StandardView::Front => [-FRAC_PI_2, 0.0],
            StandardView::Back => [FRAC_PI_2, 0.0],
            StandardView::Left => [PI, 0.0],
            StandardView::Right => [0.0, 0.0],
            StandardView::Top => [-FRAC_PI_2, FRAC_PI_2],
            StandardView::Bottom => [-FRAC_PI_2, -FRAC_PI_2],
        }
    }
}

/// A camera that looks at a point, z upwards. Lengths in m, angles in rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// What it looks at, m.
    pub target: DVec3,
    /// How far away it is, m.
    pub distance: f64,
    /// From the x axis, about z.
    pub azimuth: f64,
    /// Above the xy plane.
    pub elevation: f64,
    /// Size of what is looked at, m: how near and how far the camera may go.
    pub size: f64,
}

impl Default for Camera {
    fn default() -> Self {
        Camera::fitting(DVec3::ZERO, 0.05)
    }
}

/// A way of light: from a point, m, in a direction of unit length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// m.
    pub from: DVec3,
    /// Unit vector.
    pub direction: DVec3,
}

impl Camera {
    /// All of a ball is seen, obliquely.
    pub fn fitting(middle: DVec3, radius: f64) -> Self {
        let radius = if radius.is_finite() && radius > 0.0 { radius } else { 0.05 };
        let [azimuth, elevation] = StandardView::Oblique.angles();
        let distance = Self::distance_for(radius);
        Camera { target: middle, distance, azimuth, elevation, size: radius }
    }

    /// From where a ball fills the picture.
    fn distance_for(radius: f64) -> f64 {
        1.04 * radius / (0.5 * FIELD_OF_VIEW).sin()
    }

    /// The whole ball again, from the same direction.
    pub fn fit(&mut self, middle: DVec3) {
        (self.target, self.distance) = (middle, Self::distance_for(self.size));
    }

    /// From a standard direction.
    pub fn look_from(&mut self, view: StandardView) {
        [self.azimuth, self.elevation] = view.angles();
        self.keep_off_the_poles();
    }

    /// Turns about the target, rad to the right and upwards.
    pub fn orbit(&mut self, by: DVec2) {
        if by.is_finite() {
            self.azimuth = (self.azimuth - by.x).rem_euclid(2.0 * PI);
            self.elevation += by.y;
            self.keep_off_the_poles();
        }
    }

    fn keep_off_the_poles(&mut self) {
        self.elevation = self.elevation.clamp(-FRAC_PI_2 + POLE, FRAC_PI_2 - POLE);
    }

    /// Moves along the picture, in parts of its height to the right and upwards.
    pub fn pan(&mut self, by: DVec2) {
        if by.is_finite() {
            let height = 2.0 * self.distance * (0.5 * FIELD_OF_VIEW).tan();
            let [right, up, _] = self.axes();
            let moved = self.target - (right * by.x + up * by.y) * height;
            self.target = moved.clamp(DVec3::splat(-1e3), DVec3::splat(1e3));
        }
    }

    /// Comes nearer by this factor.
    pub fn zoom(&mut self, factor: f64) {
        if factor.is_finite() && factor > 0.0 {
            self.distance = (self.distance / factor).clamp(0.02 * self.size, 50.0 * self.size);
        }
    }

    /// Right, up, and towards the viewer: unit vectors.
    pub fn axes(&self) -> [DVec3; 3] {
        let (sin_a, cos_a) = self.azimuth.sin_cos();
        let (sin_e, cos_e) = self.elevation.sin_cos();
        let back = DVec3::new(cos_e * cos_a, cos_e * sin_a, sin_e);
        let right = DVec3::new(-sin_a, cos_a, 0.0);
        [right, back.cross(right), back]
    }

    /// Where it is, m.
    pub fn eye(&self) -> DVec3 {
        self.target + self.axes()[2] * self.distance
    }

    /// From the body's frame to clip space, for a picture of this width per height. Depths are from 0 to 1, near to far.
    pub fn clip_from_body(&self, aspect: f32) -> Mat4 {
        let near = (0.01 * self.size).min(0.25 * self.distance) as f32;
        let far = (self.distance + 60.0 * self.size) as f32;
        let [right, up, back] = self.axes().map(|v| v.as_vec3());
        let eye = self.eye().as_vec3();
        let view = Mat4::from_cols(
            Vec3::new(right.x, up.x, back.x).extend(0.0),
            Vec3::new(right.y, up.y, back.y).extend(0.0),
            Vec3::new(right.z, up.z, back.z).extend(0.0),
            Vec3::new(-right.dot(eye), -up.dot(eye), -back.dot(eye)).extend(1.0),
        );
        let flat = 1.0 / (0.5 * FIELD_OF_VIEW as f32).tan();
        // A picture that is higher than wide shows as much across as a square one.
        let (x, y) = if aspect < 1.0 { (flat, flat * aspect) } else { (flat / aspect, flat) };
        let depth = far / (near - far);
        let projection = Mat4::from_cols_array_2d(&[
            [x, 0.0, 0.0, 0.0],
            [0.0, y, 0.0, 0.0],
            [0.0, 0.0, depth, -1.0],
            [0.0, 0.0, near * depth, 0.0],
        ]);
        projection * view
    }

    /// Through a place of the picture, from −1 to 1 to the right and upwards.
    pub fn ray(&self, place: DVec2, aspect: f64) -> Ray {
        let flat = (0.5 * FIELD_OF_VIEW).tan();
        let (wide, high) = if aspect < 1.0 { (flat, flat / aspect) } else { (flat * aspect, flat) };
        let [right, up, back] = self.axes();
        let direction = right * (place.x * wide) + up * (place.y * high) - back;
        Ray { from: self.eye(), direction: direction.normalize() }
    }

    /// Where a point is seen, from −1 to 1 to the right and upwards; `None` behind the camera.
    pub fn place_of(&self, point: DVec3, aspect: f32) -> Option<[f32; 2]> {
        let clip = self.clip_from_body(aspect) * point.as_vec3().extend(1.0);
        (clip.w > 0.0).then(|| [clip.x / clip.w, clip.y / clip.w])
    }
}

/// What a command says of the camera: a standard view, or azimuth, elevation and zoom.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraChoice {
    /// rad.
    angles: [f64; 2],
    /// How many times nearer than where all of the body is seen.
    zoom: f64,
}

impl CameraChoice {
    /// Points the camera so; it keeps looking at what it looks at.
    pub fn apply(&self, camera: &mut Camera) {
        [camera.azimuth, camera.elevation] = self.angles;
        camera.keep_off_the_poles();
        camera.zoom(self.zoom);
    }
}

impl FromStr for CameraChoice {
    type Err = String;

    /// `front`, or `AZIMUTH_DEG,ELEVATION_DEG[,ZOOM]`; a standard view may be followed by a zoom too: `top,2`.
    fn from_str(text: &str) -> Result<Self, String> {
        let refused = || {
            let names = StandardView::ALL.map(StandardView::name).join(", ");
            format!(
                "`{text}` is no camera; give one of {names}, or AZIMUTH_DEG,ELEVATION_DEG, and a zoom after a comma if it is not 1"
            )
        };
        let words: Vec<&str> = text.split(',').map(str::trim).collect();
        let number = |word: &str| word.parse::<f64>().ok().filter(|x| x.is_finite()).ok_or_else(refused);
        let zoom = |word: &str| number(word).ok().filter(|z| (0.05..=50.0).contains(z)).ok_or_else(refused);
        let named = |name: &str| StandardView::ALL.into_iter().find(|v| v.name() == name);
        match (named(words[0]), &words[..]) {
            (Some(view), [_]) => Ok(CameraChoice { angles: view.angles(), zoom: 1.0 }),
            (Some(view), [_, z]) => Ok(CameraChoice { angles: view.angles(), zoom: zoom(z)? }),
            (None, [azimuth, elevation, rest @ ..]) if rest.len() < 2 => Ok(CameraChoice {
                angles: [number(azimuth)?.to_radians(), number(elevation)?.to_radians()],
                zoom: rest.first().map_or(Ok(1.0), |z| zoom(z))?,
            }),
            _ => Err(refused()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_through_where_a_point_is_seen_meets_it() {
        let mut camera = Camera::fitting(DVec3::new(0.1, 0.0, -0.02), 0.06);
        camera.orbit(DVec2::new(0.7, -0.9));
        camera.pan(DVec2::new(0.1, 0.2));
        camera.zoom(1.7);
        let point = DVec3::new(0.09, 0.01, -0.01);
        for aspect in [0.5f32, 1.0, 1.8] {
            let [x, y] = camera.place_of(point, aspect).unwrap();
            let ray = camera.ray(DVec2::new(x.into(), y.into()), aspect.into());
            let off = (point - ray.from).cross(ray.direction).length();
            assert!(off < 1e-6, "{aspect}: {off}");
        }
    }

    #[test]
    fn the_standard_views_look_where_they_say() {
        let mut camera = Camera::default();
        for (view, towards) in [
            (StandardView::Front, DVec3::Y),
            (StandardView::Right, DVec3::NEG_X),
            (StandardView::Top, DVec3::NEG_Z),
            (StandardView::Bottom, DVec3::Z),
        ] {
            camera.look_from(view);
            assert!((-camera.axes()[2]).distance(towards) < 2e-3, "{view:?}");
            // x runs to the right when seen from above and from the front.
            assert!(view == StandardView::Right || camera.axes()[0].distance(DVec3::X) < 1e-9, "{view:?}");
        }
    }

    #[test]
    fn all_of_the_ball_is_in_the_picture() {
        let camera = Camera::fitting(DVec3::ONE, 0.2);
        for v in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::ONE.normalize()] {
            for point in [DVec3::ONE + v * 0.2, DVec3::ONE - v * 0.2] {
                let [x, y] = camera.place_of(point, 1.0).unwrap();
                assert!(x.abs() <= 1.0 && y.abs() <= 1.0, "{point}: {x} {y}");
            }
        }
    }

    #[test]
    fn a_command_says_where_from() {
        let read = |text: &str| text.parse::<CameraChoice>();
        let mut camera = Camera::default();
        let far = camera.distance;
        read("30, 20, 2").unwrap().apply(&mut camera);
        assert!(
            (camera.azimuth - 30f64.to_radians()).abs() < 1e-12
                && (camera.distance - far / 2.0).abs() < 1e-12
        );
        assert!(read("top").is_ok() && read("left,1.5").is_ok());
        for wrong in ["", "up", "1", "1,2,3,4", "top,0", "nan,1", "30,20,-1"] {
            assert!(read(wrong).unwrap_err().contains("oblique"), "{wrong}");
        }
    }
}
