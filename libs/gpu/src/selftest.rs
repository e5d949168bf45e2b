//! Compares the functions of a device with those of the CPU.

use crate::functions::{FUNCTIONS, Function, Input, kernel};
use crate::{Access, Buffer, Device, GpuError, Kernel};
use granita_base::hash;
use std::fmt;

/// The number of inputs of a test.
pub const INPUTS: u32 = 1 << 20;

/// The comparison of one function.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Agreement {
    /// The name of the function.
    pub name: &'static str,
    /// The number of inputs that the function supports; `None` when the adapter lacks something that it needs.
    pub tested: Option<u32>,
    /// The number of inputs for which the results differ in some bit. All NaN are equal.
    pub differ: u32,
    /// The first input with different results, in words; empty without one.
    pub first: String,
}

impl Agreement {
    /// True when the results are those of the CPU for all inputs.
    pub fn holds(&self) -> bool {
        self.tested.is_some_and(|n| n > 0) && self.differ == 0
    }
}

impl fmt::Display for Agreement {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{:<34} ", self.name)?;
        match self.tested {
            None => write!(out, "not on this adapter"),
            Some(tested) if self.differ == 0 => write!(out, "{tested:>8} inputs, all equal"),
            Some(tested) => write!(out, "{tested:>8} inputs, {} differ; {}", self.differ, self.first),
        }
    }
}

/// Runs all functions over `inputs` inputs, and passes each comparison to `report`. Returns true when all hold.
///
/// # Errors
/// Returns an error when the device is lost, or the driver reports one.
pub fn selftest(device: &Device, inputs: u32, report: &mut dyn FnMut(&Agreement)) -> Result<bool, GpuError> {
    let most = (device.limits().binding_bytes / size_of::<Input>() as u64) as u32;
    let batch = inputs.min(most).min(device.limits().batch).max(1);
    let mut all = true;
    for function in FUNCTIONS {
        let agreement = compare(device, function, inputs, batch)?;
        all &= agreement.holds();
        report(&agreement);
    }
    Ok(all)
}

/// The functions that rays need, by their names.
const OF_RAYS: [&str; 8] = [
    "add",
    "subtract",
    "multiply",
    "multiply and add",
    "divide",
    "multiply and add (double)",
    "divide (double)",
    "double to single",
];

/// Returns whether the functions that rays need hold, over fewer inputs than [`selftest`].
///
/// # Errors
/// Returns the errors of [`selftest`].
pub fn rays_agree(device: &Device) -> Result<bool, GpuError> {
    for function in FUNCTIONS.iter().filter(|f| OF_RAYS.contains(&f.name)) {
        if !compare(device, function, INPUTS / 16, INPUTS / 16)?.holds() {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Compares one function.
fn compare(device: &Device, function: &Function, inputs: u32, batch: u32) -> Result<Agreement, GpuError> {
    let mut out = Agreement { name: function.name, tested: None, differ: 0, first: String::new() };
    let abilities = device.adapter().abilities;
    if function.wide && !(abilities.doubles && abilities.wide_integers) {
        return Ok(out);
    }
    let kernel = Kernel::new(device, function.name, &kernel(function), &[Access::Read, Access::Write])?;
    let from = Buffer::zeroed(device, "inputs", u64::from(batch) * 4)?;
    let to = Buffer::zeroed(device, "results", u64::from(batch) * 2)?;
    let mut tested = 0;
    for first in (0..inputs).step_by(batch as usize) {
        let all: Vec<Input> = (first..inputs.min(first.saturating_add(batch))).map(input).collect();
        from.write(device, all.as_flattened())?;
        kernel.run(device, &[&from, &to], all.len() as u32)?;
        let got = to.read(device, all.len() * 2)?;
        for (input, got) in all.iter().zip(got.as_chunks::<2>().0) {
            let Some(wanted) = (function.cpu)(*input) else { continue };
            tested += 1;
            let is_double = function.text.starts_with("double");
            if !is_same(wanted, *got, is_double) {
                if out.first.is_empty() {
                    out.first = format!(
                        "of {:08x} {:08x} {:08x} {:08x}: {:08x} {:08x}, not {:08x} {:08x}",
                        input[0], input[1], input[2], input[3], got[0], got[1], wanted[0], wanted[1]
                    );
                }
                out.differ += 1;
            }
        }
    }
    out.tested = Some(tested);
    Ok(out)
}

fn is_same(a: [u32; 2], b: [u32; 2], double: bool) -> bool {
    let is_nan = |v: [u32; 2]| {
        if double {
            f64::from_bits(u64::from(v[0]) << 32 | u64::from(v[1])).is_nan()
        } else {
            f32::from_bits(v[0]).is_nan()
        }
    };
    a == b || is_nan(a) && is_nan(b)
}

/// Numbers at which functions change their behaviour.
const SPECIAL: [f32; 32] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    -0.5,
    1.5,
    2.5,
    -2.5,
    2.0,
    3.0,
    0.1,
    0.333_333_34,
    0.999_999_94,
    1.000_000_1,
    f32::MIN_POSITIVE,
    -f32::MIN_POSITIVE,
    f32::from_bits(1),
    f32::from_bits(0x807f_ffff),
    f32::from_bits(0x007f_ffff),
    f32::MAX,
    f32::MIN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::NAN,
    8_388_607.5,
    -8_388_607.5,
    8_388_608.0,
    16_777_216.0,
    1e-20,
    1e20,
    86.999,
];

/// Returns an input. A quarter has random bits. The others have numbers of usual sizes, tiny and special numbers, and
/// numbers of double precision.
fn input(i: u32) -> Input {
    let word = |d: u32| hash::words(&[i, d]);
    let kind = i % 16;
    std::array::from_fn(|d| {
        let d = d as u32;
        let (w, u) = (word(d), hash::unit(word(d + 7)));
        let number = match kind {
            0..=3 => return w,
            4..=5 => (u - 0.5) * 16.0,
            6 => (u - 0.5) * 2.0,
            7 => (u - 0.5) * 180.0,
            8 => u,
            9 => (u - 0.5) * 16_384.0,
            10 => f32::from_bits(w & 0x807f_ffff | (127 - 30 + (w >> 8) % 60) << 23),
            11 => f32::from_bits(w & 0x80ff_ffff),
            12 => f32::from_bits(w & 0x807f_ffff | ((w >> 7) % 30) << 23),
            13 => SPECIAL[(w >> 5) as usize % SPECIAL.len()],
            // Numbers of double precision whose quotients and single forms are normal, or nearly so.
            14 if d.is_multiple_of(2) => return w & 0x800f_ffff | (1023 - 60 + (w >> 3) % 120) << 20,
            15 if d.is_multiple_of(2) => return w & 0x800f_ffff | (1023 - 152 + (w >> 3) % 30) << 20,
            _ => return w,
        };
        number.to_bits()
    })
}
