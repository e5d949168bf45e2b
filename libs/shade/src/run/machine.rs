//! A run of a group over a grid: registers, mask and services.

use crate::link::Layer;
use crate::program::{At, Place};
use crate::run::kernel::{blend, blend_one};
use crate::run::store::{Mask, Out, Pool, Slot, View, Work};
use crate::run::strings::{Regexes, StringId, StringTable};
use crate::tape::{Room, Tape};
use crate::{Grid, Group, LightResult, LookupResult, Services, TraceResult};
use granita_base::{Severity, Transform};
use granita_gsl::ir::{Global, ScopeId, SourcePos, SymbolId, ValueType};
use std::sync::Arc;

/// The memory that is kept from run to run. Values are not kept.
#[derive(Debug, Default)]
pub(crate) struct State {
    pub(crate) slots: Vec<Slot>,
    pub(crate) pool: Pool,
    pub(crate) masks: Vec<Mask>,
    pub(crate) strings: StringTable,
    pub(crate) regexes: Regexes,
    pub(crate) lookup: LookupResult,
    pub(crate) room: Room,
    pub(crate) messages: Vec<Sent>,
    pub(crate) spaces: Vec<(StringId, usize, Option<Transform>)>,
    /// The stacks of a run, empty between runs.
    pub(crate) loops: Vec<LoopFrame>,
    pub(crate) scopes: Vec<(ScopeId, Mask)>,
    /// The layers that need not run.
    pub(crate) idle: Vec<bool>,
    /// True when results are searched for NaN.
    pub(crate) nan_check: bool,
    /// A seed of random numbers that is combined with that of each grid; 0 has no effect.
    pub(crate) seed: u32,
    /// The group and the number of lanes of the last run.
    pub(crate) last: (u64, usize),
}

/// A message of `setmessage`.
#[derive(Debug)]
pub(crate) struct Sent {
    pub(crate) name: StringId,
    pub(crate) value: ValueType,
    pub(crate) elements: u32,
    pub(crate) slot: Slot,
}

/// A loop that is running.
#[derive(Debug)]
pub(crate) struct LoopFrame {
    pub(crate) broken: Mask,
    pub(crate) continued: Mask,
}

/// The properties of the emission for `emit` bodies.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Emission {
    pub(crate) inside: bool,
    pub(crate) infinite: bool,
    /// The angle in radians across a broad distant light that shines from all of it at once; 0 for others.
    pub(crate) spread: f32,
}

/// One ray of each lane of a `trace` loop.
pub(crate) struct RaySample {
    /// The results of the rays.
    pub(crate) found: TraceResult,
    /// The names and types of `found.others`.
    pub(crate) wanted: Vec<(Arc<str>, ValueType)>,
}

/// One run.
pub(crate) struct Machine<'a> {
    pub(crate) group: &'a Group,
    pub(crate) grid: &'a Grid,
    pub(crate) services: &'a mut dyn Services,
    pub(crate) st: &'a mut State,
    /// The number of lanes.
    pub(crate) n: usize,
    /// The index of the running layer.
    pub(crate) layer: usize,
    /// The tapes of the running code.
    pub(crate) tapes: &'a [Tape],
    pub(crate) mask: Mask,
    /// The number of lanes at the start of the run. Others never matter.
    pub(crate) base: usize,
    pub(crate) loops: Vec<LoopFrame>,
    pub(crate) scopes: Vec<(ScopeId, Mask)>,
    /// The number of calls of `random` and `randomgrid` so far.
    pub(crate) draws: u32,
    /// The number of calls of `random` of each lane, for lanes with their own seeds.
    pub(crate) lane_draws: Vec<u32>,
    pub(crate) emission: Emission,
    /// The values of [`crate::IlluminateQuery::cone`] for all lanes.
    pub(crate) cone: Option<[Vec<f32>; 2]>,
    /// The samples of a running light.
    pub(crate) emitted: Option<LightResult>,
    /// The light that the innermost `lights` loop examines.
    pub(crate) light: Option<Arc<LightResult>>,
    /// The rays of the innermost `trace` loop.
    pub(crate) ray: Option<RaySample>,
}

