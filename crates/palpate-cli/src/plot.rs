//! Line charts as PNG files, drawn with the font that the program carries: no system font is needed.

use anyhow::{Context, Result, anyhow, bail};
use palpate_files as files;
use plotters::prelude::*;
use std::ops::Range;
use std::path::Path;
use std::sync::Once;

/// DejaVu Sans; its licence is in `assets/DejaVuSans.licence.txt`.
const FONT: &[u8] = include_bytes!("../assets/DejaVuSans.ttf");

/// Makes the font known to plotters as `sans-serif`. Call it before drawing; again does no harm.
pub fn use_font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // A font that can't be read would show when the first text is drawn, as an error there.
        let _ = plotters::style::register_font("sans-serif", FontStyle::Normal, FONT);
    });
}

/// Colours that stay apart for most eyes (Okabe and Ito 2008).
pub const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(120, 120, 120),
    RGBColor(0, 0, 0),
];

/// One line of a chart.
#[derive(Debug, Clone, Default)]
pub struct Line {
    /// Its entry in the legend; empty for none.
    pub name: String,
    /// (x, y), in the units that the axes name.
    pub points: Vec<(f64, f64)>,
    /// Single values beside the line, in its colour.
    pub dots: Vec<(f64, f64)>,
}

impl Line {
    fn all(&self) -> impl Iterator<Item = &(f64, f64)> {
        self.points.iter().chain(&self.dots)
    }
}

/// A chart with one pair of axes.
#[derive(Debug, Clone, Default)]
pub struct LineChart {
    /// Above it.
    pub title: String,
    /// With the unit.
    pub x_label: String,
    /// With the unit.
    pub y_label: String,
    /// In the order of the legend.
    pub lines: Vec<Line>,
    /// Whether y starts at 0, as it should where the height itself means something.
    pub from_zero: bool,
}

/// Width of a picture, pixels.
const WIDTH: u32 = 1100;
/// Height of one chart, pixels.
const HEIGHT: u32 = 640;

/// Draws `charts` one below the other into a PNG file.
///
/// # Errors
/// No chart, a chart without a finite point, or a file that can't be written.
pub fn save(path: &Path, charts: &[LineChart]) -> Result<()> {
    if charts.is_empty() {
        bail!("{}: no chart to draw", path.display());
    }
    let bytes = png((WIDTH, HEIGHT * charts.len() as u32), |area| {
        area.fill(&WHITE)?;
        for (panel, chart) in area.split_evenly((charts.len(), 1)).iter().zip(charts) {
            draw(panel, chart)?;
        }
        Ok(())
    })
    .with_context(|| format!("{}: can't draw the picture", path.display()))?;
    files::replace(path, |out| Ok(out.write_all(&bytes)?))
}

/// The bytes of a PNG file of this many pixels.
///
/// # Errors
/// Whatever `draw` reports, or a folder for temporary files that can't be written: the encoder writes only files.
pub fn png(size: (u32, u32), draw: impl FnOnce(&Panel) -> Result<()>) -> Result<Vec<u8>> {
    use_font();
    let unwritable = "the folder for temporary files can't be written; check that it has room, or set TMPDIR";
    let folder = tempfile::tempdir().map_err(|_| anyhow!(unwritable))?;
    let file = folder.path().join("picture.png");
    let area = BitMapBackend::new(&file, size).into_drawing_area();
    draw(&area)?;
    area.present().map_err(|_| anyhow!(unwritable))?;
    drop(area);
    std::fs::read(&file).map_err(|_| anyhow!(unwritable))
}

/// Where a chart is drawn.
pub type Panel<'a> = DrawingArea<BitMapBackend<'a>, plotters::coord::Shift>;

