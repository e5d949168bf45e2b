//! Primitive variables and control vertices, checked and sorted by their interpolation.

use crate::GeomError;
use crate::dice::{DiceData, DicePrimvar};
use crate::key::{SPECIAL, ShapeKey};
use crate::moving::is_later;
use granita_base::{BaseType, Interp, Param, ParamData, ParamType, Params, Severity, Vec3};
use std::sync::Arc;

/// The receiver of messages about a primitive.
pub(crate) type Report<'a> = &'a mut dyn FnMut(Severity, String);

/// A primitive variable of floats that varies.
#[derive(Clone, Debug)]
pub(crate) struct Var {
    pub(crate) name: Arc<str>,
    pub(crate) ty: ParamType,
    /// The number of floats per item.
    pub(crate) width: usize,
    /// The values of all items.
    pub(crate) values: Arc<[f32]>,
}

/// A variable of "perpiece" strings.
#[derive(Clone, Debug)]
pub(crate) struct StringVar {
    name: Arc<str>,
    ty: ParamType,
    width: usize,
    values: Arc<[Arc<str>]>,
}

/// The number of items that each interpolation needs; `None` where the primitive does not accept it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Counts {
    pub(crate) vertex: Option<usize>,
    pub(crate) linear: Option<usize>,
    pub(crate) perpiece: Option<usize>,
}

/// The primitive variables of a primitive, without its positions.
#[derive(Clone, Debug, Default)]
pub(crate) struct Vars {
    constant: Vec<DicePrimvar>,
    perpiece: Vec<Var>,
    strings: Vec<StringVar>,
    pub(crate) linear: Vec<Var>,
    pub(crate) vertex: Vec<Var>,
}

/// Returns the type of a well-known name that is given without a type.
fn known_type(name: &str) -> Option<ParamType> {
    let of = |base, interp| Some(ParamType::of(base).with_interp(interp));
    match name {
        "P" => of(BaseType::Point, Interp::Vertex),
        "Pw" => of(BaseType::HPoint, Interp::Vertex),
        "N" => of(BaseType::Normal, Interp::Vertex),
        "C" | "opacity" => of(BaseType::Color, Interp::Constant),
        "width" | "rasterwidth" => of(BaseType::Float, Interp::Constant),
        _ => None,
    }
}

impl Vars {
    /// Sorts the primitive variables of `params`. Variables of a wrong size or kind are reported and left out.
    pub(crate) fn collect(call: &str, params: &Params, counts: Counts, report: Report<'_>) -> Self {
        let mut vars = Self::default();
        for (i, param) in params.iter().enumerate() {
            let repeated = params.0[i + 1..].iter().any(|later| later.name == param.name);
            if repeated || SPECIAL.contains(&&*param.name) {
                continue;
            }
            let added = vars.add(param, counts, call != "Mesh");
            if is_later(&param.name) {
                // The variable has the same size as at the first key, where its errors were already reported.
                continue;
            }
            match added {
                Ok(0) => {}
                Ok(n) => {
                    let (got, name) = (param.data.len(), param.declaration());
                    let text = format!("{call}: \"{name}\" has {got} values, but only {} are used", got - n);
                    report(Severity::Warning, text);
                }
                Err(why) => {
                    report(
                        Severity::Warning,
                        format!("{call}: \"{}\" is ignored: {why}", param.declaration()),
                    );
                }
            }
        }
        vars
    }

