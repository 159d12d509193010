//! What the body's surface is coloured by, and the legend that says what colours mean.

use crate::palette::{ColourMap, Rgb, Theme};
use crate::place::{self, Place};
use crate::surface::DrawnSurface;
use glam::DVec3;
use palpate::Body;
use palpate::engine::certify::Bounds;

/// What colours show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Colouring {
    /// One colour, as of flesh.
    #[default]
    Plain,
    /// Normal stiffness at a depth.
    Stiffness,
    /// Friction coefficient at a depth.
    Friction,
    /// Test points, and how far their curves are from the load paths they were made from.
    TestPoints,
    /// How far a place is from test points, in what it blends.
    Interpolation,
    /// The margin of the certificate of passivity, element by element.
    Certificate,
    /// Energy stored by a press to a depth.
    Energy,
}

impl Colouring {
    /// All, in the order in which the key C goes through them.
    pub const ALL: [Colouring; 7] = [
        Colouring::Plain,
        Colouring::Stiffness,
        Colouring::Friction,
        Colouring::TestPoints,
        Colouring::Interpolation,
        Colouring::Certificate,
        Colouring::Energy,
    ];

    /// As options name it.
    pub fn name(self) -> &'static str {
        match self {
            Colouring::Plain => "plain",
            Colouring::Stiffness => "stiffness",
            Colouring::Friction => "friction",
            Colouring::TestPoints => "test-points",
            Colouring::Interpolation => "interpolation",
            Colouring::Certificate => "certificate",
            Colouring::Energy => "energy",
        }
    }

    /// As a menu names it.
    pub fn title(self) -> &'static str {
        match self {
            Colouring::Plain => "No colouring",
            Colouring::Stiffness => "Normal stiffness",
            Colouring::Friction => "Friction coefficient",
            Colouring::TestPoints => "Test points' errors",
            Colouring::Interpolation => "Interpolation",
            Colouring::Certificate => "Passivity margin",
            Colouring::Energy => "Stored energy",
        }
    }

    /// Whether it is of a press to a depth that can be chosen.
    pub fn has_depth(self) -> bool {
        matches!(self, Colouring::Stiffness | Colouring::Friction | Colouring::Energy)
    }

    /// Whether each element has a colour of its own.
    pub fn is_by_element(self) -> bool {
        self == Colouring::Certificate
    }
}

impl std::str::FromStr for Colouring {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Colouring::ALL.into_iter().find(|c| c.name() == text);
        found.ok_or_else(|| {
            let names = Colouring::ALL.map(Colouring::name).join(", ");
            format!("`{text}` is no colouring; give one of {names}")
        })
    }
}

/// What colours mean.
#[derive(Debug, Clone, PartialEq)]
pub struct Legend {
    /// What is shown.
    pub title: String,
    /// Its unit; empty for none.
    pub unit: &'static str,
    /// The values at both ends.
    pub range: [f64; 2],
    /// From values to colours.
    pub map: ColourMap,
    /// What else is to be known; or why there is nothing to see.
    pub note: String,
    /// Whether any place has a value.
    pub has_values: bool,
}

/// The surface's colours.
#[derive(Debug, Clone, PartialEq)]
pub struct Coloured {
    /// Of each vertex.
    pub vertices: Vec<Rgb>,
    /// `None` where there is one colour.
    pub legend: Option<Legend>,
    /// Test points to be marked, m in the body's frame.
    pub marks: Vec<DVec3>,
}

/// Colours of a body's surface. `certificate` has the bounds of each element, as far as they are known.
pub fn colour(
    body: &Body,
    surface: &DrawnSurface,
    colouring: Colouring,
    depth_m: f64,
    certificate: Option<&[Bounds]>,
    theme: Theme,
) -> Coloured {
    let at_depth = |what: &str| format!("{what} at {:.1} mm", depth_m * 1e3);
    let of_press = |of: &dyn Fn(&place::Press) -> f64| {
        of_nodes(body, surface, |node| of(&Place::of_node(body, node).press(body, depth_m)))
    };
    let mut note = String::new();
    let (values, title, unit, map) = match colouring {
        Colouring::Plain => {
            let vertices = vec![theme.colours().flesh; surface.positions.len()];
            return Coloured { vertices, legend: None, marks: Vec::new() };
        }
        Colouring::Stiffness => {
            (of_press(&|p| p.stiffness_n_per_m), at_depth("normal stiffness"), "N/m", ColourMap::Viridis)
        }
        Colouring::Friction => {
            (of_press(&|p| p.friction), at_depth("friction coefficient"), "", ColourMap::Viridis)
        }
        Colouring::Energy => {
            (of_press(&|p| p.energy_j * 1e3), at_depth("energy of a press"), "mJ", ColourMap::Viridis)
        }
        Colouring::TestPoints => {
            let errors = test_point_errors(body);
            if errors.is_none() {
                note = "The body's file tells no errors: its curves were given or measured, not simulated."
                    .into();
            }
            let of = |node: usize| {
                let errors = errors.as_ref()?;
                let terms = Place::of_node(body, node).terms;
                terms.iter().map(|&(t, w)| errors.get(t as usize).map(|e| w * e)).sum::<Option<f64>>()
            };
            let values = of_nodes(body, surface, |node| of(node).unwrap_or(f64::NAN));
            (
                values,
                "largest error of the curves, in parts of the largest force".into(),
                "%",
                ColourMap::Viridis,
            )
        }
        Colouring::Interpolation => {
            note = "100 % at a test point; 33 % where three are blended alike.".into();
            let nearest = |node: usize| {
                let terms = Place::of_node(body, node).terms;
                terms.iter().map(|(_, w)| w * 100.0).fold(0.0, f64::max)
            };
            (
                of_nodes(body, surface, nearest),
                "share of the nearest test point".into(),
                "%",
                ColourMap::Viridis,
            )
        }
        Colouring::Certificate => {
            let known = certificate.unwrap_or_default();
            note = match known.len() {
                0 => "Being bounded: no element is done yet.".into(),
                n if n < body.elements().len() => {
                    format!("{n} of {} elements are bounded.", body.elements().len())
                }
                _ => "0 or more: no slip on the element gives out energy. Below 0: not proved.".into(),
            };
            let of = |v: usize| {
                let bound = known.get(surface.elements[v] as usize).map(|b| b.proved);
                // Without any slip there is nothing to bound.
                bound.map_or(f64::NAN, |b| if b.is_finite() { b.clamp(-1.0, 1.0) } else { b.signum() })
            };
            let values = (0..surface.positions.len()).map(of).collect();
            (values, "proved margin of passivity".into(), "", ColourMap::Diverging)
        }
    };
    let range = match colouring {
        Colouring::Interpolation => [100.0 / 3.0, 100.0],
        _ => range_of(&values, map),
    };
    let span = range[1] - range[0];
    let share = |v: f64| if span > 0.0 { (v - range[0]) / span } else { 0.5 + 0.0 * v };
    let marks = match colouring {
        Colouring::TestPoints | Colouring::Interpolation => test_points(body),
        _ => Vec::new(),
    };
    let has_values = values.iter().any(|v| v.is_finite());
    let legend = Legend { title, unit, range, map, note, has_values };
    Coloured { vertices: values.into_iter().map(|v| map.at(share(v))).collect(), legend: Some(legend), marks }
}

