//! `gslc -run`: a shader over a flat grid, without a renderer.

use crate::surroundings::Surroundings;
use crate::{Options, read_source, say};
use granita_base::{BaseType, Param, ParamData, ParamType, Params, Reporter, Severity, Vec3};
use granita_cli::{Status, print};
use granita_gsl::ir::{Module, ShaderKind, ValueType};
use granita_gsl::{CompileOptions, compile, gso};
use granita_image::{CreateOptions, ImageSpec, Limits, PixelType, Pixels};
use granita_shade::{
    Batch, Executor, Grid, Group, IlluminateQuery, Lane3, Lanes3, LayerSource, LinkOptions, Topology,
};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Side of the grids that the picture is shaded in: 256 points each.
const TILE: usize = 16;

/// Shines from the viewer when no light is given.
const HEADLIGHT: &str = "light headlight () { emit (vector (0, 0, 1), 0) { Cl = 1; } }";

/// The picture of a run: channels of every pixel together, the first row on top.
struct Picture {
    width: usize,
    height: usize,
    channels: usize,
    values: Vec<f32>,
}

/// Runs the shader that the options name.
pub(crate) fn run(options: &Options) -> Status {
    match try_run(options) {
        Ok(status) => status,
        Err(what) => {
            say(&format!("gslc: error: {what}"));
            Status::Failed
        }
    }
}

fn try_run(options: &Options) -> Result<Status, String> {
    let (width, height) = size(&options.grid)?;
    let verbosity = options.verbosity;
    let reporter = Reporter::new(Box::new(move |message| {
        if verbosity >= 1 || message.severity >= Severity::Error {
            say(&format!("gslc: {message}"));
        }
    }));
    let params = options.param.iter().map(|text| param(text)).collect::<Result<Params, _>>()?;
    let link = |name: &str, params: &Params| -> Result<Group, String> {
        let module = load(name, options)?;
        let usage = match module.kind {
            ShaderKind::Generic => ShaderKind::Surface,
            kind => kind,
        };
        let layer = LayerSource { module, params, name: None };
        let link = LinkOptions { optimize: options.optimize > 0 };
        let mut group = Group::link_with(&[layer], &[], link, &mut |severity, text| match severity {
            Severity::Error => reporter.error(text),
            _ => reporter.warning(text),
        })
        .map_err(|e| e.to_string())?;
        group.attach(usage).map_err(|e| e.to_string())?;
        Ok(group)
    };
    let group = link(&options.source, &params)?;
    let mut lights = options.light.iter().map(|l| link(l, &Params::new())).collect::<Result<Vec<_>, _>>()?;
    if lights.is_empty() && group.gathers_light() {
        let module = compile(HEADLIGHT, "headlight", &CompileOptions::default())
            .map_err(|list| list.first().map_or_else(String::new, ToString::to_string))?
            .module;
        let layer = LayerSource { module: Arc::new(module), params: &Params::new(), name: None };
        lights.push(Group::link(&[layer], &[], &mut |_, _| {}).map_err(|e| e.to_string())?);
    }
    let wanted = wanted(&group, options.data.as_deref())?;
    let (picture, took) = shade(&group, &lights, &wanted, [width, height], options.repeat.max(1), &reporter);
    if options.verbosity >= 2 {
        let points = (width * height * options.repeat.max(1) as usize) as f64;
        say(&format!("gslc: {:.1} ns per point", took.as_secs_f64() * 1e9 / points));
    }
    let output = match &options.output {
        Some(name) => name.clone(),
        None => {
            format!("{}.exr", Path::new(&options.source).file_stem().unwrap_or_default().to_string_lossy())
        }
    };
    if output != "null" {
        write(&picture, Path::new(&output))?;
    }
    Ok(if reporter.errors() > 0 { Status::WithErrors } else { Status::Done })
}

/// "512x512" or "512".
fn size(text: &str) -> Result<(usize, usize), String> {
    let (w, h) = text.split_once(['x', 'X']).unwrap_or((text, text));
    let side = |s: &str| s.trim().parse().ok().filter(|n| (1..=1 << 16).contains(n));
    match (side(w), side(h)) {
        (Some(w), Some(h)) if w * h <= 1 << 28 => Ok((w, h)),
        _ => Err(format!("\"{text}\" is no grid size such as 512x512")),
    }
}

