//! Messages between shaders, attributes, texture information (reference 5.8.13, 5.8.14).

use super::constant;
use crate::link::{same_type, usage_word};
use crate::program::{At, Op};
use crate::run::machine::{Machine, RaySample, Sent};
use crate::run::store::Slot;
use crate::{HitValues, Lanes3, Primvar, PrimvarData};
use granita_base::{BaseType, Param, ParamData};
use granita_gsl::Func;
use granita_gsl::ir::{ShaderKind, SymbolId, ValueType};

/// Where a value was found: the same for all lanes, or by lane.
enum Found {
    All(bool),
    Some(Vec<bool>),
}

/// Runs `setmessage`, `getmessage`, `getattribute`, `gettextureinfo`. When nothing of the name and type exists, the
/// last three leave the destination unchanged and return 0.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    match func {
        Func::SetMessage => send(m, op),
        Func::GetMessage => {
            let (source, name) = (m.string(op.args[0]), m.string(op.args[1]));
            let found = match &*source {
                "trace" => from_ray(m, &name, op.args[2]),
                _ => Found::All(receive(m, &source, &name, op.args[2])),
            };
            match found {
                Found::All(found) => constant(m, op, f32::from(found)),
                Found::Some(there) => {
                    let Some(dst) = op.dst else { return };
                    let mut out = m.out(true, 1);
                    for (lane, there) in out.part(0).iter_mut().zip(there) {
                        *lane = f32::from(there);
                    }
                    m.commit(dst, out);
                }
            }
        }
        Func::GetAttribute => {
            let name = m.string(op.args[0]);
            let found = m.services.attribute(&name);
            let stored = found.is_some_and(|p| store_param(m, op.args[1], &p));
            constant(m, op, f32::from(stored));
        }
        _ => {
            let (texture, name) = (m.string(op.args[0]), m.string(op.args[1]));
            let found = m.services.texture_info(&texture, &name);
            let stored = found.is_some_and(|p| store_param(m, op.args[2], &p));
            constant(m, op, f32::from(stored));
        }
    }
}

impl Machine<'_> {
    /// Returns the messages of the running shader for the shaders that its rays against a set hit, when these may
    /// query them.
    pub(crate) fn ray_messages(&mut self, set: &str) -> Vec<Primvar> {
        if !self.services.queries_parent(set) {
            return Vec::new();
        }
        let mut values = Vec::new();
        for sent in &self.st.messages {
            let array = (sent.elements > 1).then_some(sent.elements);
            let name = self.text(sent.name).clone();
            values.push(self.as_primvar(&name, sent.value, array, &sent.slot));
        }
        // The layer that runs last has precedence.
        let layers = &self.group.layers;
        for layer in layers[..=self.layer].iter().rev() {
            for plan in &layer.params {
                let place = &layer.places[plan.symbol.0 as usize];
                let At::Slot(slot) = place.at else { continue };
                let array = place.array.then_some(place.elements);
                values.push(self.as_primvar(&plan.name, place.value, array, &self.st.slots[slot as usize]));
            }
        }
        values
    }
}

/// Keeps a message. One of the same name and type is replaced in the active lanes.
fn send(m: &mut Machine<'_>, op: &Op) {
    let name = m.view(op.args[0]).string(m.first());
    let (value, elements) = (m.type_of(op.args[1]), m.place(op.args[1]).elements);
    let fresh = m.captured(op.args[1]);
    let old = m.st.messages.iter().position(|s| s.name == name);
    let same = old.filter(|&k| m.st.messages[k].value == value && m.st.messages[k].elements == elements);
    let Some(k) = same else {
        if let Some(k) = old {
            let gone = m.st.messages.remove(k);
            m.st.pool.give(gone.slot.data);
        }
        let slot = Slot { data: fresh.data, varying: fresh.varying };
        m.st.messages.push(Sent { name, value, elements, slot });
        return;
    };
    // The register functions merge lanes, so the message is moved to the end of the registers for the store.
    let slot = std::mem::take(&mut m.st.messages[k].slot);
    m.st.slots.push(slot);
    let last = m.st.slots.len() - 1;
    m.commit_slot(last, fresh, false);
    m.st.messages[k].slot = m.st.slots.pop().unwrap_or_default();
}

