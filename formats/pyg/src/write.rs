//! The writer. It writes calls as Pyg text, flat and ASCII (reference 3.6, 4.3.12).

use crate::line::{Line, is_whole};
use granita_base::shape::KnotSpan;
use granita_base::{BaseType, Interp, Location, Param, ParamData, ParamType, Params, ShapeDesc, TrimDesc};
use granita_scene::{Call, Matrix, SceneSink, Stop, TransformTarget, attr};
use std::fmt::Write as _;
use std::io::{self, Write};
use std::sync::Arc;

/// The length from which arrays are written as binary data in binary files.
const BINARY_FROM: usize = 16;
/// The number of bytes after which text is passed on.
const PIECE: usize = 1 << 16;

/// The options for writing. Attributes such as `Attribute ("int pyg:binary", 1)` change them between calls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriterOptions {
    /// True when long arrays are binary data (reference 3.7), with half the size. The file is then no longer Python.
    pub binary: bool,
    /// True when parameters are written as calls of `Parameter`, before the call that takes them.
    pub separate_params: bool,
    /// The number of blanks before every statement.
    pub indent: usize,
}

/// Writes every call that it receives as Pyg. The text is flat, so that it can be read without Python. It is plain
/// ASCII unless it is binary. Numbers are written with the fewest digits that read back to the same bits.
///
/// The attributes "pyg:binary", "format:binary", "pyg:separateparams", "pyg:indent" and "limits:inputlevels" control
/// the writer and are not written.
///
/// ```
/// use granita_base::{Location, Param};
/// use granita_pyg::Writer;
/// use granita_scene::{Call, SceneSink};
/// let mut writer = Writer::new(Vec::new());
/// writer.call(Call::Attribute(Param::declared("float fov", 45.0)?), &Location::default())?;
/// assert_eq!(writer.into_inner()?, b"Attribute (\"float fov\", 45)\n");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Writer<W: Write> {
    out: W,
    options: WriterOptions,
    input_levels: i32,
    /// The parameters of `Parameter` for the call that takes them. They are always empty where parameters are separate.
    pending: Params,
    line: Line,
}

impl<W: Write> Writer<W> {
    /// Returns a writer to `out`. It passes text on in pieces, so a buffered output is not needed.
    pub fn new(out: W) -> Self {
        Self::with_options(out, WriterOptions::default())
    }

    /// Returns a writer like [`Writer::new`], with other options.
    pub fn with_options(out: W, options: WriterOptions) -> Self {
        Self { out, options, input_levels: 0, pending: Params::new(), line: Line::default() }
    }

    /// Passes all text on and returns the output.
    ///
    /// # Errors
    /// Returns the errors of the output.
    pub fn into_inner(mut self) -> io::Result<W> {
        self.write_pending()?;
        self.flush()?;
        Ok(self.out)
    }

    /// Passes all text on.
    ///
    /// # Errors
    /// Returns the errors of the output.
    pub fn flush(&mut self) -> io::Result<()> {
        self.out.write_all(&self.line.text)?;
        self.line.text.clear();
        self.out.flush()
    }

    /// Returns the output.
    pub fn get_ref(&self) -> &W {
        &self.out
    }

    /// Returns the number of levels of `Input` that are expanded, as set by "limits:inputlevels".
    pub fn input_levels(&self) -> i32 {
        self.input_levels
    }

    fn begin(&mut self, name: &str) {
        let line = &mut self.line;
        line.indent = self.options.indent;
        line.start = line.text.len();
        line.text.extend(std::iter::repeat_n(b' ', line.indent));
        line.text.extend(name.as_bytes());
        line.text.extend(b" (");
        line.first = true;
    }

    fn end(&mut self) -> io::Result<()> {
        self.line.text.extend(b")\n");
        if self.line.text.len() >= PIECE {
            self.out.write_all(&self.line.text)?;
            self.line.text.clear();
        }
        Ok(())
    }

    fn comma(&mut self) {
        if !std::mem::take(&mut self.line.first) {
            self.line.text.push(b',');
            self.line.gap();
        }
    }

    fn string(&mut self, s: &str) {
        self.comma();
        self.line.quoted(s);
    }

    fn optional(&mut self, s: Option<&Arc<str>>) {
        match s {
            Some(s) => self.string(s),
            None => self.word("None"),
        }
    }

    fn word(&mut self, word: &str) {
        self.comma();
        self.line.put(word);
    }

    fn count(&mut self, n: usize) {
        self.word(&n.to_string());
    }

    fn number(&mut self, f: f32) {
        self.comma();
        self.line.float(f, false);
        self.line.put_item();
    }

