// tidy: tests
//! Whole command lines on small files.

use super::*;
use granita_edit::{File, float_rows};
use granita_image::FormatRegistry;
use granita_texture::make::Kernel;

struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Runs a command line, in which `./` is the folder. Returns the status, and all messages.
    fn run(&self, line: &str) -> (u8, String) {
        let folder = format!("{}/", self.folder.path().display());
        let words: Vec<OsString> =
            format!("imgtool {line}").split(' ').map(|w| w.replace("./", &folder).into()).collect();
        let steps = match parse::steps(&words) {
            Ok(steps) => steps,
            Err(refusal) => return (2, format!("{refusal:?}")),
        };
        let options = match Run::of(&steps) {
            Ok(options) => options,
            Err(fault) => return (2, fault.what),
        };
        let (reporter, messages) = Reporter::collecting();
        reporter.set_verbosity(2);
        let status = run(&steps, &options, &reporter);
        let text: Vec<String> = messages.lock().iter().map(|m| m.to_string()).collect();
        (status.code(), text.join("\n"))
    }

    /// Runs a command line that must succeed without a warning.
    fn done(&self, line: &str) -> String {
        let (status, text) = self.run(line);
        assert!(status == 0 && !text.contains("warning"), "{line}: {status} {text}");
        text
    }

    fn image(&self, name: &str) -> granita_edit::Image {
        File::open(&self.path(name), &formats()).unwrap().image(0, 0).unwrap()
    }

    fn values(&self, name: &str) -> Vec<f32> {
        let image = self.image(name);
        float_rows(&**image.source(), 0, image.spec().height).unwrap()
    }
}

fn formats() -> FormatRegistry {
    granita_plugin::bundled_formats(Limits::default())
}

#[test]
fn words_are_processed_from_left_to_right() {
    let place = Place::new();
    place.done("-pattern constant:color=0.25,0.5,0.75 8x4 3 -o ./a.exr -addc 0.25 -o ./b.exr -resize 50% -d uint8 -o ./c.png");
    assert_eq!(place.values("a.exr")[..3], [0.25, 0.5, 0.75]);
    assert_eq!(place.values("b.exr")[..3], [0.5, 0.75, 1.0]);
    let small = place.image("c.png");
    assert_eq!(
        (small.spec().width, small.spec().height, small.stored()),
        (4, 2, granita_image::PixelType::U8)
    );
    // The order of two images is that of their names, also after the option.
    for line in [
        "./b.exr ./a.exr -sub -o ./d.exr",
        "-sub ./b.exr ./a.exr -o ./d.exr",
        "./a.exr ./b.exr -swap -sub -o ./d.exr",
    ] {
        place.done(line);
        assert_eq!(place.values("d.exr")[..3], [0.25; 3], "{line}");
    }
    place.done("./a.exr ./b.exr -pop -dup -add -o ./e.exr");
    assert_eq!(place.values("e.exr")[..3], [0.5, 1.0, 1.5]);
    place.done("--mad ./a.exr ./b.exr ./a.exr -o=./f.exr");
    assert_eq!(place.values("f.exr")[..2], [0.375, 0.875]);
}

