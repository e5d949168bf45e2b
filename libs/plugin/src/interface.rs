//! Converts scene calls from C and C++ to [`Call`]s, as the receiver behind a `gelato_calls` table.
//!
//! Arrays that `Parameter` names are not copied. Their address is kept until the call that uses them, and they are
//! then read once, directly into the parameter of the scene.

mod entry;
mod values;

pub(crate) use entry::c_string;
pub use entry::{GeneratorObject, InterfaceObject, Meanwhile};

use crate::Messages;
use granita_base::shape::KnotSpan;
use granita_base::{
    BaseType, CurveBasis, Interp, Location, Param, ParamData, ParamType, Params, Reporter, Severity,
    ShapeDesc, TrimDesc,
};
use granita_scene::{Call, Matrix, SceneSink, Stop, TransformTarget};
use rustc_hash::FxHashMap;
use std::collections::HashMap;
use std::ffi::{CStr, CString, c_int};
use std::sync::Arc;
use values::{Pending, Source};

/// The operations that an interface needs from its program.
pub trait InterfaceHost {
    /// Keeps a generator with a bound for later. Returns the command by which `Input` finds it.
    ///
    /// # Errors
    /// Returns the generator when it is not kept, so that it is run at once.
    fn keep(&mut self, generator: GeneratorObject) -> Result<Arc<str>, GeneratorObject> {
        Err(generator)
    }

    /// Permits an output whose format is the address of an `ImageOutput` of the program.
    fn grant(&mut self, format: &str) {
        let _ = format;
    }

    /// Returns an attribute that the graphics state does not have.
    fn attribute(&self, declaration: &str) -> Option<Param> {
        let _ = declaration;
        None
    }

    /// True when calls are written to a file and not executed. The program's own generators are then run to the depth
    /// of "limits:inputlevels" of the sink (reference 4.3.12).
    fn archives(&self) -> bool {
        false
    }

    /// Runs a command of the host. Returns false when the host does not have the command.
    fn command(&mut self, name: &str) -> bool {
        let _ = name;
        false
    }
}

/// A host with the default operations.
impl InterfaceHost for () {}

/// The host of a program whose calls are written to a file.
#[derive(Clone, Copy, Debug)]
pub struct Archiving;

impl InterfaceHost for Archiving {
    fn archives(&self) -> bool {
        true
    }
}

/// A parsed declaration.
#[derive(Clone)]
struct Declared {
    ty: ParamType,
    name: Arc<str>,
}

/// The largest number of declarations, and of names, that are remembered. When a program uses more, all are forgotten.
const REMEMBERED: usize = 4096;

/// Receives the calls of one program or generator, and passes them on to a sink.
pub struct Interface<'a> {
    sink: Box<dyn SceneSink + 'a>,
    host: Box<dyn InterfaceHost + 'a>,
    reporter: Reporter,
    errors: Messages,
    at: Location,
    pending: Vec<Pending>,
    /// The parsed declarations, by their text.
    declarations: FxHashMap<Box<CStr>, Declared>,
    /// The names whose types were passed separately.
    names: FxHashMap<Box<CStr>, Arc<str>>,
    /// The strings that `GetAttribute` returned.
    answers: HashMap<Box<str>, CString>,
    stopped: bool,
    /// The number of generators of the program that this one runs within.
    level: i32,
}

impl std::fmt::Debug for Interface<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Interface({} pending)", self.pending.len())
    }
}

impl<'a> Interface<'a> {
    /// Returns an interface that passes calls on to `sink`, with the position `at`. Messages go to `errors`.
    pub fn new(
        sink: Box<dyn SceneSink + 'a>,
        host: Box<dyn InterfaceHost + 'a>,
        errors: Messages,
        at: Location,
    ) -> Self {
        let reporter = errors.reporter().clone();
        Self {
            sink,
            host,
            reporter,
            errors,
            at,
            pending: Vec::new(),
            declarations: FxHashMap::default(),
            names: FxHashMap::default(),
            answers: HashMap::new(),
            stopped: false,
            level: 0,
        }
    }

    /// True when the sink accepts no more calls.
    pub fn stopped(&self) -> bool {
        self.stopped
    }

    fn complain(&self, text: impl Into<String>) {
        self.reporter.say(Severity::Error, &self.at, text);
    }

    /// Passes a call to the sink.
    fn call(&mut self, call: Call) {
        if self.stopped {
            return;
        }
        match self.sink.call(call, &self.at) {
            Ok(()) => {}
            Err(Stop::Exit) => self.stopped = true,
            Err(other) => {
                self.stopped = true;
                self.complain(other.to_string());
            }
        }
    }

    /// Returns the pending parameters, for a call that is not a primitive.
    fn params(&mut self, call: &str) -> Params {
        let pending = std::mem::take(&mut self.pending);
        let mut params = Params::new();
        for p in pending {
            // The parameters of cameras and outputs have known types.
            let ty = match p.ty.base {
                BaseType::Unknown => values::known_type(&p.name).unwrap_or(p.ty),
                _ => p.ty,
            };
            self.add(&mut params, &p, ty, 1, call);
        }
        params
    }

