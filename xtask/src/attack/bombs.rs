// tidy: table
//! Bombs: small files that cause much work or need much memory, and the expected result of each.

use super::run::{Bounds, MEMORY_KIB, Outcome, Place};
use super::{Attack, Failure, Tally, first_line, images, scenes};
use parking_lot::Mutex;
use std::fs;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The selected bombs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Choice {
    /// All bombs.
    All,
    /// The bombs that are small and end soon.
    Quick,
}

/// The expected result of the last command of a bomb. The commands before it must end with status 0. No command may end
/// by a signal, panic, exceed its time or leave temporary files.
enum Expect {
    /// The status is 0.
    Done,
    /// The status is 1 or 2, and there is a message.
    Refused,
    /// The status is 0, 1 or 2. There is a message unless it is 0.
    Ends,
    /// The status is 0 or 1, `out.exr` exists, and all of its values are finite.
    Finite,
    /// Like `Finite`, with a message about the replaced values.
    Told,
    /// The status is 0, and the mean of the alpha of `out.exr` has this value, to 0.001.
    Alpha(f64),
    /// The bytes of this file are unchanged.
    Untouched(&'static str),
    /// The status is 0, and the resident memory is at most this number of MiB.
    Within(u64),
}

/// Writes the files of a bomb into a folder.
type Make = dyn Fn(&Path) -> io::Result<()> + Send + Sync;

/// A bomb.
struct Bomb {
    name: String,
    make: Box<Make>,
    /// The commands in their order.
    commands: Vec<String>,
    expect: Expect,
    /// The largest processor time of a command of a release build, in seconds.
    seconds: f64,
    /// The largest number of open files; `None` leaves the system's limit.
    files: Option<u32>,
    /// True when the bomb is part of `cargo xtask ci`.
    is_quick: bool,
}

/// The memory that `maketx -memory N` may use in addition to N, in MiB: that of the program, its threads and one row of
/// tiles.
const BASE_MIB: u64 = 150;

/// Runs the chosen bombs, as many at once as there are processors.
pub(crate) fn run(attack: &Attack, choice: Choice) -> Result<Tally, String> {
    let is_chosen =
        |bomb: &Bomb| (choice == Choice::All || bomb.is_quick) && attack.is_wanted("bombs", &bomb.name);
    let bombs: Vec<Bomb> = all().into_iter().filter(is_chosen).collect();
    let (next, tally) = (AtomicUsize::new(0), Mutex::new(Tally::new("bombs")));
    let work = |worker: usize| -> io::Result<()> {
        let place = Place::new(attack.scratch.join(format!("bombs-{worker}")))?;
        while !attack.is_over() {
            let Some(bomb) = bombs.get(next.fetch_add(1, Ordering::Relaxed)) else { break };
            place.clear()?;
            (bomb.make)(&place.work())?;
            let failure = match bomb.fault(attack, &place)? {
                None => None,
                Some(what) => {
                    let kept = attack.keep("bombs", &bomb.name, &place, &bomb.commands)?;
                    Some(Failure { name: bomb.name.clone(), what, kept: Some(kept) })
                }
            };
            tally.lock().add(failure);
        }
        place.clear()
    };
    attack.on_all_processors("bombs", work)?;
    let tally = tally.into_inner();
    if tally.tried < bombs.len() as u64 {
        println!("attack: bombs: the time is over after {} of {}", tally.tried, bombs.len());
    }
    Ok(tally)
}

impl Bomb {
    /// Runs the commands of the bomb, and returns the error.
    fn fault(&self, attack: &Attack, place: &Place) -> io::Result<Option<String>> {
        let bounds =
            Bounds { seconds: attack.seconds(self.seconds), memory_kib: MEMORY_KIB, files: self.files };
        let before = match self.expect {
            Expect::Untouched(file) => fs::read(place.work().join(file))?,
            _ => Vec::new(),
        };
        for (number, command) in self.commands.iter().enumerate() {
            let outcome = attack.run(place, command, &bounds)?;
            let is_last = number + 1 == self.commands.len();
            let wrong = outcome.fault().or_else(|| {
                if is_last {
                    self.wrong(attack, place, &outcome, &before)
                } else {
                    (outcome.code() != Some(0)).then(|| status(&outcome))
                }
            });
            if let Some(wrong) = wrong {
                let peak = outcome.peak_kib >> 10;
                let seconds = outcome.wall.as_secs_f64();
                return Ok(Some(format!("`{command}`: {wrong} ({seconds:.1} s, {peak} MiB)")));
            }
            if outcome.wall.as_secs_f64() > 0.5 * bounds.processor_seconds() {
                let share = 100.0 * outcome.wall.as_secs_f64() / bounds.processor_seconds();
                println!("attack: bombs/{}: `{command}` took {share:.0} % of its time", self.name);
            }
            let left = place.leftovers();
            if !left.is_empty() {
                return Ok(Some(format!("`{command}` left {}", left.join(" "))));
            }
        }
        Ok(None)
    }

