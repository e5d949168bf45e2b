//! Kernels: from text in WGSL to a pipeline with exact arithmetic.

#![allow(unsafe_code, reason = "modules of SPIR-V are passed to the driver as they are")]

use crate::{Buffer, Device, GpuError, spirv};
use wgpu::naga;

/// How a kernel uses a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// It reads the buffer.
    Read,
    /// It reads and writes the buffer.
    Write,
}

/// A compiled kernel. Its entry point is `main`, with [`Kernel::GROUP`] invocations in a group.
#[derive(Debug)]
pub struct Kernel {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

impl Kernel {
    /// The number of invocations of a group.
    pub const GROUP: u32 = 64;
    /// The largest number of groups in a row. The index of an invocation is that in its row plus
    /// `ROW * GROUP` times the number of the row.
    pub const ROW: u32 = 32768;

    /// Compiles a text. Its bindings are those of group 0, from 0 on, with these kinds of access.
    ///
    /// # Errors
    /// Returns an error when the text is not valid, when it has more bindings than the adapter allows, or when the
    /// driver does not accept it.
    pub fn new(device: &Device, name: &str, text: &str, bindings: &[Access]) -> Result<Self, GpuError> {
        device.check()?;
        let most = u64::from(device.limits().bindings);
        if bindings.len() as u64 > most {
            return Err(GpuError::Limit { what: "buffers of a kernel", asked: bindings.len() as u64, most });
        }
        let words = spirv::exact(&translate(name, text)?, device.modes);
        let entries: Vec<wgpu::BindGroupLayoutEntry> = (0..)
            .zip(bindings)
            .map(|(binding, access)| wgpu::BindGroupLayoutEntry {
                binding,
                visibility: wgpu::ShaderStages::COMPUTE,
                ty: wgpu::BindingType::Buffer {
                    ty: wgpu::BufferBindingType::Storage { read_only: *access == Access::Read },
                    has_dynamic_offset: false,
                    min_binding_size: None,
                },
                count: None,
            })
            .collect();
        let made = device.scoped(|| {
            let label = Some(name);
            let entry_points = [wgpu::PassthroughShaderEntryPoint {
                name: "main".into(),
                workgroup_size: (Self::GROUP, 1, 1),
            }];
            let descriptor = wgpu::ShaderModuleDescriptorPassthrough {
                label,
                entry_points: (&entry_points[..]).into(),
                spirv: Some(words.into()),
                ..Default::default()
            };
            // SAFETY: the module comes from a text that was validated. The pass adds decorations and modes that the
            // adapter supports. Kernels of this crate stay within their buffers.
            let module = unsafe { device.device.create_shader_module_passthrough(descriptor) };
            let layout = device
                .device
                .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor { label, entries: &entries });
            let pipeline_layout = device.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label,
                bind_group_layouts: &[Some(&layout)],
                immediate_size: 0,
            });
            let pipeline = device.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label,
                layout: Some(&pipeline_layout),
                module: &module,
                entry_point: Some("main"),
                compilation_options: Default::default(),
                cache: None,
            });
            Self { pipeline, layout }
        });
        made.map_err(|error| {
            device.check().err().unwrap_or(GpuError::Failed { what: format!("kernel {name}: {error}") })
        })
    }

    pub(crate) fn pipeline(&self) -> &wgpu::ComputePipeline {
        &self.pipeline
    }

    /// Binds buffers in the order of the bindings.
    pub(crate) fn bind(&self, device: &Device, buffers: &[&Buffer]) -> wgpu::BindGroup {
        let entries: Vec<wgpu::BindGroupEntry<'_>> = (0..)
            .zip(buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.raw().as_entire_binding(),
            })
            .collect();
        let descriptor = wgpu::BindGroupDescriptor { label: None, layout: &self.layout, entries: &entries };
        device.device.create_bind_group(&descriptor)
    }
}

/// Returns the SPIR-V of a text, without checks of bounds and loops.
fn translate(name: &str, text: &str) -> Result<Vec<u32>, GpuError> {
    let failed = |what: String| GpuError::Failed { what: format!("kernel {name}: {what}") };
    let module = naga::front::wgsl::parse_str(text).map_err(|e| failed(e.emit_to_string(text)))?;
    let flags = naga::valid::ValidationFlags::all();
    let capabilities = naga::valid::Capabilities::all();
    let info = naga::valid::Validator::new(flags, capabilities)
        .validate(&module)
        .map_err(|e| failed(e.emit_to_string(text)))?;
    let unchecked = naga::proc::BoundsCheckPolicy::Unchecked;
    let options = naga::back::spv::Options {
        lang_version: (1, 3),
        flags: naga::back::spv::WriterFlags::empty(),
        bounds_check_policies: naga::proc::BoundsCheckPolicies {
            index: unchecked,
            buffer: unchecked,
            image_load: unchecked,
            binding_array: unchecked,
        },
        force_loop_bounding: false,
        ..Default::default()
    };
    naga::back::spv::write_vec(&module, &info, &options, None).map_err(|e| failed(e.to_string()))
}
