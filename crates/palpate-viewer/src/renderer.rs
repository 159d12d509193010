//! Draws a [`Scene`] into a texture of its own, with depth, and puts it into the window.
//!
//! The window's own pass has no depth: so the scene is drawn beside it ([`View`] is a paint callback), whoever drives the window: a
//! display, a test, or a screenshot.

use crate::scene::Scene;
use crate::solid::Vertex;
use eframe::egui_wgpu::{CallbackResources, CallbackTrait, ScreenDescriptor};
use eframe::{egui, wgpu};
use glam::{Mat4, Vec3, Vec4};
use std::sync::Arc;

const COLOUR: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Pixels along a side, at most: what every adapter can.
const LARGEST: u32 = 8192;

/// What the shader knows of a scene.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Uniforms {
    clip_from_body: [[f32; 4]; 4],
    section: [f32; 4],
    eye: [f32; 4],
    key_light: [f32; 4],
    fill_light: [f32; 4],
    inside: [f32; 4],
    ground_above: [f32; 4],
    ground_below: [f32; 4],
    edges: [f32; 4],
}

impl Uniforms {
    fn new(scene: &Scene, aspect: f32) -> Self {
        let colours = scene.theme.colours();
        let opaque = |[r, g, b]: [f32; 3]| [r, g, b, 1.0];
        let direction = |v: Vec3| v.normalize().extend(0.0).to_array();
        // Lights go with the camera: what one looks at is lit, from above one's left shoulder.
        let [right, up, back] = scene.camera.axes().map(|v| v.as_vec3());
        let origin = Mat4::from_translation(scene.origin.as_vec3());
        // The camera is in the body's frame, places are from the origin.
        let clip_from_body = scene.camera.clip_from_body(aspect) * origin;
        let eye = (scene.camera.eye() - scene.origin).as_vec3();
        let [above, below] = colours.ground;
        Uniforms {
            clip_from_body: clip_from_body.to_cols_array_2d(),
            section: scene.section,
            eye: Vec4::from((eye, 1.0)).to_array(),
            key_light: direction(-right * 0.45 + up * 0.75 + back),
            fill_light: direction(right * 0.9 - up * 0.25 + back * 0.4),
            inside: opaque(colours.inside),
            ground_above: opaque(above),
            ground_below: opaque(below),
            edges: opaque(colours.edges),
        }
    }
}

/// A buffer of vertices or indices that grows.
#[derive(Debug)]
struct Growing {
    buffer: wgpu::Buffer,
    usage: wgpu::BufferUsages,
    count: u32,
}

impl Growing {
    fn new(device: &wgpu::Device, usage: wgpu::BufferUsages) -> Self {
        Growing { buffer: Self::buffer(device, usage, 1024), usage, count: 0 }
    }

    fn buffer(device: &wgpu::Device, usage: wgpu::BufferUsages, size: u64) -> wgpu::Buffer {
        let usage = usage | wgpu::BufferUsages::COPY_DST;
        device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
    }

    fn fill<T: bytemuck::NoUninit>(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, values: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        if (bytes.len() as u64) > self.buffer.size() {
            self.buffer = Self::buffer(device, self.usage, (bytes.len() as u64).next_power_of_two());
        }
        if !bytes.is_empty() {
            queue.write_buffer(&self.buffer, 0, bytes);
        }
        self.count = values.len() as u32;
    }
}

/// Textures of one size.
#[derive(Debug)]
struct Target {
    size: [u32; 2],
    picture: wgpu::Texture,
    view: wgpu::TextureView,
    /// With several samples a pixel, where there are.
    samples: Option<wgpu::TextureView>,
    depth: wgpu::TextureView,
    shown: wgpu::BindGroup,
}