/// "float Kd 0.5", "color c 1 0 0" or "string name wood": a declaration and its values.
fn param(text: &str) -> Result<Param, String> {
    let mut words = text.split_whitespace();
    let (Some(ty), Some(name)) = (words.next(), words.next()) else {
        return Err(format!("\"{text}\" is no parameter such as \"float Kd 0.5\""));
    };
    let (ty, name) = ParamType::parse(&format!("{ty} {name}")).map_err(|e| e.to_string())?;
    let data = if ty.base == BaseType::String {
        // Blanks belong to a single string; lists are of words.
        let all: Vec<&str> = words.collect();
        let list: Vec<Arc<str>> = match ty.array {
            None => vec![all.join(" ").trim_matches('"').into()],
            Some(_) => all.iter().map(|w| w.trim_matches('"').into()).collect(),
        };
        ParamData::String(list.into())
    } else {
        let number = |w: &str| w.parse::<f32>().map_err(|_| format!("\"{text}\": \"{w}\" is no number"));
        ParamData::Float(words.map(number).collect::<Result<Vec<f32>, _>>()?.into())
    };
    Ok(Param { name: name.into(), ty, data })
}

/// A shader from source text, from a compiled file, or from those that come with the suite.
fn load(name: &str, options: &Options) -> Result<Arc<Module>, String> {
    let path = Path::new(name);
    if path.extension().is_some_and(|e| e == "gso") {
        let bytes = std::fs::read(path).map_err(|e| format!("{name}: {e}"))?;
        return Ok(Arc::new(gso::read(&bytes, name).map_err(|e| e.to_string())?));
    }
    if name == "-" || path.is_file() {
        let (source, file) = read_source(name).map_err(|e| format!("{name}: {e}"))?;
        return crate::compiled(&source, &file, options).map(Arc::new).ok_or(format!("{name}: not compiled"));
    }
    let source = granita_bundled::shader(name).ok_or(format!("{name}: no such file and no such shader"))?;
    crate::compiled(source, name, options).map(Arc::new).ok_or(format!("{name}: not compiled"))
}

/// The value that becomes the picture: an output parameter or a global.
fn wanted(group: &Group, asked: Option<&str>) -> Result<(String, ValueType), String> {
    let globals = [
        ("C", ValueType::Color),
        ("opacity", ValueType::Color),
        ("P", ValueType::Point),
        ("N", ValueType::Normal),
        ("Cl", ValueType::Color),
        ("L", ValueType::Vector),
    ];
    let usual = match group.usage() {
        ShaderKind::Displacement => "P",
        ShaderKind::Light => "Cl",
        _ => "C",
    };
    let name = asked.unwrap_or(usual);
    if let Some((_, ty)) = globals.iter().find(|(n, _)| *n == name) {
        return Ok((name.to_owned(), *ty));
    }
    match group.output_type(name) {
        Some(ValueType::String) | None => {
            Err(format!("the shader has no numeric output parameter \"{name}\""))
        }
        Some(ty) => Ok((name.to_owned(), ty)),
    }
}

/// Points at the centres of the pixels `x0.. x y0..` of a unit square in z = 0, seen along z.
fn square(size: [usize; 2], from: [usize; 2], points: [usize; 2]) -> Grid {
    let [nu, nv] = points;
    let mut grid = Grid::new(Topology::Rect { nu, nv });
    for j in 0..nv {
        for i in 0..nu {
            let k = j * nu + i;
            grid.u[k] = ((from[0] + i) as f32 + 0.5) / size[0] as f32;
            grid.v[k] = ((from[1] + j) as f32 + 0.5) / size[1] as f32;
            grid.p.set(k, Vec3::new(grid.u[k], grid.v[k], 0.0));
        }
    }
    let n = nu * nv;
    grid.n = Lanes3::splat(-Vec3::Z, n);
    grid.ng = grid.n.clone();
    grid.i = Lanes3::splat(Vec3::Z, n);
    grid.dpdu = Lanes3::splat(Vec3::X, n);
    grid.dpdv = Lanes3::splat(Vec3::Y, n);
    grid.flip_normals = true;
    grid.seed = granita_base::hash::mix32(from[0] as u32 ^ (from[1] as u32) << 16);
    grid
}

