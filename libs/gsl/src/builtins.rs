// tidy: table
//! The signatures of the standard library, with one row per overload (reference 5.8).
//!
//! `exit`, constructors and casts are not functions here, because they have their own IR.

mod options;

pub(crate) use options::TRACE;

use crate::Func;
use crate::ir::{Global, ValueType};
use ValueType::{
    Color as C, Float as F, Matrix as M, Normal as N, Point as P, String as S, Vector as V, Void,
};
use options::{ENVIRONMENT, GATHER, OCCLUSION, QUERY, SAVE, SHADOW, STEP, SUBSURFACE, TEXTURE};

/// A set of value types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct TypeSet(u16);

impl TypeSet {
    pub(crate) const fn of(types: &[ValueType]) -> Self {
        let mut bits = 0;
        let mut i = 0;
        while i < types.len() {
            bits |= 1 << types[i] as u16;
            i += 1;
        }
        Self(bits)
    }

    pub(crate) fn contains(self, ty: ValueType) -> bool {
        self.0 & (1 << ty as u16) != 0
    }

    pub(crate) fn intersection(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    /// Returns the types in order of preference.
    pub(crate) fn iter(self) -> impl Iterator<Item = ValueType> {
        [F, C, P, V, N, M, S].into_iter().filter(move |t| self.contains(*t))
    }
}

/// The types float, color, point, vector and normal.
pub(crate) const NUMBERS: TypeSet = TypeSet::of(&[F, C, P, V, N]);
const NUMBERS_MATRIX: TypeSet = TypeSet::of(&[F, C, P, V, N, M]);
const FLOAT_COLOR: TypeSet = TypeSet::of(&[F, C]);
pub(crate) const ANY_VALUE: TypeSet = TypeSet::of(&[F, C, P, V, N, M, S]);

/// The types that an argument may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Arg {
    /// This type, or one that converts to it.
    Is(ValueType),
    /// The type that all `Same` arguments of the row share (and the result, if it is `Same`).
    Same(TypeSet),
    /// One of these types, without conversion.
    Any(TypeSet),
    /// A value or an array of any type, without conversion.
    Data,
    /// An array of any type.
    Array,
    /// An array of numbers whose type is the result's.
    SameArray(TypeSet),
    /// A variable of this type, which the function writes.
    Out(ValueType),
    /// A variable of one of these types.
    OutAny(TypeSet),
    /// A variable or array of any type.
    OutData,
}

/// The result of a function.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ret {
    Is(ValueType),
    /// The type of the `Same` arguments.
    Same,
    /// The type that the context expects, if it is one of these. Otherwise it is the first of them.
    Wanted(TypeSet),
}

/// The arguments that may follow the fixed ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rest {
    Nothing,
    /// Values of any type, as `printf` takes them.
    Values,
    /// More strings.
    Strings,
    /// At least this number of further `Same` arguments.
    Same(usize),
    /// Optional arguments, as names with values.
    Options(&'static [Choice]),
}

/// An optional argument.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Choice {
    pub(crate) name: &'static str,
    pub(crate) ty: ValueType,
    pub(crate) array: Option<u32>,
    pub(crate) output: bool,
    /// The default value as text; empty where there is none.
    pub(crate) default: &'static str,
    /// The effect, for the manual.
    pub(crate) help: &'static str,
}

/// One overload.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Signature {
    pub(crate) func: Func,
    pub(crate) ret: Ret,
    pub(crate) args: &'static [Arg],
    pub(crate) rest: Rest,
    /// True when the function reads neighbouring points.
    pub(crate) derivatives: bool,
    /// The globals that it reads implicitly.
    pub(crate) reads: &'static [Global],
    /// The globals that it writes implicitly.
    pub(crate) writes: &'static [Global],
    /// True when it runs the lights, as a `lights` statement does.
    pub(crate) runs_lights: bool,
}

const fn row(func: Func, ret: Ret, args: &'static [Arg]) -> Signature {
    Signature {
        func,
        ret,
        args,
        rest: Rest::Nothing,
        derivatives: false,
        reads: &[],
        writes: &[],
        runs_lights: false,
    }
}

