//! Divides the code of a layer into parts for re-renders: a forward partition by what may change.
//!
//! Code depends on changes through *sources*: lookups in files, lights, rays. The class of a statement is the set of
//! the sources that its values depend on. Statements that follow each other and have one class are a [`Part`]. In a
//! re-render only the parts run whose sources changed. What they read from other parts, the frontier, was kept lane by
//! lane when these ran.
//!
//! Some sources draw numbers from a common sequence or share their answers: all lights that are not ambient, all rays,
//! all calls of `random ()`. Such a *chain* counts as one source, whose parts run all or none.

use super::analyse::{Analysis, SURROUNDINGS, is_plain};
use super::optimize::{Effect, blocks, effect, first_written, is_partial, operands};
use crate::program::{At, Block, Op, Operation, Place, Stmt};
use crate::tape::Tape;
use granita_gsl::Func;
use granita_gsl::ir::{Global, ShaderKind, Symbol, SymbolId, SymbolKind, ValueType};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// The sources of lights that are not ambient.
const LIGHTS: u64 = 1;
/// The sources of ambient lights.
const AMBIENT: u64 = 1 << 1;
/// The sources of rays, shadows and records.
const RAYS: u64 = 1 << 2;
/// The sequence of `random ()`.
const RANDOM: u64 = 1 << 3;
/// All chains.
const CHAINS: u64 = LIGHTS | AMBIENT | RAYS | RANDOM;
/// The number of sources of a layer.
const MAX_SOURCES: u32 = 64;
/// The number of plain operations whose results are computed again sooner than kept.
const FEW_OPERATIONS: u32 = 48;

/// Statements of a layer that depend on the same sources.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Part {
    /// Its statements in the body.
    pub(crate) range: Range<usize>,
    /// The chains to which it belongs.
    pub(crate) chains: u64,
    /// True when its values are not kept, because they are strings, or computed sooner than kept. It runs in a
    /// re-render when another part or the result needs it.
    pub(crate) unkept: bool,
    /// The registers that it reads from other parts, and the parts that wrote them last.
    pub(crate) reads: Vec<(u32, u32)>,
    /// The registers that it may write.
    pub(crate) writes: BTreeSet<u32>,
    /// The registers whose values after it are kept.
    pub(crate) keeps: Vec<u32>,
}

/// The parts of a layer.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Parts {
    pub(crate) list: Vec<Part>,
    /// The registers of results that parts write, and the parts that write them last.
    pub(crate) results: Vec<(u32, u32)>,
}

/// Divides a body. There are no parts when all of it depends on the same sources, or when it has effects that must
/// happen in every run.
pub(crate) fn divide(
    body: &Block,
    tapes: &[Tape],
    symbols: &[Symbol],
    places: &[Place],
    facts: &Analysis,
) -> Parts {
    // Messages and own parameters are read by name.
    if facts.listens.iter().any(|usage| matches!(usage, ShaderKind::Surface | ShaderKind::Volume)) {
        return Parts::default();
    }
    let divider = Divider { symbols, places };
    let mut units = Vec::new();
    let mut next = 0;
    while let Some(stmt) = body.get(next) {
        let length = match stmt {
            Stmt::Op(Op { code: Operation::Fused(k), .. }) => 1 + tapes[*k as usize].len,
            _ => 1,
        };
        let Some(unit) = divider.unit(&body[next..next + length]) else { return Parts::default() };
        units.push((next..next + length, unit));
        next += length;
    }
    divider.parts(units).unwrap_or_default()
}

/// What statements read and write, by register.
#[derive(Default)]
struct Unit {
    /// The registers whose values before the statements they may read.
    reads: BTreeSet<u32>,
    writes: BTreeSet<u32>,
    /// The chains of its sources.
    chains: u64,
    /// The number of other sources.
    lookups: u32,
    /// The number of plain operations; large for others.
    cost: u32,
}

struct Divider<'a> {
    symbols: &'a [Symbol],
    places: &'a [Place],
}

