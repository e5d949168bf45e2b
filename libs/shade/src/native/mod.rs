//! Plans as native code.
//!
//! A plan that many points ran through is printed as C ([`print`]) and given to a [`NativeCompiler`], which compiles it
//! while rendering goes on. Once the code is there, strips of points run through it. Its values equal those of the tape
//! to the bit: it does the same arithmetic in the same order, without contraction. The tape is the reference. It runs
//! for plans with functions that have no native form, and for strips with arguments outside of the range of the
//! polynomials in `run/approx.rs`.

mod print;

pub(crate) use print::print;

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// A function to compile.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NativeSource {
    /// A translation unit of C99 with the builtins of GCC and Clang. It includes no headers. It defines
    ///
    /// ```c
    /// int granita (const float *const *in, const float *scalars, float *const *out, long from, long to);
    /// ```
    ///
    /// which computes the lanes from `from` up to `to`, reads the arrays of `in`, and writes those of `out`. It
    /// returns 0 when all lanes are right. It must be compiled without contraction of operations.
    pub text: String,
    /// The number of arrays that are read.
    pub inputs: usize,
    /// The number of numbers that are the same for all lanes.
    pub scalars: usize,
    /// The number of arrays that are written.
    pub outputs: usize,
}

/// The data of a native function.
#[derive(Debug)]
pub struct NativeStrip<'a, 'b> {
    /// The arrays that are read. They have one number for each lane.
    pub inputs: &'a [&'a [f32]],
    /// The numbers that are the same for all lanes.
    pub scalars: &'a [f32],
    /// The arrays that are written.
    pub outputs: &'a mut [&'b mut [f32]],
    /// The lanes to compute.
    pub lanes: Range<usize>,
}

/// A compiled function.
pub trait NativeCode: Send + Sync + std::fmt::Debug {
    /// Computes lanes. Returns false when some lane has an argument that native code does not support. The output of
    /// all lanes is unspecified then.
    ///
    /// # Panics
    /// May panic when the strip does not have the arrays of the source, or when they are shorter than the lanes.
    fn run(&self, strip: &mut NativeStrip<'_, '_>) -> bool;
}

/// Receives a compiled function.
pub type NativeDone = Box<dyn FnOnce(Arc<dyn NativeCode>) + Send>;

/// Compiles functions.
pub trait NativeCompiler: Send + Sync + std::fmt::Debug {
    /// Compiles a source, and then calls `done`. It does not wait. `done` is not called when the source
    /// cannot be compiled.
    fn compile(&self, source: NativeSource, done: NativeDone);
}

/// The number of points after which a plan is compiled. The compiler takes about as long as a tape of average length
/// for ten times as many.
const HOT_POINTS: u64 = 1 << 16;

/// The native code of a plan, once it was requested and is there.
#[derive(Debug, Default)]
pub(crate) struct Native {
    /// The number of points so far.
    points: AtomicU64,
    code: OnceLock<Arc<dyn NativeCode>>,
}

impl Native {
    /// Returns the code, if it is there.
    #[inline]
    pub(crate) fn code(&self) -> Option<&dyn NativeCode> {
        self.code.get().map(|code| &**code)
    }

    /// Counts points. The code of a plan through which enough points ran is requested, once. `source` returns it, or
    /// `None` when it has no native form.
    pub(crate) fn count(
        self: &Arc<Self>,
        points: usize,
        compiler: &dyn NativeCompiler,
        source: impl FnOnce() -> Option<NativeSource>,
    ) {
        let before = self.points.fetch_add(points as u64, Ordering::Relaxed);
        if before < HOT_POINTS
            && before + points as u64 >= HOT_POINTS
            && let Some(source) = source()
        {
            let native = self.clone();
            let done = move |code| drop(native.code.set(code));
            compiler.compile(source, Box::new(done));
        }
    }
}

#[cfg(test)]
mod tests;
