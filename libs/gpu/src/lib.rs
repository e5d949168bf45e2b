//! Work for graphics processors, with the results of the CPU to the bit.
//!
//! This is the only crate of the renderer that knows `wgpu`. [`adapters`] lists the devices of this machine.
//! [`Device::open`] opens one. [`GpuTracer`] traces rays on it. [`selftest`] compares the arithmetic of a device with
//! that of the CPU.
//!
//! # Invariants
//!
//! - **The same bits.** Kernels use no built-in function whose result is not exact. Their modules are decorated, so
//!   that drivers neither contract nor reorder (`spirv.rs`). Quotients and roots are corrected by their residuals.
//!   Where [`selftest`] holds, hits are those of `granita_trace`.
//! - **Limits are kept.** No binding is larger than the adapter allows. Trees are divided into pages ([`Pages`]), and
//!   rays into batches.
//! - **Nothing is lost with a device.** Every call returns a [`GpuError`] when the device was lost, its memory is used
//!   up, or the driver reports something. Callers compute on the CPU then.
//! - Only adapters of Vulkan are used, because modules of SPIR-V must reach the driver unchanged.
//!
//! # Deliberately absent
//!
//! Triangles that move, shading, and the hider.
//!
//! # Example
//!
//! ```
//! use granita_gpu::{Choice, Device, GpuTracer, Limits};
//! use granita_trace::{Hit, Ray, TracerBuilder};
//! let tracer = std::sync::Arc::new(TracerBuilder::new().build(1));
//! let mut hits = [Hit::MISS; 1];
//! let rays = [Ray { origin: glam(0.0), tmin: 0.0, dir: glam(1.0), tmax: 1.0, time: 0.0 }];
//! if let Ok(Some(device)) = Device::open(Choice::Auto, Limits::default())
//!     && let Ok(resident) = GpuTracer::new(device, tracer.clone())
//!     && resident.closest(&rays, &mut hits).is_ok()
//! {
//!     println!("traced on the device");
//! } else {
//!     tracer.closest(&rays, &mut hits);
//! }
//! # fn glam(x: f32) -> granita_base::Vec3 { granita_base::Vec3::splat(x) }
//! ```
#![deny(unsafe_code)]

mod adapter;
mod buffer;
mod device;
mod error;
mod functions;
mod kernel;
mod native;
mod rays;
mod selftest;
mod spirv;

#[cfg(test)]
mod tests;

pub use adapter::{Abilities, Adapter, Choice, adapters};
pub use buffer::{Buffer, Pages};
pub use device::{Device, GpuStatistics, Limits};
pub use error::GpuError;
pub use functions::{DOUBLE, SINGLE};
pub use kernel::{Access, Kernel};
pub use rays::{GpuAccelerator, GpuTracer, Occluded, OcclusionPoint, Traced, occlusion_on_cpu};
pub use selftest::{Agreement, INPUTS, rays_agree, selftest};