    /// Adds a variable. Returns the number of its excess values.
    fn add(&mut self, param: &Param, counts: Counts, exact: bool) -> Result<usize, String> {
        let mut ty = param.ty;
        if ty.base == BaseType::Unknown {
            ty = known_type(&param.name).unwrap_or(match &param.data {
                ParamData::String(_) => ParamType::of(BaseType::String),
                ParamData::Int(_) => ParamType::of(BaseType::Int),
                ParamData::Float(_) => ParamType::of(BaseType::Float),
            });
        }
        let width = ty.width();
        if width == 0 {
            return Err("it has no elements".into());
        }
        let wanted = match ty.interp {
            Interp::Constant => Some(1),
            Interp::PerPiece => counts.perpiece,
            Interp::Linear => counts.linear,
            Interp::Vertex => counts.vertex,
        };
        let Some(wanted) = wanted else {
            return Err(format!("the primitive has no {} primitive variables", ty.interp.word()));
        };
        let wanted_len = wanted.checked_mul(width).ok_or("it is too large")?;
        if param.data.len() < wanted_len {
            return Err(format!("{} values instead of {wanted_len}", param.data.len()));
        }
        // A mesh may have values for vertices that no face uses.
        let may_be_more = ty.interp == Interp::Vertex && !exact;
        let excess = if may_be_more { 0 } else { param.data.len() - wanted_len };
        let name = param.name.clone();
        match (&param.data, ty.interp) {
            (ParamData::String(values), _) if ty.base != BaseType::String => {
                return Err(format!("{} strings instead of numbers", values.len()));
            }
            (ParamData::String(values), Interp::Constant) => {
                let data = DiceData::Strings(values[..width].to_vec());
                self.constant.push(DicePrimvar { name, ty, data });
            }
            (ParamData::String(values), Interp::PerPiece) => {
                self.strings.push(StringVar { name, ty, width, values: values.clone() });
            }
            (ParamData::String(_), _) => return Err("strings cannot be interpolated".into()),
            (data, interp) => {
                if ty.base == BaseType::String {
                    return Err("numbers instead of strings".into());
                }
                let values = data.to_floats().ok_or("it holds no numbers")?;
                let var = Var { name, ty, width, values };
                match interp {
                    Interp::Constant => self.constant.push(var.uniform(0)),
                    Interp::PerPiece => self.perpiece.push(var),
                    Interp::Linear => self.linear.push(var),
                    Interp::Vertex => self.vertex.push(var),
                }
            }
        }
        Ok(excess)
    }

    /// The number of floats per control vertex of all vertex variables.
    pub(crate) fn vertex_channels(&self) -> usize {
        self.vertex.iter().map(|v| v.width).sum()
    }

    /// The number of floats per corner of all linear variables.
    pub(crate) fn linear_channels(&self) -> usize {
        self.linear.iter().map(|v| v.width).sum()
    }

    /// True when the user gives normals "N".
    pub(crate) fn has_normals(&self) -> bool {
        let varying = self.perpiece.iter().chain(&self.linear).chain(&self.vertex);
        let constant = self.constant.iter().map(|v| (&v.name, v.ty));
        constant.chain(varying.map(|v| (&v.name, v.ty))).any(|(name, ty)| &**name == "N" && ty.width() == 3)
    }

    /// Appends the linear values of corner `index`.
    pub(crate) fn push_linear(&self, index: usize, out: &mut Vec<f64>) {
        for var in &self.linear {
            out.extend(var.item(index).iter().map(|&x| f64::from(x)));
        }
    }

    /// Appends the linear variables at points with fractions `s` and `t` between the corners (0,0), (1,0), (0,1) and
    /// (1,1). `corners` holds the channels of the corners.
    pub(crate) fn emit_linear(&self, corners: &[f64], s: &[f64], t: &[f64], out: &mut Vec<DicePrimvar>) {
        let channels = self.linear_channels();
        let corner = |k: usize, ch: usize| corners[k * channels + ch];
        let mut values = Vec::with_capacity(s.len() * channels);
        for (&s, &t) in s.iter().zip(t) {
            values.extend((0..channels).map(|ch| {
                (corner(0, ch) * (1.0 - s) + corner(1, ch) * s) * (1.0 - t)
                    + (corner(2, ch) * (1.0 - s) + corner(3, ch) * s) * t
            }));
        }
        emit(&self.linear, &values, s.len(), channels, 0, out);
    }

    /// Returns the vertex and linear variables of a single vertex.
    pub(crate) fn at_vertex(&self, index: usize) -> impl Iterator<Item = DicePrimvar> + '_ {
        self.vertex.iter().chain(&self.linear).map(move |var| var.uniform(index))
    }

    /// Returns the constant and "perpiece" variables of a piece.
    pub(crate) fn uniform(&self, piece: usize) -> Vec<DicePrimvar> {
        let mut out = self.constant.clone();
        out.extend(self.perpiece.iter().map(|var| var.uniform(piece)));
        out.extend(self.strings.iter().map(|var| {
            let values = var.values[piece * var.width..(piece + 1) * var.width].to_vec();
            DicePrimvar { name: var.name.clone(), ty: var.ty, data: DiceData::Strings(values) }
        }));
        out
    }
}

