//! Named spaces and units, as shaders and attributes name them (reference 5.2.3, 5.8.3, 8.5).

use granita_base::{MotionTransform, Transform};
use granita_dicing::CameraView;
use granita_scene::attribute::{Key, scope::Global};
use granita_scene::{AttributeSet, Scene, attr};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The spaces of a frame that do not depend on an object.
#[derive(Clone, Debug)]
pub struct Spaces {
    camera: CameraView,
    /// The transformations from "common" to camera space of all cameras, by their names.
    cameras: BTreeMap<Arc<str>, MotionTransform>,
    /// The transformations of the spaces named by `SaveAttributes` to "common".
    named: BTreeMap<Arc<str>, MotionTransform>,
}

impl Spaces {
    /// Returns the spaces of a scene seen by a camera.
    pub fn new(scene: &Scene, camera: &CameraView) -> Self {
        Self {
            camera: camera.clone(),
            cameras: scene.cameras.iter().map(|c| (c.name.clone(), c.world_to_camera.clone())).collect(),
            named: scene.coordinate_systems.clone(),
        }
    }

    /// Returns the time at which the frame shades.
    pub fn shading_time(&self) -> f32 {
        self.camera.shading_time()
    }

    /// Returns the matrix from a named space to "common" at a time. Returns `None` for unknown names, for "object"
    /// and "shader", and for a space without an inverse.
    ///
    /// A name given by `SaveAttributes` has precedence over a camera's name.
    pub fn to_common(&self, name: &str, time: f32) -> Option<Transform> {
        match name {
            "common" => return Some(Transform::IDENTITY),
            "world" => return Some(self.camera.world_to_common().unwrap_or_default()),
            _ => (),
        }
        if let Some(world_to) = self.camera.world_to(name, time) {
            return world_to.try_inverse();
        }
        if let Some(to_world) = self.named.get(name) {
            return Some(to_world.at(time));
        }
        self.cameras.get(name)?.at(time).try_inverse()
    }

    /// Does the same as [`Spaces::to_common`], with "object" (and, outside of shaders, "shader") as the object's
    /// space.
    pub fn of_object(&self, name: &str, attributes: &AttributeSet, time: f32) -> Option<Transform> {
        match name {
            "object" | "shader" => Some(attributes.object_to_world(time)),
            _ => self.to_common(name, time),
        }
    }
}

/// The quantity that a unit measures.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Measure {
    /// A length in metres.
    Length(f64),
    /// A time in seconds.
    Time(f64),
    /// The unit "common", which takes the quantity of the other unit.
    Common,
}

/// Units of "common" space (reference 4.3.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Units {
    /// Metres per common length unit; `None` when the scene does not declare it.
    length_m: Option<f64>,
    /// Seconds per common time unit; `None` when the scene does not declare it.
    time_s: Option<f64>,
    fps: f64,
}

impl Units {
    /// Reads "units:length", "units:lengthscale", "units:time", "units:timescale" and "units:fps".
    ///
    /// A common unit is `lengthscale` times the named unit, as in the examples of reference 4.3.2 and 8.5.1.
    pub fn new(scene: &Scene) -> Self {
        let positive = |key: Key<Global, f32>| match f64::from(scene.get(key)) {
            v if v > 0.0 && v.is_finite() => v,
            _ => f64::from(key.default()),
        };
        let fps = positive(attr::UNITS_FPS);
        let time_s = match &*scene.get(attr::UNITS_TIME) {
            "s" => Some(positive(attr::UNITS_TIMESCALE)),
            "frames" => Some(positive(attr::UNITS_TIMESCALE) / fps),
            _ => None,
        };
        let length_m = metres(&scene.get(attr::UNITS_LENGTH)).map(|m| m * positive(attr::UNITS_LENGTHSCALE));
        Self { length_m, time_s, fps }
    }

    /// Does the same as [`Units::scale`] for scenes that do not declare the unit of "common" space, which then
    /// counts as a millimetre or a second. The text is the warning to report. Returns `None` when that assumption
    /// does not help.
    pub fn assumed(&self, from: &str, to: &str) -> Option<(f32, &'static str)> {
        const LENGTH: &str =
            "\"units:length\" is not set: shaders assume that a unit of \"common\" space is a millimetre";
        const TIME: &str =
            "\"units:time\" is not set: shaders assume that a unit of \"common\" time is a second";
        let whole =
            Self { length_m: self.length_m.or(Some(0.001)), time_s: self.time_s.or(Some(1.0)), ..*self };
        let factor = whole.scale(from, to)?;
        let is_time = [from, to].iter().any(|name| matches!(self.measure(name), Some(Measure::Time(_))));
        Some((factor, if is_time { TIME } else { LENGTH }))
    }

