//! The body that is shown, and what drawing it keeps from picture to picture.

use crate::camera::Camera;
use crate::colouring::{self, Coloured, Colouring};
use crate::deform::{Deformed, Fields, deform};
use crate::palette::Theme;
use crate::place;
use crate::scene::{self, BodyMesh, Indices, Scene, Sight};
use crate::settings::Settings;
use crate::shown::Shown;
use crate::solid::bytes;
use crate::surface::DrawnSurface;
use crate::tool::DrawnTool;
use crate::work::{Certificate, Opened};
use glam::DVec3;
use palpate::Body;
use palpate::engine::certify::{Assumptions, Bounds};
use palpate::runtime::{BodyFile, SessionBody};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Numbers for buffers: no two ever have the same.
static GENERATIONS: AtomicU64 = AtomicU64::new(1);

fn generation() -> u64 {
    GENERATIONS.fetch_add(1, Ordering::Relaxed)
}

/// A body on show.
#[derive(Debug)]
pub struct Subject {
    /// It.
    pub body: Arc<Body>,
    /// What it is called.
    pub name: String,
    /// Its file, as recordings name it.
    pub file: BodyFile,
    /// The tool that it was made for.
    pub tool: DrawnTool,
    /// Its surface as drawn.
    pub surface: DrawnSurface,
    /// Its colours.
    pub coloured: Coloured,
    /// What the colours are of.
    coloured_by: (Colouring, f64, Theme, usize),
    indices: Arc<Indices>,
    deformed: Deformed,
    fields: Option<Fields>,
    mesh: Arc<BodyMesh>,
    generation: [u64; 2],
    /// The state that the mesh shows.
    shown: Option<Shown>,
    certificate: Option<Certificate>,
    /// m a newton, of arrows.
    pub metres_per_newton: f64,
}

impl Subject {
    /// Puts a body on show.
    pub fn new(opened: Opened, settings: &Settings) -> Self {
        let Opened { body, name, file } = opened;
        let surface = DrawnSurface::new(&body, settings.colouring.is_by_element());
        let coloured = colouring::colour(&body, &surface, Colouring::Plain, 0.0, None, settings.theme);
        // What the body answers at its deepest is drawn as long as the body is large.
        let depth = place::depth_range_m(&body);
        let some = (0..body.nodes().len()).step_by((body.nodes().len() / 500).max(1));
        let force = |node: usize| place::Place::of_node(&body, node).press(&body, depth).force_n;
        let most = some.map(force).fold(0.0, f64::max);
        let metres_per_newton = 0.9 * surface.radius / most.max(1e-3);
        let indices = Arc::new(scene::indices(&surface));
        let tool = DrawnTool::of(&body);
        let fields = Fields::of(&body);
        let mut subject = Subject {
            body,
            name,
            file,
            tool,
            surface,
            coloured,
            coloured_by: (Colouring::Plain, 0.0, settings.theme, 0),
            indices,
            deformed: Deformed::default(),
            fields,
            mesh: Arc::default(),
            generation: [generation(), generation()],
            shown: None,
            certificate: None,
            metres_per_newton,
        };
        subject.colour(settings);
        subject.draw(None);
        subject
    }

    /// As sessions want it.
    pub fn session_body(&self) -> SessionBody {
        SessionBody { source: self.body.clone(), file: self.file.clone() }
    }

    /// A camera that sees all of it.
    pub fn camera(&self) -> Camera {
        Camera::fitting(self.surface.origin, self.surface.radius)
    }

    /// Bounds of the certificate so far, if it is shown.
    pub fn certificate(&self) -> Option<Vec<Bounds>> {
        self.certificate.as_ref().map(Certificate::bounds)
    }

    /// Whether bounds of the certificate are still coming.
    pub fn is_bounding(&self) -> bool {
        self.certificate.as_ref().is_some_and(|c| !c.is_over())
    }