    /// Returns the pending parameters of a primitive.
    fn shape_params(&mut self, shape: &ShapeDesc) -> Params {
        let pending = std::mem::take(&mut self.pending);
        let mut params = Params::new();
        for p in pending {
            let ty = match p.ty.base {
                BaseType::Unknown => granita_scene::predeclared(&p.name).unwrap_or(p.ty),
                _ => p.ty,
            };
            // Positions have one value for each vertex, whatever was declared.
            let interp = if matches!(&*p.name, "P" | "Pw") { Interp::Vertex } else { ty.interp };
            self.add(&mut params, &p, ty, shape.items(interp), shape.call_name());
        }
        params
    }

    fn add(&self, params: &mut Params, p: &Pending, ty: ParamType, items: usize, call: &str) {
        match p.source.read(ty, items) {
            Ok(data) => params.set(Param { name: p.name.clone(), ty: p.ty, data }),
            Err(what) => self.complain(format!("{call}: parameter \"{}\" {what}", p.name)),
        }
    }

    fn shape(&mut self, shape: ShapeDesc) {
        let params = self.shape_params(&shape);
        self.call(Call::Shape { shape: Box::new(shape), params });
    }

    /// Returns the type and the name of a declaration. An error is reported.
    fn declaration(&mut self, text: &CStr) -> Option<Declared> {
        if let Some(declared) = self.declarations.get(text) {
            return Some(declared.clone());
        }
        match ParamType::parse(&text.to_string_lossy()) {
            Ok((ty, name)) => {
                let declared = Declared { ty, name: name.into() };
                if self.declarations.len() >= REMEMBERED {
                    self.declarations.clear();
                }
                self.declarations.insert(text.into(), declared.clone());
                Some(declared)
            }
            Err(error) => {
                self.complain(error.to_string());
                None
            }
        }
    }

    /// Returns a name whose type is passed separately.
    fn name(&mut self, text: &CStr) -> Arc<str> {
        if let Some(name) = self.names.get(text) {
            return name.clone();
        }
        let name: Arc<str> = text.to_string_lossy().into();
        if self.names.len() >= REMEMBERED {
            self.names.clear();
        }
        self.names.insert(text.into(), name.clone());
        name
    }

    /// Executes `Parameter` and `Attribute`.
    fn value(&mut self, attribute: bool, name: &CStr, bits: u32, source: Source) {
        let Declared { ty, name } = if bits == 0 {
            let Some(declared) = self.declaration(name) else { return };
            declared
        } else {
            match ParamType::from_bits(bits) {
                Ok(ty) => Declared { ty, name: self.name(name) },
                Err(what) => {
                    return self.complain(format!("\"{}\": {what}", name.to_string_lossy()));
                }
            }
        };
        if !attribute {
            self.pending.retain(|p| p.name != name);
            self.pending.push(Pending { name, ty, source });
            return;
        }
        let read = match (ty.base, &source) {
            // Single values have the type of their data.
            (BaseType::Unknown, Source::Int(_) | Source::Float(_) | Source::Text(_)) => ty,
            (BaseType::Unknown, _) => values::known_type(&name).unwrap_or(ty),
            _ => ty,
        };
        match source.read(read, 1) {
            Ok(data) => self.call(Call::Attribute(Param { name, ty, data })),
            Err(what) => self.complain(format!("Attribute \"{name}\" {what}")),
        }
    }

    /// Executes a call that has only words.
    fn words(&mut self, call: c_int, words: [Option<Arc<str>>; 4]) {
        let [a, b, c, d] = words;
        let text = |word: Option<Arc<str>>| word.unwrap_or_else(|| "".into());
        let call = match call {
            0 => Call::Input { command: text(a), bound: None },
            1 => {
                let params = self.params("Camera");
                Call::Camera { name: text(a), params }
            }
            2 => {
                let format = b.unwrap_or_else(|| "null".into());
                if format.starts_with("0x") {
                    self.host.grant(&format);
                }
                let params = self.params("Output");
                Call::Output { name: text(a), format, data: text(c), camera: text(d), params }
            }
            3 => Call::World,
            4 => Call::Render { camera: a },
            5 => Call::Comment(text(a)),
            6 => {
                let (name, params) = (text(a), self.params("Command"));
                if self.host.command(&name) {
                    return;
                }
                Call::Command { name, params }
            }
            7 => Call::PushAttributes,
            8 => Call::PopAttributes,
            9 => Call::SaveAttributes { name: text(a), attributes: b },
            10 => Call::RestoreAttributes { name: text(a), attributes: b },
            11 => Call::Modify { pattern: text(a) },
            12 => Call::PushTransform,
            13 => Call::PopTransform,
            14 => Call::SetTransform(TransformTarget::Named(text(a))),
            15 => {
                let params = self.params("Shader");
                Call::Shader { usage: text(a), name: b, layer: c, params }
            }
            16 => {
                let params = self.params("Light");
                Call::Light { id: text(a), shader: b, layer: c, params }
            }
            17 => Call::ShaderGroupBegin,
            18 => Call::ShaderGroupEnd,
            19 => Call::ConnectShaders {
                source_layer: text(a),
                source: text(b),
                target_layer: text(c),
                target: text(d),
            },
            other => return self.complain(format!("there is no scene call of number {other}")),
        };
        self.call(call);
    }