    fn floats(&mut self, values: &[f32], keep_float: bool) -> io::Result<()> {
        self.comma();
        if self.options.binary && values.len() >= BINARY_FROM {
            return self.raw(0x82, values.len(), values.iter().map(|f| f.to_le_bytes()));
        }
        // One value with a point turns the whole sequence into floats.
        let mut keep = keep_float && values.iter().all(|f| is_whole(*f));
        self.line.text.push(b'(');
        for (i, f) in values.iter().enumerate() {
            if i > 0 {
                self.line.text.push(b',');
                self.line.gap();
            }
            self.line.float(*f, std::mem::take(&mut keep));
            self.line.put_item();
            self.relieve()?;
        }
        self.line.text.extend(if values.len() == 1 { &b",)"[..] } else { b")" });
        Ok(())
    }

    fn ints(&mut self, values: &[i32]) -> io::Result<()> {
        self.comma();
        if self.options.binary && values.len() >= BINARY_FROM {
            return self.raw(0x80, values.len(), values.iter().map(|i| i.to_le_bytes()));
        }
        self.line.text.push(b'(');
        for (i, n) in values.iter().enumerate() {
            if i > 0 {
                self.line.text.push(b',');
                self.line.gap();
            }
            // Writing to a string cannot fail.
            let _ = write!(self.line.item, "{n}");
            self.line.put_item();
            self.relieve()?;
        }
        self.line.text.extend(if values.len() == 1 { &b",)"[..] } else { b")" });
        Ok(())
    }

    /// Writes a binary array. The format limits its length to `i32::MAX` values.
    fn raw(&mut self, code: u8, n: usize, words: impl Iterator<Item = [u8; 4]>) -> io::Result<()> {
        let n = i32::try_from(n).map_err(|_| io::Error::other("an array is too long for binary Pyg"))?;
        self.line.text.push(code);
        self.line.text.extend(n.to_le_bytes());
        words.for_each(|w| self.line.text.extend(w));
        self.line.start = self.line.text.len();
        Ok(())
    }

    /// Passes the finished lines of a long statement on.
    fn relieve(&mut self) -> io::Result<()> {
        if self.line.text.len() >= PIECE && self.line.start > 0 {
            let start = std::mem::take(&mut self.line.start);
            self.out.write_all(&self.line.text[..start])?;
            self.line.text.drain(..start);
        }
        Ok(())
    }

    fn value(&mut self, data: &ParamData, ty: ParamType) -> io::Result<()> {
        let single = data.len() == 1 && ty.array.is_none();
        // Without a type in the declaration, the text itself must distinguish floats from integers.
        let keep_float = matches!(ty.base, BaseType::Unknown | BaseType::Int | BaseType::String);
        match data {
            ParamData::Float(v) if single => {
                self.comma();
                self.line.float(v[0], keep_float);
                self.line.put_item();
                Ok(())
            }
            ParamData::Int(v) if single => {
                self.word(&v[0].to_string());
                Ok(())
            }
            ParamData::String(v) if single => {
                self.string(&v[0]);
                Ok(())
            }
            ParamData::Float(v) => self.floats(v, keep_float),
            ParamData::Int(v) => self.ints(v),
            ParamData::String(v) => {
                self.comma();
                self.line.text.push(b'(');
                for (i, s) in v.iter().enumerate() {
                    if i > 0 {
                        self.line.text.push(b',');
                        self.line.gap();
                    }
                    self.line.quoted(s);
                }
                self.line.text.extend(if v.len() == 1 { &b",)"[..] } else { b")" });
                Ok(())
            }
        }
    }

    fn param(&mut self, param: &Param) -> io::Result<()> {
        self.string(&declaration(param));
        self.value(&param.data, param.ty)
    }

    /// Writes a call that takes parameters. `head` writes the arguments before them.
    fn with_params(
        &mut self,
        name: &str,
        params: &Params,
        head: impl FnOnce(&mut Self) -> io::Result<()>,
    ) -> io::Result<()> {
        let mut all = std::mem::take(&mut self.pending);
        let params = match all.is_empty() {
            true => params,
            false => {
                params.iter().for_each(|param| all.set(param.clone()));
                &all
            }
        };
        if self.options.separate_params {
            params.iter().try_for_each(|param| self.separate(param))?;
        }
        self.begin(name);
        head(self)?;
        if !self.options.separate_params {
            params.iter().try_for_each(|p| self.param(p))?;
        }
        self.end()
    }

    /// Writes the parameters that no call has taken, as calls of their own.
    fn write_pending(&mut self) -> io::Result<()> {
        for param in std::mem::take(&mut self.pending).0 {
            self.separate(&param)?;
        }
        Ok(())
    }