impl<'a> Machine<'a> {
    /// Returns the running layer.
    #[inline]
    pub(crate) fn code(&self) -> &'a Layer {
        let group: &'a Group = self.group;
        &group.layers[self.layer]
    }

    /// Returns the place of a symbol.
    #[inline]
    pub(crate) fn place(&self, sym: SymbolId) -> &'a Place {
        &self.code().places[sym.0 as usize]
    }

    /// Returns the type of a symbol's elements.
    pub(crate) fn type_of(&self, sym: SymbolId) -> ValueType {
        self.place(sym).value
    }

    /// Returns the values of a symbol.
    #[inline]
    pub(crate) fn view(&self, sym: SymbolId) -> View<'_> {
        view(self.code(), self.group, &self.st.slots, self.n, sym)
    }

    /// Returns the values of a global.
    pub(crate) fn global(&self, global: Global) -> View<'_> {
        let slot = &self.st.slots[global as usize];
        View {
            data: &slot.data,
            n: self.n,
            varying: slot.varying,
            components: global.value_type().components(),
            elements: 1,
        }
    }

    /// True when one of the symbols is varying.
    pub(crate) fn varies(&self, list: &[SymbolId]) -> bool {
        list.iter().any(|&s| self.view(s).varying)
    }

    /// True when every lane of the run is active.
    pub(crate) fn whole(&self) -> bool {
        self.mask.count() == self.base
    }

    /// Returns the lanes to compute one by one.
    pub(crate) fn work(&self, varying: bool) -> Work<'_> {
        if !varying {
            Work::One
        } else if self.mask.count() == self.n {
            Work::All(self.n)
        } else {
            Work::Some(&self.mask.active)
        }
    }

    /// Returns the first active lane, where varying arguments that must be uniform are read.
    pub(crate) fn first(&self) -> usize {
        self.mask.active.first().map_or(0, |&i| i as usize)
    }

    /// Allocates a result of `components` numbers.
    pub(crate) fn out(&mut self, varying: bool, components: usize) -> Out {
        let width = if varying { self.n } else { 1 };
        Out { data: self.st.pool.take(components * width), width, varying }
    }

    /// Frees a result.
    pub(crate) fn discard(&mut self, out: Out) {
        self.st.pool.give(out.data);
    }

    /// Stores a result into a symbol, in active lanes.
    pub(crate) fn commit(&mut self, dst: SymbolId, mut out: Out) {
        let place = self.place(dst);
        // A damaged module may store a value of another size. Registers keep theirs.
        out.data.resize(place.value.components() * place.elements as usize * out.width, 0.0);
        match place.at {
            At::Slot(slot) => self.commit_slot(slot as usize, out, place.scratch),
            // Nothing writes constants; linking has checked it.
            At::Const(_) => self.discard(out),
        }
    }

    /// Stores a result into a global, in active lanes.
    pub(crate) fn commit_global(&mut self, global: Global, out: Out) {
        self.commit_slot(global as usize, out, false);
    }

    /// Stores a result in active lanes. With `scratch`, other lanes do not matter.
    pub(crate) fn commit_slot(&mut self, slot: usize, mut out: Out, scratch: bool) {
        let whole = scratch || self.whole();
        let slot = &mut self.st.slots[slot];
        if whole {
            std::mem::swap(&mut slot.data, &mut out.data);
            slot.varying = out.varying;
        } else if out.varying || slot.varying || !same_bits(&slot.data, &out.data) {
            promote(slot, self.n, &mut self.st.pool);
            let on = &self.mask.on;
            if out.varying {
                for (to, from) in slot.data.chunks_exact_mut(self.n).zip(out.data.chunks_exact(self.n)) {
                    blend(to, from, on);
                }
            } else {
                for (to, &from) in slot.data.chunks_exact_mut(self.n).zip(&out.data) {
                    blend_one(to, from, on);
                }
            }
        }
        self.st.pool.give(out.data);
    }

    /// Returns a copy of a symbol's or global's register, for [`Self::restore`].
    pub(crate) fn saved(&mut self, slot: usize) -> Slot {
        let varying = self.st.slots[slot].varying;
        let len = self.st.slots[slot].data.len();
        let mut data = self.st.pool.take(len);
        data.copy_from_slice(&self.st.slots[slot].data);
        Slot { data, varying }
    }

    /// Restores a saved register.
    pub(crate) fn restore(&mut self, slot: usize, saved: Slot) {
        let old = std::mem::replace(&mut self.st.slots[slot], saved);
        self.st.pool.give(old.data);
    }

    /// Takes an empty mask.
    pub(crate) fn borrow_mask(&mut self) -> Mask {
        let mut mask = self.st.masks.pop().unwrap_or_default();
        mask.on.clear();
        mask.on.resize(self.n, false);
        mask.active.clear();
        mask
    }

    /// Returns a mask to the pool.
    pub(crate) fn return_mask(&mut self, mask: Mask) {
        self.st.masks.push(mask);
    }

    /// The text of a string.
    pub(crate) fn text(&self, id: StringId) -> &Arc<str> {
        self.st.strings.text(&self.group.strings, id)
    }

    /// The id of a text.
    pub(crate) fn intern(&mut self, text: &str) -> StringId {
        self.intern_at(text, SourcePos::default())
    }

    /// Returns the id of a text that is made at a place of the source. It is that of the empty string when the
    /// table is full.
    pub(crate) fn intern_at(&mut self, text: &str, at: SourcePos) -> StringId {
        if let Some(id) = self.st.strings.intern(&self.group.strings, text) {
            return id;
        }
        let what = format!(
            "its strings take more than {} MiB at once; further ones are empty",
            crate::run::strings::MAX_BYTES >> 20
        );
        self.complain(at, &what);
        StringId::EMPTY
    }

    /// The string of a symbol in the first active lane.
    pub(crate) fn string(&self, sym: SymbolId) -> Arc<str> {
        self.text(self.view(sym).string(self.first())).clone()
    }

    /// Reports an error of the running shader, once per place and cause of the group.
    pub(crate) fn complain(&mut self, at: SourcePos, what: &str) {
        let module = &self.code().module;
        let place = module.location(at);
        let key = format!("{}|{place}|{what}", self.layer);
        if self.group.first_time(key) {
            self.services.say_of(Severity::Error, &module.name, &place, what);
        }
    }

    /// Reports a missing feature once per group.
    pub(crate) fn missing(&mut self, feature: &str) {
        if self.group.first_time(format!("missing {feature}")) {
            self.services.unsupported(feature);
        }
    }
}

/// Returns the values of a symbol from parts of a machine, so that services may be called at the same time.
#[inline]
pub(crate) fn view<'v>(
    layer: &'v Layer,
    group: &'v Group,
    slots: &'v [Slot],
    n: usize,
    sym: SymbolId,
) -> View<'v> {
    let place = &layer.places[sym.0 as usize];
    let (data, varying) = match place.at {
        At::Slot(k) => {
            let slot = &slots[k as usize];
            (slot.data.as_slice(), slot.varying)
        }
        At::Const(k) => (&*group.constants[k as usize], false),
    };
    View { data, n, varying, components: place.value.components().max(1), elements: place.elements as usize }
}

/// Makes a register varying.
pub(crate) fn promote(slot: &mut Slot, n: usize, pool: &mut Pool) {
    if slot.varying {
        return;
    }
    let mut wide = pool.take(slot.data.len() * n);
    for (to, &from) in wide.chunks_exact_mut(n).zip(&slot.data) {
        to.fill(from);
    }
    pool.give(std::mem::replace(&mut slot.data, wide));
    slot.varying = true;
}

/// True when two lists are equal to the bit.
fn same_bits(a: &[f32], b: &[f32]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(x, y)| x.to_bits() == y.to_bits())
}