    /// Returns the error at the end of the last command.
    fn wrong(&self, attack: &Attack, place: &Place, outcome: &Outcome, before: &[u8]) -> Option<String> {
        let is_told = !outcome.stderr.trim().is_empty() || !outcome.stdout.trim().is_empty();
        let code = outcome.code();
        match &self.expect {
            Expect::Done => (code != Some(0)).then(|| status(outcome)),
            Expect::Refused => {
                (code == Some(0) || !is_told).then(|| format!("is not refused: {}", status(outcome)))
            }
            Expect::Ends => (code != Some(0) && !is_told).then(|| format!("no message: {}", status(outcome))),
            Expect::Finite => finite(attack, place, outcome),
            Expect::Told => finite(attack, place, outcome)
                .or_else(|| (!is_told).then(|| "values were replaced without a message".to_owned())),
            Expect::Alpha(right) => finite(attack, place, outcome).or_else(|| {
                let mean = statistics(attack, place).ok()?.into_iter().find(|row| row.channel == "A")?.mean;
                let is_right = code == Some(0) && (mean - right).abs() <= 1e-3;
                (!is_right).then(|| format!("the mean of alpha is {mean}, not {right}: {}", status(outcome)))
            }),
            Expect::Untouched(file) => match fs::read(place.work().join(file)) {
                Ok(now) if now == before => None,
                Ok(now) => Some(format!("{file} of {} bytes became {} others", before.len(), now.len())),
                Err(error) => Some(format!("{file}: {error}")),
            },
            Expect::Within(mib) => {
                let peak = outcome.peak_kib >> 10;
                if code != Some(0) {
                    return Some(status(outcome));
                }
                (peak > *mib).then(|| format!("took {peak} MiB, more than {mib} MiB"))
            }
        }
    }
}

/// Returns the status with its message.
fn status(outcome: &Outcome) -> String {
    format!("status {}: {}", outcome.code().unwrap_or(-1), first_line(&outcome.stderr))
}

/// Returns the error in `out.exr`.
fn finite(attack: &Attack, place: &Place, outcome: &Outcome) -> Option<String> {
    if outcome.code() == Some(2) {
        return Some(status(outcome));
    }
    match statistics(attack, place) {
        Err(error) => Some(error),
        Ok(rows) if rows.is_empty() => Some("out.exr has no channels".to_owned()),
        Ok(rows) => {
            let broken = rows.iter().find(|row| row.nan + row.infinite > 0)?;
            Some(format!("{} NaN and {} infinite values in {}", broken.nan, broken.infinite, broken.channel))
        }
    }
}

/// A row of the output of `iv -stats`.
struct Row {
    channel: String,
    mean: f64,
    nan: u64,
    infinite: u64,
}

/// Returns the output of `iv` for `out.exr`.
fn statistics(attack: &Attack, place: &Place) -> Result<Vec<Row>, String> {
    let bounds = Bounds { seconds: attack.seconds(30.0), memory_kib: MEMORY_KIB, files: None };
    let outcome = attack.run(place, "iv -stats out.exr", &bounds).map_err(|e| e.to_string())?;
    if outcome.code() != Some(0) {
        return Err(format!("no whole out.exr: {}", first_line(&outcome.stderr)));
    }
    // The columns are: channel, least, largest, mean, deviation, negative, NaN, infinite.
    let row = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [channel, _, _, mean, _, _, nan, infinite] = words[..] else { return None };
        Some(Row {
            channel: channel.to_owned(),
            mean: mean.parse().unwrap_or(f64::NAN),
            nan: nan.parse().ok()?,
            infinite: infinite.parse().ok()?,
        })
    };
    Ok(outcome.stdout.lines().filter_map(row).collect())
}

