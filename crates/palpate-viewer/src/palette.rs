//! Colours: maps that most eyes tell apart and that read in grey, and the window's own.

use palpate::colours;

/// Red, green, blue as a screen has them, 0 to 1.
pub type Rgb = [f32; 3];

/// From values to colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ColourMap {
    /// From dark blue over green to yellow: monotone in lightness.
    Viridis,
    /// From blue over white to orange: for what has a sign.
    Diverging,
}

/// Blue and orange differ to every common kind of colour blindness.
const DIVERGING: [[u8; 3]; 5] =
    [[20, 80, 150], [110, 165, 215], [240, 240, 238], [240, 165, 85], [175, 80, 10]];

impl ColourMap {
    /// At `share`, from 0 to 1; what is no number is grey.
    pub fn at(self, share: f64) -> Rgb {
        if share.is_nan() {
            return [0.55, 0.55, 0.55];
        }
        let colour = match self {
            ColourMap::Viridis => colours::viridis(share),
            ColourMap::Diverging => colours::between(&DIVERGING, share),
        };
        colour.map(|c| c as f32)
    }
}

/// Light or dark.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Theme {
    /// Dark letters on light ground.
    #[default]
    Light,
    /// Light letters on dark ground.
    Dark,
}

/// The colours of one theme; those of curves are Okabe and Ito's, which all common kinds of colour blindness tell apart.
#[derive(Debug, Clone, Copy)]
pub struct Colours {
    /// Behind the body, above and below.
    pub ground: [Rgb; 2],
    /// The body without a colouring.
    pub flesh: Rgb,
    /// The body's inside, where a section shows it.
    pub inside: Rgb,
    /// The tool.
    pub tool: Rgb,
    /// The force on the tool.
    pub force: Rgb,
    /// The torque on the tool.
    pub torque: Rgb,
    /// The contact point and its triangle.
    pub contact: Rgb,
    /// Its track.
    pub track: Rgb,
    /// Where the hand wants the tool to be.
    pub target: Rgb,
    /// Edges of elements.
    pub edges: Rgb,
    /// First, second and third curve of a panel.
    pub curves: [Rgb; 4],
    /// The frame's two lateral directions and the normal.
    pub frame: [Rgb; 3],
}

impl Theme {
    /// Its colours.
    pub fn colours(self) -> Colours {
        let blue = [0.0, 0.447, 0.698];
        let vermilion = [0.835, 0.369, 0.0];
        let green = [0.0, 0.620, 0.451];
        let (sky, amber, purple) = ([0.337, 0.706, 0.914], [0.902, 0.624, 0.0], [0.8, 0.475, 0.655]);
        match self {
            Theme::Light => Colours {
                ground: [[0.965, 0.972, 0.980], [0.845, 0.872, 0.898]],
                flesh: [0.880, 0.690, 0.625],
                inside: [0.720, 0.420, 0.385],
                tool: [0.56, 0.60, 0.65],
                force: vermilion,
                torque: purple,
                contact: [0.06, 0.06, 0.08],
                track: blue,
                target: green,
                edges: [0.25, 0.20, 0.20],
                curves: [blue, vermilion, green, purple],
                frame: [sky, green, amber],
            },
            Theme::Dark => Colours {
                ground: [[0.150, 0.165, 0.185], [0.065, 0.072, 0.085]],
                flesh: [0.790, 0.595, 0.535],
                inside: [0.560, 0.310, 0.290],
                tool: [0.66, 0.70, 0.75],
                force: [1.0, 0.52, 0.12],
                torque: purple,
                contact: [0.98, 0.98, 0.95],
                track: sky,
                target: [0.20, 0.80, 0.60],
                edges: [0.10, 0.08, 0.08],
                curves: [sky, [1.0, 0.52, 0.12], [0.20, 0.80, 0.60], purple],
                frame: [sky, [0.20, 0.80, 0.60], amber],
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_outside_has_the_end_s_colour() {
        for map in [ColourMap::Viridis, ColourMap::Diverging] {
            assert_eq!((map.at(-1.0), map.at(f64::INFINITY)), (map.at(0.0), map.at(1.0)));
            assert!(map.at(f64::NAN).iter().all(|c| *c == 0.55));
        }
    }
}
