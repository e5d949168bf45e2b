//! The changes of lights that edits request.

use super::Desk;
use super::edit::Change;
use super::geometry;
use super::interface::Emission;
use super::rig::{Lamp, Layer, Rig, Rule};
use granita_base::{BaseType, MotionTransform, Param, ParamType, Params, Vec3};
use granita_image::PixelRect;
use std::sync::Arc;

impl Desk {
    /// Returns how a light emits, its position, and the direction in which it shines, in world space.
    pub(super) fn frame(&mut self, lamp: &Lamp) -> Option<(Emission, Vec3, Vec3)> {
        // Of several layers, the last one that emits counts.
        let found = lamp.layers.iter().rev().find_map(|layer| {
            let interface = self.interfaces.get(&layer.shader).ok()?;
            let emission = interface.emission(layer);
            (emission != Emission::Ambient).then_some((interface, emission, layer))
        });
        let Some((interface, emission, layer)) = found else {
            let layer = lamp.layers.last()?;
            self.interfaces.get(&layer.shader).ok()?;
            return Some((Emission::Ambient, layer.to_world.first().point(Vec3::ZERO), Vec3::Z));
        };
        let (from, axis) = interface.frame(layer);
        let to_world = layer.to_world.first();
        Some((emission, to_world.point(from), to_world.vector(axis)))
    }

    /// Returns the pixel coordinates of the camera for those of the image.
    pub(super) fn raster(&self, [x, y]: [f32; 2]) -> Option<[f32; 2]> {
        let window = self.window()?;
        Some([x + window.x0 as f32, y + window.y0 as f32])
    }

    /// Returns the point of the first surface in a pixel of the image, in world space.
    pub(super) fn surface(&self, [x, y]: [f32; 2]) -> Option<Vec3> {
        let pixel = [x, y].map(|v| v.floor() as i32);
        let depth = self.screen.depth(pixel)?;
        let centre = self.raster(pixel.map(|v| v as f32 + 0.5))?;
        Some(self.eye.as_ref()?.point(centre, depth))
    }

    /// Changes a light.
    pub(super) fn change(&mut self, rig: &mut Rig, id: &str, change: Change) -> Result<(), String> {
        if rig.lamp(id).is_none() && !matches!(change, Change::Restore) {
            return Err(self.no_light(id));
        }
        match change {
            Change::Delete => {
                rig.lamps.retain(|lamp| &*lamp.id != id);
                return Ok(());
            }
            Change::Copy => {
                let Some(lamp) = rig.lamp(id) else { return Err(self.no_light(id)) };
                let new = Lamp { id: rig.free_id(id, &self.base), solo: false, ..(**lamp).clone() };
                rig.lamps.push(Arc::new(new));
                return Ok(());
            }
            Change::Restore => {
                let Some(base) = self.base.lamp(id).cloned() else {
                    return Err(format!("light \"{id}\" is not from the scene"));
                };
                match rig.lamps.iter_mut().find(|lamp| &*lamp.id == id) {
                    Some(lamp) => *lamp = base,
                    None => rig.lamps.push(base),
                }
                return Ok(());
            }
            _ => (),
        }
        let Some(lamp) = rig.lamp_mut(id) else { return Err(self.no_light(id)) };
        match change {
            Change::Set(layer, name, value) => {
                let layer = layer_of(lamp, layer)?;
                let param = self.interfaces.get(&layer.shader)?.param(&name, &value)?;
                layer.params.set(param);
            }
            Change::Reset(index, name) => {
                let base = self.base.lamp(id).and_then(|base| base.layers.get(index));
                let old = base.and_then(|base| base.params.get(&name)).cloned();
                let layer = layer_of(lamp, index)?;
                match old {
                    Some(old) => layer.params.set(old),
                    None => layer.params.0.retain(|param| *param.name != *name),
                }
            }
            Change::Shader(index, name) => {
                let interface = self.interfaces.get(&name)?;
                let layer = layer_of(lamp, index)?;
                layer.shader = name.as_str().into();
                // The other shader has its own parameters.
                layer.params.0.retain(|param| interface.args.arg(&param.name).is_some());
            }
            Change::On(on) => lamp.off = !on,
            Change::Solo(solo) => lamp.solo = solo,
            Change::Link(pattern, on) => {
                granita_scene::check_pattern(&pattern)?;
                lamp.rules.push(Rule { pattern: pattern.as_str().into(), on });
            }
            Change::Unlink(index) if index < lamp.rules.len() => _ = lamp.rules.remove(index),
            Change::Unlink(index) => return Err(format!("light \"{id}\" has no rule {index}")),
            moves => {
                let by = self.motion(lamp, &moves)?;
                if let Some(by) = by {
                    lamp.transform(&by);
                }
            }
        }
        Ok(())
    }

