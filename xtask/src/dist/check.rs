//! Installs each result in a clean place and runs it there (`dist --check`).

mod debian;

use super::{Release, tarball};
use crate::files::{answer, emptied, run};
use crate::home::TOOLS;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

/// The longest time from a file to the first image, a bundled model in a studio, in seconds.
const FIRST_IMAGE: f64 = 20.0;
/// The longest time from there to the image of the first example, on two cores, in seconds.
const EXAMPLE: f64 = 120.0;

/// A place where one result is installed.
struct Place {
    folder: PathBuf,
}

impl Place {
    fn new(release: &Release, name: &str) -> Result<Self, String> {
        Ok(Self { folder: emptied(release.work.join("check").join(name))? })
    }

    /// Returns a command without the variables of this process, in the folder of the place.
    fn command(&self, program: &Path) -> Command {
        let mut command = Command::new(program);
        command.env_clear().env("PATH", "/usr/bin:/bin").env("HOME", &self.folder).current_dir(&self.folder);
        command
    }

    /// Renders a bundled model with a `gelato`, as the first image after an installation that began at `start`.
    fn model(&self, name: &str, gelato: &Path, start: Instant) -> Result<(), String> {
        run(self.command(gelato).args(["-silent", "-up", "z", "teapot.pyg", "-o", "teapot.png"]))?;
        if !self.folder.join("teapot.png").is_file() {
            return Err(format!("{name}: teapot.png was not made"));
        }
        in_time(name, "to the first image", start, FIRST_IMAGE)
    }

    /// Renders the first example with a `gelato`, in the folder that contains `examples`. Returns the image.
    fn first(&self, gelato: &Path, folder: &Path) -> Result<PathBuf, String> {
        let mut render = self.command(gelato);
        let threads = std::thread::available_parallelism().map_or(1, usize::from).to_string();
        run(render.arg("-cwd").arg(folder).args([
            "-threads",
            &threads,
            "-silent",
            "examples/first/first.pyg",
        ]))?;
        let image = folder.join("examples/first/out/first.png");
        if image.is_file() { Ok(image) } else { Err(format!("{}: was not made", image.display())) }
    }
}

/// Checks all results. `made` are the tarball, the wheel and the package of Debian.
pub(super) fn all(release: &Release, made: &[PathBuf; 3]) -> Result<(), String> {
    let [archive, wheel, package] = made;
    same_again(release, made)?;
    let image = check_tarball(release, archive)?;
    check_wheel(release, wheel, &image)?;
    debian::check(release, package, &image)
}

/// Packs everything again, and compares the bytes.
fn same_again(release: &Release, made: &[PathBuf; 3]) -> Result<(), String> {
    let bytes = |path: &PathBuf| std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()));
    let before = made.iter().map(bytes).collect::<Result<Vec<_>, _>>()?;
    // The times of the files change, and the results must not.
    run(Command::new("find").arg(&release.home).args(["-exec", "touch", "-h", "{}", "+"]))?;
    let again = [tarball::make(release)?, super::wheel::make(release)?, super::deb::make(release)?];
    for (path, before) in again.iter().zip(&before) {
        if bytes(path)? != *before {
            return Err(format!("{}: the second run gave other bytes", path.display()));
        }
    }
    println!("check: two runs gave the same bytes");
    Ok(())
}

/// Checks that the time since `start` is within the limit, and prints it.
fn in_time(name: &str, what: &str, start: Instant, limit: f64) -> Result<(), String> {
    let seconds = start.elapsed().as_secs_f64();
    println!("check: {name}: {seconds:.1} s {what}");
    if seconds < limit { Ok(()) } else { Err(format!("{name}: {seconds:.1} s {what}, more than {limit}")) }
}

/// Checks that two images are equal, with the `iv` of the first place.
fn same_image(granita: &Path, image: &Path, other: &Path) -> Result<(), String> {
    let mut compare = Command::new(granita);
    answer(compare.args(["iv", "-compare"]).arg(image).arg(other)).map(|_| ())
}

/// Unpacks the tarball elsewhere, runs all its tools, and compiles a program in C++ with its library.
fn check_tarball(release: &Release, archive: &Path) -> Result<PathBuf, String> {
    let place = Place::new(release, "tarball")?;
    let start = Instant::now();
    run(Command::new("tar").arg("-xf").arg(archive).arg("-C").arg(&place.folder))?;
    let home = place.folder.join("moved elsewhere");
    let from = place.folder.join(tarball::name(release));
    std::fs::rename(&from, &home).map_err(|e| format!("{}: {e}", from.display()))?;
    place.model("tarball", &home.join("bin/gelato"), start)?;
    let start = Instant::now();
    let image = place.first(&home.join("bin/gelato"), &home)?;
    in_time("tarball", "for the example", start, EXAMPLE)?;
    for tool in TOOLS {
        let version = answer(place.command(&home.join("bin").join(tool)).arg("-version"))?;
        if !version.starts_with(tool) {
            return Err(format!("tarball: bin/{tool} -version prints {version}"));
        }
    }
    let said = answer(place.command(&home.join("bin/granita")).arg("-home"))?;
    if Path::new(&said) != home {
        return Err(format!("tarball: granita -home prints {said}"));
    }
    let mut compile = place.command(Path::new("c++"));
    compile.args(["-O0", "-w", "-o", "scene"]).arg(home.join("examples/cpp/scene.cpp"));
    compile.arg("-I").arg(home.join("include")).arg("-L").arg(home.join("lib")).arg("-lgelato");
    let mut path = std::ffi::OsString::from("-Wl,-rpath,");
    path.push(home.join("lib"));
    run(compile.arg(path))?;
    run(&mut place.command(&place.folder.join("scene")))?;
    exceptions(&place, &home)?;
    println!("check: tarball: all tools run, a program in C++ renders");
    Ok(image)
}

