//! Primitive variables that change from motion key to motion key (reference 2.7).
//!
//! A surface evaluates its variables at the first key. Variables that change are stored as further variables of that
//! key, one for each other key, under names that no scene can use. [`Dice::variables_at`] interpolates them.

use crate::dice::{Dice, DiceData, DicePrimvar};
use crate::key::{SPECIAL, ShapeKey};
use granita_base::{Param, ParamData, Params, Vec3};
use std::borrow::Cow;
use std::sync::Arc;

/// The mark that begins the name of a variable at a later key. It precedes the number of the key, and a second mark
/// follows the number.
const MARK: char = '\u{1}';

/// Variables that define or follow the shape of the primitive at each key. They change with nearly every deformation,
/// so that a change of these alone is not evaluated over time.
const OF_THE_SHAPE: [&str; 3] = ["N", "width", "rasterwidth"];

/// True when primitive variables change between the motion keys of a primitive: "C", "opacity" and all others, except
/// positions, normals and widths.
pub fn variables_move(keys: &[ShapeKey<'_>]) -> bool {
    let Some((first, later)) = keys.split_first() else { return false };
    let of_the_shape = |p: &&Param| !OF_THE_SHAPE.contains(&&*p.name);
    first.params.iter().filter(of_the_shape).any(|p| later.iter().any(|key| changes(p, key)))
}

/// Returns the value of a variable at another key, when it is numeric and differs.
fn changed<'a>(param: &Param, key: &ShapeKey<'a>) -> Option<&'a Param> {
    let is_text = matches!(param.data, ParamData::String(_));
    let other = key.params.get(&param.name).filter(|_| !is_text && !SPECIAL.contains(&&*param.name))?;
    (other.data.len() == param.data.len() && other.data != param.data).then_some(other)
}

fn changes(param: &Param, key: &ShapeKey<'_>) -> bool {
    changed(param, key).is_some()
}