/// Returns the row of an overload with a result of type `ret`.
const fn f(func: Func, ret: ValueType, args: &'static [Arg]) -> Signature {
    row(func, Ret::Is(ret), args)
}

impl Signature {
    const fn rest(mut self, rest: Rest) -> Self {
        self.rest = rest;
        self
    }
    const fn options(self, options: &'static [Choice]) -> Self {
        self.rest(Rest::Options(options))
    }
    const fn derivatives(mut self) -> Self {
        self.derivatives = true;
        self
    }
    const fn reads(mut self, globals: &'static [Global]) -> Self {
        self.reads = globals;
        self
    }
    const fn writes(mut self, globals: &'static [Global]) -> Self {
        self.writes = globals;
        self
    }
    const fn lights(mut self) -> Self {
        self.runs_lights = true;
        self
    }
}

// Arguments.
const AF: Arg = Arg::Is(F);
const AC: Arg = Arg::Is(C);
const AP: Arg = Arg::Is(P);
const AV: Arg = Arg::Is(V);
const AN: Arg = Arg::Is(N);
const AM: Arg = Arg::Is(M);
const AS: Arg = Arg::Is(S);
const T: Arg = Arg::Same(NUMBERS);
const TM: Arg = Arg::Same(NUMBERS_MATRIX);
const W: Ret = Ret::Wanted(NUMBERS);
const FC: Ret = Ret::Wanted(FLOAT_COLOR);

