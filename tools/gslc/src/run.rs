//! `gslc -run`: runs a shader over a flat grid, without a renderer.

use crate::surroundings::Surroundings;
use crate::{Options, read_source, say};
use granita_base::{BaseType, Param, ParamData, ParamType, Params, Reporter, SearchPath, Severity, Vec3};
use granita_cli::{Status, environment, print};
use granita_gsl::ir::{ShaderKind, ValueType};
use granita_gsl::{CompileOptions, ValidModule, compile, gso};
use granita_image::{CreateOptions, ImageSpec, Limits, PixelType, Pixels};
use granita_plugin::Plugins;
use granita_shade::{
    Batch, Executor, Grid, Group, IlluminateQuery, Lane3, Lanes3, LayerSource, LinkOptions, Topology,
};
use granita_texture::{CacheOptions, TextureCache};
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// The side of the grids in which the image is shaded, in pixels. A grid has 256 points.
const TILE: usize = 16;

/// The largest number of threads.
const MAX_THREADS: usize = 1024;

/// The source of a light that shines from the viewer when no light is given.
const HEADLIGHT: &str = "light headlight () { emit (vector (0, 0, 1), 0) { Cl = 1; } }";

/// The image of a run. The channels of a pixel are stored together, and the first row is on top.
struct Image {
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
    let group = link(options.source(), &params)?;
    let mut lights = options.light.iter().map(|l| link(l, &Params::new())).collect::<Result<Vec<_>, _>>()?;
    if lights.is_empty() && group.gathers_light() {
        let module = compile(HEADLIGHT, "headlight", &CompileOptions::default())
            .map_err(|list| list.first().map_or_else(String::new, ToString::to_string))?
            .module;
        let layer = LayerSource { module, params: &Params::new(), name: None };
        lights.push(Group::link(&[layer], &[], &mut |_, _| {}).map_err(|e| e.to_string())?);
    }
    let (name, ty) = wanted(&group, options.data.as_deref())?;
    let textures = TextureCache::new(
        granita_plugin::bundled_formats(Limits::default()),
        SearchPath::parse(".", &SearchPath::default(), &environment()),
        CacheOptions::default(),
        reporter.clone(),
    );
    let plugins = (crate::plugins(options), crate::shadeop_path(options));
    let job = Job {
        group: &group,
        lights: &lights,
        textures: &textures,
        plugins: &plugins,
        reporter: &reporter,
        name: &name,
        ty,
        size: [width, height],
        repeat: options.repeat.max(1),
    };
    let threads = match options.threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        n => n,
    };
    let (image, took) = job.shade(threads.min(MAX_THREADS));
    if options.verbosity >= 2 {
        let points = (width * height) as f64 * f64::from(job.repeat);
        say(&format!("gslc: {:.1} ns per point and thread", took.as_secs_f64() * 1e9 / points));
    }
    let output = match &options.output {
        Some(name) => name.clone(),
        None => {
            format!("{}.exr", Path::new(options.source()).file_stem().unwrap_or_default().to_string_lossy())
        }
    };
    if output != "null" {
        write(&image, Path::new(&output))?;
    }
    Ok(if reporter.errors() > 0 { Status::WithErrors } else { Status::Done })
}

/// Parses a size such as "512x512" or "512".
fn size(text: &str) -> Result<(usize, usize), String> {
    let (w, h) = text.split_once(['x', 'X']).unwrap_or((text, text));
    let side = |s: &str| s.trim().parse().ok().filter(|n| (1..=1 << 16).contains(n));
    match (side(w), side(h)) {
        (Some(w), Some(h)) if w * h <= 1 << 28 => Ok((w, h)),
        _ => Err(format!("\"{text}\" is not a grid size such as 512x512")),
    }
}

/// Parses a declaration and its values, such as "float Kd 0.5", "color c 1 0 0" or "string name wood".
fn param(text: &str) -> Result<Param, String> {
    let mut words = text.split_whitespace();
    let (Some(ty), Some(name)) = (words.next(), words.next()) else {
        return Err(format!("\"{text}\" is not a parameter such as \"float Kd 0.5\""));
    };
    let (ty, name) = ParamType::parse(&format!("{ty} {name}")).map_err(|e| e.to_string())?;
    let data = if ty.base == BaseType::String {
        // A single string may contain blanks. The strings of a list are words.
        let all: Vec<&str> = words.collect();
        let list: Vec<Arc<str>> = match ty.array {
            None => vec![all.join(" ").trim_matches('"').into()],
            Some(_) => all.iter().map(|w| w.trim_matches('"').into()).collect(),
        };
        ParamData::String(list.into())
    } else {
        let number = |w: &str| w.parse::<f32>().map_err(|_| format!("\"{text}\": \"{w}\" is not a number"));
        ParamData::Float(words.map(number).collect::<Result<Vec<f32>, _>>()?.into())
    };
    Ok(Param { name: name.into(), ty, data })
}

/// Loads a shader from source text, from a compiled file, or from the bundled ones.
fn load(name: &str, options: &Options) -> Result<ValidModule, String> {
    let path = Path::new(name);
    if path.extension().is_some_and(|e| e == "gso") {
        let bytes = std::fs::read(path).map_err(|e| format!("{name}: {e}"))?;
        return gso::read(&bytes, name).map_err(|e| e.to_string());
    }
    if name == "-" || path.is_file() {
        let (source, file) = read_source(name).map_err(|e| format!("{name}: {e}"))?;
        return crate::compiled(&source, &file, options).ok_or(format!("{name}: not compiled"));
    }
    let source = granita_bundled::shader(name).ok_or(format!("{name}: no such file and no such shader"))?;
    crate::compiled(source, name, options).ok_or(format!("{name}: not compiled"))
}