fn draw(panel: &Panel, chart: &LineChart) -> Result<()> {
    let [x, y] = ranges(chart).ok_or_else(|| anyhow!("the chart '{}' holds no finite point", chart.title))?;
    let mut context = ChartBuilder::on(panel)
        .caption(&chart.title, ("sans-serif", 26))
        .margin(18)
        .x_label_area_size(58)
        .y_label_area_size(84)
        .build_cartesian_2d(x.clone(), y.clone())?;
    context
        .configure_mesh()
        .x_desc(&chart.x_label)
        .y_desc(&chart.y_label)
        .axis_desc_style(("sans-serif", 20))
        .label_style(("sans-serif", 17))
        .light_line_style(BLACK.mix(0.04))
        .bold_line_style(BLACK.mix(0.12))
        .x_label_formatter(&|v| tidy(*v, x.end - x.start))
        .y_label_formatter(&|v| tidy(*v, y.end - y.start))
        .draw()?;
    for (i, line) in chart.lines.iter().enumerate() {
        // Past the palette's end the lines are thinner, so that no two look alike.
        let style = COLOURS[i % COLOURS.len()].stroke_width(if i < COLOURS.len() { 2 } else { 1 });
        let series = context.draw_series(LineSeries::new(line.points.iter().copied(), style))?;
        if !line.name.is_empty() {
            series.label(&line.name).legend(move |(x, y)| PathElement::new([(x, y), (x + 22, y)], style));
        }
        context.draw_series(line.dots.iter().map(|&dot| Circle::new(dot, 3, style.filled())))?;
    }
    if chart.lines.iter().any(|l| !l.name.is_empty()) {
        context
            .configure_series_labels()
            .position(legend_corner(chart, &x, &y))
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK.mix(0.3))
            .label_font(("sans-serif", 17))
            .draw()?;
    }
    Ok(())
}

/// The ranges of x and y, with some air above and below.
fn ranges(chart: &LineChart) -> Option<[Range<f64>; 2]> {
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    let points = chart.lines.iter().flat_map(Line::all).filter(|p| p.0.is_finite() && p.1.is_finite());
    for &(x, y) in points {
        for (i, v) in [x, y].into_iter().enumerate() {
            low[i] = low[i].min(v);
            high[i] = high[i].max(v);
        }
    }
    if low[0] > high[0] {
        return None;
    }
    if chart.from_zero {
        low[1] = low[1].min(0.0);
    }
    let spread = |i: usize| (high[i] - low[i]).max(1e-9 * high[i].abs()).max(1e-12);
    let air = 0.05 * spread(1);
    let bottom = if chart.from_zero && low[1] == 0.0 { 0.0 } else { low[1] - air };
    Some([low[0]..low[0] + spread(0), bottom..low[1] + spread(1) + air])
}

/// The corner where a legend hides the fewest points; the upper left one if it is free.
fn legend_corner(chart: &LineChart, x: &Range<f64>, y: &Range<f64>) -> SeriesLabelPosition {
    let (width, height) = (x.end - x.start, y.end - y.start);
    let hidden = |right: bool, upper: bool| {
        let points = chart.lines.iter().flat_map(Line::all);
        let beside = |v: f64| if right { v > x.end - 0.3 * width } else { v < x.start + 0.3 * width };
        let level = |v: f64| (v > y.start + 0.5 * height) == upper;
        points.filter(|p| beside(p.0) && level(p.1)).count()
    };
    [
        (hidden(false, true), SeriesLabelPosition::UpperLeft),
        (hidden(true, true), SeriesLabelPosition::UpperRight),
        (hidden(true, false), SeriesLabelPosition::LowerRight),
        (hidden(false, false), SeriesLabelPosition::LowerLeft),
    ]
    .into_iter()
    .min_by_key(|(count, _)| *count)
    .map_or(SeriesLabelPosition::UpperLeft, |(_, corner)| corner)
}

/// A tick's number with as many decimals as an axis of this extent needs.
fn tidy(value: f64, extent: f64) -> String {
    let decimals = (1.0 - (extent / 10.0).log10().floor()).clamp(0.0, 9.0) as usize;
    let text = format!("{value:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".into() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_short() {
        assert_eq!(tidy(2.0, 10.0), "2");
        assert_eq!(tidy(0.25, 0.5), "0.25");
        assert_eq!(tidy(-0.0, 1.0), "0");
        assert_eq!(tidy(1500.0, 3000.0), "1500");
    }

    #[test]
    fn a_chart_is_drawn() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let points = (0..20).map(|i| (f64::from(i), f64::from(i * i))).collect();
        let line = Line { name: "square".into(), points, ..Line::default() };
        let chart = LineChart {
            title: "A curve".into(),
            x_label: "x (mm)".into(),
            y_label: "y (N)".into(),
            lines: vec![line],
            from_zero: true,
        };
        save(&path, &[chart.clone(), chart]).unwrap();
        assert!(std::fs::read(&path).unwrap().starts_with(b"\x89PNG"));
        assert!(save(&path, &[LineChart::default()]).is_err());
    }
}
