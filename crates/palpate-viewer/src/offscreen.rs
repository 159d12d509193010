//! The window's contents without a window: for screenshots, sequences, and tests.

use crate::renderer::{self, Renderer};
use crate::scene::Scene;
use crate::state::Viewer;
use crate::ui;
use eframe::egui_wgpu::{
    RenderState, RendererOptions, ScreenDescriptor, WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew,
};
use eframe::{egui, wgpu};
use std::path::Path;

/// Why nothing can be drawn.
#[derive(Debug, thiserror::Error)]
pub enum DrawError {
    /// There is no adapter, neither a graphics card nor a program that draws in its place.
    #[error(
        "there is nothing to draw with: no graphics card with Vulkan, Metal, Direct3D 12 or OpenGL, and no program in its place ({0}); \
         on Debian and Ubuntu install mesa-vulkan-drivers, elsewhere a Vulkan driver such as Mesa's lavapipe"
    )]
    NoAdapter(String),
    /// The adapter gave up.
    #[error("the graphics adapter failed ({0}); update its driver, or take a smaller picture")]
    Lost(String),
    /// The picture can't be written.
    #[error("{0}")]
    Unwritable(String),
    /// More pixels than an adapter can.
    #[error("a picture of {0} × {1} pixels; give from 64 to 8,192 each way")]
    Size(u32, u32),
}

/// Pixels, four bytes each: red, green, blue, and 255.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Across and down.
    pub size: [u32; 2],
    /// Row by row from the top.
    pub pixels: Vec<u8>,
}

impl Picture {
    /// Writes it as a PNG, whole or not at all.
    ///
    /// # Errors
    /// The file can't be written.
    pub fn save(&self, path: &Path) -> Result<(), DrawError> {
        let write = |out: &mut dyn std::io::Write| {
            let mut encoder = png::Encoder::new(out, self.size[0], self.size[1]);
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_depth(png::BitDepth::Eight);
            encoder.set_compression(png::Compression::Balanced);
            let mut writer = encoder.write_header()?;
            let rgb: Vec<u8> = self.pixels.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
            writer.write_image_data(&rgb)?;
            writer.finish()?;
            Ok(())
        };
        palpate::files::replace(path, write).map_err(|e| DrawError::Unwritable(palpate::files::message(&e)))
    }
}

/// An adapter and all that draws with it. `steady` wants the same pixels on every machine, as tests do: a program as adapter
/// before any card, and no dithering.
///
/// # Errors
/// There is no adapter.
pub fn render_state(samples: u32, steady: bool) -> Result<RenderState, DrawError> {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    if steady {
        setup.native_adapter_selector = Some(std::sync::Arc::new(|adapters, _| {
            let is_program = |a: &&wgpu::Adapter| a.get_info().device_type == wgpu::DeviceType::Cpu;
            let is_vulkan = |a: &&wgpu::Adapter| a.get_info().backend == wgpu::Backend::Vulkan;
            let found = adapters.iter().find(|a| is_program(a) && is_vulkan(a)).or_else(|| adapters.first());
            found.cloned().ok_or_else(|| "no adapter was found".into())
        }));
    }
    let configuration = WgpuConfiguration { wgpu_setup: WgpuSetup::CreateNew(setup), ..Default::default() };
    let options = if steady { RendererOptions::PREDICTABLE } else { RendererOptions::default() };
    let instance = pollster::block_on(configuration.wgpu_setup.new_instance());
    let state = pollster::block_on(RenderState::create(&configuration, &instance, None, options));
    let state = state.map_err(|e| DrawError::NoAdapter(e.to_string()))?;
    renderer::install(&state, samples);
    Ok(state)
}

/// Draws viewers into pictures.
pub struct Offscreen {
    state: RenderState,
    ctx: egui::Context,
    time_s: f64,
}

impl Offscreen {
    /// On whatever adapter there is.
    ///
    /// # Errors
    /// There is none.
    pub fn new(steady: bool) -> Result<Self, DrawError> {
        Self::with_samples(steady, 4)
    }

    /// The same with so many samples a pixel, 1 or 4.
    ///
    /// # Errors
    /// There is none.
    pub fn with_samples(steady: bool, samples: u32) -> Result<Self, DrawError> {
        let state = render_state(samples, steady)?;
        let ctx = egui::Context::default();
        ui::set_up(&ctx);
        Ok(Offscreen { state, ctx, time_s: 0.0 })
    }

    /// The adapter's name and kind.
    pub fn adapter(&self) -> String {
        let info = self.state.adapter.get_info();
        format!("{} ({:?}, {:?})", info.name, info.device_type, info.backend)
    }