/// Every option runs on images for which it is meant.
#[test]
fn every_option_runs() {
    let place = Place::new();
    place.done("-pattern fill:topleft=0.1,0.2,0.3,1:topright=0.9,0.1,0.4,0.5:bottomleft=0:bottomright=1 32x16 4 -fullsize 40x20 -o ./a.exr -fullpixels -flop -o ./b.exr");
    place.done("-pattern noise:type=uniform:max=1:mono=1:seed=3 32x16 3 -o ./map.exr");
    let look = "ocio_profile_version: 2\nroles: {scene_linear: lin}\nlooks:\n  - !<Look> {name: grade, process_space: lin, transform: !<ExponentTransform> {value: 2}}\ncolorspaces:\n  - !<ColorSpace> {name: lin}\n";
    std::fs::write(place.path("look.ocio"), look).unwrap();
    std::fs::write(place.path("one.spimtx"), "1 0 0 0 0 1 0 0 0 0 1 0").unwrap();
    let mut used = std::collections::BTreeSet::new();
    for line in [
        "-i:ch=R,G ./a.exr -o:type=half:compression=zip ./o.exr",
        "./a.exr -unmip -selectmip 0 -subimage 0 -o ./o.exr",
        "-create 4x4 2 -o:format=tiff ./o.bin",
        "-pattern checker:width=2:height=3:color1=0.5:color2=0,1:xoffset=1:yoffset=1 9x9 2 -o ./o.exr",
        "-d half -compression none -tile 16 16 -scanline -planarconfig contig -noautocrop ./a.exr -o ./o.tif",
        "./a.exr -o:tile=16x16:separate=1 ./o.tif -o:scanline=1 ./p.tif",
        "./a.exr -resize:filter=mitchell 0x9 -resample:interp=0 200% -resample 9x9 -o ./o.exr",
        "./a.exr -fit:pad=1:fillmode=width:filter=box 30x30 -crop 9x9+1+1 -croptofull -cut 5x5+0+0 -trim -o ./o.exr",
        "./a.exr -origin +3+4 -originoffset -1-1 -fullsize 50x50+0+0 -fullpixels -o ./o.exr",
        "./b.exr ./a.exr -paste:mergeroi=1 +4+4 ./b.exr -mosaic:pad=2:fit=10x10 2x1 -o ./o.exr",
        "./a.exr -flip -flop -rotate90 -rotate180 -rotate270 -transpose -cshift +3-2 -orientation 6 -reorient -o ./o.exr",
        "./map.exr -env:size=8:up=z latlong:cross -env:up=z cross:probe -o ./o.exr",
        "./map.exr -env:size=8 latlong:faces -env faces:column -o ./o.exr",
        "./a.exr -ch B,A=1,R -chnames x,y -nchannels 4 ./b.exr -chappend -chsum:weight=1,2 -o ./o.exr",
        "./a.exr -saturate 0.5 -dup -maxchan -swap -minchan -add -o ./o.exr",
        "./a.exr ./b.exr -add ./b.exr -sub ./b.exr -mul ./b.exr -div ./b.exr -absdiff ./b.exr -min ./b.exr -max ./b.exr -pow -o ./o.exr",
        "./a.exr -addc 1 -subc 0.5,1 -mulc 2 -divc 3 -absdiffc 0.1 -minc 1 -maxc 0 -powc 2.2 -abs -o ./o.exr",
        "./a.exr ./b.exr ./a.exr -mad -invert:chbegin=0:chend=2 -clamp:min=0:max=1,2:clampalpha=1 -o ./o.exr",
        "./a.exr ./b.exr -over -premult -unpremult -o ./o.exr",
        "./a.exr -blur:kernel=box 3x5 -unsharp:kernel=gaussian:width=5:contrast=0.5:threshold=0.1 -fixnan box3 -o ./o.exr",
        "./a.exr -colorconvert:unpremult=1:strict=1 srgb ACEScg -tocolorspace:unpremult=1 srgb -iscolorspace ACEScg -o ./o.exr",
        "./a.exr -colorconfig ocio://default -ociodisplay:from=ACEScg:unpremult=1 default default -o ./o.exr",
        "-colorconfig ./look.ocio ./a.exr -ociolook:from=lin:to=lin:unpremult=1 grade -ociofiletransform:inverse=1:unpremult=1 ./one.spimtx -o ./o.exr",
        "./a.exr -fill:color=1,0,0,1 4x4+2+2 -noise:type=salt:value=1:portion=0.1:seed=4 -noise:stddev=0.1:mean=0:mono=0 -o ./o.exr",
        "./a.exr -attrib:type=float[2] ab 1,2 -sattrib name 3 -eraseattrib name -caption words -keyword one -clear-keywords -o ./o.exr",
        "./a.exr -dup -swap -pop -info:verbose=1 -stats -echo words -v -q",
        "-fail 1 -failpercent 1 -hardfail 9 -warn 1 -warnpercent 1 -hardwarn 9 ./a.exr ./b.exr -diff",
        "./a.exr -n -u -no-clobber -create-dir -memory 100 -threads 2 -o ./none.exr",
        "-create 4x4 3 -frames 1-2 -skip-bad-frames -o ./s.#.exr",
        "-safe -nofence ./a.exr -o ./o.exr",
        "-plugins ./ ./a.exr -info",
    ] {
        place.done(line);
        used.extend(
            line.split(' ')
                .filter_map(|w| table::find(w.strip_prefix('-')?.split(':').next()?))
                .map(|row| row.name),
        );
    }
    let unused: Vec<&str> = table::rows().map(|row| row.name).filter(|name| !used.contains(name)).collect();
    assert!(unused.is_empty(), "{unused:?}");
}