/// Every overload of every function.
pub(crate) const TABLE: &[Signature] = &[
    // 5.8.2 Mathematical functions.
    f(Func::Radians, F, &[AF]),
    f(Func::Degrees, F, &[AF]),
    f(Func::Sin, F, &[AF]),
    f(Func::Cos, F, &[AF]),
    f(Func::Tan, F, &[AF]),
    f(Func::Asin, F, &[AF]),
    f(Func::Acos, F, &[AF]),
    f(Func::Atan, F, &[AF, AF]),
    f(Func::Atan, F, &[AF]),
    f(Func::Sinh, F, &[AF]),
    f(Func::Cosh, F, &[AF]),
    f(Func::Tanh, F, &[AF]),
    f(Func::Pow, F, &[AF, AF]),
    f(Func::Exp, F, &[AF]),
    f(Func::Log, F, &[AF]),
    f(Func::Log2, F, &[AF]),
    f(Func::Log10, F, &[AF]),
    f(Func::Log, F, &[AF, AF]),
    f(Func::Sqrt, F, &[AF]),
    f(Func::InverseSqrt, F, &[AF]),
    f(Func::Hypot, F, &[AF, AF]),
    f(Func::Hypot, F, &[AF, AF, AF]),
    f(Func::Abs, F, &[AF]),
    f(Func::Fabs, F, &[AF]),
    f(Func::Sign, F, &[AF]),
    f(Func::Floor, F, &[AF]),
    f(Func::Ceil, F, &[AF]),
    f(Func::Round, F, &[AF]),
    f(Func::Trunc, F, &[AF]),
    f(Func::Mod, F, &[AF, AF]),
    row(Func::Min, Ret::Same, &[T, T]),
    row(Func::Max, Ret::Same, &[T, T]),
    row(Func::Clamp, Ret::Same, &[T, T, T]),
    row(Func::Mix, Ret::Same, &[TM, TM, AF]),
    f(Func::IsNan, F, &[AF]),
    f(Func::IsInf, F, &[AF]),
    f(Func::Finite, F, &[AF]),
    f(Func::Erf, F, &[AF]),
    f(Func::Erfc, F, &[AF]),
    // 5.8.3 Geometric functions.
    f(Func::Dot, F, &[AV, AV]),
    f(Func::Cross, V, &[AV, AV]),
    f(Func::Length, F, &[AV]),
    f(Func::Distance, F, &[AP, AP]),
    f(Func::Distance, F, &[AP, AP, AP]),
    f(Func::Normalize, V, &[AV]),
    f(Func::FaceForward, V, &[AV, AV, AV]),
    f(Func::FaceForward, V, &[AV, AV]).reads(&[Global::Ng]),
    f(Func::Reflect, V, &[AV, AV]),
    f(Func::Refract, V, &[AV, AV, AF]),
    f(Func::Fresnel, Void, &[AV, AN, AF, Arg::Out(F), Arg::Out(F), Arg::Out(V), Arg::Out(V)]),
    f(Func::Transform, P, &[AM, AP]),
    f(Func::Transform, P, &[AS, AS, AP]),
    f(Func::Transform, P, &[AS, AP]),
    f(Func::Transform, P, &[AS, AM, AP]),
    f(Func::Transform, P, &[AM, AS, AP]),
    f(Func::Transform, P, &[AM, AM, AP]),
    f(Func::TransformV, V, &[AM, AV]),
    f(Func::TransformV, V, &[AS, AS, AV]),
    f(Func::TransformV, V, &[AS, AV]),
    f(Func::TransformV, V, &[AS, AM, AV]),
    f(Func::TransformV, V, &[AM, AS, AV]),
    f(Func::TransformV, V, &[AM, AM, AV]),
    f(Func::TransformN, N, &[AM, AN]),
    f(Func::TransformN, N, &[AS, AS, AN]),
    f(Func::TransformN, N, &[AS, AN]),
    f(Func::TransformN, N, &[AS, AM, AN]),
    f(Func::TransformN, N, &[AM, AS, AN]),
    f(Func::TransformN, N, &[AM, AM, AN]),
    f(Func::TransformU, F, &[AS, AF]),
    f(Func::TransformU, F, &[AS, AS, AF]),
    f(Func::Rotate, P, &[AP, AF, AP, AP]),
    // 5.8.4 Color functions.
    f(Func::Luminance, F, &[AC]),
    f(Func::TransformC, C, &[AS, AC]),
    f(Func::TransformC, C, &[AS, AS, AC]),
    // 5.8.5 Matrix functions.
    f(Func::Determinant, F, &[AM]),
    f(Func::Transpose, M, &[AM]),
    f(Func::Translate, M, &[AM, AP]),
    f(Func::Rotate, M, &[AM, AF, AV]),
    f(Func::Scale, M, &[AM, AP]),
    // 5.8.6 Pattern generation.
    f(Func::Step, F, &[AF, AF]),
    f(Func::SmoothStep, F, &[AF, AF, AF]),
    row(Func::Noise, W, &[AF]),
    row(Func::Noise, W, &[AF, AF]),
    row(Func::Noise, W, &[AP]),
    row(Func::Noise, W, &[AP, AF]),
    row(Func::SNoise, W, &[AF]),
    row(Func::SNoise, W, &[AF, AF]),
    row(Func::SNoise, W, &[AP]),
    row(Func::SNoise, W, &[AP, AF]),
    row(Func::CNoise, W, &[AF]),
    row(Func::CNoise, W, &[AF, AF]),
    row(Func::CNoise, W, &[AP]),
    row(Func::CNoise, W, &[AP, AF]),
    // The reference's text has pnnoise, and its contents have pnoise. Both are accepted.
    row(Func::PNoise, W, &[AF, AF]),
    row(Func::PNoise, W, &[AF, AF, AF, AF]),
    row(Func::PNoise, W, &[AP, AP]),
    row(Func::PNoise, W, &[AP, AF, AP, AF]),
    row(Func::PNNoise, W, &[AF, AF]),
    row(Func::PNNoise, W, &[AF, AF, AF, AF]),
    row(Func::PNNoise, W, &[AP, AP]),
    row(Func::PNNoise, W, &[AP, AF, AP, AF]),
    row(Func::PSNoise, W, &[AF, AF]),
    row(Func::PSNoise, W, &[AF, AF, AF, AF]),
    row(Func::PSNoise, W, &[AP, AP]),
    row(Func::PSNoise, W, &[AP, AF, AP, AF]),
    row(Func::Random, W, &[]),
    row(Func::Random, W, &[AF]),
    row(Func::Random, W, &[AP]),
    row(Func::RandomGrid, W, &[]),
    row(Func::Spline, Ret::Same, &[AF]).rest(Rest::Same(4)),
    row(Func::Spline, Ret::Same, &[AS, AF]).rest(Rest::Same(4)),
    row(Func::Spline, Ret::Same, &[AF, Arg::SameArray(NUMBERS)]),
    row(Func::Spline, Ret::Same, &[AS, AF, Arg::SameArray(NUMBERS)]),
    // 5.8.7 Derivatives and antialiasing.
    f(Func::DeltaU, F, &[AF]).derivatives(),
    f(Func::DeltaU, V, &[AP]).derivatives(),
    f(Func::DeltaU, V, &[AV]).derivatives(),
    f(Func::DeltaU, C, &[AC]).derivatives(),
    f(Func::DeltaV, F, &[AF]).derivatives(),
    f(Func::DeltaV, V, &[AP]).derivatives(),
    f(Func::DeltaV, V, &[AV]).derivatives(),
    f(Func::DeltaV, C, &[AC]).derivatives(),
    f(Func::FilterWidth, F, &[AF]).derivatives(),
    f(Func::FilterWidth, F, &[AP]).derivatives(),
    f(Func::FilterWidth, F, &[AV]).derivatives(),
    f(Func::FilterWidth, F, &[AC]).derivatives(),
    f(Func::SurfaceNormal, N, &[AP]).derivatives(),
    f(Func::SampleArea, F, &[AP]).derivatives(),
    f(Func::AaStep, F, &[AF, AF]).options(STEP).derivatives(),
    f(Func::AaStep, F, &[AF, AF, AF]).options(STEP),
    // 5.8.8 Grids.
    f(Func::GridN, F, &[]),
    f(Func::GridNU, F, &[]),
    f(Func::GridNV, F, &[]),
    f(Func::GridIndex, F, &[]),
    f(Func::GridAny, F, &[Arg::Any(ANY_VALUE)]),
    row(Func::GridMin, Ret::Same, &[T]),
    row(Func::GridMax, Ret::Same, &[T]),
    // 5.8.9 Strings.
    f(Func::Format, S, &[AS]).rest(Rest::Values),
    f(Func::Printf, Void, &[AS]).rest(Rest::Values),
    f(Func::Error, Void, &[AS]).rest(Rest::Values),
    f(Func::Fprintf, Void, &[AS, AS]).rest(Rest::Values),
    f(Func::Concat, S, &[AS]).rest(Rest::Strings),
    f(Func::Match, F, &[AS, AS]),
    f(Func::Substr, S, &[AS, AF, AF]),
    f(Func::Substr, S, &[AS, AF]),
    // 5.8.10 Textures, reflections, shadows.
    row(Func::Texture, FC, &[AS, AF, AF]).options(TEXTURE).derivatives(),
    row(Func::Texture, FC, &[AS, AF, AF, AF, AF, AF, AF]).options(TEXTURE),
    row(Func::Texture3d, FC, &[AS, AP]).options(TEXTURE).derivatives(),
    row(Func::Environment, FC, &[AS, AV]).options(ENVIRONMENT).derivatives().reads(&[Global::P]),
    row(Func::Environment, FC, &[AS, AP, AV]).options(ENVIRONMENT).derivatives(),
    row(Func::Environment, FC, &[AS, AV, AV, AV]).options(ENVIRONMENT).reads(&[Global::P]),
    row(Func::Environment, FC, &[AS, AP, AV, AV, AV]).options(ENVIRONMENT),
    row(Func::Shadow, FC, &[AS, AP]).options(SHADOW).derivatives(),
    row(Func::Shadow, FC, &[AS, AP, AV, AV]).options(SHADOW),
    // 5.8.11 Lighting.
    f(Func::Ambient, C, &[]).reads(&[Global::P, Global::N]).lights(),
    f(Func::Diffuse, C, &[AV]).reads(&[Global::P]).lights(),
    f(Func::Specular, C, &[AV, AV, AF]).reads(&[Global::P]).lights(),
    f(Func::SpecularBrdf, C, &[AV, AV, AV, AF]),
    f(Func::Indirect, C, &[AS, AP, AV]).options(GATHER),
    f(Func::Occlusion, F, &[AS, AP, AV, AF]).options(OCCLUSION),
    f(Func::Occlusion, F, &[AS, AP, AV, AF, Arg::Out(V)]).options(OCCLUSION),
    f(Func::Subsurface, C, &[AS, AP, AN]).options(SUBSURFACE),
    // 5.8.12 Displacement.
    f(Func::Displace, Void, &[AF]).derivatives().reads(&[Global::N]).writes(&[Global::P, Global::N]),
    f(Func::Displace, Void, &[AS, AF]).derivatives().reads(&[Global::N]).writes(&[Global::P, Global::N]),
    f(Func::Displace, Void, &[AV]).derivatives().reads(&[Global::N]).writes(&[Global::P, Global::N]),
    f(Func::Bump, Void, &[AF]).derivatives().reads(&[Global::P, Global::N]).writes(&[Global::N]),
    f(Func::Bump, Void, &[AS, AF]).derivatives().reads(&[Global::P, Global::N]).writes(&[Global::N]),
    f(Func::Bump, Void, &[AV]).derivatives().reads(&[Global::P, Global::N]).writes(&[Global::N]),
    // 5.8.13 Spatial databases.
    f(Func::SpatialDbSave, Void, &[AS, AF, AF, Arg::Any(NUMBERS)]).options(SAVE),
    f(Func::SpatialDbSave, Void, &[AS, AP, Arg::Any(NUMBERS)]).options(SAVE),
    f(Func::SpatialDbSave, Void, &[AS, AP, AN, Arg::Any(NUMBERS)]).options(SAVE),
    f(Func::SpatialDbQuery, F, &[AS, AF, AF, Arg::OutAny(NUMBERS)]).options(QUERY),
    f(Func::SpatialDbQuery, F, &[AS, AP, Arg::OutAny(NUMBERS)]).options(QUERY),
    f(Func::SpatialDbQuery, F, &[AS, AP, AN, Arg::OutAny(NUMBERS)]).options(QUERY),
    // 5.8.14 Renderer state.
    f(Func::GetAttribute, F, &[AS, Arg::OutData]),
    f(Func::SetMessage, Void, &[AS, Arg::Data]),
    f(Func::GetMessage, F, &[AS, AS, Arg::OutData]),
    f(Func::GetTextureInfo, F, &[AS, AS, Arg::OutData]),
    f(Func::RayLevel, F, &[]),
    f(Func::IsShadowRay, F, &[]),
    f(Func::IsIndirectRay, F, &[]),
    // 5.8.15 Miscellaneous.
    f(Func::ArrayLength, F, &[Arg::Array]),
];