    /// The whole window, `size` pixels large, with `scale` pixels a point.
    ///
    /// # Errors
    /// [`DrawError::Size`], [`DrawError::Lost`].
    pub fn window(&mut self, viewer: &mut Viewer, size: [u32; 2], scale: f32) -> Result<Picture, DrawError> {
        check(size)?;
        // Twice before: what is laid out in one frame is measured in the one before.
        self.frame(viewer, size, scale)?;
        self.frame(viewer, size, scale)?;
        self.frame(viewer, size, scale)
    }

    /// One frame of it, as a display would show it.
    ///
    /// # Errors
    /// As [`Offscreen::window`].
    pub fn frame(&mut self, viewer: &mut Viewer, size: [u32; 2], scale: f32) -> Result<Picture, DrawError> {
        check(size)?;
        let points = egui::vec2(size[0] as f32, size[1] as f32) / scale;
        let mut input = egui::RawInput {
            screen_rect: Some(egui::Rect::from_min_size(egui::Pos2::ZERO, points)),
            time: Some(self.time_s),
            focused: true,
            ..Default::default()
        };
        input.viewports.entry(egui::ViewportId::ROOT).or_default().native_pixels_per_point = Some(scale);
        self.time_s += 1.0 / 60.0;
        let mut events = Vec::new();
        let output = self.ctx.run_ui(input, |ui| events.extend(ui::show(viewer, ui)));
        viewer.update(events);
        let jobs = self.ctx.tessellate(output.shapes, output.pixels_per_point);
        let RenderState { device, queue, target_format, renderer, .. } = &self.state;
        let mut renderer = renderer.write();
        let mut textures = output.textures_delta;
        for (id, deltas) in textures.set.drain() {
            deltas.iter().for_each(|delta| renderer.update_texture(device, queue, id, delta));
        }
        let screen = ScreenDescriptor { size_in_pixels: size, pixels_per_point: output.pixels_per_point };
        let mut encoder = device.create_command_encoder(&Default::default());
        let before = renderer.update_buffers(device, queue, &mut encoder, &jobs, &screen);
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("window"),
            size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: *target_format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = texture.create_view(&Default::default());
        {
            let attachment = wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
                },
            };
            let pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("window"),
                color_attachments: &[Some(attachment)],
                ..Default::default()
            });
            renderer.render(&mut pass.forget_lifetime(), &jobs, &screen);
        }
        queue.submit(before.into_iter().chain([encoder.finish()]));
        textures.free.drain().for_each(|id| renderer.free_texture(&id));
        read(device, queue, &texture)
    }

    /// The body alone, without panels.
    ///
    /// # Errors
    /// As [`Offscreen::window`].
    pub fn scene(&mut self, scene: &Scene, size: [u32; 2]) -> Result<Picture, DrawError> {
        check(size)?;
        let RenderState { device, queue, renderer, .. } = &self.state;
        let mut egui = renderer.write();
        let lost = || DrawError::Lost("it has no renderer".into());
        let renderer = egui.callback_resources.get_mut::<Renderer>().ok_or_else(lost)?;
        let mut encoder = device.create_command_encoder(&Default::default());
        renderer.draw(device, queue, &mut encoder, scene, size);
        queue.submit([encoder.finish()]);
        read(device, queue, renderer.picture().ok_or_else(lost)?)
    }
}

impl std::fmt::Debug for Offscreen {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Offscreen").field("adapter", &self.adapter()).finish_non_exhaustive()
    }
}

fn check(size: [u32; 2]) -> Result<(), DrawError> {
    let fits = size.iter().all(|s| (64..=8192).contains(s));
    if fits { Ok(()) } else { Err(DrawError::Size(size[0], size[1])) }
}

/// A texture's pixels.
fn read(device: &wgpu::Device, queue: &wgpu::Queue, texture: &wgpu::Texture) -> Result<Picture, DrawError> {
    let (width, height) = (texture.width(), texture.height());
    let row = 4 * width;
    let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("picture"),
        size: u64::from(padded) * u64::from(height),
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(padded),
                rows_per_image: None,
            },
        },
        texture.size(),
    );
    queue.submit([encoder.finish()]);
    let lost = |e: String| DrawError::Lost(e);
    let (sender, receiver) = std::sync::mpsc::channel();
    buffer.map_async(wgpu::MapMode::Read, .., move |result| drop(sender.send(result)));
    device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| lost(e.to_string()))?;
    let mapped = receiver.recv().map_err(|e| lost(e.to_string()))?;
    mapped.map_err(|e| lost(e.to_string()))?;
    let bytes = buffer.slice(..).get_mapped_range().map_err(|e| lost(e.to_string()))?;
    let is_bgra =
        matches!(texture.format(), wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Bgra8UnormSrgb);
    let mut pixels = Vec::with_capacity((row * height) as usize);
    for line in bytes.chunks_exact(padded as usize) {
        for p in line[..row as usize].chunks_exact(4) {
            pixels.extend(if is_bgra { [p[2], p[1], p[0], 255] } else { [p[0], p[1], p[2], 255] });
        }
    }
    Ok(Picture { size: [width, height], pixels })
}