#[test]
fn errors_name_the_option_and_the_file() {
    let place = Place::new();
    place.done("-create 8x8 3 -o ./a.exr -o ./a.png");
    std::fs::write(place.path("text.exr"), "no image").unwrap();
    for (line, status, expected) in [
        ("./none.exr -o ./o.exr", 2, "none.exr"),
        ("./text.exr -o ./o.exr", 2, "text.exr"),
        ("./a.exr -o ./o.nothing", 2, "-o: "),
        ("./a.exr -o ./none/o.exr", 2, "none/o.exr"),
        ("./a.exr -o ./o.exr -resize axb", 1, "-resize: \"axb\" is not a size"),
        ("./a.exr -resize 0x0", 2, "-resize: a size of 0 x 0"),
        ("./a.exr -resize:filter=bix 5x5", 2, "\"bix\" is not a filter"),
        ("./a.exr -fit 50%x", 2, "-fit: "),
        ("./a.exr -add", 2, "-add needs 2 images, there is 1"),
        ("-add -sub ./a.exr", 2, "-add waits for images, and -sub does too"),
        ("-flip", 2, "-flip needs 1 images, there are 0"),
        ("./a.exr -ch Q -o ./o.exr", 0, "there is no channel \"Q\""),
        ("./a.exr -flip -selectmip 1", 2, "-selectmip: "),
        ("./a.exr -selectmip 1", 2, "no level 1"),
        ("./a.exr#3", 2, "no image 3"),
        ("./a.exr -env cube", 2, "latlong:cube"),
        ("./a.exr -env cube:latlong", 2, "3 by 2 square faces"),
        ("./a.exr -env faces:latlong", 2, "six images"),
        ("./a.exr -env a:latlong", 2, "\"a\" is not a layout"),
        ("./a.exr -mosaic 0x2", 2, "-mosaic: a mosaic of 0 x 2"),
        ("./a.exr -d int8", 2, "-d: \"int8\" is not a type"),
        ("./a.exr -tile 0 8", 2, "-tile: "),
        ("./a.exr -attrib:type=colour a 1", 2, "-attrib: "),
        ("./a.exr -eraseattrib (", 2, "regular expression"),
        ("./a.exr -orientation 9", 2, "-orientation: "),
        ("./a.exr -nchannels 0", 2, "-nchannels: "),
        ("./a.exr -addc x", 2, "-addc: "),
        ("./a.exr -blur 5", 2, "-blur: "),
        ("./a.exr -blur 9999x1", 2, "-blur: "),
        ("./a.exr -threads 0", 2, "-threads: "),
        ("./a.exr -memory 0", 2, "-memory: "),
        ("-pattern stripes 4x4 3", 2, "-pattern: \"stripes\""),
        ("-create 99999999x4 3", 2, "-create: "),
        ("-create 4x4 0", 2, "-create: 0 channels"),
        ("./s.#.exr -o ./t.#.exr", 2, "s.0000.exr"),
        ("./a.exr", 0, "nothing is written or printed"),
        ("./a.exr -rezise 4x4", 2, "-rezise"),
        ("./a.exr -invert:chbegin=x -info", 2, "chbegin=x"),
    ] {
        let (got, text) = place.run(line);
        assert!(got == status && text.contains(expected), "{line}: {got} {text}");
    }
    assert!(!place.path("o.nothing").exists());
}

#[test]
fn comparisons_have_the_codes_of_idiff() {
    let place = Place::new();
    place.done("-pattern constant:color=0.5 8x8 3 -o ./a.exr -addc 0.01 -o ./b.exr -fill:color=0.9 1x1+3+2 -o ./c.exr -crop 4x4+0+0 -o ./d.exr");
    for (line, status, expected) in [
        ("-diff ./a.exr ./a.exr", 0, "PASS"),
        ("-diff ./a.exr ./b.exr", 2, "FAILURE"),
        ("-fail 0.1 ./a.exr ./b.exr -diff", 1, "WARNING"),
        ("-fail 0.1 -warn 0.1 -diff ./a.exr ./b.exr", 0, "PASS"),
        ("-fail 0.1 -warn 1 -diff ./a.exr ./c.exr", 2, "@ (3, 2, R)"),
        ("-fail 0.1 -failpercent 2 -warn 1 -diff ./a.exr ./c.exr", 0, "PASS"),
        ("-fail 0.1 -failpercent 2 -warn 1 -hardfail 0.3 -diff ./a.exr ./c.exr", 2, "FAILURE"),
        ("-diff ./a.exr ./d.exr", 3, "do not match in size"),
        ("-diff ./a.exr ./none.exr", 4, "none.exr"),
    ] {
        let (got, text) = place.run(line);
        assert!(got == status && text.contains(expected), "{line}: {got} {text}");
    }
}