/// A plugin whose exception reaches the program.
const THROWING: &str = "\
#include <stdexcept>
#include \"shadeop.h\"
using namespace Gelato;
extern \"C\" {
GELATO_EXPORT int shadeop_version = SHADEOP_VERSION;
GELATO_EXPORT const char *thrower_shadeop[] = { \"float thrower (float)\", NULL };
GELATO_EXPORT void thrower (ShadingExecution *, int, const ShaderArg *)
{ throw std::runtime_error (\"thrown by the plugin\"); }
}
";

/// Checks that an exception of a plugin becomes a message. That fails where the program has another unwinder than
/// plugins have.
fn exceptions(place: &Place, home: &Path) -> Result<(), String> {
    crate::files::write(&place.folder.join("thrower.cpp"), THROWING)?;
    crate::files::write(&place.folder.join("thrown.gsl"), "surface thrown () { C = thrower (1); }\n")?;
    let mut compile = place.command(Path::new("c++"));
    compile.args(["-shared", "-fPIC", "-o", "thrower.so", "thrower.cpp", "-I"]).arg(home.join("include"));
    run(&mut compile)?;
    let mut render = place.command(&home.join("bin/gslc"));
    let output = render.args(["-plugins", ".", "-run", "-grid", "4x4", "-o", "null", "thrown.gsl"]).output();
    let output = output.map_err(|e| format!("gslc: {e}"))?;
    let said = String::from_utf8_lossy(&output.stderr);
    if said.contains("thrown by the plugin") {
        Ok(())
    } else {
        Err(format!("an exception of a plugin did not become a message: {}: {said}", output.status))
    }
}

/// Installs the wheel in an environment without the network, and runs what it brings.
fn check_wheel(release: &Release, wheel: &Path, image: &Path) -> Result<(), String> {
    let place = Place::new(release, "wheel")?;
    run(Command::new("python3").args(["-m", "venv"]).arg(place.folder.join("venv")))?;
    let bin = place.folder.join("venv/bin");
    let start = Instant::now();
    let mut install = place.command(&bin.join("pip"));
    run(install.args(["install", "--quiet", "--no-index", "--disable-pip-version-check"]).arg(wheel))?;
    place.model("wheel", &bin.join("gelato"), start)?;
    let start = Instant::now();
    run(place.command(&bin.join("python")).args(["-m", "gelato", "first"]))?;
    in_time("wheel", "for the example", start, EXAMPLE)?;
    let granita = bin.join("granita");
    same_image(&granita, &place.folder.join("gelato-first/examples/first/out/first.png"), image)?;
    for tool in TOOLS {
        let version = answer(place.command(&bin.join("python")).args(["-m", "gelato", tool, "-version"]))?;
        let by_name = answer(place.command(&granita).args([tool, "-version"]))?;
        if !version.starts_with(tool) || by_name != version {
            return Err(format!("wheel: python -m gelato {tool} -version prints {version}"));
        }
    }
    for taken in super::deb::SHARED_NAMES {
        if bin.join(taken).exists() {
            return Err(format!("wheel: {taken} is in the environment, where OpenImageIO's would be"));
        }
    }
    let scene = "import gelato\ngelato.Attribute('int[2] resolution', (32, 32))\n\
                 gelato.Output('ball.tif', 'tiff', 'rgba', 'camera')\ngelato.World()\ngelato.Sphere(1, -1, 1, 360)\n\
                 gelato.Render()\nassert gelato.finish() == 0\n";
    run(place.command(&bin.join("python")).env("PATH", "").args(["-c", scene]))?;
    if !place.folder.join("ball.tif").is_file() {
        return Err("wheel: import gelato rendered nothing".to_owned());
    }
    let texture = "from granita.texture import TextureSystem\nimage = TextureSystem().info('ball.tif')\n\
                   assert (image.width, image.height, image.channels) == (32, 32, 4), image\n";
    run(place.command(&bin.join("python")).env("PATH", "").args(["-c", texture]))?;
    match answer(Command::new("auditwheel").arg("show").arg(wheel)) {
        Ok(said) => {
            println!("check: wheel: auditwheel: {}", said.split_whitespace().collect::<Vec<_>>().join(" "))
        }
        Err(_) => println!("check: wheel: auditwheel is not installed, and not asked"),
    }
    println!("check: wheel: all tools run, import gelato renders, granita.texture reads");
    Ok(())
}
