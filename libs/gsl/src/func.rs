//! The functions of the standard library (reference 5.8), one name each.

/// Declares [`Func`] with the spelling of every function.
macro_rules! functions {
    ($($id:ident $word:literal,)*) => {
        /// A function of the standard library. Its overloads share one.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[allow(missing_docs, reason = "each is the function of its name, reference 5.8")]
        pub enum Func { $($id,)* }

        impl Func {
            /// All functions.
            pub const ALL: &[Self] = &[$(Self::$id,)*];

            /// The name in the language.
            pub fn word(self) -> &'static str {
                match self { $(Self::$id => $word,)* }
            }
        }
    };
}

functions! {
    Radians "radians", Degrees "degrees",
    Sin "sin", Cos "cos", Tan "tan", Asin "asin", Acos "acos", Atan "atan",
    Sinh "sinh", Cosh "cosh", Tanh "tanh",
    Pow "pow", Exp "exp", Log "log", Log2 "log2", Log10 "log10", Sqrt "sqrt", InverseSqrt "inversesqrt",
    Hypot "hypot", Abs "abs", Fabs "fabs", Sign "sign",
    Floor "floor", Ceil "ceil", Round "round", Trunc "trunc", Mod "mod",
    Min "min", Max "max", Clamp "clamp", Mix "mix",
    IsNan "isnan", IsInf "isinf", Finite "finite", Erf "erf", Erfc "erfc",
    Dot "dot", Cross "cross", Length "length", Distance "distance", Normalize "normalize",
    FaceForward "faceforward", Reflect "reflect", Refract "refract", Fresnel "fresnel",
    Transform "transform", TransformV "transformv", TransformN "transformn", TransformU "transformu",
    Rotate "rotate",
    Luminance "luminance", TransformC "transformc",
    Determinant "determinant", Transpose "transpose", Translate "translate", Scale "scale",
    Step "step", SmoothStep "smoothstep",
    Noise "noise", SNoise "snoise", CNoise "cnoise", PNoise "pnoise", PSNoise "psnoise", PNNoise "pnnoise",
    Random "random", RandomGrid "randomgrid", Spline "spline",
    DeltaU "deltau", DeltaV "deltav", FilterWidth "filterwidth", SurfaceNormal "surfacenormal",
    SampleArea "samplearea", AaStep "aastep",
    GridN "gridn", GridNU "gridnu", GridNV "gridnv", GridIndex "gridindex",
    GridAny "gridany", GridMin "gridmin", GridMax "gridmax",
    Format "format", Printf "printf", Error "error", Fprintf "fprintf",
    Concat "concat", Match "match", Substr "substr",
    Texture "texture", Texture3d "texture3d", Environment "environment", Shadow "shadow",
    Ambient "ambient", Diffuse "diffuse", Specular "specular", SpecularBrdf "specularbrdf",
    Indirect "indirect", Occlusion "occlusion", Subsurface "subsurface",
    Displace "displace", Bump "bump",
    SpatialDbSave "spatialdbsave", SpatialDbQuery "spatialdbquery",
    GetAttribute "getattribute", SetMessage "setmessage", GetMessage "getmessage",
    GetTextureInfo "gettextureinfo",
    RayLevel "raylevel", IsShadowRay "isshadowray", IsIndirectRay "isindirectray",
    ArrayLength "arraylength",
    // This is not a word of the language. The first operand, a constant, names the function.
    Shadeop "(shadeop)",
}
