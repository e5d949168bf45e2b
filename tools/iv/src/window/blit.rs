//! Shows the image on the screen where the processor does the work of graphics hardware.
//!
//! Such drivers take long for every texture lookup. The canvas already has one pixel for each pixel of the window. Here
//! it is a plain array of numbers, and the shader reads the number of its pixel.

use eframe::egui_wgpu::{CallbackResources, CallbackTrait, RenderState};
use granita_view::Canvas;

/// The shader. `place` holds the first column and row on the screen, and the width and height of the image, in pixels.
const SHADER: &str = "
@group(0) @binding(0) var<uniform> place: vec4<i32>;
@group(0) @binding(1) var<storage, read> pixels: array<u32>;

@vertex
fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}

@fragment
fn pixel(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = clamp(vec2<i32>(at.xy) - place.xy, vec2<i32>(0, 0), place.zw - 1);
    return unpack4x8unorm(pixels[u32(p.y * place.z + p.x)]);
}
";

/// Shows a canvas on the screen.
pub(crate) struct Blit {
    device: wgpu::Device,
    queue: wgpu::Queue,
    pipeline: wgpu::RenderPipeline,
    place: wgpu::Buffer,
    /// The pixels, and their bind group.
    pixels: Option<(wgpu::Buffer, wgpu::BindGroup)>,
}

impl Blit {
    /// Returns `None` where a texture is faster, or is the only way.
    pub(crate) fn new(state: &RenderState) -> Option<Self> {
        let device = &state.device;
        let by_processor = state.adapter.get_info().device_type == wgpu::DeviceType::Cpu;
        let can = device.limits().max_storage_buffers_per_shader_stage > 0;
        if !by_processor || !can || state.target_format.is_srgb() {
            return None;
        }
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("image"),
            source: wgpu::ShaderSource::Wgsl(SHADER.into()),
        });
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("image"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("corner"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some("pixel"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(state.target_format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let place = buffer(device, 16, wgpu::BufferUsages::UNIFORM);
        Some(Self { device: device.clone(), queue: state.queue.clone(), pipeline, place, pixels: None })
    }

    /// Uploads a canvas that is shown from the pixel `corner` of the window on. Returns false when it is empty or too
    /// large for a buffer.
    pub(crate) fn take(&mut self, canvas: &Canvas, corner: [i32; 2]) -> bool {
        let bytes = canvas.bytes.len() as u64;
        let limits = self.device.limits();
        if bytes == 0 || bytes > limits.max_storage_buffer_binding_size.min(limits.max_buffer_size) {
            return false;
        }
        if self.pixels.as_ref().is_none_or(|(pixels, _)| pixels.size() != bytes) {
            let pixels = buffer(&self.device, bytes, wgpu::BufferUsages::STORAGE);
            let entries = [&self.place, &pixels].map(wgpu::Buffer::as_entire_binding);
            let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
                .zip(entries)
                .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
                .collect();
            let bound = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("image"),
                layout: &self.pipeline.get_bind_group_layout(0),
                entries: &entries,
            });
            self.pixels = Some((pixels, bound));
        }
        let Some((pixels, _)) = &self.pixels else { return false };
        let place = [corner[0], corner[1], canvas.width as i32, canvas.height as i32];
        let place: Vec<u8> = place.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.queue.write_buffer(&self.place, 0, &place);
        self.queue.write_buffer(pixels, 0, &canvas.bytes);
        true
    }

    /// Returns a callback that shows the last uploaded canvas.
    pub(crate) fn callback(&self) -> Option<impl CallbackTrait + use<>> {
        let (_, bound) = self.pixels.as_ref()?;
        Some(Drawn { pipeline: self.pipeline.clone(), bound: bound.clone() })
    }
}

fn buffer(device: &wgpu::Device, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let usage = usage | wgpu::BufferUsages::COPY_DST;
    device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
}

struct Drawn {
    pipeline: wgpu::RenderPipeline,
    bound: wgpu::BindGroup,
}

impl CallbackTrait for Drawn {
    fn paint(
        &self,
        _: eframe::egui::PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        _: &CallbackResources,
    ) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.bound, &[]);
        pass.draw(0..3, 0..1);
    }
}
