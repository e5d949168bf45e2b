//! `lights`, `emit` and `trace` (reference 5.5.5).

use crate::call::{Call, Options};
use crate::ops::lookup::Parts;
use crate::program::{At, Stmt};
use crate::run::approx;
use crate::run::machine::{Emission, Machine, RaySample};
use crate::run::store::{Mask, Out};
use crate::{Batch, IlluminateQuery, Lane, LightInfo, LightResult, LightSample, TraceQuery, TraceResult};
use granita_base::Vec3;
use granita_gsl::Func;
use granita_gsl::ir::{EmitForm, Global, SourcePos, SymbolId, ValueType};
use std::sync::Arc;

/// The largest number of rays per point. More are an error.
const MAX_RAYS: f32 = 65_536.0;

/// The half angle in radians of cones in front of surfaces, with a margin for rounding.
const RIGHT_ANGLE: f32 = std::f32::consts::FRAC_PI_2 + 1e-5;

/// The globals that a `lights` loop sets.
const LIGHT_GLOBALS: [Global; 4] = [Global::L, Global::Cl, Global::Pl, Global::Nl];

/// The values of L, Pl and Nl that `emit` sets.
struct LightVectors {
    l: Out,
    pl: Out,
    nl: Out,
}

impl LightVectors {
    /// Sets the direction to the light and the point that it comes from in a lane.
    #[inline(always)]
    fn set(&mut self, lane: usize, l: Vec3, pl: Vec3) {
        self.l.set3(lane, l);
        self.pl.set3(lane, pl);
    }
}

impl<'a> Machine<'a> {
    /// Queries every light of a category that is not ambient, at positions and axes given as triples, either for
    /// light from `in_front` of the axes or from all directions.
    pub(crate) fn illuminated(
        &mut self,
        category: Option<&str>,
        ps: &Out,
        ns: &Out,
        in_front: bool,
    ) -> Vec<Arc<LightResult>> {
        let count = self.services.light_count();
        let mut results = Vec::with_capacity(count);
        let asks = self.group.asks_light();
        let mut own = None;
        for k in 0..count {
            let info = self.services.light_info(k);
            if info.ambient || !category.is_none_or(|c| category_matches(c, &info)) {
                continue;
            }
            let messages = match self.services.light_asks(k) {
                true => own.get_or_insert_with(|| self.messages(true)).as_slice(),
                false => &[],
            };
            let batch = Batch { lanes: self.n, active: &self.mask.active, layer: self.layer };
            let query = IlluminateQuery {
                in_front,
                asks,
                messages,
                ..IlluminateQuery::new(batch, ps.triple(), ns.triple())
            };
            results.push(self.services.illuminate(k, &query));
        }
        results
    }

    /// Runs `lights`. The body runs for each sample of each light, in the lanes that it reaches.
    pub(crate) fn lights(
        &mut self,
        category: Option<SymbolId>,
        position: SymbolId,
        cone: Option<(SymbolId, SymbolId)>,
        body: &[Stmt],
    ) {
        let category = category.map(|c| self.string(c));
        let ps = self.captured(position);
        let axis = match cone {
            Some((axis, _)) => self.captured(axis),
            None => self.captured_global(Global::N),
        };
        let angle = cone.map(|(_, angle)| self.captured(angle));
        // Only constants count, because a variable may vary with the other grids that are shaded together with this
        // one.
        let is_constant = cone.is_some_and(|(_, angle)| matches!(self.place(angle).at, At::Const(_)));
        let in_front = is_constant && angle.as_ref().is_some_and(|a| a.lane(0).get(0) <= RIGHT_ANGLE);
        let results = self.illuminated(category.as_deref(), &ps, &axis, in_front);
        let outer = LIGHT_GLOBALS.map(|g| self.saved(g as usize));
        let outer_light = self.light.take();
        // The lanes that have not left the shader or the scope.
        let mut remaining = self.borrow_mask();
        remaining.copy_from(&self.mask);
        for light in &results {
            for sample in &light.samples {
                let mut mask = self.borrow_mask();
                mask.copy_from(&remaining);
                mask.retain(|i| {
                    sample.lit.get(i).copied().unwrap_or(false)
                        && angle.as_ref().is_none_or(|angle| {
                            in_cone(sample.l.get(i), axis.triple().get(i), angle.lane(0).get(i))
                        })
                });
                if mask.is_empty() {
                    self.return_mask(mask);
                    continue;
                }
                let all = std::mem::replace(&mut self.mask, mask);
                self.return_mask(all);
                let mut entered = self.borrow_mask();
                entered.copy_from(&self.mask);
                self.set_light(sample);
                self.light = Some(light.clone());
                self.block(body);
                let stayed = &self.mask;
                remaining.retain(|i| !entered.on[i] || stayed.on[i]);
                self.return_mask(entered);
                if remaining.is_empty() {
                    break;
                }
            }
        }
        let last = std::mem::replace(&mut self.mask, remaining);
        self.return_mask(last);
        self.light = outer_light;
        for (g, saved) in LIGHT_GLOBALS.into_iter().zip(outer) {
            self.restore(g as usize, saved);
        }
        for out in [Some(ps), Some(axis), angle].into_iter().flatten() {
            self.discard(out);
        }
    }