/// All that drawing needs on an adapter.
#[derive(Debug)]
pub struct Renderer {
    samples: u32,
    uniforms: wgpu::Buffer,
    scene: wgpu::BindGroup,
    ground: wgpu::RenderPipeline,
    body: wgpu::RenderPipeline,
    edges: wgpu::RenderPipeline,
    solid: wgpu::RenderPipeline,
    hidden: wgpu::RenderPipeline,
    blit: wgpu::RenderPipeline,
    blit_layout: wgpu::BindGroupLayout,
    sampler: wgpu::Sampler,
    target: Option<Target>,
    /// Of the indices and the vertices that the buffers hold.
    generation: Option<[u64; 2]>,
    mesh: Growing,
    triangles: Growing,
    edge_indices: Growing,
    solids: Growing,
    marks: Growing,
}

/// How a pipeline of the scene differs from another.
struct Draws {
    entry: &'static str,
    topology: wgpu::PrimitiveTopology,
    compare: wgpu::CompareFunction,
    writes_depth: bool,
    blends: bool,
    culls: bool,
    bias: i32,
}

impl Renderer {
    /// On this device, for windows of this format, with so many samples a pixel: 1 or 4.
    pub fn new(device: &wgpu::Device, window: wgpu::TextureFormat, samples: u32) -> Self {
        let scene_shader =
            shader(device, "scene", concat!(include_str!("scene.wgsl"), include_str!("whole.wgsl")));
        let blit_shader =
            shader(device, "blit", concat!(include_str!("blit.wgsl"), include_str!("whole.wgsl")));
        let uniforms = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("scene"),
            size: size_of::<Uniforms>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let scene_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("scene"),
            entries: &[wgpu::BindGroupLayoutEntry {
                binding: 0,
                visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Uniform,
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            }],
        });
        let scene = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("scene"),
            layout: &scene_layout,
            entries: &[wgpu::BindGroupEntry { binding: 0, resource: uniforms.as_entire_binding() }],
        });
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("scene"),
            bind_group_layouts: &[Some(&scene_layout)],
            immediate_size: 0,
        });
        let multisample = wgpu::MultisampleState { count: samples, ..Default::default() };
        let pipeline = |draws: Draws| {
            let is_ground = draws.entry == "ground";
            let blend = draws.blends.then_some(wgpu::BlendState::ALPHA_BLENDING);
            let color = wgpu::ColorTargetState { format: COLOUR, blend, write_mask: wgpu::ColorWrites::ALL };
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(draws.entry),
                layout: Some(&layout),
                vertex: wgpu::VertexState {
                    module: &scene_shader,
                    entry_point: Some(if is_ground { "whole" } else { "corner" }),
                    compilation_options: Default::default(),
                    buffers: if is_ground { &[] } else { std::slice::from_ref(&CORNERS) },
                },
                primitive: wgpu::PrimitiveState {
                    topology: draws.topology,
                    cull_mode: draws.culls.then_some(wgpu::Face::Back),
                    ..Default::default()
                },
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH,
                    depth_write_enabled: Some(draws.writes_depth),
                    depth_compare: Some(draws.compare),
                    stencil: Default::default(),
                    bias: wgpu::DepthBiasState { constant: draws.bias, ..Default::default() },
                }),
                multisample,
                fragment: Some(wgpu::FragmentState {
                    module: &scene_shader,
                    entry_point: Some(draws.entry),
                    compilation_options: Default::default(),
                    targets: &[Some(color)],
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        use wgpu::CompareFunction::{Always, Greater, Less, LessEqual};
        use wgpu::PrimitiveTopology::{LineList, TriangleList};
        let ground = pipeline(Draws {
            entry: "ground",
            topology: TriangleList,
            compare: Always,
            writes_depth: false,
            blends: false,
            culls: false,
            bias: 0,
        });
        let body = pipeline(Draws {
            entry: "body",
            topology: TriangleList,
            compare: Less,
            writes_depth: true,
            blends: false,
            culls: false,
            bias: 2,
        });
        let edges = pipeline(Draws {
            entry: "edge",
            topology: LineList,
            compare: LessEqual,
            writes_depth: false,
            blends: true,
            culls: false,
            bias: 0,
        });
        let solid = pipeline(Draws {
            entry: "solid",
            topology: TriangleList,
            compare: Less,
            writes_depth: true,
            blends: false,
            culls: true,
            bias: 0,
        });
        let hidden = pipeline(Draws {
            entry: "hidden",
            topology: TriangleList,
            compare: Greater,
            writes_depth: false,
            blends: true,
            culls: true,
            bias: 0,
        });
        let blit_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("blit"),
            entries: &[
                wgpu::BindGroupLayoutEntry {
                    binding: 0,
                    visibility: wgpu::ShaderStages::FRAGMENT,
                    ty: wgpu::BindingType::Texture {
                        sample_type: wgpu::TextureSampleType::Float { filterable: true },
                        view_dimension: wgpu::TextureViewDimension::D2,
                        multisampled: false,
                    },
                    count: None,
                },
                wgpu::BindGroupLayoutEntry {
                    binding: 1,
                    visibility: wgpu::ShaderStages::FRAGMENT,
                    ty: wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
                    count: None,
                },
            ],
        });
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("blit"),
            bind_group_layouts: &[Some(&blit_layout)],
            immediate_size: 0,
        });
        let blit = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("blit"),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &blit_shader,
                entry_point: Some("whole"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &blit_shader,
                entry_point: Some(if window.is_srgb() { "as_light" } else { "as_it_is" }),
                compilation_options: Default::default(),
                targets: &[Some(window.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let vertices = wgpu::BufferUsages::VERTEX;
        Renderer {
            samples,
            uniforms,
            scene,
            ground,
            body,
            edges,
            solid,
            hidden,
            blit,
            blit_layout,
            sampler,
            target: None,
            generation: None,
            mesh: Growing::new(device, vertices),
            triangles: Growing::new(device, wgpu::BufferUsages::INDEX),
            edge_indices: Growing::new(device, wgpu::BufferUsages::INDEX),
            solids: Growing::new(device, vertices),
            marks: Growing::new(device, vertices),
        }
    }

    fn target(&mut self, device: &wgpu::Device, size: [u32; 2]) {
        let size = size.map(|s| s.clamp(1, LARGEST));
        if self.target.as_ref().is_some_and(|t| t.size == size) {
            return;
        }
        let texture = |format, sample_count, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some("scene"),
                size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let view = |texture: &wgpu::Texture| texture.create_view(&Default::default());
        use wgpu::TextureUsages as Usage;
        let picture = texture(COLOUR, 1, Usage::RENDER_ATTACHMENT | Usage::TEXTURE_BINDING | Usage::COPY_SRC);
        let picture_view = view(&picture);
        let shown = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("blit"),
            layout: &self.blit_layout,
            entries: &[
                wgpu::BindGroupEntry {
                    binding: 0,
                    resource: wgpu::BindingResource::TextureView(&picture_view),
                },
                wgpu::BindGroupEntry { binding: 1, resource: wgpu::BindingResource::Sampler(&self.sampler) },
            ],
        });
        let samples =
            (self.samples > 1).then(|| view(&texture(COLOUR, self.samples, Usage::RENDER_ATTACHMENT)));
        let depth = view(&texture(DEPTH, self.samples, Usage::RENDER_ATTACHMENT));
        self.target = Some(Target { size, picture, view: picture_view, samples, depth, shown });
    }

    /// Draws the scene into the picture, which is of `size` pixels from then on.
    pub fn draw(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        scene: &Scene,
        size: [u32; 2],
    ) {
        self.target(device, size);
        let Some(target) = &self.target else { return };
        let aspect = target.size[0] as f32 / target.size[1] as f32;
        queue.write_buffer(&self.uniforms, 0, bytemuck::bytes_of(&Uniforms::new(scene, aspect)));
        let known = self.generation.map_or([false; 2], |g| [0, 1].map(|i| g[i] == scene.generation[i]));
        if !known[0] {
            self.triangles.fill(device, queue, &scene.indices.triangles);
            self.edge_indices.fill(device, queue, &scene.indices.edges);
        }
        if !(known[0] && known[1]) {
            self.mesh.fill(device, queue, &scene.mesh.vertices);
        }
        self.generation = Some(scene.generation);
        self.solids.fill(device, queue, &scene.solids);
        self.marks.fill(device, queue, &scene.marks);
        let (view, resolve_target) = match &target.samples {
            Some(samples) => (samples, Some(&target.view)),
            None => (&target.view, None),
        };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("scene"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view,
                depth_slice: None,
                resolve_target,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &target.depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(1.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: None,
            }),
            ..Default::default()
        });
        pass.set_bind_group(0, &self.scene, &[]);
        pass.set_pipeline(&self.ground);
        pass.draw(0..3, 0..1);
        if self.triangles.count > 0 && self.mesh.count > 0 {
            pass.set_vertex_buffer(0, self.mesh.buffer.slice(..));
            pass.set_pipeline(&self.body);
            pass.set_index_buffer(self.triangles.buffer.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..self.triangles.count, 0, 0..1);
            if scene.has_edges && self.edge_indices.count > 0 {
                pass.set_pipeline(&self.edges);
                pass.set_index_buffer(self.edge_indices.buffer.slice(..), wgpu::IndexFormat::Uint32);
                pass.draw_indexed(0..self.edge_indices.count, 0, 0..1);
            }
        }
        if self.solids.count > 0 {
            pass.set_vertex_buffer(0, self.solids.buffer.slice(..));
            pass.set_pipeline(&self.solid);
            pass.draw(0..self.solids.count, 0..1);
        }
        if self.marks.count > 0 {
            pass.set_vertex_buffer(0, self.marks.buffer.slice(..));
            // First what is hidden, as long as the marks themselves hide nothing.
            pass.set_pipeline(&self.hidden);
            pass.draw(0..self.marks.count, 0..1);
            pass.set_pipeline(&self.solid);
            pass.draw(0..self.marks.count, 0..1);
        }
    }

    /// The last picture.
    pub fn picture(&self) -> Option<&wgpu::Texture> {
        self.target.as_ref().map(|t| &t.picture)
    }
}