/// Finds a message of a source and stores it.
fn receive(m: &mut Machine<'_>, source: &str, name: &str, dst: SymbolId) -> bool {
    match source {
        "light" => {
            let Some(light) = m.light.clone() else { return false };
            light.messages.iter().rev().any(|p| *p.name == *name && store_primvar(m, dst, p))
        }
        "parent" => {
            let grid = m.grid;
            grid.parent.iter().any(|p| *p.name == *name && store_primvar(m, dst, p))
        }
        "primitive" => {
            let grid = m.grid;
            grid.primvars.iter().any(|p| *p.name == *name && store_primvar(m, dst, p))
        }
        _ => {
            let Some(usage) = usage_word(source) else {
                return false;
            };
            let own = m.group.usage();
            if (own == usage || own == ShaderKind::Generic) && from_group(m, name, dst) {
                return true;
            }
            let grid = m.grid;
            grid.messages
                .iter()
                .rev()
                .any(|p| p.from == usage && *p.value.name == *name && store_primvar(m, dst, &p.value))
        }
    }
}

/// Reads from the layers of the running group: messages, then parameters, the last layer's first.
fn from_group(m: &mut Machine<'_>, name: &str, dst: SymbolId) -> bool {
    let id = m.intern(name);
    let place = *m.place(dst);
    let sent =
        m.st.messages
            .iter()
            .position(|s| s.name == id && s.value == place.value && s.elements == place.elements);
    let (varying, data) = if let Some(k) = sent {
        let slot = &m.st.messages[k].slot;
        (slot.varying, slot.data.clone())
    } else {
        let found = m.group.layers[..=m.layer].iter().rev().find_map(|layer| {
            let plan = layer.params.iter().find(|p| *p.name == *name)?;
            let p = &layer.places[plan.symbol.0 as usize];
            match p.at {
                At::Slot(slot) if p.value == place.value && p.elements == place.elements => Some(slot),
                _ => None,
            }
        });
        let Some(slot) = found else { return false };
        let slot = &m.st.slots[slot as usize];
        (slot.varying, slot.data.clone())
    };
    let mut out = m.out(varying, place.value.components() * place.elements as usize);
    out.data.copy_from_slice(&data);
    m.commit(dst, out);
    true
}

/// Reads from the ray of the innermost `trace` loop.
fn from_ray(m: &mut Machine<'_>, name: &str, dst: SymbolId) -> Found {
    let Some(sample) = m.ray.take() else { return Found::All(false) };
    let found = of_sample(m, &sample, name, dst);
    m.ray = Some(sample);
    found
}

fn of_sample(m: &mut Machine<'_>, sample: &RaySample, name: &str, dst: SymbolId) -> Found {
    let ray = &sample.found;
    let ty = m.type_of(dst);
    let flags: Vec<f32>;
    let found = match (name, ty) {
        ("hit", ValueType::Float) => {
            flags = ray.hit.iter().map(|&h| f32::from(h)).collect();
            store_lanes(m, dst, &[&flags])
        }
        ("hitdist", ValueType::Float) => store_lanes(m, dst, &[&ray.hitdist]),
        ("L", ValueType::Vector) => store_lanes3(m, dst, &ray.l),
        ("Ps", ValueType::Point) => store_lanes3(m, dst, &ray.ps),
        ("Cl", ValueType::Color) => store_lanes3(m, dst, &ray.cl),
        ("Ol", ValueType::Color) => store_lanes3(m, dst, &ray.ol),
        ("P", ValueType::Point) => store_lanes3(m, dst, &ray.p),
        _ => {
            let asked = sample.wanted.iter().position(|(known, of)| **known == *name && *of == ty);
            let Some(k) = asked.filter(|_| !m.place(dst).array) else {
                if ty != ValueType::String && !m.place(dst).array {
                    m.missing("getmessage (\"trace\", ...) of a name that is not a constant");
                }
                return Found::All(false);
            };
            return match ray.others.get(k) {
                Some(values) => store_where(m, dst, values),
                None => Found::All(false),
            };
        }
    };
    Found::All(found)
}

