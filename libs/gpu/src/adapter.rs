//! Adapters: the devices of this machine that can be opened.

use crate::GpuError;
use std::fmt;
use std::str::FromStr;
use wgpu::Features;

/// The user's choice of a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Choice {
    /// The first adapter that is hardware and has everything that rays need. None is not an error.
    #[default]
    Auto,
    /// No device.
    Off,
    /// The adapter of this number in the list of [`adapters`].
    Index(usize),
}

impl FromStr for Choice {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        match word {
            "auto" => Ok(Self::Auto),
            "off" => Ok(Self::Off),
            number => number
                .parse()
                .map(Self::Index)
                .map_err(|_| format!("expected auto, off or the number of an adapter, not \"{word}\"")),
        }
    }
}

/// The abilities of an adapter that kernels need.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Abilities {
    /// Modules of SPIR-V are used as they are. Without them no kernel runs.
    pub own_modules: bool,
    /// Numbers of double precision. Rays and some functions need them.
    pub doubles: bool,
    /// Whole numbers of 64 bits. Rays and some functions need them.
    pub wide_integers: bool,
    /// Atomic operations on whole numbers of 64 bits.
    pub wide_atomics: bool,
    /// Operations between the invocations of a subgroup.
    pub subgroups: bool,
    /// The time on the device is measured.
    pub time_stamps: bool,
}

impl Abilities {
    pub(crate) fn of(features: Features) -> Self {
        let all = |wanted| features.contains(wanted);
        Self {
            own_modules: all(Features::PASSTHROUGH_SHADERS),
            doubles: all(Features::SHADER_F64),
            wide_integers: all(Features::SHADER_INT64),
            wide_atomics: all(Features::SHADER_INT64_ATOMIC_MIN_MAX),
            subgroups: all(Features::SUBGROUP),
            time_stamps: all(Features::TIMESTAMP_QUERY),
        }
    }

    /// Returns the features that a device is opened with.
    pub(crate) fn features(self) -> Features {
        let mut out = Features::empty();
        for (there, feature) in [
            (self.own_modules, Features::PASSTHROUGH_SHADERS),
            (self.doubles, Features::SHADER_F64),
            (self.wide_integers, Features::SHADER_INT64),
            (self.time_stamps, Features::TIMESTAMP_QUERY),
        ] {
            out.set(feature, there);
        }
        out
    }

    /// Returns the names of the abilities that are `there`, or of the missing ones.
    pub fn names(self, there: bool) -> Vec<&'static str> {
        [
            (self.own_modules, "own modules"),
            (self.doubles, "doubles"),
            (self.wide_integers, "64-bit integers"),
            (self.wide_atomics, "64-bit atomics"),
            (self.subgroups, "subgroups"),
            (self.time_stamps, "time stamps"),
        ]
        .into_iter()
        .filter_map(|(has, name)| (has == there).then_some(name))
        .collect()
    }

    /// True when rays can be traced.
    pub fn trace_rays(self) -> bool {
        self.own_modules && self.doubles && self.wide_integers
    }
}

/// The description of an adapter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adapter {
    /// The number by which the adapter is chosen.
    pub index: usize,
    /// The name that the driver reports.
    pub name: String,
    /// The driver and its version.
    pub driver: String,
    /// The kind of device: "discrete", "integrated", "virtual", "software" or "other".
    pub kind: &'static str,
    /// The memory of the device in bytes, without the part that is the machine's own memory; 0 when the driver does
    /// not report it.
    pub memory: u64,
    /// The largest number of bytes of one binding of a buffer.
    pub binding_bytes: u64,
    /// The largest number of bytes of one buffer.
    pub buffer_bytes: u64,
    /// The largest number of buffers that a kernel uses.
    pub bindings: u32,
    /// The abilities.
    pub abilities: Abilities,
}

impl fmt::Display for Adapter {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mib = |bytes: u64| bytes >> 20;
        write!(out, "{}: {} ({}; {})", self.index, self.name, self.kind, self.driver)?;
        match self.memory {
            0 => write!(out, "\n   memory: that of the machine, or not reported")?,
            bytes => write!(out, "\n   memory: {} MiB", mib(bytes))?,
        }
        write!(
            out,
            "\n   limits: buffers of {} MiB, bindings of {} MiB, {} bindings",
            mib(self.buffer_bytes),
            mib(self.binding_bytes),
            self.bindings
        )?;
        for (title, names) in [("has", self.abilities.names(true)), ("lacks", self.abilities.names(false))] {
            if !names.is_empty() {
                write!(out, "\n   {title}: {}", names.join(", "))?;
            }
        }
        Ok(())
    }
}