impl Var {
    /// Returns the floats of item `index`.
    pub(crate) fn item(&self, index: usize) -> &[f32] {
        &self.values[index * self.width..(index + 1) * self.width]
    }

    fn uniform(&self, index: usize) -> DicePrimvar {
        let data = DiceData::Floats { values: self.item(index).to_vec(), varying: false };
        DicePrimvar { name: self.name.clone(), ty: self.ty, data }
    }
}

/// Appends the variables `vars`, evaluated at `n` points. The channels of point `i` are at `i * stride + offset` of
/// `values`.
pub(crate) fn emit(
    vars: &[Var],
    values: &[f64],
    n: usize,
    stride: usize,
    mut offset: usize,
    out: &mut Vec<DicePrimvar>,
) {
    for var in vars {
        let mut lanes = Vec::with_capacity(n * var.width);
        for c in offset..offset + var.width {
            lanes.extend((0..n).map(|i| values[i * stride + c] as f32));
        }
        offset += var.width;
        let data = DiceData::Floats { values: lanes, varying: true };
        out.push(DicePrimvar { name: var.name.clone(), ty: var.ty, data });
    }
}

/// Removes the user's normals from the primitive variables and returns them.
pub(crate) fn take_normals(n: usize, primvars: &mut Vec<DicePrimvar>) -> Option<Vec<Vec3>> {
    let at = primvars.iter().position(|v| &*v.name == "N" && v.ty.width() == 3)?;
    match primvars.remove(at).data {
        DiceData::Floats { values, varying: true } => {
            Some((0..n).map(|i| Vec3::new(values[i], values[n + i], values[2 * n + i])).collect())
        }
        DiceData::Floats { values, varying: false } => Some(vec![Vec3::from_slice(&values); n]),
        DiceData::Strings(_) => None,
    }
}

/// Control vertices with all variables that are interpolated like them.
///
/// The channels of a vertex are its position (`dim` numbers) for each motion key, then the vertex variables. The
/// variables of rational vertices (`dim` 4) are multiplied by the weight of the first key.
#[derive(Clone, Debug)]
pub(crate) struct Control {
    /// 3, or 4 for rational vertices.
    pub(crate) dim: usize,
    /// The number of motion keys.
    pub(crate) keys: usize,
    /// The number of channels per vertex.
    pub(crate) channels: usize,
    /// The channels of all vertices.
    pub(crate) values: Vec<f64>,
}

impl Control {
    /// Returns the channels of vertex `i`.
    pub(crate) fn vertex(&self, i: usize) -> &[f64] {
        &self.values[i * self.channels..(i + 1) * self.channels]
    }

    /// The number of vertices.
    pub(crate) fn len(&self) -> usize {
        self.values.len().checked_div(self.channels).unwrap_or(0)
    }

    /// The offset of the vertex variables in a vertex.
    pub(crate) fn vars_offset(&self) -> usize {
        self.keys * self.dim
    }

    /// Returns the position of vertex `i` at a key, divided by its weight.
    pub(crate) fn position(&self, i: usize, key: usize) -> Vec3 {
        position(&self.vertex(i)[key * self.dim..], self.dim)
    }

    /// Divides rational vertices by their weights.
    pub(crate) fn divided(self) -> Self {
        if self.dim == 3 {
            return self;
        }
        let offset = self.vars_offset();
        let channels = self.keys * 3 + self.channels - offset;
        let mut values = Vec::with_capacity(self.len() * channels);
        for vertex in self.values.chunks_exact(self.channels) {
            let safe = |w: f64| if w == 0.0 { 1.0 } else { w };
            for key in vertex[..offset].chunks_exact(4) {
                // Positions are in single precision, whatever their source.
                values.extend(key[..3].iter().map(|x| f64::from((x / safe(key[3])) as f32)));
            }
            values.extend(vertex[offset..].iter().map(|x| x / safe(vertex[3])));
        }
        Self { dim: 3, keys: self.keys, channels, values }
    }

    /// True when all position channels of vertex `i` are finite.
    pub(crate) fn is_finite(&self, i: usize) -> bool {
        (0..self.keys).all(|key| self.position(i, key).is_finite())
    }
}