    /// Colours it anew where settings ask for other colours; true if it did.
    pub fn colour(&mut self, settings: &Settings) -> bool {
        let colouring = settings.colouring;
        if colouring == Colouring::Certificate {
            let assumptions = Assumptions {
                friction_factor: settings.friction_scale,
                slip: settings.slip.unwrap_or(self.body.slip()),
                ..Assumptions::default()
            };
            if self.certificate.as_ref().is_none_or(|c| c.assumptions != assumptions) {
                self.certificate = Some(Certificate::start(self.body.clone(), assumptions));
            }
        } else {
            self.certificate = None;
        }
        let known = self.certificate.as_ref().map_or(0, Certificate::len);
        let by = (colouring, settings.colour_depth_m, settings.theme, known);
        if by == self.coloured_by {
            return false;
        }
        self.coloured_by = by;
        if self.surface.is_split != colouring.is_by_element() {
            self.surface = DrawnSurface::new(&self.body, colouring.is_by_element());
            self.indices = Arc::new(scene::indices(&self.surface));
            self.generation[0] = generation();
            self.deformed = Deformed::default();
        }
        let bounds = self.certificate();
        let depth = settings.colour_depth_m;
        self.coloured =
            colouring::colour(&self.body, &self.surface, colouring, depth, bounds.as_deref(), settings.theme);
        let trouble = self.certificate.as_ref().and_then(Certificate::trouble);
        if let (Some(legend), Some(trouble)) = (&mut self.coloured.legend, trouble) {
            legend.note = trouble;
        }
        let shown = self.shown.take();
        self.draw_again(shown);
        true
    }

    /// Deforms it as in a state.
    pub fn draw(&mut self, shown: Option<&Shown>) {
        let same = match (&self.shown, shown) {
            (None, None) => !self.mesh.vertices.is_empty(),
            (Some(a), Some(b)) => a.contact == b.contact && a.tool == b.tool,
            _ => false,
        };
        if !same {
            self.draw_again(shown.copied());
        }
    }

    fn draw_again(&mut self, shown: Option<Shown>) {
        let was_deformed = self.deformed.is_deformed;
        deform(&self.body, &self.surface, shown.as_ref(), self.fields.as_mut(), &mut self.deformed);
        self.shown = shown;
        // At rest before and now, and coloured as before: nothing to do.
        let drawn = &self.mesh.vertices;
        let colours_fit = || {
            let pairs = drawn.iter().zip(&self.coloured.vertices);
            drawn.len() == self.coloured.vertices.len()
                && pairs.into_iter().all(|(v, c)| v.colour == bytes(*c))
        };
        if was_deformed || self.deformed.is_deformed || !colours_fit() {
            self.mesh = Arc::new(scene::mesh(&self.deformed, &self.coloured));
            self.generation[1] = generation();
        }
    }

    /// The scene of what is drawn, as seen by `camera`.
    pub fn scene(&self, sight: &Sight, settings: &Settings, camera: Camera) -> Scene {
        let (solids, marks) =
            scene::contact_marks(&self.body, &self.tool, &self.surface, &self.coloured, sight);
        Scene {
            generation: self.generation,
            mesh: self.mesh.clone(),
            indices: self.indices.clone(),
            solids: solids.0,
            marks: marks.0,
            has_edges: settings.marks.edges,
            section: scene::section_plane(&self.surface, settings.section.as_ref()),
            camera,
            origin: self.surface.origin,
            theme: settings.theme,
        }
    }

    /// Where a ray meets the body at rest: the point and the unit vector into the body, m.
    pub fn aim(&self, ray: crate::camera::Ray) -> Option<[DVec3; 2]> {
        let far = ray.from.distance(self.surface.origin) + 2.0 * self.surface.radius;
        let touch = self.body.first_touch(ray.from, ray.from + ray.direction * far, 0.0)?;
        Some([self.body.point(touch.at), self.body.inward(touch.at)])
    }
}