/// Returns the descriptions of all adapters, in the order of their numbers. It is empty without a driver of Vulkan.
pub fn adapters() -> Vec<Adapter> {
    found().iter().enumerate().map(|(index, adapter)| describe(index, adapter)).collect()
}

/// Returns the adapters of Vulkan. Other interfaces do not accept modules of SPIR-V.
fn found() -> Vec<wgpu::Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::VULKAN;
    descriptor.flags = wgpu::InstanceFlags::empty();
    let instance = wgpu::Instance::new(descriptor);
    pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN))
}

fn describe(index: usize, adapter: &wgpu::Adapter) -> Adapter {
    let (info, limits) = (adapter.get_info(), adapter.limits());
    let kind = match info.device_type {
        wgpu::DeviceType::DiscreteGpu => "discrete",
        wgpu::DeviceType::IntegratedGpu => "integrated",
        wgpu::DeviceType::VirtualGpu => "virtual",
        wgpu::DeviceType::Cpu => "software",
        wgpu::DeviceType::Other => "other",
    };
    Adapter {
        index,
        name: info.name,
        driver: [info.driver, info.driver_info].join(" ").trim().to_owned(),
        kind,
        memory: crate::native::memory(adapter),
        binding_bytes: limits.max_storage_buffer_binding_size,
        buffer_bytes: limits.max_buffer_size,
        bindings: limits.max_storage_buffers_per_shader_stage,
        abilities: Abilities::of(adapter.features()),
    }
}

/// Returns the adapter of a choice; `None` when no device is to be used.
///
/// # Errors
/// Returns an error when there is no adapter of the chosen number.
pub(crate) fn choose(choice: Choice) -> Result<Option<(wgpu::Adapter, Adapter)>, GpuError> {
    if choice == Choice::Off {
        return Ok(None);
    }
    let mut all: Vec<(wgpu::Adapter, Adapter)> = found()
        .into_iter()
        .enumerate()
        .map(|(index, adapter)| {
            let description = describe(index, &adapter);
            (adapter, description)
        })
        .collect();
    match choice {
        Choice::Index(index) if index < all.len() => Ok(Some(all.swap_remove(index))),
        Choice::Index(index) => Err(GpuError::NoAdapter {
            what: match all.len() {
                0 => format!("there is no adapter {index}: no driver of Vulkan reports one"),
                n => format!("there is no adapter {index}: the last one is {}", n - 1),
            },
        }),
        _ => {
            let rank = |a: &Adapter| match a.kind {
                "discrete" => 0,
                "integrated" => 1,
                _ => 2,
            };
            let usable = |(_, a): &(wgpu::Adapter, Adapter)| a.kind != "software" && a.abilities.trace_rays();
            Ok(all.into_iter().filter(usable).min_by_key(|(_, a)| (rank(a), a.index)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_are_read_from_words() {
        assert_eq!("auto".parse(), Ok(Choice::Auto));
        assert_eq!("off".parse(), Ok(Choice::Off));
        assert_eq!("12".parse(), Ok(Choice::Index(12)));
        for word in ["", "-1", "1.5", "Auto", "all"] {
            assert!(word.parse::<Choice>().is_err_and(|e| e.contains(word)), "{word}");
        }
    }

    #[test]
    fn a_number_without_an_adapter_is_an_error() {
        let error = choose(Choice::Index(999)).err();
        assert!(matches!(error, Some(GpuError::NoAdapter { what }) if what.contains("999")));
        assert!(choose(Choice::Off).is_ok_and(|chosen| chosen.is_none()));
    }

    #[test]
    fn software_is_never_chosen_automatically() {
        let chosen = choose(Choice::Auto);
        assert!(chosen.is_ok_and(|chosen| chosen.is_none_or(|(_, a)| a.kind != "software")));
    }

    #[test]
    fn descriptions_name_what_an_adapter_has_and_lacks() {
        let abilities = Abilities { own_modules: true, doubles: true, ..Abilities::default() };
        let adapter = Adapter {
            index: 3,
            name: "X".into(),
            driver: "d 1".into(),
            kind: "discrete",
            memory: 8 << 30,
            binding_bytes: 128 << 20,
            buffer_bytes: 1 << 30,
            bindings: 8,
            abilities,
        };
        let text = adapter.to_string();
        for part in ["3: X (discrete; d 1)", "8192 MiB", "bindings of 128 MiB", "has: own modules, doubles"] {
            assert!(text.contains(part), "{text}");
        }
        assert!(text.contains("lacks: 64-bit integers, 64-bit atomics, subgroups, time stamps"), "{text}");
        assert!(!abilities.trace_rays());
    }
}
