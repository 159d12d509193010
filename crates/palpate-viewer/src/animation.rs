//! Pictures that move, in one file: an animated PNG, which browsers, README pages and most viewers of pictures play.

use crate::offscreen::Picture;
use anyhow::{Context as _, Result, ensure};
use std::io::Write;
use std::path::Path;

/// Shades by which a pixel may be off before it is drawn anew: nobody sees them, and light that wanders over a body takes no room.
const UNSEEN: u8 = 2;
/// How long the first and the last picture stay, ms.
const STAYS_MS: u16 = 900;

/// Whether a name is that of an animated PNG.
///
/// # Errors
/// It ends otherwise.
pub fn check_name(path: &Path) -> Result<(), String> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    match extension.as_deref() {
        Some("png" | "apng") => Ok(()),
        _ => {
            Err(format!("{}: an animation is an animated PNG; give a name that ends in .png", path.display()))
        }
    }
}

/// Writes `count` pictures of one size, each shown for `period_ms`, again and again. The first and the last stay a moment.
///
/// # Errors
/// A picture can't be drawn; the file can't be written.
pub fn save(
    path: &Path,
    count: u32,
    period_ms: u16,
    mut draw: impl FnMut(u32) -> Result<Picture>,
) -> Result<()> {
    palpate::files::replace(path, |out| write(out, count, period_ms, &mut draw))
}

fn write(
    out: &mut dyn Write,
    count: u32,
    period_ms: u16,
    draw: &mut dyn FnMut(u32) -> Result<Picture>,
) -> Result<()> {
    let mut shown = draw(0)?;
    let [width, height] = shown.size;
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.set_animated(count, 0)?;
    encoder.set_blend_op(png::BlendOp::Over)?;
    let mut writer = encoder.write_header()?;
    for k in 0..count {
        let stays = if k == 0 || k + 1 == count { STAYS_MS.max(period_ms) } else { period_ms };
        writer.set_frame_delay(stays, 1000)?;
        if k == 0 {
            writer.write_image_data(&shown.pixels)?;
            continue;
        }
        let picture = draw(k).with_context(|| format!("picture {k}"))?;
        ensure!(picture.size == shown.size, "picture {k} has another size");
        let Change { at, size, pixels } = Change::make(&mut shown, &picture);
        // The position first would be checked against the size of the picture before.
        writer.reset_frame_position()?;
        writer.set_frame_dimension(size[0], size[1])?;
        writer.set_frame_position(at[0], at[1])?;
        writer.write_image_data(&pixels)?;
    }
    writer.finish()?;
    Ok(())
}

/// What of a picture differs from what is shown: a rectangle whose other pixels let through what is there.
#[derive(Debug, PartialEq)]
struct Change {
    at: [u32; 2],
    size: [u32; 2],
    pixels: Vec<u8>,
}

impl Change {
    /// From what is shown, which it changes, to the next picture.
    fn make(shown: &mut Picture, next: &Picture) -> Self {
        let width = next.size[0] as usize;
        let is_seen = |(a, b): (&[u8], &[u8])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > UNSEEN);
        let pairs = shown.pixels.chunks_exact(4).zip(next.pixels.chunks_exact(4));
        let seen: Vec<bool> = pairs.map(is_seen).collect();
        let places = (0..seen.len()).filter(|i| seen[*i]).map(|i| [i % width, i / width]);
        let ends = places.fold(None, |ends: Option<[[usize; 2]; 2]>, [x, y]| {
            let [[left, top], [right, bottom]] = ends.unwrap_or([[x, y]; 2]);
            Some([[left.min(x), top.min(y)], [right.max(x), bottom.max(y)]])
        });
        // A picture that is the same still takes its time: one pixel that changes nothing.
        let [[left, top], [right, bottom]] = ends.unwrap_or_default();
        let mut pixels = Vec::new();
        for i in (top..=bottom).flat_map(|y| (left..=right).map(move |x| y * width + x)) {
            if seen[i] {
                let pixel = &next.pixels[4 * i..4 * i + 4];
                shown.pixels[4 * i..4 * i + 4].copy_from_slice(pixel);
                pixels.extend(pixel);
            } else {
                pixels.extend([0; 4]);
            }
        }
        Change {
            at: [left, top].map(|x| x as u32),
            size: [right - left + 1, bottom - top + 1].map(|x| x as u32),
            pixels,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(marked: Option<(usize, u8)>) -> Picture {
        let mut pixels = [10, 20, 30, 255].repeat(8 * 6);
        if let Some((at, shade)) = marked {
            pixels[4 * at] = shade;
        }
        Picture { size: [8, 6], pixels }
    }

    /// Read back frame by frame and laid over each other, the pictures are those that were written.
    #[test]
    fn what_is_read_back_is_what_was_drawn() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.png");
        let pictures =
            [picture(None), picture(Some((13, 99))), picture(Some((13, 99))), picture(Some((46, 7)))];
        save(&file, 4, 40, |k| Ok(pictures[k as usize].clone())).unwrap();
        let mut reader = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&file).unwrap()))
            .read_info()
            .unwrap();
        let animation = *reader.info().animation_control().unwrap();
        assert_eq!((animation.num_frames, animation.num_plays), (4, 0));
        let mut canvas = vec![0; 4 * 8 * 6];
        for (k, picture) in pictures.iter().enumerate() {
            let mut buffer = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut buffer).unwrap();
            let frame = *reader.info().frame_control().unwrap();
            let stays = if k == 0 || k == 3 { STAYS_MS } else { 40 };
            assert_eq!((frame.delay_num, frame.delay_den), (stays, 1000));
            for (i, pixel) in buffer.chunks_exact(4).take((frame.width * frame.height) as usize).enumerate() {
                let (x, y) =
                    (i as u32 % frame.width + frame.x_offset, i as u32 / frame.width + frame.y_offset);
                let at = 4 * (y * 8 + x) as usize;
                if pixel[3] == 255 {
                    canvas[at..at + 4].copy_from_slice(pixel);
                }
            }
            assert_eq!(canvas, picture.pixels, "picture {k}");
        }
    }

    #[test]
    fn a_picture_that_can_t_be_drawn_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.png");
        let draw = |k| if k < 2 { Ok(picture(None)) } else { Err(anyhow::anyhow!("the adapter failed")) };
        let error = save(&file, 4, 40, draw).unwrap_err();
        assert!(format!("{error:#}").contains("adapter failed"), "{error:#}");
        assert!(!file.exists());
        assert!(check_name(&file).is_ok());
        assert!(check_name(Path::new("a.gif")).unwrap_err().contains(".png"));
    }
}
