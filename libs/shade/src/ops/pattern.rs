//! Noise, random numbers and the antialiased step (reference 5.8.6, 5.8.7).

use super::{compute_as, derive, noise as table};
use crate::Lane;
use crate::call::Options;
use crate::program::Op;
use crate::run::kernel::map2;
use crate::run::machine::Machine;
use crate::run::noise_lanes::{NoiseKind, NoiseTask};
use crate::run::simd;
use granita_base::{Filter, hash};
use granita_gsl::Func;
use granita_gsl::ir::SymbolId;
use table::{drawn, hashed};

/// Returns the floats of a list of operands, with triples as three of them.
fn spread<'v>(m: &'v Machine<'_>, args: &[SymbolId]) -> [Option<Lane<'v>>; 4] {
    let mut lanes = [None; 4];
    let mut next = 0;
    for &arg in args {
        let view = m.view(arg);
        for c in 0..view.components.min(3) {
            if next < 4 {
                lanes[next] = Some(view.lane(c));
                next += 1;
            }
        }
    }
    lanes
}

/// Returns the values of the lanes at `i`; 0 where there is none.
fn at(lanes: &[Option<Lane<'_>>; 4], i: usize) -> [f32; 4] {
    lanes.map(|l| l.map_or(0.0, |l| l.get(i)))
}

/// `noise`, `snoise`, `cnoise`, `pnoise`, `psnoise`.
pub(super) fn noise(m: &mut Machine<'_>, func: Func, op: &Op) {
    let Some(dst) = op.dst else { return };
    let components = m.type_of(dst).components();
    let varying = m.varies(&op.args);
    let kind = match func {
        Func::CNoise => NoiseKind::Cell,
        Func::SNoise | Func::PSNoise => NoiseKind::Signed,
        _ => NoiseKind::Unsigned,
    };
    let few = super::sparse(m, varying);
    compute_as(m, dst, varying, components, |m, out, work| {
        let periodic = matches!(func, Func::PNoise | Func::PNNoise | Func::PSNoise);
        let count = if periodic { op.args.len() / 2 } else { op.args.len() };
        const NONE: Lane<'static> = Lane { values: &[0.0], stride: 0 };
        let task = NoiseTask {
            x: spread(m, &op.args[..count]),
            periods: periodic.then(|| spread(m, &op.args[count..]).map(|p| p.unwrap_or(NONE))),
            kind,
        };
        for c in 0..components {
            if few {
                // Lanes are computed one by one, as a list of one lane.
                work.each(|i| {
                    let at = |lane: Lane<'_>| [lane.get(i)];
                    let x = task.x.map(|l| l.map(at));
                    let periods = task.periods.map(|p| p.map(at));
                    let task = NoiseTask {
                        x: std::array::from_fn(|k| x[k].as_ref().map(|v| Lane { values: &v[..], stride: 0 })),
                        periods: periods
                            .as_ref()
                            .map(|p| std::array::from_fn(|k| Lane { values: &p[k][..], stride: 0 })),
                        kind,
                    };
                    let mut value = [0.0];
                    simd::noise(&task, c as u32, &mut value);
                    out.set(c, i, value[0]);
                });
            } else {
                simd::noise(&task, c as u32, out.part(c));
            }
        }
    });
}

/// The kind of noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoiseForm {
    /// `noise`: within [0, 1].
    Noise,
    /// `snoise`: within [-1, 1].
    Signed,
    /// `cnoise`: one value for each cell.
    Cell,
}

/// Computes the noise of the language at one point of 1 to 4 dimensions, into one or more uncorrelated components.
/// `period`, one for each dimension, makes it periodic.
pub fn noise_at(form: NoiseForm, x: &[f32], period: Option<&[f32]>, out: &mut [f32]) {
    let kind = match form {
        NoiseForm::Noise => NoiseKind::Unsigned,
        NoiseForm::Signed => NoiseKind::Signed,
        NoiseForm::Cell => NoiseKind::Cell,
    };
    const NONE: Lane<'static> = Lane { values: &[0.0], stride: 0 };
    let lane = |list: &'_ [f32], k: usize| -> Option<[f32; 1]> { list.get(k).map(|v| [*v]) };
    let values: [Option<[f32; 1]>; 4] = std::array::from_fn(|k| lane(x, k));
    let periods: Option<[Option<[f32; 1]>; 4]> = period.map(|p| std::array::from_fn(|k| lane(p, k)));
    let task = NoiseTask {
        x: std::array::from_fn(|k| values[k].as_ref().map(|v| Lane { values: &v[..], stride: 0 })),
        periods: periods.as_ref().map(|p| {
            std::array::from_fn(|k| p[k].as_ref().map_or(NONE, |v| Lane { values: &v[..], stride: 0 }))
        }),
        kind,
    };
    for (c, value) in out.iter_mut().enumerate() {
        let mut one = [0.0];
        simd::noise(&task, c as u32, &mut one);
        *value = one[0];
    }
}