/// The forms of `emit`.
pub(crate) const EMIT: &[&[ValueType]] = &[&[P], &[P, V, F], &[V, F], &[]];
/// The forms of `lights`.
pub(crate) const LIGHTS: &[&[ValueType]] = &[&[P], &[P, V, F], &[S, P], &[S, P, V, F]];
/// The forms of `trace`, which takes the options [`TRACE`].
pub(crate) const TRACES: &[&[ValueType]] = &[&[S, P, V, F, F]];

/// The letters of the conversions of templates, as `printf` takes them.
pub const CONVERSIONS: &str = "fFeEgGdixcpvnms";

/// The mathematical constants (reference 5.8.1).
pub(crate) const CONSTANTS: &[(&str, f32)] = &[
    ("M_PI", std::f32::consts::PI),
    ("PI", std::f32::consts::PI),
    ("M_PI_2", std::f32::consts::FRAC_PI_2),
    ("M_E", std::f32::consts::E),
    ("M_LN2", std::f32::consts::LN_2),
    ("M_LN10", std::f32::consts::LN_10),
    ("M_SQRT2", std::f32::consts::SQRT_2),
    ("M_SQRT1_2", std::f32::consts::FRAC_1_SQRT_2),
];

/// Returns all overloads of the function called `name`.
pub(crate) fn named(name: &str) -> impl Iterator<Item = &'static Signature> + Clone {
    TABLE.iter().filter(move |s| s.func.word() == name)
}