/// Shades the whole picture, `repeat` times; how long the shading alone took.
fn shade(
    group: &Group,
    lights: &[Group],
    (name, ty): &(String, ValueType),
    size: [usize; 2],
    repeat: u32,
    reporter: &Reporter,
) -> (Picture, Duration) {
    let channels = ty.components();
    let mut picture = Picture {
        width: size[0],
        height: size[1],
        channels,
        values: vec![0.0; channels * size[0] * size[1]],
    };
    let mut executor = Executor::new();
    let mut around =
        Surroundings { lights, executor: Executor::new(), grid: None, reporter, printed: String::new() };
    let mut took = Duration::ZERO;
    for y0 in (0..size[1]).step_by(TILE) {
        for x0 in (0..size[0]).step_by(TILE) {
            let points = [TILE.min(size[0] - x0), TILE.min(size[1] - y0)];
            let fresh = square(size, [x0, y0], points);
            let mut values = None;
            for _ in 0..repeat {
                let mut grid = fresh.clone();
                if !lights.is_empty() {
                    around.grid = Some(fresh.clone());
                }
                let start = Instant::now();
                values = if group.usage() == ShaderKind::Light {
                    Some(light_values(group, &grid, name, &mut executor, &mut around))
                } else {
                    executor.run(group, &mut grid, &mut around, &[(name, *ty)]).pop().flatten()
                };
                took += start.elapsed();
            }
            let n = points[0] * points[1];
            let Some(values) = values else { continue };
            for k in 0..n {
                let pixel = (y0 + k / points[0]) * size[0] + x0 + k % points[0];
                for c in 0..channels {
                    picture.values[pixel * channels + c] = values[c * n + k];
                }
            }
            print(&std::mem::take(&mut around.printed));
        }
    }
    (picture, took)
}

/// The sum of `Cl` (or of `L`) over what a light sends to the square.
fn light_values(
    group: &Group,
    grid: &Grid,
    name: &str,
    executor: &mut Executor,
    around: &mut Surroundings<'_>,
) -> Vec<f32> {
    let n = grid.len();
    let active: Vec<u32> = (0..n as u32).collect();
    let batch = Batch { lanes: n, active: &active, layer: 0 };
    let query =
        IlluminateQuery { batch, ps: Lane3::over(&grid.p), ns: Lane3::over(&grid.n), pl: None, nl: None };
    let result = executor.run_light(group, grid, &query, around);
    let mut sum = Lanes3::zeros(n);
    let mut add = |lanes: &Lanes3, lit: &dyn Fn(usize) -> bool| {
        for i in (0..n).filter(|&i| lit(i)) {
            sum.set(i, sum.get(i) + lanes.get(i));
        }
    };
    for sample in &result.samples {
        add(if name == "L" { &sample.l } else { &sample.cl }, &|i| sample.lit[i]);
    }
    if let Some(ambient) = &result.ambient {
        add(ambient, &|_| true);
    }
    sum.xyz.concat()
}

/// Writes the picture in the format that the name's extension says, as floats where the format can.
fn write(picture: &Picture, path: &Path) -> Result<(), String> {
    let registry = granita_plugin::bundled_formats(Limits::default());
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("exr").to_ascii_lowercase();
    let format = registry
        .by_name(&extension)
        .ok_or_else(|| format!("{}: no image format has this extension", path.display()))?;
    let pixel_type = format.output_type(PixelType::Float);
    let spec = ImageSpec::new(picture.width as u32, picture.height as u32, picture.channels, pixel_type);
    let mut file =
        format.create(path, &CreateOptions { spec: &spec, levels: 1 }).map_err(|e| e.to_string())?;
    file.write_rows(&Pixels::from_floats(pixel_type, &picture.values)).map_err(|e| e.to_string())?;
    file.close().map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_and_sizes() {
        let p = param("float Kd 0.5").unwrap();
        assert_eq!((&*p.name, p.data), ("Kd", ParamData::Float([0.5].into())));
        let p = param("color c 1 0 0.25").unwrap();
        assert_eq!(p.data, ParamData::Float([1.0, 0.0, 0.25].into()));
        let p = param("string name dark wood").unwrap();
        assert_eq!(p.data, ParamData::from("dark wood"));
        let p = param("string[2] name a \"b\"").unwrap();
        assert_eq!(p.data.len(), 2);
        for bad in ["", "float", "float Kd x", "floot Kd 1"] {
            assert!(param(bad).is_err(), "{bad}");
        }
        assert_eq!(size("3x4"), Ok((3, 4)));
        assert_eq!(size("7"), Ok((7, 7)));
        for bad in ["", "0", "3x", "x3", "-1x4", "65536x65536"] {
            assert!(size(bad).is_err(), "{bad}");
        }
    }
}