/// Returns a bomb of one file.
fn bomb(name: &str, file: &'static str, bytes: Vec<u8>, commands: &[&str], expect: Expect) -> Bomb {
    Bomb {
        name: name.to_owned(),
        make: Box::new(move |folder| fs::write(folder.join(file), &bytes)),
        commands: commands.iter().map(|c| (*c).to_owned()).collect(),
        expect,
        seconds: 20.0,
        files: None,
        is_quick: true,
    }
}

/// Returns a bomb of a scene.
fn scene(name: &str, text: String, expect: Expect) -> Bomb {
    bomb(name, "x.pyg", text.into_bytes(), &["gelato -threads 2 x.pyg"], expect)
}

/// Returns all bombs, in groups, the most informative first.
fn all() -> Vec<Bomb> {
    let mut all = Vec::new();
    grounds(&mut all);
    extremes(&mut all);
    depths(&mut all);
    numbers(&mut all);
    large_counts(&mut all);
    headers(&mut all);
    outputs(&mut all);
    memory(&mut all);
    all
}

/// Adds flat grounds up to the horizon. They must cover half of the image.
fn grounds(all: &mut Vec<Bomb>) {
    for half in ["1e4", "3e4", "1e5", "1e6", "1e7", "1e8"] {
        let shapes = [
            ("patch", scenes::patch(half)),
            ("mesh", scenes::mesh(half)),
            // The horizon of a smaller globe lies lower than the tolerance.
            ("globe", scenes::globe(half)),
        ];
        for (kind, calls) in shapes {
            if kind == "globe" && !matches!(half, "1e7" | "1e8") {
                continue;
            }
            all.push(scene(&format!("ground-{kind}-{half}"), scenes::ground(&calls), Expect::Alpha(0.5)));
        }
    }
    let far = scenes::frame(
        "Attribute (\"float fov\", 60)\nRotate (90, 1, 0, 0)\nTranslate (1e7, 0, 0)\n",
        &format!("Shader (\"surface\", \"constant\")\nTranslate (-1e7, 0, -1)\n{}", scenes::patch("1e5")),
    );
    all.push(scene("ground-far-camera", far, Expect::Alpha(0.5)));
}

/// Adds vertices, cameras and rates at the ends of their ranges.
fn extremes(all: &mut Vec<Bomb>) {
    for place in ["1e8", "1e10", "1e15", "1e20", "1e38", "nan", "inf"] {
        for kind in ["patch", "mesh", "bezier"] {
            let point = format!("{place}, {place}, 3");
            all.push(scene(&format!("vertex-{kind}-{place}"), scenes::vertex(kind, &point), Expect::Finite));
        }
    }
    for fov in ["1e-5", "1e-20", "179.99999", "0", "nan"] {
        let settings = format!("Attribute (\"float fov\", {fov})\n");
        all.push(scene(&format!("fov-{fov}"), scenes::frame(&settings, scenes::BALL), Expect::Finite));
    }
    for quality in ["1e6", "1e30", "1e-30", "nan"] {
        let settings = format!("Attribute (\"float shadingquality\", {quality})\n");
        let name = format!("shadingquality-{quality}");
        all.push(scene(&name, scenes::frame(&settings, scenes::BALL), Expect::Finite));
    }
    let mut preview = scene("preview-1e30", scenes::frame("", scenes::BALL), Expect::Finite);
    preview.commands = vec!["gelato -preview 1e30 x.pyg".to_owned()];
    all.push(preview);
    for (name, matrix) in [
        ("w-through-zero", "1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 1, 0, 0, 0, -3"),
        ("nan", "1, 0, 0, 0, 0, nan, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1"),
        ("zero", "0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0"),
        ("huge", "1e30, 0, 0, 0, 0, 1e30, 0, 0, 0, 0, 1e30, 0, 0, 0, 0, 1"),
    ] {
        let calls = format!("AppendTransform (({matrix}))\n{}", scenes::BALL);
        all.push(scene(&format!("matrix-{name}"), scenes::frame("", &calls), Expect::Finite));
    }
}