impl Signature {
    /// Returns its spelling in the reference, for messages.
    pub(crate) fn spell(&self) -> String {
        let set = |s: TypeSet| {
            let words: Vec<_> = s.iter().map(ValueType::word).collect();
            words.join("|")
        };
        let mut args: Vec<String> = self
            .args
            .iter()
            .map(|a| match *a {
                Arg::Is(t) => t.word().to_owned(),
                Arg::Same(_) => "type".to_owned(),
                Arg::Any(s) if s == ANY_VALUE => "any".to_owned(),
                Arg::Any(s) => set(s),
                Arg::Data => "any".to_owned(),
                Arg::Array => "any[]".to_owned(),
                Arg::SameArray(_) => "type[]".to_owned(),
                Arg::Out(t) => format!("output {}", t.word()),
                Arg::OutAny(s) => format!("output {}", set(s)),
                Arg::OutData => "output any".to_owned(),
            })
            .collect();
        match self.rest {
            Rest::Nothing => {}
            Rest::Same(n) => args.push(format!("{n} or more type")),
            Rest::Strings => args.push("string...".to_owned()),
            Rest::Values | Rest::Options(_) => args.push("...".to_owned()),
        }
        format!("{} ({})", self.func.word(), args.join(", "))
    }
}

/// One overload of a function of the standard library, for tools and tests.
#[derive(Clone, Debug, PartialEq)]
pub struct Overload {
    /// The function.
    pub func: Func,
    /// The spelling in messages, such as `mix (type, type, float)`. It is unique.
    pub form: String,
    /// The possible result types in order of preference; empty when it returns nothing.
    pub results: Vec<ValueType>,
}