    /// Returns the transformation of world space by which a change moves or turns a light.
    fn motion(&mut self, lamp: &Lamp, change: &Change) -> Result<Option<MotionTransform>, String> {
        let Some((emission, position, axis)) = self.frame(lamp) else {
            return Err(format!("the shader of light \"{}\" cannot be used", lamp.id));
        };
        if emission == Emission::Ambient {
            return Err(format!("light \"{}\" is ambient: it has no position", lamp.id));
        }
        if emission == Emission::Geometry {
            return Err(format!("light \"{}\" shines from objects, which stay where they are", lamp.id));
        }
        let Some(eye) = self.eye.clone() else { return Err("there is no camera".to_owned()) };
        let missing = || "there is no image yet".to_owned();
        Ok(match change {
            Change::Place(at) => {
                // A light behind the camera comes to where the objects are.
                let depth = eye.project(position).map(|[.., depth]| depth);
                let depth = depth.or_else(|| self.screen.usual_depth()).unwrap_or(1.0);
                let to = eye.point(self.raster(*at).ok_or_else(missing)?, depth);
                Some(geometry::moved(to - position))
            }
            Change::Distance(by) => {
                let Some([x, y, depth]) = eye.project(position) else {
                    return Err(format!("light \"{}\" is not before the camera", lamp.id));
                };
                Some(geometry::moved(eye.point([x, y], depth * by) - position))
            }
            Change::Position(to) => Some(geometry::moved(Vec3::from(*to) - position)),
            Change::Direction(angles) => geometry::turned(position, axis, geometry::direction(*angles)),
            Change::Aim(at) => {
                let target = self.surface(*at).ok_or("there is no surface to aim at")?;
                // A light without a position shines from where the camera is.
                let from = if emission == Emission::Direction { eye.position() } else { position };
                geometry::turned(position, axis, target - from)
            }
            _ => None,
        })
    }

    /// Adds a light. It shines from above and beside the camera at the middle of what is visible.
    pub(super) fn add(&mut self, rig: &mut Rig, shader: &str, id: Option<&str>) -> Result<(), String> {
        let interface = self.interfaces.get(shader)?;
        if let Some(id) = id.filter(|id| rig.lamp(id).is_some() || self.base.lamp(id).is_some()) {
            return Err(format!("there is a light \"{id}\" already"));
        }
        let id = id.map_or_else(|| rig.free_id(shader, &self.base), Into::into);
        let window = self.window().ok_or("there is no image yet")?;
        let seen = self.seen().unwrap_or(PixelRect::at(0, 0, window.width() as u32, window.height() as u32));
        let middle = [seen.x0.midpoint(seen.x1) as f32, seen.y0.midpoint(seen.y1) as f32];
        let eye = self.eye.clone().ok_or("there is no camera")?;
        let depth = self.screen.usual_depth().unwrap_or(5.0);
        let target = self
            .surface(middle)
            .unwrap_or_else(|| self.raster(middle).map_or(Vec3::ZERO, |middle| eye.point(middle, depth)));
        let quarter =
            [seen.x0 as f32 * 0.6 + seen.x1 as f32 * 0.4, seen.y0 as f32 * 0.7 + seen.y1 as f32 * 0.3];
        let near = self.raster(quarter).map_or(target, |at| eye.point(at, 0.6 * depth));
        let mut params = Params::new();
        // The light arrives with about the intensity 1.
        let falls = interface.args.arg("falloff").is_some();
        let is_placed = matches!(interface.emission, Emission::Position { .. });
        if falls && is_placed && interface.args.arg("intensity").is_some() {
            let intensity = (target - near).length_squared();
            let ty = ParamType::of(BaseType::Float);
            params.set(Param { name: "intensity".into(), ty, data: round(intensity).into() });
        }
        let mut lamp = Lamp {
            id,
            layers: vec![Layer {
                shader: shader.into(),
                layer: None,
                params,
                to_world: MotionTransform::default(),
                state: "".into(),
            }],
            connections: Vec::new(),
            values: Arc::default(),
            state: "".into(),
            rules: Vec::new(),
            off: false,
            solo: false,
        };
        if let Some((_, position, axis)) = self.frame(&lamp) {
            lamp.transform(&geometry::moved(near - position));
            if let Some(turn) = geometry::turned(near, axis, target - near) {
                lamp.transform(&turn);
            }
        }
        rig.lamps.push(Arc::new(lamp));
        Ok(())
    }
}

/// Returns a layer of a light for a change.
fn layer_of(lamp: &mut Lamp, index: usize) -> Result<&mut Layer, String> {
    let what = format!("light \"{}\" has no layer {index}", lamp.id);
    lamp.layers.get_mut(index).ok_or(what)
}

/// Returns a number with two significant digits.
fn round(value: f32) -> f32 {
    if value <= 0.0 || !value.is_finite() {
        return 1.0;
    }
    let unit = libm::powf(10.0_f32, libm::log10f(value).floor() - 1.0);
    (value / unit).round() * unit
}