#[test]
fn sequences_run_once_for_each_frame() {
    let place = Place::new();
    place.done("-pattern noise:seed=1 4x4 3 -frames 1-3 -o ./a.#.exr");
    place.done("./a.#.exr ./a.3-1#.exr -sub -o ./b.%02d.exr");
    for (a, b, out) in [("a.0001.exr", "a.0003.exr", "b.01.exr"), ("a.0003.exr", "a.0001.exr", "b.03.exr")] {
        let (a, b) = (place.values(a), place.values(b));
        let expected: Vec<f32> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
        assert_eq!(place.values(out), expected);
    }
    std::fs::write(place.path("a.0002.exr"), "damaged").unwrap();
    let (status, text) = place.run("./a.#.exr -flip -o ./c.#.exr");
    assert!(status == 1 && text.contains("a.0002.exr") && !place.path("c.0003.exr").exists(), "{text}");
    let (status, text) = place.run("./a.#.exr -skip-bad-frames -flip -o ./c.#.exr");
    assert!(status == 1 && text.contains("a.0002.exr") && place.path("c.0003.exr").exists(), "{text}");
}

#[test]
fn files_are_skipped_on_request() {
    let place = Place::new();
    place.done("-create 2x2 1 -o ./a.exr");
    let text = place.done("./a.exr -n -o ./b.exr");
    assert!(text.contains("is not written") && !place.path("b.exr").exists());
    place.done("./a.exr -create-dir -o ./x/y/b.exr -addc 1 -no-clobber -u -o ./x/y/b.exr");
    assert_eq!(place.values("x/y/b.exr"), [0.0; 4]);
    assert!(place.done("./a.exr -u -o ./x/y/b.exr").contains("newer than all inputs"));
}

#[test]
fn descriptions_and_statistics_are_printed() {
    let place = Place::new();
    place.done("-pattern constant:color=0.25,-1 4x2 2 -attrib lens 50 -caption words -o ./a.exr");
    let text = place.done("-v -info ./a.exr");
    for expected in ["a.exr: 4 x 2, 2 channels (Y A) of float, exr", "lens", "50", "\"words\""] {
        assert!(text.contains(expected), "{text}");
    }
    let text = place.done("./a.exr -stats");
    let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split_whitespace().collect()).collect();
    assert!(rows.contains(&vec!["A", "-1", "-1", "-1", "0", "8", "0", "0"]), "{text}");
}

#[test]
fn memory_limits_do_not_change_a_rotation() {
    let place = Place::new();
    place.done("-pattern noise:type=uniform:max=1 700x900 3 -o ./a.png");
    place.done("./a.png -rotate90 -o ./b.png -rotate180 -flip -o ./c.png");
    place.done("./a.png -memory 1 -rotate90 -o ./d.png -rotate180 -flip -o ./e.png");
    assert_eq!(place.values("b.png"), place.values("d.png"));
    assert_eq!(place.values("c.png"), place.values("e.png"));
}

/// Returns the tables of options of the manual.
fn tables() -> String {
    let mut text = String::new();
    for (heading, rows) in table::GROUPS {
        text.push_str(&format!("\n### {heading}\n\n| option | meaning |\n|---|---|\n"));
        for row in rows.iter().filter(|row| !row.about.is_empty()) {
            let names: Vec<String> =
                [row.name].iter().chain(row.aliases).map(|n| format!("`-{n}`")).collect();
            let mut names = names.join(", ");
            if !row.values.is_empty() {
                names = names.replacen(
                    &format!("`-{}`", row.name),
                    &format!("`-{} {}`", row.name, row.values.join(" ")),
                    1,
                );
            }
            let about = row.about.replace('|', "\\|");
            let modifiers: Vec<String> = row.modifiers.iter().map(|m| format!("`{m}=`")).collect();
            let modifiers = if modifiers.is_empty() {
                String::new()
            } else {
                format!(". Modifiers: {}", modifiers.join(", "))
            };
            text.push_str(&format!("| {names} | {about}{modifiers} |\n"));
        }
    }
    text.push('\n');
    text
}

#[test]
fn the_manual_has_the_tables_of_options() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/imgtool.md");
    let page = std::fs::read_to_string(&path).unwrap();
    let (begin, end) = ("<!-- options -->\n", "<!-- end of options -->");
    let (before, rest) = page.split_once(begin).unwrap();
    let (_, after) = rest.split_once(end).unwrap();
    let expected = format!("{before}{begin}{}{end}{after}", tables());
    if std::env::var("GRANITA_BLESS").is_ok_and(|what| what == "manual" || what == "all") {
        std::fs::write(&path, &expected).unwrap();
        return;
    }
    assert!(
        page == expected,
        "docs/imgtool.md is not what the table says: GRANITA_BLESS=manual cargo test -p imgtool"
    );
    for (name, _) in Kernel::NAMES {
        assert!(page.contains(&format!("`{name}`")), "{name}");
    }
}