    /// Executes a call that has numbers.
    fn numbers(&mut self, call: c_int, v: &[f32], word: Option<String>) {
        let matrix = |v: &[f32]| -> Option<Box<Matrix>> { v.try_into().ok().map(Box::new) };
        let made = match (call, v) {
            (0, times) => Some(Call::Motion(times.into())),
            (1, m) => matrix(m).map(|m| Call::SetTransform(TransformTarget::Matrix(m))),
            (2, m) => matrix(m).map(Call::AppendTransform),
            (3, &[x, y, z]) => Some(Call::Translate([x, y, z])),
            (4, &[angle_deg, x, y, z]) => Some(Call::Rotate { angle_deg, axis: [x, y, z] }),
            (5, &[x, y, z]) => Some(Call::Scale([x, y, z])),
            (6, &[radius, zmin, zmax, thetamax_deg]) => {
                return self.shape(ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg });
            }
            (7, bound) => bound
                .try_into()
                .ok()
                .map(|bound| Call::Input { command: word.unwrap_or_default().into(), bound: Some(bound) }),
            _ => None,
        };
        match made {
            Some(call) => self.call(call),
            None => self.complain(format!("a scene call of number {call} with {} numbers", v.len())),
        }
    }

    /// Returns a basis by name. An error is reported, and the pending parameters are dropped.
    fn basis(&mut self, call: &str, word: Option<String>) -> Option<CurveBasis> {
        let word = word.unwrap_or_default();
        let basis = CurveBasis::from_word(&word);
        if basis.is_none() {
            self.refuse(format!("{call}: unknown interpolation \"{word}\""));
        }
        basis
    }

    /// Returns the bases along u and v, by one name or two. An error is reported, and the pending parameters are
    /// dropped.
    fn bases(&mut self, call: &str, words: Option<String>) -> Option<(CurveBasis, CurveBasis)> {
        let words = words.unwrap_or_default();
        match CurveBasis::pair_from_words(&words) {
            Ok(pair) => Some(pair),
            Err(word) => {
                self.refuse(format!("{call}: unknown interpolation \"{word}\""));
                None
            }
        }
    }

    /// Reports a primitive that cannot be made, and drops its parameters.
    fn refuse(&mut self, what: String) {
        self.pending.clear();
        self.complain(what);
    }

    /// Returns a count. A negative one is reported, and the pending parameters are dropped.
    fn count(&mut self, call: &str, n: c_int) -> Option<usize> {
        let count = usize::try_from(n).ok();
        if count.is_none() {
            self.refuse(format!("{call}: {n} is not a valid count"));
        }
        count
    }

    fn mesh(&mut self, interp: Option<String>, nverts: Arc<[i32]>, verts: Arc<[i32]>) {
        let subdivide = match interp.as_deref() {
            Some("linear") => false,
            Some("catmull-clark") => true,
            other => {
                let what = format!("Mesh: unknown interpolation \"{}\"", other.unwrap_or_default());
                return self.refuse(what);
            }
        };
        self.shape(ShapeDesc::Mesh { subdivide, nverts, verts });
    }

    fn trim(&mut self, trim: Option<TrimDesc>) {
        self.call(Call::TrimCurve(trim.map(Box::new)));
    }

    fn nurbs_curves(&mut self, ncurves: usize, span: KnotSpan) {
        self.shape(ShapeDesc::NurbsCurves { ncurves, span });
    }

    /// Returns the value of an attribute.
    fn attribute(&self, declaration: &str) -> Option<Param> {
        self.sink.attribute(declaration).or_else(|| self.host.attribute(declaration))
    }

    /// Returns a string that is valid as long as the interface exists.
    fn keep_answer(&mut self, text: &str) -> *const std::ffi::c_char {
        if !self.answers.contains_key(text) {
            let kept = CString::new(text.replace('\0', " ")).unwrap_or_default();
            self.answers.insert(text.into(), kept);
        }
        self.answers.get(text).map_or(std::ptr::null(), |kept| kept.as_ptr())
    }

    /// Returns the strings of an attribute, of which numbers have none.
    fn strings_of(data: &ParamData) -> &[Arc<str>] {
        match data {
            ParamData::String(list) => list,
            _ => &[],
        }
    }
}

/// A borrowed sink.
pub(crate) struct Borrowed<'a>(pub(crate) &'a mut dyn SceneSink);

impl SceneSink for Borrowed<'_> {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        self.0.call(call, at)
    }

    fn in_world(&self) -> bool {
        self.0.in_world()
    }

    fn new_frame(&mut self) -> bool {
        self.0.new_frame()
    }

    fn attribute(&self, declaration: &str) -> Option<granita_base::Param> {
        self.0.attribute(declaration)
    }
}
