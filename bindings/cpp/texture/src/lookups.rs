//! The functions of the interface that look up points.

use crate::failure::{Failure, guarded, text};
use crate::points::Batch;
use crate::system::System;
use crate::types::{At, Environment, Lookup2d, Lookup3d, Points, Shadow};
use granita_base::sample::{Draw, Sequence};
use granita_base::{Vec3, hash};
use granita_texture::{EnvLookup, Lookup, ShadowLookup, TextureId, TextureReader, Up, Wrap};
use std::ffi::{c_char, c_int};

/// The filters of `granita_texture_filter`.
const GAUSSIAN: c_int = 0;
const BILINEAR: c_int = 1;
const NEAREST: c_int = 2;

/// The bias of shadow lookups without one, in units of the world.
const BIAS: f32 = 0.01;

/// The arguments that all lookups share.
struct Call<'a> {
    system: &'a System,
    texture: u32,
    batch: Batch,
}

impl<'a> Call<'a> {
    /// Checks the arguments. `channels` replaces the number of channels of the caller.
    ///
    /// # Safety
    /// `system` and `points` must be NULL or exist while the result is used.
    unsafe fn new(
        system: *const System,
        texture: u32,
        points: *const Points,
        channels: Option<usize>,
    ) -> Result<Self, Failure> {
        // SAFETY: it is a system or NULL, by the contract.
        let system: &'a System = unsafe { System::of(system) }?;
        // SAFETY: there are points or NULL, by the contract.
        let points = unsafe { points.as_ref() };
        let points = points.ok_or_else(|| Failure::Misuse("there are no points (NULL)".to_owned()))?;
        let channels = channels.unwrap_or(usize::try_from(points.channels).unwrap_or(0));
        Ok(Self { system, texture, batch: Batch::new(points, channels)? })
    }

    /// Looks up all points. When the texture cannot be used, all results are `fill`.
    ///
    /// # Safety
    /// All arrays of the caller must have the points, and the memory of results must not be used meanwhile.
    unsafe fn run(
        &self,
        look: impl Fn(&mut TextureReader<'_>, TextureId, usize, At, &mut [f32]) + Sync,
    ) -> Result<(), Failure> {
        let done = self.system.with(self.texture, |cache, id| {
            // SAFETY: the contract is the same.
            unsafe {
                self.batch.run(cache, self.system.threads(), &|reader, i, at, values| {
                    look(reader, id, i, at, values);
                });
            }
            Ok(())
        });
        if done.is_err() {
            // SAFETY: the contract is the same.
            unsafe { self.batch.store_fill() };
        }
        done
    }
}

/// Returns the parameters of a lookup.
///
/// # Safety
/// `lookup` must be NULL or exist while the result is used.
unsafe fn parameters<'a, T>(lookup: *const T) -> Result<&'a T, Failure> {
    // SAFETY: it exists or is NULL, by the contract.
    unsafe { lookup.as_ref() }.ok_or_else(|| Failure::Misuse("there is no lookup (NULL)".to_owned()))
}

/// Checks that an array that a lookup needs was passed.
fn given(is_given: bool, name: &str) -> Result<(), Failure> {
    if is_given { Ok(()) } else { Err(Failure::Misuse(format!("{name} is not given (NULL)"))) }
}

/// Returns the wrap mode of a word; `None` for that of the file.
///
/// # Safety
/// `word` must be NULL or a string.
unsafe fn wrap(word: *const c_char) -> Result<Option<Wrap>, Failure> {
    // SAFETY: it is a string or NULL, by the contract.
    let word = unsafe { text(word) }.unwrap_or_default();
    match word.trim() {
        "" | "default" => Ok(None),
        known => match Wrap::from_word(known) {
            Some(wrap) => Ok(Some(wrap)),
            None => Err(Failure::Misuse(format!(
                "the wrap mode \"{word}\" is not \"black\", \"clamp\", \"periodic\", \"mirror\" or \"default\""
            ))),
        },
    }
}

/// Implements `granita_texture_lookup_2d`.
///
/// # Safety
/// The pointers must be NULL or be as the header describes them.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn granita_texture_lookup_2d(
    system: *const System,
    texture: u32,
    points: *const Points,
    lookup: *const Lookup2d,
) -> c_int {
    guarded(|| {
        // SAFETY: the pointers are NULL or valid, by the contract.
        let (call, q) = unsafe { (Call::new(system, texture, points, None)?, parameters(lookup)?) };
        given(q.s.is_given(), "s")?;
        given(q.t.is_given(), "t")?;
        // SAFETY: they are strings or NULL, by the contract.
        let (swrap, twrap) = unsafe { (wrap(q.swrap)?, wrap(q.twrap)?) };
        if !(GAUSSIAN..=NEAREST).contains(&q.filter) {
            return Err(Failure::Misuse(format!("the filter {} is not 0 to 2", q.filter)));
        }
        let q = Columns(*q);
        let (filter, first_channel) = (q.get().filter, call.batch.first_channel);
        let batch = &call.batch;
        // SAFETY: the arrays have all points, by the contract.
        let look = move |reader: &mut TextureReader<'_>, id, _: usize, at, values: &mut [f32]| unsafe {
            let q = q.get();
            let (s, t, fill) = (q.s.at(at, 0.0), q.t.at(at, 0.0), batch.fill(at));
            let sharp = Lookup { s, t, swrap, twrap, first_channel, fill, ..Lookup::default() };
            match filter {
                NEAREST => reader.nearest(id, &sharp, values),
                BILINEAR => reader.texture(id, &sharp, values),
                _ => {
                    let lookup = Lookup {
                        dsdx: q.dsdx.at(at, 0.0),
                        dtdx: q.dtdx.at(at, 0.0),
                        dsdy: q.dsdy.at(at, 0.0),
                        dtdy: q.dtdy.at(at, 0.0),
                        sblur: q.sblur.at(at, 0.0),
                        tblur: q.tblur.at(at, 0.0),
                        swidth: q.swidth.at(at, 1.0),
                        twidth: q.twidth.at(at, 1.0),
                        ..sharp
                    };
                    reader.texture(id, &lookup, values);
                }
            }
        };
        // SAFETY: the arrays have all points, by the contract.
        unsafe { call.run(look) }
    })
}