/// Returns every overload of every function (reference 5.8), in the reference's order.
pub fn overloads() -> impl Iterator<Item = Overload> {
    TABLE.iter().map(|row| {
        let shared = || {
            let of = |arg: &Arg| match *arg {
                Arg::Same(set) | Arg::SameArray(set) => Some(set),
                _ => None,
            };
            row.args.iter().find_map(of).unwrap_or(NUMBERS).iter().collect()
        };
        let results = match row.ret {
            Ret::Is(Void) => Vec::new(),
            Ret::Is(ty) => vec![ty],
            Ret::Same => shared(),
            Ret::Wanted(set) => set.iter().collect(),
        };
        Overload { func: row.func, form: row.spell(), results }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_function_has_a_row_and_every_row_a_function() {
        // Functions that a library declares have no row.
        for func in Func::ALL.iter().filter(|func| **func != Func::Shadeop) {
            assert!(TABLE.iter().any(|s| s.func == *func), "{} has no signature", func.word());
            assert_eq!(
                Func::ALL.iter().filter(|f| f.word() == func.word()).count(),
                1,
                "{} is spelled twice",
                func.word()
            );
        }
        for s in TABLE {
            assert!(Func::ALL.contains(&s.func));
            assert!(named(s.func.word()).any(|r| std::ptr::eq(r, s) || r.args == s.args));
        }
    }

    #[test]
    fn forms_of_functions_are_unique() {
        let mut forms: Vec<_> = overloads().map(|o| o.form).collect();
        forms.sort();
        let count = forms.len();
        forms.dedup();
        assert_eq!((forms.len(), count), (TABLE.len(), TABLE.len()));
        let mix = overloads().find(|o| o.func == Func::Mix).unwrap();
        assert_eq!((mix.form.as_str(), mix.results.len()), ("mix (type, type, float)", 6));
    }

    #[test]
    fn no_row_of_the_table_is_repeated() {
        for (i, a) in TABLE.iter().enumerate() {
            for b in &TABLE[i + 1..] {
                assert!(a.func != b.func || a.args != b.args || a.rest != b.rest, "{}", a.spell());
            }
        }
    }

    #[test]
    fn rows_of_the_table_are_consistent() {
        for s in TABLE {
            let same = s.args.iter().any(|a| matches!(a, Arg::Same(_) | Arg::SameArray(_)))
                || matches!(s.rest, Rest::Same(_));
            assert_eq!(s.ret == Ret::Same, same, "{}", s.spell());
            if let Rest::Options(options) = s.rest {
                let mut names: Vec<_> = options.iter().map(|o| o.name).collect();
                names.sort_unstable();
                names.dedup();
                assert_eq!(names.len(), options.len(), "{}", s.spell());
            }
        }
    }
}