impl Divider<'_> {
    fn slot(&self, symbol: SymbolId) -> Option<u32> {
        match self.places[symbol.0 as usize].at {
            At::Slot(slot) => Some(slot),
            At::Const(_) => None,
        }
    }

    /// Returns what statements do; `None` when they have effects besides their results.
    fn unit(&self, list: &[Stmt]) -> Option<Unit> {
        let mut unit = Unit::default();
        self.block(list, &mut BTreeSet::new(), &mut unit, false)?;
        Some(unit)
    }

    /// Adds statements to a unit. `own` holds the registers that were written before in the same lanes. `inside` is
    /// true when other lanes may keep their values.
    fn block(&self, list: &[Stmt], own: &mut BTreeSet<u32>, unit: &mut Unit, inside: bool) -> Option<()> {
        list.iter().try_for_each(|stmt| self.stmt(stmt, own, unit, inside))
    }

    fn stmt(&self, stmt: &Stmt, own: &mut BTreeSet<u32>, unit: &mut Unit, inside: bool) -> Option<()> {
        operands(stmt, &mut |symbol| {
            unit.reads.extend(self.slot(symbol).filter(|slot| !own.contains(slot)));
        });
        match stmt {
            Stmt::Op(op) => return self.op(op, own, unit, inside),
            Stmt::Exit | Stmt::Emit { .. } => return None,
            Stmt::Leave(_) | Stmt::Break | Stmt::Continue => {}
            Stmt::Lights { body, .. } => {
                unit.chains |= LIGHTS;
                self.read_surroundings(own, unit);
                // The loop sets these globals, and restores them at its end.
                let set = [Global::L, Global::Cl, Global::Pl, Global::Nl].map(|g| g as u32);
                let before: Vec<u32> = set.into_iter().filter(|slot| unit.writes.contains(slot)).collect();
                let mut own = own.clone();
                own.extend(set);
                self.block(body, &mut own, unit, true)?;
                set.iter().filter(|slot| !before.contains(slot)).for_each(|slot| {
                    unit.writes.remove(slot);
                });
            }
            Stmt::Trace { body, .. } => {
                unit.chains |= RAYS;
                self.read_surroundings(own, unit);
                self.block(body, &mut own.clone(), unit, true)?;
            }
            Stmt::Loop { body_first, test, cond, body, step } => {
                unit.cost = u32::MAX;
                let mut tested = own.clone();
                self.block(test, &mut tested, unit, true)?;
                if let Some(slot) = cond.and_then(|cond| self.slot(cond)).filter(|s| !tested.contains(s)) {
                    unit.reads.insert(slot);
                }
                let before = if *body_first { &*own } else { &tested };
                self.block(body, &mut before.clone(), unit, true)?;
                self.block(step, &mut before.clone(), unit, true)?;
            }
            Stmt::If { .. } | Stmt::Scope { .. } => {
                for block in blocks(stmt) {
                    self.block(block, &mut own.clone(), unit, true)?;
                }
            }
        }
        Some(())
    }

    fn op(&self, op: &Op, own: &mut BTreeSet<u32>, unit: &mut Unit, inside: bool) -> Option<()> {
        if matches!(op.code, Operation::Fused(_)) {
            return Some(());
        }
        self.sources(op, own, unit)?;
        unit.cost = unit.cost.saturating_add(cost(op));
        let mut write = |symbol: SymbolId, partial: bool| {
            let Some(slot) = self.slot(symbol) else { return };
            let place = &self.places[symbol.0 as usize];
            if (partial || inside && !place.scratch) && !own.contains(&slot) {
                unit.reads.insert(slot);
            }
            if !partial {
                own.insert(slot);
            }
            unit.writes.insert(slot);
        };
        for symbol in op.args.iter().skip(first_written(op)) {
            write(*symbol, true);
        }
        if let Some(dst) = op.dst {
            write(dst, is_partial(op, self.symbols));
        }
        Some(())
    }

    /// Adds the sources of an operation, and what it reads besides its operands. Returns `None` for effects.
    fn sources(&self, op: &Op, own: &BTreeSet<u32>, unit: &mut Unit) -> Option<()> {
        let how = effect(op, self.symbols);
        let Some(func) = op.func().filter(|_| how == Effect::Bound) else {
            if how != Effect::Pure && !op.func().is_some_and(is_plain) {
                Self::read_globals(own, unit);
            }
            return Some(());
        };
        match func {
            Func::Diffuse | Func::Specular => unit.chains |= LIGHTS,
            Func::Ambient => unit.chains |= AMBIENT,
            Func::Environment | Func::Shadow | Func::Occlusion | Func::Indirect => unit.chains |= RAYS,
            Func::Subsurface | Func::SpatialDbQuery => unit.chains |= RAYS,
            Func::Random => unit.chains |= RANDOM,
            Func::Texture | Func::Texture3d | Func::GetTextureInfo => unit.lookups += 1,
            Func::Bump => {
                for g in [Global::P, Global::N] {
                    unit.reads.extend(Some(g as u32).filter(|slot| !own.contains(slot)));
                    unit.writes.insert(g as u32);
                }
            }
            Func::GetAttribute | Func::GetMessage | Func::Fresnel => {}
            _ => return None,
        }
        if unit.chains & CHAINS & !RANDOM != 0 {
            self.read_surroundings(own, unit);
        } else {
            Self::read_globals(own, unit);
        }
        Some(())
    }

    /// Notes that the globals may be read that functions read besides their operands.
    fn read_globals(own: &BTreeSet<u32>, unit: &mut Unit) {
        unit.reads.extend(SURROUNDINGS.map(|g| g as u32).iter().filter(|slot| !own.contains(slot)));
    }

    /// Notes that all globals and parameters may be read, as by lights that query the surface.
    fn read_surroundings(&self, own: &BTreeSet<u32>, unit: &mut Unit) {
        let globals = 0..Global::ALL.len() as u32;
        unit.reads.extend(globals.chain(self.params()).filter(|slot| !own.contains(slot)));
    }

    /// Returns the registers of parameters.
    fn params(&self) -> impl Iterator<Item = u32> {
        let params = self
            .symbols
            .iter()
            .zip(self.places)
            .filter(|(symbol, _)| matches!(symbol.kind, SymbolKind::Param(_)));
        params.filter_map(|(_, place)| match place.at {
            At::Slot(slot) => Some(slot),
            At::Const(_) => None,
        })
    }

    /// True when a register holds strings.
    fn is_text(&self, slot: u32) -> bool {
        self.places.iter().any(|place| place.at == At::Slot(slot) && place.value == ValueType::String)
    }

    /// Makes parts of the units of a body. Returns `None` when it cannot be divided.
    fn parts(&self, units: Vec<(Range<usize>, Unit)>) -> Option<Parts> {
        let mut sources = CHAINS.count_ones();
        // By register: the class of its value, and the part that wrote it.
        let mut values: BTreeMap<u32, (u64, u32)> = BTreeMap::new();
        let mut classes: Vec<u64> = Vec::new();
        let mut list: Vec<Part> = Vec::new();
        let mut costs: Vec<u32> = Vec::new();
        for (range, unit) in units {
            let mut class = unit.chains;
            if unit.lookups > 0 {
                class |= 1_u64.checked_shl(sources).filter(|_| sources < MAX_SOURCES)?;
                sources += 1;
            }
            let known = |slot: &u32| values.get(slot).map_or(0, |value| value.0);
            class |= unit.reads.iter().map(known).fold(0, |a, b| a | b);
            if classes.last() != Some(&class) {
                classes.push(class);
                costs.push(0);
                list.push(Part {
                    range: range.start..range.start,
                    chains: 0,
                    unkept: false,
                    reads: Vec::new(),
                    writes: BTreeSet::new(),
                    keeps: Vec::new(),
                });
            }
            let number = list.len() as u32 - 1;
            let part = list.last_mut()?;
            part.range.end = range.end;
            part.chains |= unit.chains;
            let asks = unit.chains != 0 || unit.lookups > 0;
            let cost = costs.last_mut()?;
            *cost = cost.saturating_add(if asks { u32::MAX } else { unit.cost });
            for slot in unit.reads {
                if let Some((_, from)) = values.get(&slot).filter(|(_, from)| *from != number)
                    && !part.reads.contains(&(slot, *from))
                {
                    part.reads.push((slot, *from));
                }
            }
            values.extend(unit.writes.iter().map(|slot| (*slot, (class, number))));
            part.writes.extend(unit.writes);
        }
        if list.len() < 2 {
            return Some(Parts::default());
        }
        let is_result =
            |slot: &u32| (*slot as usize) < Global::ALL.len() || self.params().any(|p| p == *slot);
        let results: Vec<(u32, u32)> = values
            .iter()
            .filter(|(slot, _)| is_result(slot))
            .map(|(slot, (_, from))| (*slot, *from))
            .collect();
        for (part, cost) in list.iter_mut().zip(costs) {
            part.unkept = cost <= FEW_OPERATIONS;
        }
        // What is not kept is computed from what is, also where both depend on the same.
        let frontier = list.iter().zip(&classes).flat_map(|(part, class)| {
            let differs = |(_, from): &&(u32, u32)| part.unkept || classes[*from as usize] != *class;
            part.reads.iter().filter(differs).copied().collect::<Vec<_>>()
        });
        let kept: BTreeSet<(u32, u32)> = frontier.chain(results.iter().copied()).collect();
        for (slot, from) in kept {
            let part = &mut list[from as usize];
            match self.is_text(slot) {
                // Strings have no lasting form.
                true if classes[from as usize] != 0 => return None,
                true => part.unkept = true,
                false => part.keeps.push(slot),
            }
        }
        list.iter_mut().filter(|part| part.unkept).for_each(|part| part.keeps.clear());
        Some(Parts { list, results })
    }
}

/// Returns the cost of an operation, in plain ones.
fn cost(op: &Op) -> u32 {
    use Func as F;
    match op.func() {
        Some(F::Noise | F::SNoise | F::CNoise | F::PNoise | F::PSNoise | F::PNNoise | F::Spline) => u32::MAX,
        _ => 1,
    }
}
