//! Motion blocks (reference 2.7): `n` times, then `n` transformations or `n` primitives.

use super::State;
use super::current::Edit;
use super::transforms::Change;
use crate::ShapeKey;
use granita_base::{
    BaseType, Location, MotionTransform, Param, ParamType, Params, Severity, ShapeDesc, Transform,
};

/// A block whose calls are being collected.
#[derive(Debug)]
pub(super) struct MotionBlock {
    times: Vec<f32>,
    at: Location,
    content: Content,
}

#[derive(Debug)]
enum Content {
    Empty,
    /// The same call for every time, applied to the current transformation when complete.
    Transforms {
        name: &'static str,
        keys: Vec<(f32, Key)>,
    },
    Shapes {
        shape: ShapeDesc,
        keys: Vec<ShapeKey>,
        /// The arguments of the sphere at each key; empty for other primitives.
        arguments: Vec<[f32; 4]>,
        at: Location,
    },
}

#[derive(Debug)]
enum Key {
    Append(Transform),
    Set(Transform),
}

impl State {
    /// Handles `Motion`.
    pub(super) fn begin_motion(&mut self, times: &[f32], at: &Location) {
        if times.is_empty() {
            return self.out_of_place(at, "Motion", "without times");
        }
        if times.iter().any(|t| !t.is_finite()) {
            return self.out_of_place(at, "Motion", "with times that are not finite");
        }
        if let Some(i) = (1..times.len()).find(|&i| times[i] <= times[i - 1]) {
            let text =
                format!("Motion: time {} follows time {}; times should increase", times[i], times[i - 1]);
            self.report(Severity::Warning, at, "Motion", text);
        }
        self.motion = Some(MotionBlock { times: times.to_vec(), at: at.clone(), content: Content::Empty });
    }

    /// Adds a transformation inside a motion block.
    pub(super) fn motion_transform(&mut self, name: &'static str, change: Change, at: &Location) {
        let Some(block) = &mut self.motion else { return };
        if matches!(block.content, Content::Empty) {
            block.content = Content::Transforms { name, keys: Vec::new() };
        }
        let Content::Transforms { name: first, keys, .. } = &mut block.content else {
            self.finish_motion(at);
            return self.apply_alone(name, change, at);
        };
        if *first != name {
            let text = format!("{name} in a Motion block that began with {first}");
            self.report(Severity::Error, at, "Motion mix", text);
            self.finish_motion(at);
            return self.apply_alone(name, change, at);
        }
        let time = block.times[keys.len()];
        let key = match change {
            Change::Append(m) => Key::Append(m),
            Change::Set(m) => Key::Set(m.at(time)),
        };
        keys.push((time, key));
        if keys.len() == block.times.len() {
            self.finish_motion(at);
        }
    }

    fn apply_alone(&mut self, name: &str, change: Change, at: &Location) {
        self.edit_sets(Edit::Call(name, at), |set| match &change {
            Change::Append(m) => set.to_world.prepend(m),
            Change::Set(m) => set.to_world = m.clone(),
        });
    }

    /// Adds a primitive inside a motion block. Returns the primitive when there is no block, or when it does not fit.
    pub(super) fn motion_shape(
        &mut self,
        shape: ShapeDesc,
        params: Params,
        at: &Location,
    ) -> Option<(ShapeDesc, Params)> {
        let Some(block) = &mut self.motion else { return Some((shape, params)) };
        let misfit = match &mut block.content {
            Content::Empty => {
                let keys = vec![ShapeKey { time: block.times[0], params }];
                let arguments = sphere_arguments(&shape).into_iter().collect();
                block.content = Content::Shapes { shape, keys, arguments, at: at.clone() };
                None
            }
            Content::Shapes { shape: first, keys, arguments, .. } => {
                match difference(first, &keys[0].params, &shape, &params) {
                    None => {
                        keys.push(ShapeKey { time: block.times[keys.len()], params });
                        arguments.extend(sphere_arguments(&shape));
                        None
                    }
                    Some(why) => Some((shape, params, why)),
                }
            }
            Content::Transforms { .. } => {
                Some((shape, params, "a primitive follows transformations".to_owned()))
            }
        };
        if let Some((shape, params, why)) = misfit {
            let name = shape.call_name();
            let text = format!("{name} in a Motion block: {why}");
            self.report_object(Severity::Error, at, "Motion mix", text);
            self.finish_motion(at);
            return Some((shape, params));
        }
        let full = matches!(&block.content, Content::Shapes { keys, .. } if keys.len() == block.times.len());
        if full {
            self.finish_motion(at);
        }
        None
    }

