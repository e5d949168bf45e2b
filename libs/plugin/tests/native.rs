//! Tests of shaders as machine code: its values are those of tapes, to the bit, and a run goes on without a compiler.
//! They are skipped where there is no C compiler.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use granita_base::{Environment, Param, Params, Reporter, Severity, Supervisor, Transform, Vec3, hash};
use granita_gsl::ir::ValueType;
use granita_gsl::{CompileOptions, compile};
use granita_plugin::NativeShaders;
use granita_shade::*;
use parking_lot::Mutex;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// A compiler that counts the strips which its functions computed.
#[derive(Debug)]
struct Counting {
    inner: NativeShaders,
    right: Arc<AtomicUsize>,
    left: Arc<AtomicUsize>,
}

#[derive(Debug)]
struct Counted {
    inner: Arc<dyn NativeCode>,
    right: Arc<AtomicUsize>,
    left: Arc<AtomicUsize>,
}

impl NativeCode for Counted {
    fn run(&self, strip: &mut NativeStrip<'_, '_>) -> bool {
        let right = self.inner.run(strip);
        if right { &self.right } else { &self.left }.fetch_add(1, Ordering::Relaxed);
        right
    }
}

impl NativeCompiler for Counting {
    fn compile(&self, source: NativeSource, done: NativeDone) {
        let (right, left) = (self.right.clone(), self.left.clone());
        self.inner.compile(source, Box::new(move |inner| done(Arc::new(Counted { inner, right, left }))));
    }
}

/// A renderer without anything but a compiler.
struct Host<'a>(Option<&'a dyn NativeCompiler>);

impl Spaces for Host<'_> {
    fn to_common(&mut self, _: &str, _: usize) -> Option<Transform> {
        None
    }

    fn unit_scale(&mut self, _: &str, _: &str) -> Option<f32> {
        None
    }
}

impl Textures for Host<'_> {
    fn texture(&mut self, _: &TextureQuery<'_>, _: &mut LookupResult) {}

    fn environment(&mut self, _: &EnvironmentQuery<'_>, _: &mut LookupResult) {}

    fn shadow(&mut self, _: &ShadowQuery<'_>, _: &mut Lanes3) {}

    fn texture_info(&mut self, _: &str, _: &str) -> Option<Param> {
        None
    }
}

impl Lights for Host<'_> {
    fn light_count(&mut self) -> usize {
        0
    }

    fn light_info(&mut self, _: usize) -> LightInfo {
        LightInfo::default()
    }

    fn illuminate(&mut self, _: usize, _: &IlluminateQuery<'_>) -> Arc<LightResult> {
        Arc::default()
    }
}

impl Rays for Host<'_> {}

impl Databases for Host<'_> {}

impl Messages for Host<'_> {
    fn say(&mut self, severity: Severity, text: &str) {
        assert!(severity < Severity::Error, "{text}");
    }
}

impl Recall for Host<'_> {}

impl granita_shade::Host for Host<'_> {
    fn attribute(&mut self, _: &str) -> Option<Param> {
        None
    }

    fn native(&mut self) -> Option<&dyn NativeCompiler> {
        self.0
    }
}

/// Expressions of the functions that tapes compute, of `x`, `y`, `z` and `k`, which is the same for all points.
const EXPRESSIONS: [&str; 46] = [
    "x + y * z - k",
    "x * y * z",
    "x - y * z",
    "x / y",
    "-x + k",
    "(x < y) + 2 * (y <= z) + 4 * (z > x) + 8 * (x >= k)",
    "(x == y) + (x != z) * 2",
    "radians (x) + degrees (y)",
    "sin (x)",
    "cos (x)",
    "tan (x)",
    "asin (x)",
    "acos (y)",
    "atan (x)",
    "atan (y, x)",
    "sinh (x)",
    "cosh (x)",
    "tanh (x)",
    "exp (x)",
    "log (x * x + 0.01)",
    "log2 (y * y + 0.01)",
    "log10 (z * z + 0.01)",
    "sqrt (x * x + y)",
    "inversesqrt (x * x + 1)",
    "abs (x) + fabs (y)",
    "sign (x - y)",
    "floor (x)",
    "ceil (x)",
    "round (x * 2)",
    "trunc (x * 3)",
    "isnan (x) + isinf (y) * 2 + finite (z) * 4",
    "pow (abs (x) + 0.001, y)",
    "mod (x, y)",
    "min (x, y)",
    "max (y, z)",
    "step (x, y)",
    "clamp (x, y, z)",
    "clamp (x, 0, 1)",
    "mix (x, y, z)",
    "smoothstep (-1, 1, x)",
    "smoothstep (x, y, z)",
    "length (vector (x, y, z))",
    "length (normalize (vector (x, y, z)) - P)",
    "dot (vector (x, y, z), vector (y, z, x))",
    "length (cross (vector (x, y, z), vector (y, z, k)))",
    "luminance (color (x, y, z))",
];