    /// Sets the light globals from a sample, in all lanes.
    fn set_light(&mut self, sample: &LightSample) {
        let n = self.n;
        for (g, lanes) in LIGHT_GLOBALS.into_iter().zip([&sample.l, &sample.cl, &sample.pl, &sample.nl]) {
            let mut out = self.out(true, 3);
            for c in 0..3 {
                match lanes.xyz[c].get(..n) {
                    Some(values) => out.part(c).copy_from_slice(values),
                    None => out.part(c).fill(0.0),
                }
            }
            // Other lanes do not matter, because the body runs in lit lanes only.
            self.commit_slot(g as usize, out, true);
        }
    }

    /// Runs `emit`: sets L, Pl and Nl, clears Cl, runs the body where light goes, and keeps the sample.
    pub(crate) fn emit(&mut self, form: &EmitForm, body: &[Stmt]) {
        let mut outside = self.borrow_mask();
        outside.copy_from(&self.mask);
        let mut light = LightVectors { l: self.out(true, 3), pl: self.out(true, 3), nl: self.out(true, 3) };
        for out in [&mut light.l, &mut light.pl, &mut light.nl] {
            out.data.fill(0.0);
        }
        let mut lit = std::mem::take(&mut self.mask);
        let mut emission = Emission { inside: true, ..Emission::default() };
        let mut broad = false;
        match *form {
            EmitForm::Point(from) => self.point_light(from, &lit, &mut light),
            EmitForm::Cone { from, axis, angle } => {
                self.cone_light([from, axis, angle], &mut lit, &mut light)
            }
            EmitForm::Distant { axis, spread } => {
                emission.infinite = true;
                let spread = self.view(spread).lane(0);
                match &self.cone {
                    Some(_) => broad = lit.active.iter().any(|i| spread.get(*i as usize) > 0.0),
                    None => emission.spread = lit.active.first().map_or(0.0, |i| spread.get(*i as usize)),
                }
                self.distant_light(axis, spread, &lit, &mut light);
            }
            EmitForm::Reflection => {
                emission.infinite = true;
                self.reflected_light(&lit, &mut light);
            }
        }
        outside.retain(|i| !lit.on[i]);
        self.mask = lit;
        self.commit_global(Global::L, light.l);
        self.commit_global(Global::Pl, light.pl);
        self.commit_global(Global::Nl, light.nl);
        let mut black = self.out(false, 3);
        black.data.fill(0.0);
        self.commit_global(Global::Cl, black);
        if !self.mask.is_empty() {
            let on = self.mask.on.clone();
            let before = std::mem::replace(&mut self.emission, emission);
            self.block(body);
            self.emission = before;
            self.keep_sample(on, broad);
        }
        self.mask.add(&outside);
        self.return_mask(outside);
    }