/// Stores values in the lanes that have them.
fn store_where(m: &mut Machine<'_>, dst: SymbolId, found: &HitValues) -> Found {
    let components = m.place(dst).value.components();
    if found.there.len() != m.n || found.values.len() != components * m.n || !found.there.contains(&true) {
        return Found::All(false);
    }
    let mut out = m.out(true, components);
    let old = m.view(dst);
    let mut kept = Vec::with_capacity(components * m.n);
    for c in 0..components {
        let own = &found.values[c * m.n..(c + 1) * m.n];
        kept.extend((0..m.n).map(|i| if found.there[i] { own[i] } else { old.lane(c).get(i) }));
    }
    out.data.copy_from_slice(&kept);
    m.commit(dst, out);
    Found::Some(found.there.clone())
}

fn store_lanes3(m: &mut Machine<'_>, dst: SymbolId, lanes: &Lanes3) -> bool {
    let [x, y, z] = &lanes.xyz;
    store_lanes(m, dst, &[x, y, z])
}

/// Stores values per lane.
fn store_lanes(m: &mut Machine<'_>, dst: SymbolId, lanes: &[&Vec<f32>]) -> bool {
    if lanes.iter().any(|l| l.len() != m.n) {
        return false;
    }
    let mut out = m.out(true, lanes.len());
    for (c, lane) in lanes.iter().enumerate() {
        out.part(c).copy_from_slice(lane);
    }
    m.commit(dst, out);
    true
}

/// Stores a primitive variable or message of the right type.
fn store_primvar(m: &mut Machine<'_>, dst: SymbolId, p: &Primvar) -> bool {
    let place = *m.place(dst);
    if !same_type(p.ty, place.value, place.array.then_some(place.elements)) {
        return false;
    }
    let size = p.ty.width();
    match &p.data {
        PrimvarData::Floats { values, varying } => {
            if values.len() != if *varying { size * m.n } else { size } {
                return false;
            }
            let mut out = m.out(*varying, size);
            out.data.copy_from_slice(values);
            m.commit(dst, out);
        }
        PrimvarData::Strings(list) => {
            if list.len() != size {
                return false;
            }
            let mut out = m.out(false, size);
            for (k, text) in list.iter().enumerate() {
                out.data[k] = m.intern(text).to_register();
            }
            m.commit(dst, out);
        }
    }
    true
}

/// Stores a uniform value of the right type. Integers are floats, and an undeclared type counts as the
/// destination's.
fn store_param(m: &mut Machine<'_>, dst: SymbolId, p: &Param) -> bool {
    let place = *m.place(dst);
    let mut ty = p.ty;
    if ty.base == BaseType::Unknown {
        ty.base = place.value.base_type().unwrap_or(BaseType::Float);
    }
    if !same_type(ty, place.value, place.array.then_some(place.elements)) {
        return false;
    }
    let size = place.value.components() * place.elements as usize;
    if p.data.len() != size {
        return false;
    }
    let mut out = m.out(false, size);
    match (&p.data, p.data.to_floats()) {
        (ParamData::String(list), _) if place.value == ValueType::String => {
            for (k, text) in list.iter().enumerate() {
                out.data[k] = m.intern(text).to_register();
            }
        }
        (_, Some(values)) if place.value != ValueType::String => out.data.copy_from_slice(&values),
        _ => {
            m.discard(out);
            return false;
        }
    }
    m.commit(dst, out);
    true
}