/// Blended from the nodes, each asked once.
fn of_nodes(body: &Body, surface: &DrawnSurface, of: impl Fn(usize) -> f64) -> Vec<f64> {
    let values: Vec<f64> = (0..body.nodes().len()).map(of).collect();
    surface.blend(body, &values)
}

/// From the least to the greatest; about 0 where signs matter.
fn range_of(values: &[f64], map: ColourMap) -> [f64; 2] {
    let finite = values.iter().copied().filter(|v| v.is_finite());
    let [least, most] = finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
    if least > most {
        return [0.0, 1.0];
    }
    match map {
        ColourMap::Viridis => [least, most],
        ColourMap::Diverging => {
            let most = least.abs().max(most.abs()).max(1e-3);
            [-most, most]
        }
    }
}

/// Of each test point, in % of its largest force; `None` where the body tells none.
fn test_point_errors(body: &Body) -> Option<Vec<f64>> {
    let provenance = body.provenance();
    let percent = |error: f64, of: f64| if of > 0.0 { 100.0 * error / of } else { 0.0 };
    if !provenance.point_errors.is_empty() {
        let of = |e: &palpate::body::PointErrors| percent(e.normal_n.max(e.lateral_n), e.largest_force_n);
        return Some(provenance.point_errors.iter().map(of).collect());
    }
    let errors = &provenance.potential_errors;
    if errors.is_empty() {
        return None;
    }
    let of = |node: &u32| {
        let found = errors.iter().find(|e| e.node == *node);
        found.map_or(f64::NAN, |e| e.within.normal_percent[1].max(e.within.lateral_percent[1]))
    };
    Some(body.test_point_nodes().iter().map(of).collect())
}

/// Where they are, m.
pub fn test_points(body: &Body) -> Vec<DVec3> {
    let position = |n: &u32| body.nodes().get(*n as usize).map(|node| node.position);
    body.test_point_nodes().iter().filter_map(position).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gallery::Example;

    #[test]
    fn every_colouring_says_what_it_shows() {
        let body = Example::Cylinder.make().unwrap();
        for colouring in Colouring::ALL {
            let surface = DrawnSurface::new(&body, colouring.is_by_element());
            let bounds =
                vec![Bounds { proved: 0.2, found: 0.3, at: None, evaluations: 1 }; body.elements().len()];
            let coloured = colour(&body, &surface, colouring, 4e-3, Some(&bounds), Theme::Light);
            assert_eq!(coloured.vertices.len(), surface.positions.len());
            assert_eq!(coloured.legend.is_none(), colouring == Colouring::Plain);
            assert_eq!(colouring.name().parse::<Colouring>(), Ok(colouring));
            let Some(legend) = coloured.legend else { continue };
            assert!(!legend.title.is_empty() && legend.range[0] <= legend.range[1], "{legend:?}");
            // The paper's cylinder was given by a law: it knows no errors, and says so.
            assert_eq!(legend.has_values, colouring != Colouring::TestPoints, "{legend:?}");
        }
        assert!("hue".parse::<Colouring>().unwrap_err().contains("stiffness"));
    }

    /// The paper's stiffness 100 k_z δ² has the slope 200 k_z δ; its body is 1.5 times as stiff on one side as on average.
    #[test]
    fn the_legend_of_stiffness_is_in_newtons_per_metre() {
        let body = Example::Cylinder.make().unwrap();
        let surface = DrawnSurface::new(&body, false);
        let legend = colour(&body, &surface, Colouring::Stiffness, 4e-3, None, Theme::Light).legend.unwrap();
        let mean = 200.0 * 600.0 * 4e-3;
        assert!(legend.range[1] > 1.3 * mean && legend.range[1] < 1.9 * mean, "{legend:?}");
        assert!(legend.range[0] > 0.2 * mean && legend.range[0] < 0.7 * mean, "{legend:?}");
        assert_eq!(legend.unit, "N/m");
    }
}