/// Returns a position from its channels.
pub(crate) fn position(channels: &[f64], dim: usize) -> Vec3 {
    let w = if dim == 4 && channels[3] != 0.0 { channels[3] } else { 1.0 };
    if dim == 3 {
        Vec3::new(channels[0] as f32, channels[1] as f32, channels[2] as f32)
    } else {
        Vec3::new((channels[0] / w) as f32, (channels[1] / w) as f32, (channels[2] / w) as f32)
    }
}

/// Returns the positions of one key: the number of floats per vertex, and all floats.
fn positions(
    call: &'static str,
    params: &Params,
    report: Report<'_>,
) -> Result<(usize, Arc<[f32]>), GeomError> {
    let fail = |what: &str| GeomError::Malformed { call, what: what.into() };
    let (param, usual) = match (params.get("P"), params.get("Pw")) {
        (Some(p), None) => (p, 3),
        (None, Some(p)) => (p, 4),
        (Some(p), Some(_)) => {
            report(Severity::Warning, format!("{call}: both \"P\" and \"Pw\", \"Pw\" is ignored"));
            (p, 3)
        }
        (None, None) => return Err(fail("no control vertices: neither \"P\" nor \"Pw\"")),
    };
    let dim = match param.ty.base {
        BaseType::HPoint => 4,
        BaseType::Unknown => usual,
        base if base.is_triple() => 3,
        _ => return Err(fail(&format!("\"{}\" cannot be control vertices", param.declaration()))),
    };
    // Some exporters write "vertex normal P".
    if param.ty.base.is_triple() && param.ty.base != BaseType::Point {
        let text = format!("{call}: \"{}\" is read as \"vertex point P\"", param.declaration());
        report(Severity::Warning, text);
    }
    let values = param.data.to_floats().ok_or_else(|| fail("control vertices that are not numbers"))?;
    Ok((dim, values))
}

/// Returns the number of control vertices of the first key.
pub(crate) fn vertex_count(
    call: &'static str,
    keys: &[ShapeKey<'_>],
    report: Report<'_>,
) -> Result<usize, GeomError> {
    let (dim, values) = positions(call, keys[0].params, report)?;
    Ok(values.len() / dim)
}

/// Collects `n` control vertices of all keys with the vertex variables.
///
/// Fails when a key has fewer vertices than `n`. Numbers that are not finite are accepted.
pub(crate) fn control(
    call: &'static str,
    keys: &[ShapeKey<'_>],
    n: usize,
    vars: &Vars,
    report: Report<'_>,
) -> Result<Control, GeomError> {
    let mut per_key = Vec::with_capacity(keys.len());
    for (i, key) in keys.iter().enumerate() {
        // The errors of the first key were reported when its vertices were counted.
        let (dim, values) = positions(call, key.params, &mut |_, _| {})?;
        let first = per_key.first().map_or(dim, |f: &(usize, Arc<[f32]>)| f.0);
        let wanted = n.checked_mul(dim);
        if dim != first || wanted.is_none_or(|w| values.len() < w) {
            let what = format!(
                "{} numbers for {n} control vertices of {first} numbers at motion key {i}",
                values.len()
            );
            return Err(GeomError::Malformed { call, what });
        }
        if wanted != Some(values.len()) && i == 0 {
            let text = format!("{call}: {} control vertices given, {n} used", values.len() / dim);
            report(Severity::Warning, text);
        }
        per_key.push((dim, values));
    }
    let dim = per_key[0].0;
    let channels = keys.len() * dim + vars.vertex_channels();
    let limit = GeomError::Limit {
        call,
        what: "control vertices",
        asked: n as u64,
        max: (isize::MAX as u64 / 8) / channels as u64,
    };
    let total = n.checked_mul(channels).filter(|t| *t <= isize::MAX as usize / 8).ok_or(limit)?;
    let mut values = Vec::with_capacity(total);
    for i in 0..n {
        for (_, p) in &per_key {
            values.extend(p[i * dim..(i + 1) * dim].iter().map(|&x| f64::from(x)));
        }
        let weight = if dim == 4 { f64::from(per_key[0].1[i * 4 + 3]) } else { 1.0 };
        for var in &vars.vertex {
            values.extend(var.item(i).iter().map(|&x| f64::from(x) * weight));
        }
    }
    Ok(Control { dim, keys: keys.len(), channels, values })
}
