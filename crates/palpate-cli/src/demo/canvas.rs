//! A picture: drawn at twice its size and averaged down, so that lines and letters have smooth edges.

use crate::plot::{png, use_font};
use anyhow::Result;
use plotters::coord::types::RangedCoordf64;
use plotters::coord::{CoordTranslate, Shift};
use plotters::element::BitMapElement;
use plotters::prelude::*;
use std::path::Path;

/// Where pictures are drawn, in pixels of half a final one.
pub type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;

/// A chart on such an area.
pub type Chart<'a, 'b> = ChartContext<'a, BitMapBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Ink for text and axes.
pub const INK: RGBColor = RGBColor(40, 40, 40);
/// Marks of clicks.
pub const RED: RGBColor = RGBColor(200, 30, 30);

/// Letters of `size` pixels of the drawing.
pub fn font(size: u32) -> TextStyle<'static> {
    ("sans-serif", size).into_font().color(&INK)
}

/// A thick line in a chart, with round joints.
///
/// # Errors
/// The backend's.
pub fn stroke(
    chart: &Chart,
    points: impl Iterator<Item = (f64, f64)>,
    colour: RGBAColor,
    width: u32,
) -> Result<()> {
    let plot = chart.plotting_area();
    let pixels: Vec<_> = points.map(|p| plot.map_coordinate(&p)).collect();
    // The pixels are those of the whole picture.
    let (x, y) = plot.get_base_pixel();
    let pixels: Vec<_> = pixels.into_iter().map(|p| (p.0 - x, p.1 - y)).collect();
    polyline(&plot.strip_coord_spec(), &pixels, colour, width)
}

/// The same with a name in the legend.
///
/// # Errors
/// The backend's.
pub fn named_stroke(
    chart: &mut Chart,
    name: &str,
    points: impl Iterator<Item = (f64, f64)>,
    colour: RGBColor,
    width: u32,
) -> Result<()> {
    stroke(chart, points, colour.into(), width)?;
    let nothing = std::iter::empty::<Circle<(f64, f64), u32>>();
    chart.draw_series(nothing)?.label(name).legend(key(colour.stroke_width(width)));
    Ok(())
}

/// A line's sign in the legend.
pub fn key(style: ShapeStyle) -> impl Fn((i32, i32)) -> PathElement<(i32, i32)> {
    move |(x, y)| PathElement::new([(x, y), (x + 40, y)], style)
}

/// Draws the legend: what has a name, and its sign.
///
/// # Errors
/// The backend's.
pub fn names<'a, 'b: 'a, C: CoordTranslate>(
    chart: &mut ChartContext<'a, BitMapBackend<'b>, C>,
    position: SeriesLabelPosition,
) -> Result<()> {
    chart
        .configure_series_labels()
        .position(position)
        .margin(24)
        .legend_area_size(50)
        .label_font(font(34))
        .background_style(WHITE.mix(0.9))
        .draw()?;
    Ok(())
}

/// A thick line through pixels, with round joints.
///
/// Segment by segment: one path would have long mitres, which look like overshoot at a jump. Points nearer together
/// than the line is wide are skipped, because whole pixels would make it ragged.
///
/// # Errors
/// The backend's.
pub fn polyline(area: &Area, pixels: &[(i32, i32)], colour: RGBAColor, width: u32) -> Result<()> {
    let Some((&first, rest)) = pixels.split_first() else { return Ok(()) };
    let near = width.max(4) as i32;
    let mut from = first;
    for (i, &to) in rest.iter().enumerate() {
        let jumps = rest.get(i + 1).is_some_and(|&next| (next.1 - to.1).abs() > 4 * near);
        if (to.0 - from.0).abs().max((to.1 - from.1).abs()) < near && i + 1 < rest.len() && !jumps {
            continue;
        }
        area.draw(&PathElement::new([from, to], colour.stroke_width(width)))?;
        if colour.3 == 1.0 {
            area.draw(&Circle::new(to, width / 2, colour.filled()))?;
        }
        from = to;
    }
    Ok(())
}

/// Paints a PNG file of `width` × `height` final pixels; `draw` gets an area of twice that.
///
/// # Errors
/// Whatever `draw` reports, or a file that can't be written.
pub fn paint(path: &Path, (width, height): (u32, u32), draw: impl FnOnce(&Area) -> Result<()>) -> Result<()> {
    use_font();
    let (w, h) = (width as usize, height as usize);
    let mut fine = vec![255; 12 * w * h];
    {
        let area = BitMapBackend::with_buffer(&mut fine, (2 * width, 2 * height)).into_drawing_area();
        draw(&area)?;
        area.present()?;
    }
    let mut pixels = Vec::with_capacity(3 * w * h);
    for rows in fine.chunks_exact(12 * w) {
        let (upper, lower) = rows.split_at(6 * w);
        for (u, l) in upper.chunks_exact(6).zip(lower.chunks_exact(6)) {
            let mean = |c: usize| [u[c], u[c + 3], l[c], l[c + 3]].map(u16::from).iter().sum::<u16>() / 4;
            pixels.extend([0, 1, 2].map(|c| mean(c) as u8));
        }
    }
    let picture = BitMapElement::with_owned_buffer((0, 0), (width, height), pixels);
    let picture = picture.ok_or_else(|| anyhow::anyhow!("a picture of the wrong size"))?;
    let bytes = png((width, height), |area| Ok(area.draw(&picture)?))?;
    Ok(std::fs::write(path, bytes)?)
}