    /// Sets the vectors of light from the point `from` in the lanes that are lit.
    fn point_light(&self, from: SymbolId, lit: &Mask, light: &mut LightVectors) {
        let (ps, from) = (self.global(Global::Ps).triple(), self.view(from).triple());
        // The normal of an area light stays unchanged.
        let normal = self.global(Global::Nl).triple();
        for &i in &lit.active {
            let i = i as usize;
            light.set(i, from.get(i) - ps.get(i), from.get(i));
            light.nl.set3(i, normal.get(i));
        }
    }

    /// Sets the vectors of light from a point within an angle in radians of an axis. Lanes outside of this cone are
    /// removed from `lit`.
    fn cone_light(&self, [from, axis, angle]: [SymbolId; 3], lit: &mut Mask, light: &mut LightVectors) {
        let ps = self.global(Global::Ps).triple();
        let (from, axis) = (self.view(from).triple(), self.view(axis).triple());
        let angle = self.view(angle).lane(0);
        lit.retain(|i| in_cone(ps.get(i) - from.get(i), axis.get(i), angle.get(i)));
        for &i in &lit.active {
            let i = i as usize;
            light.set(i, from.get(i) - ps.get(i), from.get(i));
            light.nl.set3(i, axis.get(i));
        }
    }

    /// Sets the vectors of light that goes along an axis from infinitely far away, in the lanes that are lit. The
    /// light comes from a place in a cone of the angle `spread` (radians across) where the query has such places.
    fn distant_light(&self, axis: SymbolId, spread: Lane<'_>, lit: &Mask, light: &mut LightVectors) {
        let (ps, axis) = (self.global(Global::Ps).triple(), self.view(axis).triple());
        let from = |i: usize| match &self.cone {
            Some([x, y]) => in_spread(-axis.get(i), 0.5 * spread.get(i), [x[i], y[i]]),
            None => -axis.get(i),
        };
        for &i in &lit.active {
            let i = i as usize;
            light.set(i, from(i), ps.get(i) + from(i));
            light.nl.set3(i, -from(i));
        }
    }

    /// Sets the vectors of light from the direction of the mirror reflection, in the lanes that are lit. `Nl` stays 0.
    fn reflected_light(&self, lit: &Mask, light: &mut LightVectors) {
        let ps = self.global(Global::Ps).triple();
        let n = self.global(Global::N).triple();
        let incident = self.global(Global::I).triple();
        for &i in &lit.active {
            let i = i as usize;
            let (axis, ray) = (n.get(i).normalize_or_zero(), incident.get(i));
            let reflected = ray - 2.0 * axis.dot(ray) * axis;
            light.set(i, reflected, ps.get(i) + reflected);
        }
    }

    /// Keeps the light globals as a sample when samples are requested. `lit` holds a flag for each lane. `broad` is
    /// true when the sample is one of several places of a broad light.
    fn keep_sample(&mut self, lit: Vec<bool>, broad: bool) {
        if self.emitted.is_none() {
            return;
        }
        let sample = LightSample {
            l: self.lanes3_of(Global::L as usize),
            cl: self.lanes3_of(Global::Cl as usize),
            pl: self.lanes3_of(Global::Pl as usize),
            nl: self.lanes3_of(Global::Nl as usize),
            lit,
        };
        if let Some(result) = &mut self.emitted {
            result.broad |= broad;
            result.samples.push(sample);
        }
    }