/// Returns the name and the type of the value that becomes the image, which is an output parameter or a global.
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

/// Returns a grid of `points` at the centres of pixels, beginning with pixel `from` of an image of this `size`. The
/// image is a unit square in z = 0, seen along z.
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

/// A shader and its surroundings.
struct Job<'a> {
    group: &'a Group,
    lights: &'a [Group],
    textures: &'a TextureCache,
    plugins: &'a (Plugins, SearchPath),
    reporter: &'a Reporter,
    /// The value that becomes the image.
    name: &'a str,
    ty: ValueType,
    size: [usize; 2],
    repeat: u32,
}

/// The tiles that are shaded. They arrive in any order and are copied into the image in the order of the tiles.
struct Finished {
    image: Image,
    /// The index of the tile that is copied next.
    next: usize,
    waiting: BTreeMap<usize, (Option<Vec<f32>>, String)>,
    took: Duration,
}

impl Job<'_> {
    fn columns(&self) -> usize {
        self.size[0].div_ceil(TILE)
    }

    /// Returns the first pixel and the size of a tile.
    fn tile(&self, number: usize) -> ([usize; 2], [usize; 2]) {
        let from = [number % self.columns() * TILE, number / self.columns() * TILE];
        (from, [0, 1].map(|k| TILE.min(self.size[k] - from[k])))
    }

    /// Shades the whole image with this number of threads. Returns the image and the duration of the shading, summed
    /// over the threads. A tile is shaded by one thread and does not depend on the others, so the image does not depend
    /// on their number.
    fn shade(&self, threads: usize) -> (Image, Duration) {
        let channels = self.ty.components();
        let [width, height] = self.size;
        let tiles = self.columns() * height.div_ceil(TILE);
        let finished = Mutex::new(Finished {
            image: Image { width, height, channels, values: vec![0.0; channels * width * height] },
            next: 0,
            waiting: BTreeMap::new(),
            took: Duration::ZERO,
        });
        let started = AtomicUsize::new(0);
        let work = || {
            let mut executor = Executor::new();
            let mut around = Surroundings {
                lights: self.lights,
                textures: self.textures,
                executor: Executor::new(),
                grid: None,
                plugins: self.plugins,
                reporter: self.reporter,
                printed: String::new(),
            };
            loop {
                let number = started.fetch_add(1, Ordering::Relaxed);
                if number >= tiles {
                    return;
                }
                let (values, took) = self.shade_tile(number, &mut executor, &mut around);
                let mut finished = finished.lock();
                finished.took += took;
                finished.waiting.insert(number, (values, std::mem::take(&mut around.printed)));
                self.deliver(&mut finished);
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..threads.min(tiles) {
                scope.spawn(work);
            }
            work();
        });
        let finished = finished.into_inner();
        (finished.image, finished.took)
    }

    /// Returns the requested value over a tile, component after component, and the duration of the shading.
    fn shade_tile(
        &self,
        number: usize,
        executor: &mut Executor,
        around: &mut Surroundings<'_>,
    ) -> (Option<Vec<f32>>, Duration) {
        let (from, points) = self.tile(number);
        let fresh = square(self.size, from, points);
        let (mut values, mut took) = (None, Duration::ZERO);
        for _ in 0..self.repeat {
            let mut grid = fresh.clone();
            around.grid = Some(fresh.clone());
            let start = Instant::now();
            values = if self.group.usage() == ShaderKind::Light {
                Some(light_values(self.group, &grid, self.name, executor, around))
            } else {
                executor.run(self.group, &mut grid, around, &[(self.name, self.ty)]).pop().flatten()
            };
            took += start.elapsed();
        }
        (values, took)
    }

    /// Copies the tiles that are next in order into the image, and prints their output.
    fn deliver(&self, finished: &mut Finished) {
        while let Some((values, printed)) = finished.waiting.remove(&finished.next) {
            let (from, points) = self.tile(finished.next);
            finished.next += 1;
            let (n, channels) = (points[0] * points[1], finished.image.channels);
            for (k, value) in values.into_iter().flatten().enumerate() {
                let (c, k) = (k / n, k % n);
                let pixel = (from[1] + k / points[0]) * self.size[0] + from[0] + k % points[0];
                finished.image.values[pixel * channels + c] = value;
            }
            print(&printed);
        }
    }
}

/// Returns the sum of `Cl` (or of `L`) that a light sends to the points of the square.
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
    let query = IlluminateQuery {
        batch,
        ps: Lane3::over(&grid.p),
        ns: Lane3::over(&grid.n),
        pl: None,
        nl: None,
        cone: None,
        in_front: false,
        asks: false,
        messages: &[],
    };
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

/// Writes the image in the format of the name's extension, as floats where the format supports them.
fn write(image: &Image, path: &Path) -> Result<(), String> {
    let registry = granita_plugin::bundled_formats(Limits::default());
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("exr").to_ascii_lowercase();
    let format = registry
        .by_name(&extension)
        .ok_or_else(|| format!("{}: no image format has this extension", path.display()))?;
    let pixel_type = format.output_type(PixelType::Float);
    let spec = ImageSpec::new(image.width as u32, image.height as u32, image.channels, pixel_type);
    let mut file = format.create(path, &CreateOptions::new(&spec, 1)).map_err(|e| e.to_string())?;
    file.write_rows(&Pixels::from_floats(pixel_type, &image.values)).map_err(|e| e.to_string())?;
    file.close().map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_and_sizes_are_parsed_or_refused() {
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