/// Runs `random` and `randomgrid`. Without an argument the numbers depend on the grid's seed, the lane and the
/// number of earlier draws, so that an image can be computed again. Lanes with their own seeds count separately.
pub(super) fn random(m: &mut Machine<'_>, func: Func, op: &Op) {
    let Some(dst) = op.dst else { return };
    let components = m.type_of(dst).components();
    // Seed 0 keeps the numbers of the grid's own seed.
    let seeded = |name: u32| if m.st.seed == 0 { name } else { hash::words(&[name, m.st.seed]) };
    let (seed, draw) = (seeded(m.grid.seed), m.draws);
    let names: Vec<u32> = match op.args.is_empty() && func == Func::Random && m.st.seed != 0 {
        true => m.grid.names.iter().map(|name| seeded(*name)).collect(),
        false => Vec::new(),
    };
    let per_lane = op.args.is_empty() && func == Func::Random;
    let mut drawn_before = Vec::new();
    if op.args.is_empty() {
        m.draws = m.draws.wrapping_add(1);
        if per_lane && !m.grid.names.is_empty() {
            drawn_before = std::mem::take(&mut m.lane_draws);
            drawn_before.resize(m.n, 0_u32);
        }
    }
    let varying = per_lane || m.varies(&op.args);
    compute_as(m, dst, varying, components, |m, out, work| {
        let x = spread(m, &op.args);
        let dimensions = x.iter().flatten().count();
        work.each(|i| {
            for c in 0..components {
                let k = c as u32;
                let v = if dimensions > 0 {
                    hashed(&at(&x, i)[..dimensions], k)
                } else if let (true, Some(name)) = (per_lane, names.get(i).or(m.grid.names.get(i))) {
                    drawn(&[*name, drawn_before[i], 1], k)
                } else if per_lane {
                    drawn(&[seed, draw, i as u32 + 1], k)
                } else {
                    drawn(&[seed, draw, 0], k)
                };
                out.set(c, i, v);
            }
        });
    });
    if !drawn_before.is_empty() {
        m.mask.active.iter().for_each(|lane| drawn_before[*lane as usize] += 1);
        m.lane_draws = drawn_before;
    }
}

/// Runs `aastep (edge, s, [ds], ...)`, the step filtered by a kernel over `[s - ds/2, s + ds/2]`. `ds` is the
/// filter width of `s` by default, and the "width" option scales it.
pub(super) fn aastep(m: &mut Machine<'_>, op: &Op) {
    let Some(dst) = op.dst else { return };
    let Some(call) = m.call(op) else { return };
    let resolved = m.resolved(call);
    let Options::Step(options) = &resolved.options else { return };
    let (given, width) = (call.operands.get(2).copied(), options.width);
    let mut filter = Filter::CatmullRom;
    if let Some(name) = options.filter.map(|name| m.string(name)) {
        match Filter::from_word(&name) {
            Some(f @ (Filter::CatmullRom | Filter::Box | Filter::Triangle | Filter::Gaussian)) => filter = f,
            _ => m.complain(op.at, &format!("aastep has no filter \"{name}\"")),
        }
    }
    for other in &resolved.unknown {
        m.complain(op.at, &format!("aastep has no option \"{other}\""));
    }
    let [edge, s] = [op.args[0], op.args[1]];
    let mut ds = match given {
        Some(ds) => m.captured(ds),
        None => derive::filterwidth(m, s),
    };
    let varying = ds.varying || m.varies(&[edge, s]) || width.is_some_and(|w| m.varies(&[w]));
    if let Some(width) = width {
        let scaled_varying = ds.varying || m.view(width).varying;
        let mut scaled = m.out(scaled_varying, 1);
        map2(scaled.part(0), ds.lane(0), m.view(width).lane(0), |a, b| a * b);
        m.discard(std::mem::replace(&mut ds, scaled));
    }
    compute_as(m, dst, varying, 1, |m, out, work| {
        let (edge, s, ds) = (m.view(edge).lane(0), m.view(s).lane(0), ds.lane(0));
        work.each(|i| out.set(0, i, filtered_step(filter, edge.get(i), s.get(i), ds.get(i))));
    });
    m.discard(ds);
}