/// Implements `granita_texture_lookup_3d`.
///
/// # Safety
/// The pointers must be NULL or be as the header describes them.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn granita_texture_lookup_3d(
    system: *const System,
    texture: u32,
    points: *const Points,
    lookup: *const Lookup3d,
) -> c_int {
    guarded(|| {
        // SAFETY: the pointers are NULL or valid, by the contract.
        let (call, q) = unsafe { (Call::new(system, texture, points, None)?, parameters(lookup)?) };
        given(q.p.is_given(), "p")?;
        // SAFETY: they are strings or NULL, by the contract.
        let (swrap, twrap) = unsafe { (wrap(q.swrap)?, wrap(q.twrap)?) };
        let (q, batch) = (Columns(*q), &call.batch);
        // SAFETY: the arrays have all points, by the contract.
        let look = move |reader: &mut TextureReader<'_>, id, _: usize, at, values: &mut [f32]| unsafe {
            let q = q.get();
            let lookup = granita_texture::Lookup3d {
                p: Vec3::from(q.p.at(at)),
                dpdx: Vec3::from(q.dpdx.at(at)),
                dpdy: Vec3::from(q.dpdy.at(at)),
                sblur: q.sblur.at(at, 0.0),
                tblur: q.tblur.at(at, 0.0),
                swidth: q.swidth.at(at, 1.0),
                twidth: q.twidth.at(at, 1.0),
                swrap,
                twrap,
                first_channel: batch.first_channel,
                fill: batch.fill(at),
            };
            reader.texture3d(id, &lookup, values);
        };
        // SAFETY: the arrays have all points, by the contract.
        unsafe { call.run(look) }
    })
}

/// Implements `granita_texture_lookup_environment`.
///
/// # Safety
/// The pointers must be NULL or be as the header describes them.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn granita_texture_lookup_environment(
    system: *const System,
    texture: u32,
    points: *const Points,
    lookup: *const Environment,
) -> c_int {
    guarded(|| {
        // SAFETY: the pointers are NULL or valid, by the contract.
        let (call, q) = unsafe { (Call::new(system, texture, points, None)?, parameters(lookup)?) };
        given(q.r.is_given(), "r")?;
        // SAFETY: it is a string or NULL, by the contract.
        let word = unsafe { text(q.up) }.unwrap_or_default();
        let up = Up::from_word(&word);
        if up.is_none() && !word.is_empty() {
            return Err(Failure::Misuse(format!(
                "the axis \"{word}\" of an environment is not \"y\" or \"z\""
            )));
        }
        let (q, batch) = (Columns(*q), &call.batch);
        // SAFETY: the arrays have all points, by the contract.
        let look = move |reader: &mut TextureReader<'_>, id, _: usize, at, values: &mut [f32]| unsafe {
            let q = q.get();
            let lookup = EnvLookup {
                r: Vec3::from(q.r.at(at)),
                drdx: Vec3::from(q.drdx.at(at)),
                drdy: Vec3::from(q.drdy.at(at)),
                angle: q.angle.is_given().then(|| q.angle.at(at, 0.0)),
                sblur: q.sblur.at(at, 0.0),
                tblur: q.tblur.at(at, 0.0),
                swidth: q.swidth.at(at, 1.0),
                twidth: q.twidth.at(at, 1.0),
                up,
                quick: false,
                first_channel: batch.first_channel,
                fill: batch.fill(at),
            };
            reader.environment(id, &lookup, values);
        };
        // SAFETY: the arrays have all points, by the contract.
        unsafe { call.run(look) }
    })
}