#[test]
fn colours_are_converted_between_spaces() {
    let place = Place::new();
    place.done("-pattern constant:color=0.5,0.25,0.125 4x2 3 -d float -o ./a.exr");
    place.done("./a.exr -colorconvert lin_rec709 sRGB -d float -o ./b.exr");
    let near = |a: &[f32], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-5);
    assert!(near(&place.values("b.exr"), [0.735_357, 0.537_099, 0.388_573]), "{:?}", place.values("b.exr"));
    // The way back through what the file says now.
    let text = place.done("./b.exr -tocolorspace lin_rec709 -d float -o ./c.exr");
    assert!(text.contains("b.exr: the colours are sRGB (oiio:ColorSpace)"), "{text}");
    assert!(near(&place.values("c.exr"), [0.5, 0.25, 0.125]));
    place.done(
        "./a.exr -d uint8 -o ./a.png -iscolorspace ACEScg -tocolorspace lin_rec709 -d float -o ./d.exr",
    );
    assert!(place.values("d.exr")[0] > 0.6);
    let text = place.done("./a.png -tocolorspace lin_rec709 -d float -o ./e.exr");
    assert!(
        text.contains("sRGB (assumed of integers)") && (place.values("e.exr")[0] - 0.214).abs() < 2e-3,
        "{text}"
    );
    place.done("./a.exr -ociodisplay default default -d float -o ./f.exr");
    assert!(near(&place.values("f.exr"), [0.735_357, 0.537_099, 0.388_573]), "{:?}", place.values("f.exr"));
}

#[test]
fn spaces_that_do_not_exist_are_named() {
    let place = Place::new();
    place.done("-pattern constant 4x2 3 -o ./a.exr");
    let (status, text) = place.run("./a.exr -colorconvert ACESgc sRGB -o ./b.exr");
    assert!(
        status == 2
            && text.contains("-colorconvert: the built-in configuration has no colour space \"ACESgc\""),
        "{text}"
    );
    assert!(text.contains("did you mean"), "{text}");
    let (status, text) = place.run("./a.exr -colorconvert:strict=0 nospace sRGB -o ./b.exr");
    assert!(status == 0 && text.contains("nothing is converted"), "{text}");
    let (status, text) = place.run("./a.exr -ociodisplay screen Raw -o ./b.exr");
    assert!(status == 2 && text.contains("no display \"screen\""), "{text}");
    let (status, text) = place.run("./a.exr -colorconfig ./no.ocio -iscolorspace x -o ./b.exr");
    assert!(status == 2 && text.contains("-colorconfig: ") && text.contains("no.ocio"), "{text}");
    let (status, text) = place.run("./a.exr -ociofiletransform ./no.cube -o ./b.exr");
    assert!(status == 2 && text.contains("no.cube"), "{text}");
}

#[test]
fn a_configuration_and_its_tables_are_files() {
    let place = Place::new();
    let config = "ocio_profile_version: 2\nroles: {scene_linear: lin}\ncolorspaces:\n  - !<ColorSpace> {name: lin}\n  - !<ColorSpace> {name: half, to_scene_reference: !<MatrixTransform> {matrix: [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]}}\n";
    std::fs::write(place.path("a.ocio"), config).unwrap();
    std::fs::write(place.path("a.cube"), "LUT_1D_SIZE 2\n0 0 0\n0.5 0.25 1\n").unwrap();
    place.done("-pattern constant:color=0.5 4x2 3 -o ./a.exr");
    place.done("-safe ./a.exr -colorconfig ./a.ocio -colorconvert half lin -o ./b.exr");
    assert_eq!(place.values("b.exr")[..3], [1.0; 3]);
    place.done("./a.exr -ociofiletransform ./a.cube -o ./c.exr");
    assert_eq!(place.values("c.exr")[..3], [0.25, 0.125, 0.5]);
}

#[test]
fn a_pasted_image_is_cut_unless_the_window_may_grow() {
    let place = Place::new();
    place.done("-pattern constant:color=1 4x4 1 -o ./a.exr");
    place.done("-pattern constant:color=0.5 8x4 1 -o ./b.exr");
    place.done("./a.exr ./b.exr -paste +6+0 -o ./c.exr");
    assert_eq!(place.values("c.exr")[..8], [0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 1.0, 1.0]);
    place.done("./a.exr ./b.exr -paste:mergeroi=1 +6+0 -o ./d.exr");
    assert_eq!((place.image("d.exr").spec().width, place.values("d.exr")[9]), (10, 1.0));
}