/// Returns the parameters of the first key together with the changing variables of the others; `None` when none
/// change.
pub(crate) fn with_later(keys: &[ShapeKey<'_>]) -> Option<Params> {
    if !variables_move(keys) {
        return None;
    }
    let first = keys[0].params;
    let mut all = first.clone();
    for param in first.iter().filter(|p| keys.iter().any(|key| changes(p, key))) {
        for (k, key) in keys.iter().enumerate().skip(1) {
            let Some(value) = key.params.get(&param.name) else { continue };
            let name = format!("{MARK}{k}{MARK}{}", param.name).into();
            all.0.push(Param { name, ty: param.ty, data: value.data.clone() });
        }
    }
    Some(all)
}

/// True when a name is that of a variable at a later key.
pub(crate) fn is_later(name: &str) -> bool {
    name.starts_with(MARK)
}

/// Returns the key and the variable that a name encodes.
fn parse(name: &str) -> Option<(usize, &str)> {
    let (key, name) = name.strip_prefix(MARK)?.split_once(MARK)?;
    Some((key.parse().ok()?, name))
}

impl Dice {
    /// Returns the user's normals and the primitive variables at a time. `times` are those of the motion keys that
    /// the primitive was built from. Between keys values are interpolated. Before the first and after the last key
    /// they are constant.
    pub fn variables_at(
        &self,
        times: &[f32],
        time: f32,
    ) -> (Option<Cow<'_, [Vec3]>>, Cow<'_, [DicePrimvar]>) {
        if !self.primvars.iter().any(|v| is_later(&v.name)) {
            return (self.n.as_deref().map(Cow::Borrowed), Cow::Borrowed(&self.primvars));
        }
        let (later, own): (Vec<_>, Vec<_>) = self.primvars.iter().partition(|v| is_later(&v.name));
        let after = times.partition_point(|t| *t <= time);
        let (a, b, alpha) = match after {
            0 => (0, 0, 0.0),
            n if n >= times.len() => (times.len() - 1, times.len() - 1, 0.0),
            n => (n - 1, n, (time - times[n - 1]) / (times[n] - times[n - 1])),
        };
        let at_key = |key: usize, name: &str| {
            later.iter().find(|v| parse(&v.name) == Some((key, name))).map(|v| &v.data)
        };
        let normals = self.n.as_ref().map(|n| {
            let at =
                |key: usize| at_key(key, "N").map_or_else(|| n.clone(), |data| normals_of(data, n.len()));
            let (first, second) = (at(a), at(b));
            first.iter().zip(&second).map(|(n, m)| n.lerp(*m, alpha)).collect()
        });
        let blended = own.into_iter().map(|var| {
            let at = |key: usize| at_key(key, &var.name).unwrap_or(&var.data);
            DicePrimvar { data: blend(at(a), at(b), alpha), ..var.clone() }
        });
        (normals.map(Cow::Owned), Cow::Owned(blended.collect()))
    }
}

/// Returns the normals of `n` points.
fn normals_of(data: &DiceData, n: usize) -> Vec<Vec3> {
    match data {
        DiceData::Floats { values, varying: true } => {
            (0..n).map(|i| Vec3::new(values[i], values[n + i], values[2 * n + i])).collect()
        }
        DiceData::Floats { values, .. } => vec![Vec3::from_slice(values); n],
        DiceData::Strings(_) => vec![Vec3::ZERO; n],
    }
}

fn blend(a: &DiceData, b: &DiceData, alpha: f32) -> DiceData {
    match (a, b) {
        (DiceData::Floats { values: first, varying }, DiceData::Floats { values: second, .. })
            if alpha != 0.0 && first.len() == second.len() =>
        {
            let values = first.iter().zip(second).map(|(x, y)| x * (1.0 - alpha) + y * alpha).collect();
            DiceData::Floats { values, varying: *varying }
        }
        _ => a.clone(),
    }
}

/// Returns the arguments of a primitive at a motion key, when they differ from those at the first key (a sphere's
/// radius, lower and upper cut and sweep). They are the four numbers of the parameter "__arguments".
pub(crate) fn arguments(key: &ShapeKey<'_>) -> Option<[f32; 4]> {
    let values: Arc<[f32]> = key.params.get("__arguments")?.data.to_floats()?;
    <[f32; 4]>::try_from(&*values).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::{CurveBasis::Linear, ShapeDesc};

    fn params(list: &[(&str, &[f32])]) -> Params {
        Params(list.iter().map(|(d, v)| Param::declared(d, *v).unwrap()).collect())
    }

    const SQUARE: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];

    fn dice_of(keys: &[ShapeKey<'_>]) -> Dice {
        let shape = ShapeDesc::Patch { u: Linear, v: Linear, nu: 2, nv: 2 };
        let mut said = Vec::new();
        let pieces = crate::build(&shape, keys, None, &mut |_, text| said.push(text)).unwrap();
        assert_eq!(said, Vec::<String>::new());
        pieces[0].dice(3, 2)
    }

    fn floats(data: &DiceData) -> Vec<f32> {
        match data {
            DiceData::Floats { values, .. } => values.clone(),
            DiceData::Strings(_) => Vec::new(),
        }
    }

    #[test]
    fn variables_are_blended_between_keys() {
        let key = |c: f32, s: f32, nz: f32| {
            params(&[
                ("vertex point P", &SQUARE),
                ("color C", &[c, 0.0, 1.0]),
                ("linear float s", &[s, s + 1.0, s, s + 1.0]),
                ("linear normal N", &[0.0, 0.0, nz, 0.0, 0.0, nz, 0.0, 0.0, nz, 0.0, 0.0, nz]),
                ("float same", &[7.0]),
            ])
        };
        let all = [key(0.0, 0.0, 1.0), key(1.0, 4.0, 3.0), key(0.5, 0.0, 3.0)];
        let times = [0.0, 1.0, 3.0];
        let keys: Vec<ShapeKey<'_>> =
            all.iter().zip(times).map(|(params, time)| ShapeKey { time, params }).collect();
        assert!(variables_move(&keys));
        let dice = dice_of(&keys);
        for (time, c, s, nz) in
            [(-1.0, 0.0, 0.0, 1.0), (0.25, 0.25, 1.0, 1.5), (2.0, 0.75, 2.0, 3.0), (9.0, 0.5, 0.0, 3.0)]
        {
            let (normals, vars) = dice.variables_at(&times, time);
            let of = |name: &str| floats(&vars.iter().find(|v| &*v.name == name).unwrap().data);
            assert_eq!(vars.len(), 3, "{vars:?}");
            assert_eq!(of("C"), [c, 0.0, 1.0], "at {time}");
            assert_eq!(of("s")[..3], [s, s + 0.5, s + 1.0], "at {time}");
            assert_eq!(of("same"), [7.0]);
            assert_eq!(normals.unwrap()[4].z, nz, "at {time}");
        }
    }

    #[test]
    fn deforming_shapes_do_not_count_as_moving_variables() {
        let key = |z: f32| {
            let p: Vec<f32> = SQUARE.iter().map(|x| x + z).collect();
            params(&[("vertex point P", &p), ("normal N", &[0.0, z, 1.0]), ("float width", &[z])])
        };
        let (a, b) = (key(0.0), key(1.0));
        let keys = [ShapeKey { time: 0.0, params: &a }, ShapeKey { time: 1.0, params: &b }];
        assert!(!variables_move(&keys) && with_later(&keys).is_none() && !variables_move(&keys[..1]));
        let dice = dice_of(&keys);
        assert_eq!(dice.variables_at(&[0.0, 1.0], 0.5).1, dice.primvars);
    }

    #[test]
    fn spheres_interpolate_their_arguments() {
        let built = |first: [f32; 4], last: [f32; 4]| {
            let [radius, zmin, zmax, thetamax_deg] = first;
            let [a, b] = [first, last].map(|list| params(&[("float[4] __arguments", &list)]));
            let keys = [ShapeKey { time: 0.0, params: &a }, ShapeKey { time: 1.0, params: &b }];
            let shape = ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg };
            crate::build(&shape, &keys, None, &mut |_, text| panic!("{text}")).unwrap().remove(0)
        };
        let ball = built([1.0, -1.0, 1.0, 360.0], [2.0, -2.0, 2.0, 360.0]);
        assert_eq!((ball.key_times(), ball.measured_key()), (&[0.0, 1.0][..], Some(1)));
        let dice = ball.dice(5, 5);
        assert!(dice.primvars.is_empty());
        for (key, radius) in [(0, 1.0), (1, 2.0)] {
            assert!(dice.p[key].iter().all(|p| (p.length() - radius).abs() < 1e-6));
            assert!((ball.bound(key).max.x - radius).abs() < 1e-5);
        }
        // The fan opens. Its points move along arcs, not along chords.
        let fan = built([1.0, -1.0, 1.0, 0.0], [1.0, -1.0, 1.0, 360.0]);
        let times = fan.key_times();
        assert!(times.len() > 100 && times.windows(2).all(|t| t[0] < t[1]) && times.last() == Some(&1.0));
        let dice = fan.dice(3, 3);
        for p in &dice.p {
            let (from, middle) = (p[3], p[4]);
            assert!((from - Vec3::X).length() < 1e-6 && (middle.length() - 1.0).abs() < 1e-6);
        }
        let half_way = dice.p[times.len() / 2][5];
        assert!((half_way - -Vec3::X).length() < 0.05, "{half_way}");
        assert!(dice.dpdu.iter().all(|v| v.length() > 0.0));
    }
}