/// Returns a group whose output `aK` is the expression K, if the language has its functions.
fn group() -> (Group, Vec<(String, ValueType)>) {
    let outputs: Vec<String> = (0..EXPRESSIONS.len()).map(|k| format!("output float a{k} = 0")).collect();
    let body: Vec<String> =
        EXPRESSIONS.iter().enumerate().map(|(k, text)| format!("    a{k} = {text};\n")).collect();
    let source = format!(
        "surface all (float k = 0.75, {})\n{{\n    float x = P[0], y = P[1], z = P[2];\n{}    C = a0;\n}}\n",
        outputs.join(", "),
        body.concat()
    );
    let compiled = compile(&source, "all.gsl", &CompileOptions::default());
    let module = compiled.unwrap_or_else(|list| panic!("{list:#?}\n{source}")).module;
    let params = Params::new();
    let layer = LayerSource { module, params: &params, name: None };
    let group = Group::link(&[layer], &[], &mut |_, text| panic!("{text}")).unwrap();
    (group, (0..EXPRESSIONS.len()).map(|k| (format!("a{k}"), ValueType::Float)).collect())
}

/// Returns a grid of random positions, within the ranges of all functions unless some are `unusual`.
fn grid(points: u32, seed: u32, unusual: bool) -> Grid {
    let mut grid = Grid::new(Topology::Rect { nu: points as usize, nv: 1 });
    let numbers =
        [0.0, -0.0, f32::NAN, f32::INFINITY, -f32::INFINITY, 1e30, -1e-40, 9000.0, 1e-30, -1.0, 0.5];
    for i in 0..points {
        let number = |salt: u32| {
            let word = hash::words(&[seed, i, salt]);
            match word.is_multiple_of(5) && unusual {
                true => numbers[word as usize / 5 % numbers.len()],
                false => 6.0 * hash::unit(word) - 3.0,
            }
        };
        grid.p.set(i as usize, Vec3::new(number(0), number(1), number(2)));
    }
    grid
}

/// Runs the group, and returns the bits of all outputs. All NaN are equal.
fn run(
    group: &(Group, Vec<(String, ValueType)>),
    grid: &Grid,
    native: Option<&dyn NativeCompiler>,
) -> Vec<u32> {
    let mut grid = grid.clone();
    let wanted: Vec<(&str, ValueType)> = group.1.iter().map(|(name, ty)| (&**name, *ty)).collect();
    let values = Executor::new().run(&group.0, &mut grid, &mut Host(native), &wanted);
    let bits = |x: &f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
    let all: Vec<u32> = values.iter().flat_map(|values| values.as_ref().unwrap()).map(bits).collect();
    assert_eq!(all.len(), EXPRESSIONS.len() * grid.len());
    all
}

fn environment(cache: &Path, compiler: Option<&str>) -> Environment {
    let mut environment = Environment::empty();
    environment.set("XDG_CACHE_HOME", cache.to_string_lossy());
    if let Some(compiler) = compiler {
        environment.set("CC", compiler);
    }
    environment
}

fn counting(environment: &Environment) -> Counting {
    let (reporter, _) = Reporter::collecting();
    let inner = NativeShaders::new(environment, &Supervisor::default(), &reporter);
    Counting { inner, right: Arc::default(), left: Arc::default() }
}

#[test]
fn native_code_has_the_values_of_tapes_to_the_bit() {
    if !granita_needs::has("cc") {
        return;
    }
    let cache = tempfile::tempdir().unwrap();
    // The second compiler finds the files of the first one.
    for turn in 0..2 {
        let compiler = counting(&environment(cache.path(), None));
        let group = group();
        for turn in 0..70 {
            run(&group, &grid(1000, turn, false), Some(&compiler));
        }
        let ready = compiler.inner.wait(Duration::from_secs(100));
        assert!(ready > 0, "code is ready");
        for points in [1, 15, 64, 257, 1000] {
            let grid = grid(points, 1000 + points, false);
            assert_eq!(run(&group, &grid, Some(&compiler)), run(&group, &grid, None), "{points} points");
        }
        let right = compiler.right.load(Ordering::Relaxed);
        assert!(right > 8 * ready, "{right} strips, {ready} functions");
        assert_eq!(compiler.left.load(Ordering::Relaxed), 0, "the numbers are those of all functions");
        let unusual = grid(3000, 5, true);
        assert_eq!(run(&group, &unusual, Some(&compiler)), run(&group, &unusual, None));
        assert!(compiler.left.load(Ordering::Relaxed) > 0, "tapes compute the rest");
        let files = std::fs::read_dir(cache.path().join("granita")).unwrap().count();
        assert_eq!(files, ready, "turn {turn}: each function is a file, and nothing else is left");
    }
}