/// Implements `granita_texture_lookup_shadow`.
///
/// # Safety
/// The pointers must be NULL or be as the header describes them.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn granita_texture_lookup_shadow(
    system: *const System,
    texture: u32,
    points: *const Points,
    lookup: *const Shadow,
) -> c_int {
    guarded(|| {
        // SAFETY: the pointers are NULL or valid, by the contract.
        let (call, q) = unsafe { (Call::new(system, texture, points, Some(1))?, parameters(lookup)?) };
        given(q.p.is_given(), "p")?;
        let samples = match q.samples {
            0 => ShadowLookup::default().samples,
            n => u32::try_from(n)
                .map_err(|_| Failure::Misuse(format!("{n} samples, where 16 to 4096 are possible")))?,
        };
        call.system.with(texture, |cache, id| {
            let about = cache.describe(id);
            let usable =
                about.kind.is_shadow() && about.world_to_camera.is_some() && about.world_to_screen.is_some();
            if usable {
                return Ok(());
            }
            let path = about.path.display();
            Err(Failure::Unusable(format!("{path}: it is not a shadow map with its matrices")))
        })?;
        let q = Columns(*q);
        // SAFETY: the arrays have all points, by the contract.
        let look = move |reader: &mut TextureReader<'_>, id, i: usize, at, values: &mut [f32]| unsafe {
            let q = q.get();
            let lookup = ShadowLookup {
                p: Vec3::from(q.p.at(at)),
                dpdx: Vec3::from(q.dpdx.at(at)),
                dpdy: Vec3::from(q.dpdy.at(at)),
                sblur: q.sblur.at(at, 0.0),
                tblur: q.tblur.at(at, 0.0),
                swidth: q.swidth.at(at, 1.0),
                twidth: q.twidth.at(at, 1.0),
                samples,
                bias: q.bias.at(at, BIAS).max(0.0),
                draw: Draw::alone(Sequence::new(hash::words(&[q.seed, i as u32]))),
            };
            values[0] = reader.shadow(id, &lookup);
        };
        // SAFETY: the arrays have all points, by the contract.
        unsafe { call.run(look) }
    })
}

/// Implements `granita_texture_texels`.
///
/// # Safety
/// The pointers must be NULL or be as the header describes them.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn granita_texture_texels(
    system: *const System,
    texture: u32,
    level: c_int,
    x: c_int,
    y: c_int,
    points: *const Points,
) -> c_int {
    guarded(|| {
        // SAFETY: the pointers are NULL or valid, by the contract.
        let call = unsafe { Call::new(system, texture, points, None)? };
        let (columns, rows) = call.batch.size();
        let place = call.system.with(texture, |cache, id| {
            let about = cache.describe(id);
            let size = usize::try_from(level).ok().and_then(|level| Some((level, *about.levels.get(level)?)));
            let Some((level, [width, height])) = size else {
                let levels = about.levels.len();
                return Err(Failure::Misuse(format!(
                    "level {level}, where the texture has 0 to {}",
                    levels - 1
                )));
            };
            let fits = |from: c_int, count: usize, size: u32| {
                let from = u32::try_from(from).ok()?;
                (from as usize).checked_add(count).is_some_and(|end| end <= size as usize).then_some(from)
            };
            match (fits(x, columns, width), fits(y, rows, height)) {
                (Some(x), Some(y)) => Ok((level, x, y)),
                _ => Err(Failure::Misuse(format!(
                    "{columns} x {rows} texels at ({x}, {y}) are not inside of {width} x {height}"
                ))),
            }
        });
        let (level, x, y) = match place {
            Ok(place) => place,
            Err(failure) => {
                // SAFETY: the arrays have all points, by the contract.
                unsafe { call.batch.store_fill() };
                return Err(failure);
            }
        };
        let batch = &call.batch;
        let look = move |reader: &mut TextureReader<'_>, id, _: usize, at: At, values: &mut [f32]| {
            // SAFETY: the array has all points, by the contract.
            let fill = unsafe { batch.fill(at) };
            let texel = (level, x + at.0 as u32, y + at.1 as u32);
            reader.texel(id, texel, batch.first_channel, fill, values);
        };
        // SAFETY: the arrays have all points, by the contract.
        unsafe { call.run(look) }
    })
}

/// Parameters whose arrays several threads read.
#[derive(Clone, Copy)]
struct Columns<T>(T);

// SAFETY: the arrays do not change during a call, by the contract of the interface.
unsafe impl<T> Sync for Columns<T> {}

impl<T> Columns<T> {
    /// Returns the parameters. A closure that calls this captures the whole value.
    #[inline(always)]
    fn get(&self) -> &T {
        &self.0
    }
}