    fn measure(&self, name: &str) -> Option<Measure> {
        Some(match name {
            "common" => Measure::Common,
            "s" => Measure::Time(1.0),
            "frames" => Measure::Time(1.0 / self.fps),
            _ => Measure::Length(metres(name)?),
        })
    }

    /// Returns the factor that converts a number of `from` units into a number of `to` units. Returns `None` when a
    /// name is not a unit, when one is a length and the other a time, or when the scene does not declare the common
    /// unit.
    pub fn scale(&self, from: &str, to: &str) -> Option<f32> {
        let ratio = match (self.measure(from)?, self.measure(to)?) {
            (Measure::Common, Measure::Common) => 1.0,
            (Measure::Length(a), Measure::Length(b)) | (Measure::Time(a), Measure::Time(b)) => a / b,
            (Measure::Length(a), Measure::Common) => a / self.length_m?,
            (Measure::Common, Measure::Length(b)) => self.length_m? / b,
            (Measure::Time(a), Measure::Common) => a / self.time_s?,
            (Measure::Common, Measure::Time(b)) => self.time_s? / b,
            (Measure::Length(_), Measure::Time(_)) | (Measure::Time(_), Measure::Length(_)) => return None,
        };
        Some(ratio as f32)
    }
}

/// Returns the metres per unit of length.
fn metres(unit: &str) -> Option<f64> {
    Some(match unit {
        "mm" => 0.001,
        "cm" => 0.01,
        "m" => 1.0,
        "km" => 1000.0,
        "in" => 0.0254,
        "ft" => 0.3048,
        "mi" => 1609.344,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Param;

    fn declared(values: &[Param]) -> Scene {
        let mut scene = Scene::default();
        for v in values {
            scene.globals.insert(v.name.clone(), v.clone());
        }
        scene
    }

    #[test]
    fn units_convert_as_in_the_examples() {
        let scene = declared(&[
            Param::declared("string units:length", "cm").unwrap(),
            Param::declared("float units:lengthscale", 0.5).unwrap(),
            Param::declared("string units:time", "frames").unwrap(),
            Param::declared("float units:fps", 25.0).unwrap(),
        ]);
        let u = Units::new(&scene);
        let near = |a: Option<f32>, b: f32| assert!((a.unwrap() - b).abs() < 1e-5 * b, "{a:?} {b}");
        near(u.scale("common", "cm"), 0.5);
        near(u.scale("cm", "common"), 2.0);
        near(u.scale("in", "cm"), 2.54);
        near(u.scale("mi", "km"), 1.609_344);
        near(u.scale("common", "s"), 0.04);
        near(u.scale("s", "frames"), 25.0);
        near(u.scale("common", "common"), 1.0);
        assert_eq!(u.scale("m", "s"), None);
        assert_eq!(u.scale("furlong", "m"), None);
        // This is the same as for lengths. "units:timescale" frames are one unit of Motion, so that 2 units are a
        // twelfth of a second at 24 frames per second.
        let scene = declared(&[
            Param::declared("string units:time", "frames").unwrap(),
            Param::declared("float units:timescale", 2.0).unwrap(),
        ]);
        near(Units::new(&scene).scale("common", "frames"), 2.0);
        near(Units::new(&scene).scale("common", "s"), 1.0 / 12.0);
    }

    #[test]
    fn undeclared_units_convert_only_among_themselves() {
        let u = Units::new(&Scene::default());
        assert!(u.scale("m", "common").is_none() && u.scale("common", "s").is_none());
        assert_eq!(u.scale("m", "mm"), Some(1000.0));
        assert_eq!(u.assumed("m", "common").map(|a| a.0), Some(1000.0));
        assert_eq!(u.assumed("common", "s").map(|a| a.0), Some(1.0));
        assert!(u.assumed("m", "s").is_none() && u.assumed("shader", "mm").is_none());
        assert!(u.assumed("mm", "common").is_some_and(|a| a.1.contains("units:length")));
    }
}