    /// Runs `trace` with one ray per lane and iteration. `rays` holds set, position, axis, angle and samples.
    pub(crate) fn trace(
        &mut self,
        rays: [SymbolId; 5],
        call: Option<&'a Call>,
        body: &[Stmt],
        at: SourcePos,
    ) {
        let Some(call) = call else { return };
        let set = self.string(rays[0]);
        let [_, position, axis, angle, samples] = rays;
        let (position, axis) = (self.captured(position), self.captured(axis));
        let (angle, samples) = (self.captured(angle), self.captured(samples));
        let mut most = 0.0_f32;
        for &i in &self.mask.active {
            most = most.max(samples.lane(0).get(i as usize));
        }
        if most > MAX_RAYS {
            self.complain(at, &format!("{most} samples requested, {MAX_RAYS} allowed"));
            most = MAX_RAYS;
        }
        let outer = self.ray.take();
        let mut wanted = Vec::new();
        self.asked_of_hits(body, &mut wanted);
        let mut remaining = self.borrow_mask();
        remaining.copy_from(&self.mask);
        for sample in 0..most as u32 {
            let mut mask = self.borrow_mask();
            mask.copy_from(&remaining);
            mask.retain(|i| (sample as f32) < samples.lane(0).get(i).floor());
            let old = std::mem::replace(&mut self.mask, mask);
            self.return_mask(old);
            if self.mask.is_empty() {
                break;
            }
            let mut result = TraceResult::default();
            let messages = self.ray_messages(&set);
            let resolved = self.resolved(call);
            let Options::Trace(options) = &resolved.options else { break };
            {
                let parts = Parts::of(self.group, self.layer, self.st, self.n, &self.mask);
                let query = TraceQuery {
                    batch: Batch { lanes: self.n, active: &self.mask.active, layer: self.layer },
                    set: &set,
                    p: position.triple(),
                    axis: axis.triple(),
                    angle: angle.lane(0),
                    samples: samples.lane(0),
                    sample,
                    options: options.map(|s| parts.number(s), |s| parts.option_text(s)),
                    wanted: &wanted,
                    messages: &messages,
                };
                self.services.trace(&query, &mut result);
            }
            self.ray = Some(RaySample { found: result, wanted: wanted.clone() });
            let mut entered = self.borrow_mask();
            entered.copy_from(&self.mask);
            self.block(body);
            let stayed = &self.mask;
            remaining.retain(|i| !entered.on[i] || stayed.on[i]);
            self.return_mask(entered);
        }
        let last = std::mem::replace(&mut self.mask, remaining);
        self.return_mask(last);
        self.ray = outer;
        for out in [position, axis, angle, samples] {
            self.discard(out);
        }
    }

    /// Collects the variables of the hits that the body of a `trace` loop requests by constant names.
    fn asked_of_hits(&mut self, body: &[Stmt], wanted: &mut Vec<(Arc<str>, ValueType)>) {
        for stmt in body {
            match stmt {
                Stmt::Op(op) if op.func() == Some(Func::GetMessage) => {
                    let &[source, name, dst] = &op.args[..] else { continue };
                    let known = [source, name].iter().all(|s| matches!(self.place(*s).at, At::Const(_)));
                    let place = *self.place(dst);
                    if !known || *self.string(source) != *"trace" || place.array {
                        continue;
                    }
                    let asked = (self.string(name), place.value);
                    if place.value != ValueType::String && !wanted.contains(&asked) {
                        wanted.push(asked);
                    }
                }
                Stmt::If { then, otherwise, .. } => {
                    self.asked_of_hits(then, wanted);
                    self.asked_of_hits(otherwise, wanted);
                }
                Stmt::Loop { test, body, step, .. } => {
                    for block in [test, body, step] {
                        self.asked_of_hits(block, wanted);
                    }
                }
                Stmt::Scope { body, .. } | Stmt::Lights { body, .. } => self.asked_of_hits(body, wanted),
                // Requests inside of another `trace` loop concern its own rays.
                _ => {}
            }
        }
    }

    /// Returns a copy of a symbol's values, which later writes do not change.
    pub(crate) fn captured(&mut self, sym: SymbolId) -> Out {
        let (varying, len, components) = {
            let v = self.view(sym);
            (v.varying, v.data.len(), v.components)
        };
        let mut out = self.out(varying, components);
        out.data.resize(len, 0.0);
        out.data.copy_from_slice(self.view(sym).data);
        out
    }

    /// Returns a copy of a global's values.
    pub(crate) fn captured_global(&mut self, global: Global) -> Out {
        let varying = self.st.slots[global as usize].varying;
        let mut out = self.out(varying, global.value_type().components());
        out.data.copy_from_slice(&self.st.slots[global as usize].data);
        out
    }
}