/// Adds rays, nesting and recursion of great depth.
fn depths(all: &mut Vec<Bomb>) {
    for depth in [130, 200, 10_000] {
        for (name, glass) in [("mirrors", false), ("glass", true)] {
            all.push(scene(&format!("depth-{name}-{depth}"), scenes::mirrors(depth, glass), Expect::Finite));
        }
    }
    let own = "Input (\"x.pyg\")\nSphere (1, -1, 1, 360)\n".to_owned();
    all.push(scene("input-of-itself", own, Expect::Ends));
    let pushes = |n: usize| format!("{}{}", "PushAttributes ()\n".repeat(n), "PopAttributes ()\n".repeat(n));
    let calls = format!("{}{}", pushes(100_000), scenes::BALL);
    all.push(scene("pushed-attributes", scenes::frame("", &calls), Expect::Finite));
    let nested =
        format!("Attribute (\"float[2] screen\", {}1, 1{})\n", "(".repeat(200_000), ")".repeat(200_000));
    all.push(scene("nested-tuples", nested, Expect::Ends));
    let shader = |body: String| format!("surface x ()\n{{\n{body}\n}}\n");
    let compile = |name: &str, text: String, expect| {
        bomb(name, "x.gsl", text.into_bytes(), &["gslc -o out.gso x.gsl"], expect)
    };
    let brackets = format!("C = {}1{};", "(".repeat(100_000), ")".repeat(100_000));
    all.push(compile("nested-brackets", shader(brackets), Expect::Refused));
    let blocks = format!("{}{}", "{".repeat(100_000), "}".repeat(100_000));
    all.push(compile("nested-blocks", shader(blocks), Expect::Ends));
    let minus = format!("C = {}1;", "- ".repeat(100_000));
    all.push(compile("nested-minus", shader(minus), Expect::Ends));
    let chain: String = (0..2000).map(|k| format!("if (u < {k}) C = {k}; else ")).collect();
    all.push(compile("else-if-2000", shader(format!("{chain} C = 0;")), Expect::Ends));
    for terms in [200, 5000] {
        all.push(compile(&format!("sum-{terms}"), scenes::sum(terms), Expect::Done));
    }
    let include = "#include \"x.gsl\"\n".to_owned();
    all.push(compile("include-of-itself", include, Expect::Refused));
    let nodes = scenes::nested_nodes(100_000).into_bytes();
    all.push(bomb("nested-gltf-nodes", "x.gltf", nodes, &["topyg -r 1 -o out.txt x.gltf"], Expect::Ends));
    let arrays = format!("{}{}", "[".repeat(500_000), "]".repeat(500_000)).into_bytes();
    all.push(bomb("nested-json", "x.gltf", arrays, &["topyg -r 1 -o out.txt x.gltf"], Expect::Ends));
    let blocks = "AttributeBegin\n".repeat(100_000).into_bytes();
    all.push(bomb("nested-rib", "x.rib", blocks, &["topyg -r 1 -o out.txt x.rib"], Expect::Ends));
    let recursive =
        "surface x ()\n{\n    float f (float a) { return f (a); }\n    C = f (1);\n}\n".to_owned();
    all.push(compile("recursive-function", recursive, Expect::Ends));
    for (name, text) in [("doubled-text", scenes::doubled(100)), ("endless-loop", scenes::ENDLESS.to_owned())]
    {
        let mut shaded =
            bomb(name, "x.gsl", Vec::new(), &["gslc -o x.gso x.gsl", "gelato x.pyg"], Expect::Ends);
        shaded.make = Box::new(move |folder| {
            fs::write(folder.join("x.pyg"), scenes::shaded())?;
            fs::write(folder.join("x.gsl"), &text)
        });
        all.push(shaded);
    }
}