    fn separate(&mut self, param: &Param) -> io::Result<()> {
        self.begin("Parameter");
        self.param(param)?;
        self.end()
    }

    /// Writes a call that has only strings.
    fn strings(&mut self, name: &str, args: &[&str]) -> io::Result<()> {
        self.begin(name);
        args.iter().for_each(|a| self.string(a));
        self.end()
    }

    /// Writes a call that has only numbers.
    fn numbers(&mut self, name: &str, args: &[f32]) -> io::Result<()> {
        self.begin(name);
        args.iter().for_each(|a| self.number(*a));
        self.end()
    }

    fn span(&mut self, span: &KnotSpan) -> io::Result<()> {
        self.count(span.order);
        self.floats(&span.knots, false)?;
        self.number(span.min);
        self.number(span.max);
        Ok(())
    }

    fn shape(&mut self, shape: &ShapeDesc, params: &Params) -> io::Result<()> {
        self.with_params(shape.call_name(), params, |w| {
            match shape {
                ShapeDesc::Patch { u, v, nu, nv } => {
                    if u == v {
                        w.string(u.word());
                    } else {
                        w.string(&format!("{},{}", u.word(), v.word()));
                    }
                    w.count(*nu);
                    w.count(*nv);
                }
                ShapeDesc::Nurbs { u, v } => {
                    for span in [u, v] {
                        w.count(span.n);
                        w.span(span)?;
                    }
                }
                ShapeDesc::Mesh { subdivide, nverts, verts } => {
                    w.string(if *subdivide { "catmull-clark" } else { "linear" });
                    w.ints(nverts)?;
                    w.ints(verts)?;
                }
                ShapeDesc::Points { n } => w.count(*n),
                ShapeDesc::Curves { basis, ncurves, nverts } => {
                    w.string(basis.word());
                    w.count(*ncurves);
                    w.count(*nverts);
                }
                ShapeDesc::NurbsCurves { ncurves, span } => {
                    w.count(*ncurves);
                    w.count(span.n);
                    w.span(span)?;
                }
                ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg } => {
                    [radius, zmin, zmax, thetamax_deg].into_iter().for_each(|f| w.number(*f));
                }
            }
            Ok(())
        })
    }

    /// Writes a Shader or Light call with its name, layer and parameters.
    fn shader(
        &mut self,
        call: &str,
        first: &str,
        name: Option<&Arc<str>>,
        layer: Option<&Arc<str>>,
        params: &Params,
    ) -> io::Result<()> {
        let alone = layer.is_none() && params.is_empty() && self.pending.is_empty();
        self.with_params(call, params, |w| {
            w.string(first);
            match name {
                None if call == "Light" => w.string("null"),
                None if alone => {}
                _ => w.optional(name),
            }
            if let Some(layer) = layer {
                w.string(layer);
            }
            Ok(())
        })
    }

    fn attribute(&mut self, param: &Param) -> io::Result<()> {
        if let Some(binary) = attr::PYG_BINARY.given(param) {
            self.options.binary = binary;
        } else if let Some(separate) = attr::PYG_SEPARATEPARAMS.given(param) {
            self.options.separate_params = separate;
            if separate {
                self.write_pending()?;
            }
        } else if let Some(more) = attr::PYG_INDENT.given(param) {
            // The value is relative to the current indentation. A very large indentation is an error of the scene.
            let indent = self.options.indent as i64 + i64::from(more);
            self.options.indent = indent.clamp(0, 256) as usize;
        } else if let Some(levels) = attr::LIMITS_INPUTLEVELS.given(param) {
            self.input_levels = levels;
        } else {
            self.begin("Attribute");
            self.param(param)?;
            self.end()?;
        }
        Ok(())
    }

    fn matrix(&mut self, name: &str, matrix: &Matrix) -> io::Result<()> {
        self.begin(name);
        // A matrix of sixteen numbers stays readable.
        let binary = std::mem::take(&mut self.options.binary);
        let result = self.floats(&matrix[..], false);
        self.options.binary = binary;
        result.and_then(|()| self.end())
    }

    /// Writes each line of a text as a comment.
    fn comment(&mut self, text: &str) {
        for line in text.split(['\n', '\r']) {
            let shown: String = line.chars().map(|c| if c.is_ascii() { c } else { '?' }).collect();
            let indent = " ".repeat(self.options.indent);
            let blank = if shown.is_empty() { "" } else { " " };
            self.line.text.extend(format!("{indent}#{blank}{shown}\n").bytes());
        }
    }

    /// Writes the loops of a `TrimCurve` call; `None` turns trimming off.
    fn trim_curve(&mut self, name: &str, trim: Option<&TrimDesc>) -> io::Result<()> {
        self.begin(name);
        match trim {
            Some(t) => {
                [&t.ncurves, &t.n, &t.order].into_iter().try_for_each(|v| self.ints(v))?;
                [&t.knots, &t.min, &t.max, &t.uvw].into_iter().try_for_each(|v| self.floats(v, false))?;
            }
            None => (0..7).try_for_each(|_| self.ints(&[]))?,
        }
        self.end()
    }

    fn write(&mut self, call: &Call) -> io::Result<()> {
        let name = call.name();
        match call {
            Call::Parameter(p) if self.options.separate_params => self.separate(p),
            // The parameter is written in the call that takes it.
            Call::Parameter(p) => {
                self.pending.set(p.clone());
                Ok(())
            }
            Call::Attribute(p) => self.attribute(p),
            Call::PushAttributes
            | Call::PopAttributes
            | Call::PushTransform
            | Call::PopTransform
            | Call::World
            | Call::ShaderGroupBegin
            | Call::ShaderGroupEnd => self.strings(name, &[]),
            Call::SaveAttributes { name: saved, attributes }
            | Call::RestoreAttributes { name: saved, attributes } => {
                let args = std::iter::once(&**saved).chain(attributes.as_deref());
                self.strings(name, &args.collect::<Vec<_>>())
            }
            Call::Modify { pattern } => self.strings(name, &[pattern]),
            Call::SetTransform(TransformTarget::Named(space)) => self.strings(name, &[space]),
            Call::SetTransform(TransformTarget::Matrix(m)) | Call::AppendTransform(m) => self.matrix(name, m),
            Call::Translate(v) | Call::Scale(v) => self.numbers(name, v),
            Call::Rotate { angle_deg, axis: [x, y, z] } => self.numbers(name, &[*angle_deg, *x, *y, *z]),
            Call::Motion(times) => self.numbers(name, times),
            Call::Camera { name: camera, params } => self.with_params(name, params, |w| {
                w.string(camera);
                Ok(())
            }),
            Call::Output { name: file, format, data, camera, params } => {
                self.with_params(name, params, |w| {
                    [file, format, data, camera].into_iter().for_each(|s| w.string(s));
                    Ok(())
                })
            }
            Call::Render { camera } => self.strings(name, &camera.as_deref().into_iter().collect::<Vec<_>>()),
            Call::Command { name: command, params } => self.with_params(name, params, |w| {
                w.string(command);
                Ok(())
            }),
            Call::Comment(text) => {
                self.comment(text);
                Ok(())
            }
            Call::Shader { usage, name: shader, layer, params } => {
                self.shader(name, usage, shader.as_ref(), layer.as_ref(), params)
            }
            Call::Light { id, shader, layer, params } => {
                self.shader(name, id, shader.as_ref(), layer.as_ref(), params)
            }
            Call::ConnectShaders { source_layer, source, target_layer, target } => {
                self.strings(name, &[source_layer, source, target_layer, target])
            }
            Call::LightSwitch { id, on } => {
                self.begin(name);
                self.string(id);
                self.word(if *on { "1" } else { "0" });
                self.end()
            }
            Call::Shape { shape, params } => self.shape(shape, params),
            Call::TrimCurve(trim) => self.trim_curve(name, trim.as_deref()),
            Call::Input { command, bound } => {
                self.begin(name);
                self.string(command);
                if let Some(bound) = bound {
                    self.floats(bound, false)?;
                }
                self.end()
            }
        }
    }
}

impl<W: Write> SceneSink for Writer<W> {
    fn call(&mut self, call: Call, _: &Location) -> Result<(), Stop> {
        Ok(self.write(&call)?)
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        let (_, name) = ParamType::parse(declaration).ok()?;
        let own = [
            attr::PYG_BINARY.param(self.options.binary),
            attr::PYG_SEPARATEPARAMS.param(self.options.separate_params),
            attr::PYG_INDENT.param(self.options.indent as i32),
            attr::LIMITS_INPUTLEVELS.param(self.input_levels),
        ];
        let row = granita_scene::attribute_row(&name)?;
        own.into_iter().find(|param| *param.name == *row.name).or_else(|| row.default_param())
    }
}

/// Returns the declaration as it is written. It may have an interpolation without a type.
fn declaration(param: &Param) -> String {
    if param.ty.base == BaseType::Unknown && param.ty.interp != Interp::Constant {
        return format!("{} {}", param.ty.interp.word(), param.name);
    }
    param.declaration()
}
