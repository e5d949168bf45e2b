//! Runs the parts of a layer that a re-render must run, and takes the values of the others ([`crate::link::Parts`]).

use crate::link::{Code, Part, Parts};
use crate::run::machine::Machine;
use crate::run::store::Slot;
use crate::services::{KeptValue, PartValues};
use std::collections::HashMap;
use std::sync::Arc;

impl Parts {
    /// Finds the parts that must run. `is_kept` is true for those whose values are kept and still right.
    fn stale(&self, is_kept: &mut dyn FnMut(u32) -> bool) -> Vec<bool> {
        let mut stale: Vec<bool> = (0..self.list.len() as u32).map(|k| !is_kept(k)).collect();
        for (slot, from) in &self.results {
            let from = *from as usize;
            stale[from] |= !self.list[from].keeps.contains(slot);
        }
        loop {
            let before = stale.clone();
            let chains = self.list.iter().zip(&stale).filter(|(_, stale)| **stale);
            let chains = chains.fold(0, |chains, (part, _)| chains | part.chains);
            for (k, part) in self.list.iter().enumerate() {
                stale[k] |= part.chains & chains != 0;
                let missing = |(slot, from): &&(u32, u32)| !self.list[*from as usize].keeps.contains(slot);
                for (_, from) in part.reads.iter().filter(missing) {
                    stale[*from as usize] |= stale[k];
                }
            }
            if stale == before {
                return stale;
            }
        }
    }
}

impl<'a> Machine<'a> {
    /// Runs the body of a layer, except for the parts whose values are kept and still right.
    pub(crate) fn parts(&mut self, code: &'a Code) {
        let Code { body, parts, .. } = code;
        let stale = parts.stale(&mut |k| self.services.is_part_kept(k));
        let mut values: Vec<Arc<PartValues>> = Vec::with_capacity(stale.len());
        // By register, the part whose value it has.
        let mut holds = HashMap::new();
        for ((k, part), stale) in (0..).zip(&parts.list).zip(stale) {
            if !stale && let Some(known) = self.services.recall_part(k) {
                values.push(known);
                continue;
            }
            part.reads.iter().for_each(|read| self.load_part(*read, &values, &mut holds));
            self.services.begin_part(part.chains != 0);
            self.block(&body[part.range.clone()]);
            holds.extend(part.writes.iter().map(|slot| (*slot, k)));
            let kept = Arc::new(self.part_values(part));
            let reads: Vec<u32> = part.reads.iter().map(|(_, from)| *from).collect();
            self.services.end_part(k, &reads, &kept);
            values.push(kept);
        }
        parts.results.iter().for_each(|read| self.load_part(*read, &values, &mut holds));
    }

    /// Returns the values that other parts read of a part that just ran.
    fn part_values(&self, part: &Part) -> PartValues {
        let kept = part.keeps.iter().map(|slot| {
            let Slot { data, varying } = &self.st.slots[*slot as usize];
            KeptValue { slot: *slot, varying: *varying, values: data.as_slice().into() }
        });
        PartValues(kept.collect())
    }

    /// Brings the value of a register after a part into it, unless it has that value.
    fn load_part(
        &mut self,
        (slot, from): (u32, u32),
        values: &[Arc<PartValues>],
        holds: &mut HashMap<u32, u32>,
    ) {
        if holds.insert(slot, from) == Some(from) {
            return;
        }
        let known = values[from as usize].0.iter().find(|kept| kept.slot == slot);
        debug_assert!(known.is_some(), "what parts read of others is kept");
        let Some(KeptValue { varying, values, .. }) = known else { return };
        let register = &mut self.st.slots[slot as usize];
        register.varying = *varying;
        register.data.clear();
        register.data.extend_from_slice(values);
    }
}