/// Adds values that are not finite or not sensible.
fn numbers(all: &mut Vec<Bomb>) {
    let with = |name: &str, settings: &str, calls: &str| {
        scene(name, scenes::frame(settings, &format!("{calls}{}", scenes::BALL)), Expect::Told)
    };
    all.push(with("light-at-nan", "", "Light (\"lamp\", \"pointlight\", \"point from\", (nan, 0, 0))\n"));
    all.push(with("light-infinite", "", "Light (\"lamp\", \"pointlight\", \"float intensity\", inf)\n"));
    all.push(with("axis-of-nan", "", "Rotate (30, nan, 0, 1)\n"));
    all.push(with(
        "roughness-nan",
        "",
        "Shader (\"surface\", \"plastic\", \"float roughness\", nan, \"float Ks\", 1)\n",
    ));
    all.push(with("colour-nan", "", "Attribute (\"color C\", (nan, 1, 1))\n"));
    let mut opacity = with("opacity-1e20", "", "Attribute (\"color opacity\", (1e20, 1e20, 1e20))\n");
    opacity.expect = Expect::Finite;
    all.push(opacity);
    let mut gain = with("gain-infinite", "", "");
    gain.make = Box::new(|folder| {
        let text = scenes::frame("", scenes::BALL).replace("\"camera\")", "\"camera\", \"float gain\", inf)");
        fs::write(folder.join("x.pyg"), text)
    });
    all.push(gain);
}

/// Adds scenes with large numbers of one thing.
fn large_counts(all: &mut Vec<Bomb>) {
    for corners in [90_000, 1_000_000] {
        let mut face = scene(&format!("star-{corners}"), String::new(), Expect::Finite);
        face.make = Box::new(move |folder| {
            fs::write(folder.join("x.obj"), scenes::star(corners))?;
            let calls = "Translate (0, 0, 3)\nInput (\"x.obj\")\n";
            fs::write(folder.join("x.pyg"), scenes::frame("", calls))
        });
        face.is_quick = corners < 100_000;
        all.push(face);
    }
    all.push(scene("user-attributes-20000", scenes::user_attributes(20_000), Expect::Finite));
    let mut textures = scene("textures-150", String::new(), Expect::Done);
    textures.make = Box::new(|folder| {
        for k in 0..150 {
            let pixel = [k as u8, 100, 200];
            let bytes = [&b"P6\n4 4\n255\n"[..], &pixel.repeat(16)].concat();
            fs::write(folder.join(format!("{k}.ppm")), bytes)?;
        }
        fs::write(folder.join("x.pyg"), scenes::textures(150))
    });
    let names: Vec<String> = (0..150).map(|k| format!("{k}.ppm")).collect();
    textures.commands.insert(0, format!("maketx {}", names.join(" ")));
    textures.files = Some(64);
    all.push(textures);
}