    /// Drops the block when nothing is in it, and ends it otherwise. It is for primitives that are not added.
    pub(super) fn drop_motion(&mut self, at: &Location) {
        if self.motion.as_ref().is_some_and(|block| matches!(block.content, Content::Empty)) {
            self.motion = None;
        }
        self.finish_motion(at);
    }

    /// Ends the block, complete or not, and applies its contents.
    pub(super) fn finish_motion(&mut self, at: &Location) {
        let Some(block) = self.motion.take() else { return };
        let got = match &block.content {
            Content::Empty => 0,
            Content::Transforms { keys, .. } => keys.len(),
            Content::Shapes { keys, .. } => keys.len(),
        };
        if got != block.times.len() {
            let place = if at.is_known() { at } else { &block.at };
            let follow = if got == 1 { "call follows" } else { "calls follow" };
            let text = format!("Motion with {} times, but {got} {follow}", block.times.len());
            self.report_object(Severity::Error, place, "Motion count", text);
        }
        match block.content {
            Content::Empty => {}
            Content::Transforms { name, keys } => {
                let appended = matches!(keys.first(), Some((_, Key::Append(_))));
                let keys = keys.into_iter().map(|(t, Key::Append(m) | Key::Set(m))| (t, m)).collect();
                let Some(moving) = MotionTransform::from_keys(keys) else { return };
                self.edit_sets(Edit::Call(name, &block.at), |set| {
                    set.to_world = if appended { moving.then(&set.to_world) } else { moving.clone() };
                });
            }
            Content::Shapes { shape, mut keys, arguments, at } => {
                if arguments.iter().any(|list| *list != arguments[0]) {
                    for (key, list) in keys.iter_mut().zip(&arguments) {
                        let ty = ParamType::array(BaseType::Float, 4);
                        key.params.set(Param { name: "__arguments".into(), ty, data: list[..].into() });
                    }
                }
                keys.sort_by(|a, b| a.time.total_cmp(&b.time));
                keys.dedup_by(|later, earlier| later.time == earlier.time);
                self.add_primitive(shape, keys, &at);
            }
        }
    }
}

/// Returns the radius, lower and upper cut and sweep of a sphere.
fn sphere_arguments(shape: &ShapeDesc) -> Option<[f32; 4]> {
    match *shape {
        ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg } => Some([radius, zmin, zmax, thetamax_deg]),
        _ => None,
    }
}

/// Returns the reason why two primitives cannot be keys of one motion, if there is one.
fn difference(a: &ShapeDesc, a_params: &Params, b: &ShapeDesc, b_params: &Params) -> Option<String> {
    if std::mem::discriminant(a) != std::mem::discriminant(b) {
        return Some(format!("it began with another primitive, {}", a.call_name()));
    }
    // The arguments of a sphere may change over time, as its parameters may.
    if a != b && sphere_arguments(a).is_none() {
        return Some(format!("the arguments of {} differ from those at the first time", b.call_name()));
    }
    if a_params.0.len() != b_params.0.len() {
        let (n, first) = (b_params.0.len(), a_params.0.len());
        return Some(format!("{n} parameters, but {first} at the first time"));
    }
    a_params.iter().find_map(|p| match b_params.get(&p.name) {
        None => Some(format!("parameter \"{}\" is missing", p.name)),
        Some(q) if q.ty != p.ty || q.data.len() != p.data.len() => {
            Some(format!("parameter \"{}\" has another type or length than at the first time", p.name))
        }
        Some(_) => None,
    })
}