/// A compiler that keeps the sources.
#[derive(Debug, Default)]
struct Keeping(Mutex<Vec<String>>);

impl NativeCompiler for Keeping {
    fn compile(&self, source: NativeSource, _: NativeDone) {
        self.0.lock().push(source.text);
    }
}

#[test]
fn native_code_uses_vectors() {
    let version = std::process::Command::new("cc").arg("--version").output();
    if !version.is_ok_and(|v| String::from_utf8_lossy(&v.stdout).contains("Free Software Foundation")) {
        return granita_needs::skip("GCC (its report of loops with vectors)");
    }
    let keeping = Keeping::default();
    let group = group();
    for turn in 0..70 {
        run(&group, &grid(1000, turn, false), Some(&keeping));
    }
    let sources = keeping.0.lock();
    assert!(!sources.is_empty());
    let folder = tempfile::tempdir().unwrap();
    for text in &*sources {
        std::fs::write(folder.path().join("shader.c"), text).unwrap();
        let mut compile = std::process::Command::new("cc");
        compile.current_dir(&folder).args([
            "-std=gnu99",
            "-O3",
            "-w",
            "-ffp-contract=off",
            "-fno-math-errno",
        ]);
        compile.args(["-fno-trapping-math", "-fopt-info-vec-optimized", "-c", "shader.c"]);
        if cfg!(target_arch = "x86_64") {
            compile.arg("-mavx2");
        }
        let said = compile.output().unwrap();
        let said = String::from_utf8_lossy(&said.stderr);
        assert!(said.contains("loop vectorized"), "{said}\n{}", &text[text.find("noinline").unwrap()..]);
    }
}

#[test]
fn without_a_compiler_there_is_one_warning() {
    let cache = tempfile::tempdir().unwrap();
    let (reporter, messages) = Reporter::collecting();
    let environment = environment(cache.path(), Some("no-such-compiler"));
    let compiler = NativeShaders::new(&environment, &Supervisor::default(), &reporter);
    for text in ["a", "b"] {
        let source = NativeSource { text: text.to_owned(), inputs: 1, scalars: 0, outputs: 1 };
        compiler.compile(source, Box::new(|code| panic!("{code:?}")));
    }
    assert_eq!(compiler.wait(Duration::from_secs(100)), 0);
    let messages = messages.lock();
    assert_eq!(messages.len(), 1, "{messages:?}");
    let text = messages[0].to_string();
    assert!(text.contains("no-such-compiler") && text.contains("without native code"), "{text}");
}

#[test]
fn a_damaged_file_is_made_again() {
    if !granita_needs::has("cc") {
        return;
    }
    let text = "int granita (const float *const *in, const float *s, float *const *out, long from, long to)\n\
                { for (long i = from; i < to; ++i) out[0][i] = in[0][i] + s[0]; return 0; }\n";
    let source = NativeSource { text: text.to_owned(), inputs: 1, scalars: 1, outputs: 1 };
    let compiled = |cache: &Path| {
        let compiler = counting(&environment(cache, None));
        let (sender, receiver) = std::sync::mpsc::channel();
        compiler.inner.compile(source.clone(), Box::new(move |code| sender.send(code).unwrap()));
        let code = receiver.recv_timeout(Duration::from_secs(100)).unwrap();
        let (a, mut b) = ([1.0, 2.0], [0.0; 2]);
        let mut strip = NativeStrip { inputs: &[&a], scalars: &[0.5], outputs: &mut [&mut b], lanes: 1..2 };
        assert!(code.run(&mut strip));
        b
    };
    let (first, second) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    assert_eq!(compiled(first.path()), [0.0, 2.5]);
    // The name of the file depends on the source and the compiler alone.
    let file = std::fs::read_dir(first.path().join("granita")).unwrap().next().unwrap().unwrap();
    std::fs::create_dir(second.path().join("granita")).unwrap();
    let closed = std::os::unix::fs::PermissionsExt::from_mode(0o700);
    std::fs::set_permissions(second.path().join("granita"), closed).unwrap();
    std::fs::write(second.path().join("granita").join(file.file_name()), "not a library").unwrap();
    assert_eq!(compiled(second.path()), [0.0, 2.5]);
}
