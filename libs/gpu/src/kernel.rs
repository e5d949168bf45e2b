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

    /// Runs the kernel with `invocations` invocations and the buffers of its bindings, and waits for it. Returns its
    /// time on the device in seconds; 0 when the device does not measure time.
    ///
    /// # Errors
    /// Returns an error when the device is lost or the driver reports one.
    pub fn run(&self, device: &Device, buffers: &[&Buffer], invocations: u32) -> Result<f64, GpuError> {
        device.check()?;
        if invocations == 0 {
            return Ok(0.0);
        }
        let stamps = Stamps::new(device)?;
        let done = device.scoped(|| {
            let bound = self.bind(device, buffers);
            let mut encoder = device.device.create_command_encoder(&Default::default());
            {
                let timestamp_writes = stamps.as_ref().map(|s| wgpu::ComputePassTimestampWrites {
                    query_set: &s.queries,
                    beginning_of_pass_write_index: Some(0),
                    end_of_pass_write_index: Some(1),
                });
                let descriptor = wgpu::ComputePassDescriptor { label: None, timestamp_writes };
                let mut pass = encoder.begin_compute_pass(&descriptor);
                pass.set_pipeline(&self.pipeline);
                pass.set_bind_group(0, &bound, &[]);
                let groups = invocations.div_ceil(Self::GROUP);
                // A dimension has at most 65535 groups.
                pass.dispatch_workgroups(groups.min(Self::ROW), groups.div_ceil(Self::ROW), 1);
            }
            if let Some(s) = &stamps {
                encoder.resolve_query_set(&s.queries, 0..2, s.buffer.raw(), 0);
            }
            device.queue.submit([encoder.finish()]);
        });
        done.map_err(|error| device.failure(error.to_string()))?;
        device.wait()?;
        let Some(stamps) = stamps else { return Ok(device.count(None)) };
        let words = stamps.buffer.read(device, 4)?;
        let at = |k: usize| u64::from(words[2 * k]) | u64::from(words[2 * k + 1]) << 32;
        Ok(device.count(Some(at(1).saturating_sub(at(0)))))
    }

    /// Binds buffers in the order of the bindings.
    fn bind(&self, device: &Device, buffers: &[&Buffer]) -> wgpu::BindGroup {
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

/// The beginning and the end of a run, by the clock of the device.
struct Stamps {
    queries: wgpu::QuerySet,
    buffer: Buffer,
}

impl Stamps {
    /// Returns `None` when the device does not measure time.
    fn new(device: &Device) -> Result<Option<Self>, GpuError> {
        if !device.adapter().abilities.time_stamps {
            return Ok(None);
        }
        let buffer = Buffer::new_stamps(device)?;
        let queries = device.device.create_query_set(&wgpu::QuerySetDescriptor {
            label: None,
            ty: wgpu::QueryType::Timestamp,
            count: 2,
        });
        Ok(Some(Self { queries, buffer }))
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