/// Returns the share of a kernel of full width `ds` around `s` that lies above `edge`.
fn filtered_step(filter: Filter, edge: f32, s: f32, ds: f32) -> f32 {
    let half = 0.5 * ds.abs();
    // NaN counts as a width of zero.
    if half.is_nan() || half <= 0.0 {
        return f32::from(s >= edge);
    }
    let x = ((s - edge) / half).clamp(-1.0, 1.0);
    // The integrals of the kernels over [-1, x], with a total of 1.
    match filter {
        Filter::Box => 0.5 + 0.5 * x,
        Filter::Triangle => {
            if x < 0.0 {
                0.5 * (1.0 + x) * (1.0 + x)
            } else {
                1.0 - 0.5 * (1.0 - x) * (1.0 - x)
            }
        }
        // exp (-2 x^2)
        Filter::Gaussian => 0.5 + 0.5 * libm::erff(std::f32::consts::SQRT_2 * x) / GAUSSIAN,
        _ => 0.5 + catmull_rom(2.0 * x.abs()).copysign(x),
    }
}

/// erf (sqrt 2), the part of the Gaussian inside of its width.
const GAUSSIAN: f32 = 0.954_499_7;

/// Returns the integral of the Catmull-Rom kernel from 0 to `t`, which is at most 2. Half of the kernel has an
/// integral of 1/2.
fn catmull_rom(t: f32) -> f32 {
    if t < 1.0 {
        // 1 - 5/2 t^2 + 3/2 t^3
        t - 5.0 / 6.0 * t * t * t + 0.375 * t * t * t * t
    } else {
        // 2 - 4 t + 5/2 t^2 - 1/2 t^3, from 1 on; 13/24 at 1.
        let f = |t: f32| 2.0 * t - 2.0 * t * t + 5.0 / 6.0 * t * t * t - 0.125 * t * t * t * t;
        13.0 / 24.0 + f(t) - f(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILTERS: [Filter; 4] = [Filter::Box, Filter::Triangle, Filter::Gaussian, Filter::CatmullRom];

    #[test]
    fn filtered_steps_are_integrals_of_their_kernels() {
        for filter in FILTERS {
            let step = |x: f32| filtered_step(filter, 0.0, x, 2.0);
            assert!(step(-1.0).abs() < 1e-6 && (step(1.0) - 1.0).abs() < 1e-6, "{filter:?}");
            assert_eq!((step(-5.0), step(5.0)), (step(-1.0), step(1.0)));
            assert!((step(0.0) - 0.5).abs() < 1e-6);
            // Slopes are the kernel, of natural shape squeezed into [-1, 1].
            let width = filter.natural_width();
            let norm: f32 =
                (0..2000).map(|k| filter.weight((k as f32 / 1000.0 - 1.0) * width / 2.0, width)).sum();
            for k in -8..=8 {
                let x = k as f32 * 0.11;
                let slope = (step(x + 0.005) - step(x - 0.005)) / 0.01;
                let expected = filter.weight(x * width / 2.0, width) / (norm / 1000.0);
                assert!((slope - expected).abs() < 0.02, "{filter:?} {x}: {slope} {expected}");
            }
        }
    }

    #[test]
    fn a_filter_without_width_is_a_step() {
        for ds in [0.0, f32::NAN] {
            assert_eq!(filtered_step(Filter::Box, 1.0, 1.0, ds), 1.0);
            assert_eq!(filtered_step(Filter::Box, 1.0, 0.99, ds), 0.0);
        }
        assert_eq!(filtered_step(Filter::Box, 0.0, 0.25, -1.0), 0.75);
    }
}