const ATTRIBUTES: [wgpu::VertexAttribute; 3] =
    wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Unorm8x4];
const CORNERS: Option<wgpu::VertexBufferLayout> = Some(wgpu::VertexBufferLayout {
    array_stride: size_of::<Vertex>() as u64,
    step_mode: wgpu::VertexStepMode::Vertex,
    attributes: &ATTRIBUTES,
});

/// A scene in a part of the window.
#[derive(Debug, Clone)]
pub struct View {
    /// What is drawn.
    pub scene: Arc<Scene>,
    /// Pixels across and down.
    pub size: [u32; 2],
}

impl View {
    /// As a shape that fills `rect`.
    pub fn shape(self, rect: egui::Rect) -> egui::Shape {
        eframe::egui_wgpu::Callback::new_paint_callback(rect, self).into()
    }
}

impl CallbackTrait for View {
    fn prepare(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        _screen: &ScreenDescriptor,
        encoder: &mut wgpu::CommandEncoder,
        resources: &mut CallbackResources,
    ) -> Vec<wgpu::CommandBuffer> {
        if let Some(renderer) = resources.get_mut::<Renderer>() {
            renderer.draw(device, queue, encoder, &self.scene, self.size);
        }
        Vec::new()
    }

    fn paint(
        &self,
        _info: egui::PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        resources: &CallbackResources,
    ) {
        let Some(renderer) = resources.get::<Renderer>() else { return };
        if let Some(target) = &renderer.target {
            pass.set_pipeline(&renderer.blit);
            pass.set_bind_group(0, &target.shown, &[]);
            pass.draw(0..3, 0..1);
        }
    }
}

/// A module of the scene's programs, each beside what they share.
fn shader(device: &wgpu::Device, name: &str, text: &str) -> wgpu::ShaderModule {
    let source = wgpu::ShaderSource::Wgsl(text.into());
    device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some(name), source })
}

/// Lets a window's renderer draw scenes.
pub fn install(state: &eframe::egui_wgpu::RenderState, samples: u32) {
    let renderer = Renderer::new(&state.device, state.target_format, samples);
    state.renderer.write().callback_resources.insert(renderer);
}