/// Returns a direction within `half_angle` (radians) of another, uniform over that cone when the place is uniform
/// over the unit square. It has the length of the axis.
fn in_spread(axis: Vec3, half_angle: f32, [x, y]: [f32; 2]) -> Vec3 {
    let length = axis.length();
    let Some(unit) = axis.try_normalize().filter(|_| half_angle > 0.0) else { return axis };
    // The area of a spherical cap is proportional to its height.
    let cos = 1.0 - y * (1.0 - approx::cos(half_angle.min(std::f32::consts::PI)));
    let around = (1.0 - cos * cos).max(0.0).sqrt();
    let phi = x * std::f32::consts::TAU;
    let (sin_phi, cos_phi) = (approx::sin(phi), approx::cos(phi));
    let (right, up) = unit.any_orthonormal_pair();
    (unit * cos + (right * cos_phi + up * sin_phi) * around) * length
}

/// True when a direction lies within `angle` (radians) of an axis, or has no length.
pub(crate) fn in_cone(direction: Vec3, axis: Vec3, angle: f32) -> bool {
    let lengths = direction.length() * axis.length();
    if angle >= std::f32::consts::PI || lengths == 0.0 {
        return true;
    }
    direction.dot(axis) >= libm::cosf(angle) * lengths
}

/// True when a light belongs to a category expression. It consists of words joined by `&` and `|` (or `,`) from
/// left to right, with `!` (or `-`) for the opposite, and `*` for any category.
pub(crate) fn category_matches(expression: &str, light: &LightInfo) -> bool {
    let has = |word: &str| {
        let mut names = light.category.split(',').map(str::trim).filter(|n| !n.is_empty());
        if word == "*" { names.next().is_some() } else { names.any(|n| n == word) }
    };
    let mut result: Option<bool> = None;
    let mut rest = expression;
    let mut operator = '|';
    loop {
        let end = rest.find(['&', '|', ',']).unwrap_or(rest.len());
        let mut word = rest[..end].trim();
        let mut wanted = true;
        while let Some(bare) = word.strip_prefix(['!', '-']) {
            wanted = !wanted;
            word = bare.trim();
        }
        // An empty expression matches every light.
        let term = if word.is_empty() { None } else { Some(has(word) == wanted) };
        result = match (result, term, operator) {
            (None, term, _) => term,
            (some, None, _) => some,
            (Some(a), Some(b), '&') => Some(a && b),
            (Some(a), Some(b), _) => Some(a || b),
        };
        match rest[end..].chars().next() {
            None => return result.unwrap_or(true),
            Some(c) => {
                operator = c;
                rest = &rest[end + 1..];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_categories_match_expressions() {
        let light = |c: &str| LightInfo { ambient: false, category: c.into() };
        for (expression, category, expected) in [
            ("blue", "red,blue", true),
            ("blue", "bluegreen", false),
            ("blue&!red", "blue", true),
            ("blue&!red", "blue, red", false),
            ("blue&-red", "blue,red", false),
            ("a|b&c", "a", false),
            ("a|b&c", "a,c", true),
            ("b&c|a", "a", true),
            ("a,b", "b", true),
            ("*", "x", true),
            ("*", "", false),
            ("-*", "", true),
            ("!*", "x", false),
            ("", "x", true),
            ("!!a", "a", true),
        ] {
            assert_eq!(category_matches(expression, &light(category)), expected, "{expression} {category}");
        }
    }

    #[test]
    fn directions_are_inside_or_outside_of_cones() {
        assert!(in_cone(Vec3::X, Vec3::X * 3.0, 0.0));
        assert!(in_cone(Vec3::new(1.0, 0.9, 0.0), Vec3::X, std::f32::consts::FRAC_PI_4));
        assert!(!in_cone(Vec3::new(1.0, 1.1, 0.0), Vec3::X, std::f32::consts::FRAC_PI_4));
        assert!(in_cone(Vec3::ZERO, Vec3::X, 0.1) && in_cone(-Vec3::X, Vec3::X, 4.0));
    }
}