/// Adds image files whose headers declare more than the files contain.
fn headers(all: &mut Vec<Bomb>) {
    type Bytes = fn() -> Vec<u8>;
    let makers: [(&str, &'static str, Bytes); 19] = [
        ("ppm", "x.ppm", || images::ppm(65535, 65535)),
        ("ppm-text", "x.ppm", images::text_ppm),
        ("pam", "x.pam", images::pam),
        ("pfm", "x.pfm", images::pfm),
        ("hdr", "x.hdr", images::hdr),
        ("tga", "x.tga", images::tga),
        ("gif", "x.gif", images::gif),
        ("gif-image", "x.gif", images::gif_of_small_screen),
        ("tiff", "x.tif", || images::tiff(65535, 65535, 0)),
        ("tiff-chain", "x.tif", || images::tiff(1, 1, 8)),
        ("tiff-directories", "x.tif", || images::many_directories(100_000)),
        ("qoi", "x.qoi", images::qoi),
        ("png", "x.png", images::png),
        ("bmp", "x.bmp", images::bmp),
        ("sgi", "x.sgi", images::sgi),
        ("dds", "x.dds", images::dds),
        ("exr-window", "x.exr", || images::exr(64, 16_777_154)),
        ("exr-large", "x.exr", || images::exr(100_000, 100_000)),
        ("exr-huge", "x.exr", || images::exr(i32::MAX, i32::MAX)),
    ];
    for (name, file, make) in makers {
        let commands = [
            ("info", "iv -info {}"),
            ("maketx", "maketx {} -o out.tx"),
            ("thumbnail", "iv -thumbnail out.png {}"),
            ("texture", "gelato texture.pyg"),
        ];
        for (how, command) in commands {
            let command = command.replace("{}", file);
            // `iv -info` may print a header although the image is refused. Some readers also print the part that is
            // there.
            let mut header =
                bomb(&format!("header-{name}-{how}"), file, Vec::new(), &[&command], Expect::Ends);
            header.make = Box::new(move |folder| {
                let calls = format!(
                    "Shader (\"surface\", \"texmap\", \"string texturename\", \"{file}\")\n{}",
                    scenes::BALL
                );
                fs::write(folder.join("texture.pyg"), scenes::frame("", &calls))?;
                fs::write(folder.join(file), make())
            });
            all.push(header);
        }
    }
}

/// Adds outputs whose names are already in use.
fn outputs(all: &mut Vec<Bomb>) {
    let to = |name: &str, output: &str, expect| {
        let text = scenes::frame("", scenes::BALL).replace("out.exr", output);
        scene(name, text, expect)
    };
    let mut fifo = to("output-fifo", "pipe.ppm", Expect::Ends);
    fifo.make = Box::new(|folder| {
        let made = std::process::Command::new("mkfifo").arg(folder.join("pipe.ppm")).status()?;
        if !made.success() {
            return Err(io::Error::other("mkfifo failed"));
        }
        let text = scenes::frame("", scenes::BALL)
            .replace("out.exr\", \"exr\", \"rgba\"", "pipe.ppm\", \"ppm\", \"rgb\"");
        fs::write(folder.join("x.pyg"), text)
    });
    all.push(fifo);
    all.push(to("output-nowhere", "no/such/folder/out.exr", Expect::Refused));
    let ppm = || [&b"P6\n4 4\n255\n"[..], &[90; 48]].concat();
    let keep = |name: &str, file: &'static str, bytes, command: &str| {
        bomb(name, file, bytes, &[command], Expect::Untouched(file))
    };
    all.push(keep("maketx-onto-input", "x.ppm", ppm(), "maketx x.ppm -o x.ppm"));
    all.push(keep("thumbnail-onto-input", "x.ppm", ppm(), "iv -thumbnail x.ppm x.ppm"));
    all.push(keep(
        "topyg-onto-input",
        "x.pyg",
        scenes::frame("", scenes::BALL).into_bytes(),
        "topyg -o x.pyg x.pyg",
    ));
    all.push(keep("gslc-onto-input", "p.gsl", scenes::sum(3).into_bytes(), "gslc -o p.gsl p.gsl"));
    all.push(keep(
        "gelato-onto-input",
        "x.pyg",
        scenes::frame("", scenes::BALL).into_bytes(),
        "gelato -o x.pyg x.pyg",
    ));
}

/// Adds `maketx -memory` for an image of 108 MB.
fn memory(all: &mut Vec<Bomb>) {
    for mode in ["periodic", "black", "clamp", "mirror"] {
        let command = format!("maketx -memory 50 -mode {mode} -threads 2 large.ppm -o out.tx");
        let mut large = bomb(
            &format!("memory-{mode}"),
            "large.ppm",
            Vec::new(),
            &[&command],
            Expect::Within(50 + BASE_MIB),
        );
        large.make = Box::new(|folder| fs::write(folder.join("large.ppm"), images::large_ppm(6000)));
        (large.seconds, large.is_quick) = (60.0, false);
        all.push(large);
    }
}
