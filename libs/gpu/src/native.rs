//! Properties of adapters that the portable interface does not report: their memory, and which modes of floating
//! point numbers they support.

#![allow(unsafe_code, reason = "the properties are read through the interface of the driver")]

use ash::vk;
use wgpu::hal::api::Vulkan;

/// The modes of floating point numbers that a module requests, for numbers of 32 and of 64 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct FloatModes {
    /// Denormal numbers are kept.
    pub(crate) denormals: [bool; 2],
    /// Signs of zero, infinities and NaN are kept.
    pub(crate) specials: [bool; 2],
    /// Results are rounded to the nearest number, to the even one of two.
    pub(crate) nearest: [bool; 2],
}

/// Returns the modes that an adapter supports.
pub(crate) fn float_modes(adapter: &wgpu::Adapter) -> FloatModes {
    // SAFETY: the adapter outlives the guard, and nothing of it is destroyed.
    let Some(native) = (unsafe { adapter.as_hal::<Vulkan>() }) else { return FloatModes::default() };
    if native.physical_device_capabilities().properties().api_version < vk::API_VERSION_1_2 {
        return FloatModes::default();
    }
    let mut controls = vk::PhysicalDeviceFloatControlsProperties::default();
    let mut all = vk::PhysicalDeviceProperties2::default().push_next(&mut controls);
    let instance = native.shared_instance().raw_instance();
    // SAFETY: the device belongs to the instance, which lives as long as the adapter. The structures are initialised
    // and linked, and Vulkan 1.2 knows both.
    unsafe { instance.get_physical_device_properties2(native.raw_physical_device(), &mut all) };
    let pair = |a, b| [a != vk::FALSE, b != vk::FALSE];
    // Where the modes of both sizes must be equal, only a common one is requested.
    let joint = |independence, [a, b]: [bool; 2]| {
        if independence == vk::ShaderFloatControlsIndependence::NONE { [a && b; 2] } else { [a, b] }
    };
    FloatModes {
        denormals: joint(
            controls.denorm_behavior_independence,
            pair(controls.shader_denorm_preserve_float32, controls.shader_denorm_preserve_float64),
        ),
        specials: pair(
            controls.shader_signed_zero_inf_nan_preserve_float32,
            controls.shader_signed_zero_inf_nan_preserve_float64,
        ),
        nearest: joint(
            controls.rounding_mode_independence,
            pair(controls.shader_rounding_mode_rte_float32, controls.shader_rounding_mode_rte_float64),
        ),
    }
}

/// Returns the number of bytes of the largest heap of memory of an adapter's own; 0 when it shares that of the
/// machine, or does not report it.
pub(crate) fn memory(adapter: &wgpu::Adapter) -> u64 {
    let kind = adapter.get_info().device_type;
    if matches!(kind, wgpu::DeviceType::Cpu | wgpu::DeviceType::IntegratedGpu) {
        return 0;
    }
    // SAFETY: the adapter outlives the guard, and nothing of it is destroyed.
    let Some(native) = (unsafe { adapter.as_hal::<Vulkan>() }) else { return 0 };
    let instance = native.shared_instance().raw_instance();
    // SAFETY: the device belongs to the instance, which lives as long as the adapter.
    let memory = unsafe { instance.get_physical_device_memory_properties(native.raw_physical_device()) };
    let heaps = memory.memory_heaps.iter().take(memory.memory_heap_count as usize);
    heaps.filter(|h| h.flags.contains(vk::MemoryHeapFlags::DEVICE_LOCAL)).map(|h| h.size).max().unwrap_or(0)
}
