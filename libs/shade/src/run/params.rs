//! Assigns values to globals and parameters before a layer runs (reference 5.3.2), and reads results after it.

use crate::link::{Connection, Endpoint, ParamPlan, same_type};
use crate::program::At;
use crate::run::machine::{Machine, promote};
use crate::run::store::Slot;
use crate::run::strings::StringId;
use crate::{IlluminateQuery, Lane3, Lanes3, Primvar, PrimvarData};
use granita_base::{BaseType, ParamType, Vec3};
use granita_gsl::ir::{Global, ValueType};
use std::sync::Arc;

impl Machine<'_> {
    /// Empties all registers and loads the globals that the group uses.
    pub(crate) fn prepare(&mut self, query: Option<&IlluminateQuery<'_>>) {
        self.st.slots.resize_with(self.group.slots.len().max(self.st.slots.len()), Slot::default);
        // Registers whose earlier values are not read keep their memory from the last run of the same group.
        let same = self.st.last == (self.group.id, self.n);
        self.st.last = (self.group.id, self.n);
        for ((slot, &size), &scratch) in
            self.st.slots.iter_mut().zip(&self.group.slots).zip(&self.group.scratch)
        {
            if scratch && same {
                continue;
            }
            slot.varying = false;
            slot.data.clear();
            slot.data.resize(size as usize, 0.0);
        }
        self.st.strings.reset();
        self.st.spaces.clear();
        while let Some(sent) = self.st.messages.pop() {
            self.st.pool.give(sent.slot.data);
        }
        for g in Global::ALL {
            if self.group.used[g as usize] {
                self.load_global(g, query);
            }
        }
    }

    /// Loads one global from the grid. Those of lights come from the query, or are zero.
    pub(crate) fn load_global(&mut self, global: Global, query: Option<&IlluminateQuery<'_>>) {
        let grid = self.grid;
        match global {
            Global::P => self.load_lanes(global, &grid.p),
            Global::I => self.load_lanes(global, &grid.i),
            Global::N => self.load_lanes(global, &grid.n),
            Global::Ng => self.load_lanes(global, &grid.ng),
            Global::dPdu => self.load_lanes(global, &grid.dpdu),
            Global::dPdv => self.load_lanes(global, &grid.dpdv),
            Global::dPdtime => self.load_lanes(global, &grid.dpdtime),
            Global::C => self.load_lanes(global, &grid.c),
            Global::opacity => self.load_lanes(global, &grid.opacity),
            Global::u => self.load_floats(global, &grid.u),
            Global::v => self.load_floats(global, &grid.v),
            Global::time => self.load_floats(global, &[grid.time]),
            Global::dtime => self.load_floats(global, &[grid.dtime]),
            Global::Ps | Global::Ns => {
                if let Some(q) = query {
                    self.load_query(global, if global == Global::Ps { q.ps } else { q.ns });
                }
            }
            Global::Pl | Global::Nl => {
                let given = query.and_then(|q| if global == Global::Pl { q.pl } else { q.nl });
                if let Some(lanes) = given {
                    self.load_query(global, lanes);
                }
            }
            Global::L | Global::Cl => {}
        }
    }

    /// Loads a triple per lane. A value that is the same for all lanes becomes uniform. A missing one stays zero.
    fn load_lanes(&mut self, global: Global, lanes: &Lanes3) {
        let n = self.n;
        if lanes.xyz.iter().any(|c| c.len() != n) {
            return;
        }
        let slot = &mut self.st.slots[global as usize];
        let constant = |c: &[f32]| c.iter().all(|v| v.to_bits() == c[0].to_bits());
        slot.data.clear();
        // Colours are often uniform. Positions never are, so the check ends after one comparison.
        if lanes.xyz.iter().all(|c| constant(c)) {
            slot.data.extend(lanes.xyz.iter().map(|c| c[0]));
            slot.varying = false;
        } else {
            for c in &lanes.xyz {
                slot.data.extend_from_slice(c);
            }
            slot.varying = true;
        }
    }

    /// Loads a float per lane, or one.
    fn load_floats(&mut self, global: Global, values: &[f32]) {
        let slot = &mut self.st.slots[global as usize];
        if values.len() == self.n || values.len() == 1 {
            slot.data.clear();
            slot.data.extend_from_slice(values);
            slot.varying = values.len() == self.n && self.n > 1;
        }
    }

    /// Loads lanes of a query.
    fn load_query(&mut self, global: Global, lanes: Lane3<'_>) {
        let n = self.n;
        let slot = &mut self.st.slots[global as usize];
        slot.varying = lanes.xyz.iter().any(|c| c.stride > 0);
        slot.data.clear();
        for c in &lanes.xyz {
            if slot.varying {
                slot.data.extend((0..n).map(|i| c.get(i)));
            } else {
                slot.data.push(c.values[0]);
            }
        }
    }

    /// Assigns values to the parameters of the current layer, in order of declaration. With `primvars`, primitive
    /// variables have precedence.
    pub(crate) fn bind_params(&mut self, primvars: bool) {
        let layer = self.code();
        for connection in &layer.globals {
            self.transfer(connection);
        }
        for (plan, init) in layer.params.iter().zip(&layer.inits) {
            if primvars && self.bind_primvar(plan) {
                continue;
            }
            if !plan.connections.iter().any(|w| w.target.is_whole()) {
                match &plan.given {
                    Some(values) => self.bind_given(plan, values),
                    None => self.block(init),
                }
            }
            for connection in &plan.connections {
                self.transfer(connection);
            }
        }
    }

    /// Takes the value of a primitive variable of the same name and type, if there is one.
    fn bind_primvar(&mut self, plan: &ParamPlan) -> bool {
        let grid = self.grid;
        let Some(primvar) = grid.primvars.iter().find(|p| p.name == plan.name) else { return false };
        let place = *self.place(plan.symbol);
        let array = place.array.then_some(place.elements);
        if !same_type(primvar.ty, place.value, array) {
            return false;
        }
        let At::Slot(slot) = place.at else { return false };
        self.load_primvar(slot as usize, primvar)
    }

    /// Copies a primitive variable into a register. Returns `false` when its size is wrong.
    pub(crate) fn load_primvar(&mut self, slot: usize, primvar: &Primvar) -> bool {
        let size = primvar.ty.width();
        match &primvar.data {
            PrimvarData::Floats { values, varying } => {
                if values.len() != if *varying { size * self.n } else { size } {
                    return false;
                }
                let slot = &mut self.st.slots[slot];
                slot.data.clear();
                slot.data.extend_from_slice(values);
                slot.varying = *varying;
            }
            PrimvarData::Strings(list) => {
                if list.len() != size {
                    return false;
                }
                for (k, text) in list.iter().enumerate() {
                    let id = self.intern(text);
                    self.st.slots[slot].data[k] = id.to_register();
                }
                self.st.slots[slot].varying = false;
            }
        }
        true
    }

    /// Takes the value of the instance. Spatial values are transformed from "shader" space to "common" space.
    fn bind_given(&mut self, plan: &ParamPlan, values: &Arc<[f32]>) {
        let place = *self.place(plan.symbol);
        let At::Slot(slot) = place.at else { return };
        let matrix = match place.value {
            ValueType::Point | ValueType::Vector | ValueType::Normal | ValueType::Matrix => {
                self.shader_space()
            }
            _ => None,
        };
        let slot = &mut self.st.slots[slot as usize];
        let len = values.len().min(slot.data.len());
        slot.data[..len].copy_from_slice(&values[..len]);
        let Some(m) = matrix else { return };
        if place.value == ValueType::Matrix {
            for rows in slot.data[..len].chunks_exact_mut(16) {
                let own =
                    granita_base::Transform::from_rows((&*rows).try_into().expect("invariant: 16 floats"));
                rows.copy_from_slice(&own.then(&m).to_rows());
            }
            return;
        }
        let normals = if place.value == ValueType::Normal { Some(m.normal_matrix()) } else { None };
        for triple in slot.data[..len].chunks_exact_mut(3) {
            let v = Vec3::from_slice(triple);
            let v = match (place.value, &normals) {
                (ValueType::Point, _) => m.point(v),
                (_, Some(normals)) => normals.vector(v),
                _ => m.vector(v),
            };
            triple.copy_from_slice(&v.to_array());
        }
    }

    /// Keeps globals that later layers take from this one.
    pub(crate) fn keep_globals(&mut self) {
        for &(global, slot) in &self.code().kept {
            let saved = self.saved(global as usize);
            self.restore(slot as usize, saved);
        }
    }

    /// Copies values along a connection, in all lanes.
    fn transfer(&mut self, connection: &Connection) {
        let (s, t) = (&connection.source, &connection.target);
        let (from, to) = (part(s), part(t));
        let single = from.1 == 1;
        for k in 0..to.1 {
            // A float is copied to all components. A float target takes the first component of a triple.
            let source = from.0 + if single { 0 } else { k.min(from.1 - 1) };
            self.copy_part(s.slot as usize, source, t.slot as usize, to.0 + k);
        }
    }

    /// Copies one number per lane between registers.
    fn copy_part(&mut self, from: usize, source: usize, to: usize, target: usize) {
        let n = self.n;
        let from_slot = std::mem::take(&mut self.st.slots[from]);
        let st = &mut *self.st;
        let slot = &mut st.slots[to];
        if from_slot.varying {
            promote(slot, n, &mut st.pool);
            slot.data[target * n..(target + 1) * n]
                .copy_from_slice(&from_slot.data[source * n..(source + 1) * n]);
        } else if slot.varying {
            slot.data[target * n..(target + 1) * n].fill(from_slot.data[source]);
        } else {
            slot.data[target] = from_slot.data[source];
        }
        st.slots[from] = from_slot;
    }

    /// Returns a register's values per lane, component after component.
    pub(crate) fn lanes_of(&self, slot: usize) -> Vec<f32> {
        let slot = &self.st.slots[slot];
        if slot.varying {
            return slot.data.clone();
        }
        slot.data.iter().flat_map(|&v| std::iter::repeat_n(v, self.n)).collect()
    }

    /// Returns a triple's register as lanes.
    pub(crate) fn lanes3_of(&self, slot: usize) -> Lanes3 {
        let values = self.lanes_of(slot);
        Lanes3 { xyz: std::array::from_fn(|c| values[c * self.n..(c + 1) * self.n].to_vec()) }
    }

    /// Returns the parameters of all layers as primitive variables, those of later layers last.
    pub(crate) fn parameters(&self) -> Vec<Primvar> {
        let mut list = Vec::new();
        for layer in &self.group.layers {
            for plan in &layer.params {
                let place = &layer.places[plan.symbol.0 as usize];
                let At::Slot(slot) = place.at else { continue };
                let array = place.array.then_some(place.elements);
                list.push(self.as_primvar(&plan.name, place.value, array, &self.st.slots[slot as usize]));
            }
        }
        list
    }

    /// Returns a register as a primitive variable.
    pub(crate) fn as_primvar(
        &self,
        name: &Arc<str>,
        value: ValueType,
        array: Option<u32>,
        slot: &Slot,
    ) -> Primvar {
        let base = value.base_type().unwrap_or(BaseType::Float);
        let data = if value == ValueType::String {
            // A varying string takes the value of the first active lane, because messages of strings are uniform.
            let stride = if slot.varying { self.n } else { 1 };
            let first = if slot.varying { self.first() } else { 0 };
            let elements = slot.data.len() / stride;
            PrimvarData::Strings(
                (0..elements)
                    .map(|e| self.text(StringId::from_register(slot.data[e * stride + first])).clone())
                    .collect(),
            )
        } else {
            PrimvarData::Floats { values: slot.data.clone(), varying: slot.varying }
        };
        Primvar { name: name.clone(), ty: ParamType { base, array, ..ParamType::default() }, data }
    }
}

/// Returns the first index and the count of an end of a connection.
fn part(endpoint: &Endpoint) -> (usize, usize) {
    let size = endpoint.value.components();
    let first = endpoint.element.unwrap_or(0) as usize * size + endpoint.component.unwrap_or(0) as usize;
    let count = match (endpoint.component, endpoint.element) {
        (Some(_), _) => 1,
        (None, Some(_)) => size,
        (None, None) => size * endpoint.elements as usize,
    };
    (first, count)
}
