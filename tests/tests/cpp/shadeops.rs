//! Tests functions in C++ that shaders call.

use crate::support::*;
use std::path::Path;

/// Renders a square with a shader. Returns the colour of the middle pixel, and the output of the tool.
fn shaded(folder: &Path, shader: &str, name: &str, arguments: &[&str]) -> ([f32; 3], String) {
    shaded_in(folder, shader, name, arguments, "World ()\n")
}

/// Does the same with another beginning of the world.
fn shaded_in(folder: &Path, shader: &str, name: &str, arguments: &[&str], world: &str) -> ([f32; 3], String) {
    std::fs::write(folder.join(format!("{name}.gsl")), shader).unwrap();
    let scene = format!(
        "Attribute (\"int[2] resolution\", (16, 12))\nAttribute (\"string path:shader\", \".\")\n\
         Attribute (\"string projection\", \"orthographic\")\n\
         Parameter (\"int[4] quantize\", (0, 0, 0, 0))\nOutput (\"a.tif\", \"tiff\", \"rgb\", \"c\")\n{world}\
         Attribute (\"string name\", \"ball\")\nAttribute (\"float user:temperature\", 98.5)\n\
         Translate (0, 0, 3)\nParameter (\"float Kd\", 0.25)\nShader (\"surface\", \"{name}\")\n\
         Parameter (\"vertex point P\", (-2, -2, 0, 2, -2, 0, -2, 2, 0, 2, 2, 0))\nPatch (\"linear\", 2, 2)\nRender ()\n"
    );
    std::fs::write(folder.join("a.pyg"), scene).unwrap();
    let (status, out, err) = tool("gelato", folder, &[arguments, &["a.pyg"]].concat());
    assert!(status != 2, "{err}");
    let formats = granita_plugin::bundled_formats(granita_image::Limits::default());
    let pixels = formats.open(&folder.join("a.tif")).unwrap().read_level(0, 0).unwrap().to_floats();
    let middle = (6 * 16 + 8) * 3;
    ([pixels[middle], pixels[middle + 1], pixels[middle + 2]], out + &err)
}

/// 14.3: cubes of all types, polymorphic, interpreted and compiled.
#[test]
fn the_cube_of_chapter_14_compiles_and_runs() {
    let Some(text) = chapter("14-shadeops.txt") else { return };
    let source = listing(&text, "14.3 Basic Example", "#include \"shadeop.h\"", Some("14.4 Texture"));
    for compiler in compilers() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("cube.cpp");
        std::fs::write(&file, &source).unwrap();
        plugin(compiler, &file, "cube.so", &[]);
        let shader = "surface cubes (float Kd = 1) { color c = cube (color (1, 2, 3)); float f = cube (3);\n\
             point p = cube (point (u * 0 + 2, 1, 0)); if (u > 2) c = 0;\n\
             C = color (f, comp, p[0]) * 0 + color (f, c[2], p[0]); }"
            .replace("color (f, comp, p[0]) * 0 + ", "");
        let (color, said) = shaded(folder.path(), &shader, "cubes", &[]);
        assert_eq!((color, said.as_str()), ([27.0, 27.0, 8.0], ""));
        let (status, _, err) = tool("gslc", folder.path(), &["cubes.gsl"]);
        assert_eq!((status, err.as_str()), (0, ""));
        std::fs::remove_file(folder.path().join("cubes.gsl")).unwrap();
        let (_, out, err) = tool("gelato", folder.path(), &["a.pyg"]);
        assert_eq!((out + &err).as_str(), "");
        std::fs::write(folder.path().join("new.gsl"), shader.replace("cubes", "new")).unwrap();
        let (status, out, err) = tool("gslc", folder.path(), &["-debugdso", "new.gsl"]);
        let told = |line: &str| line.contains("dso: ") && line.contains("cube.so: declares cube in ");
        assert!(status == 0 && (out + &err).lines().any(told), "what is looked at is told, a file in a line");
        let (_, out, _) =
            tool("gslc", folder.path(), &["-debugdso", "-run", "-grid", "4x4", "-o", "null", "cubes.gso"]);
        assert!(!out.contains("error"), "{out}");
        // Without its library, a compiled shader reports the missing function.
        std::fs::remove_file(folder.path().join("cube.so")).unwrap();
        let (status, _, err) = tool("gelato", folder.path(), &["a.pyg"]);
        assert!(status == 1 && err.contains("no library declares shadeop `cube`"), "{err}");
    }
}

/// 14.4: an unfiltered lookup in a shadow map.
#[test]
fn the_shadow_lookup_of_chapter_14_compiles_and_runs() {
    let Some(text) = chapter("14-shadeops.txt") else { return };
    let source =
        listing(&text, "Below is an example of a DSO shadeop", "GELATO_EXPORT void", Some("14.4.2 Noise"));
    let source = format!(
        "#include \"shadeop.h\"\nusing namespace Gelato;\nextern \"C\" {{\n\
         GELATO_EXPORT const char *dso_shadeop[] = {{ \"float dso (point)\", NULL }};\n{source}\n}}\n"
    );
    for compiler in compilers() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("dso.cpp");
        std::fs::write(&file, &source).unwrap();
        plugin(compiler, &file, "dso.so", &[]);
        // A light from above sees a small square that covers the middle of a large one.
        let map = "Attribute (\"int[2] resolution\", (64, 64))\nAttribute (\"string projection\", \"orthographic\")\n\
             Attribute (\"float[4] screen\", (-2, 2, -2, 2))\n\
             Output (\"foo.z\", \"shadow\", \"z\", \"c\")\nWorld ()\nTranslate (0, 0, 1)\n\
             Parameter (\"vertex point P\", (-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0))\nPatch (\"linear\", 2, 2)\nRender ()\n";
        std::fs::write(folder.path().join("map.pyg"), map).unwrap();
        let (status, _, err) = tool("gelato", folder.path(), &["map.pyg"]);
        assert_eq!((status, err.as_str()), (0, ""));
        let (status, _, err) = tool("maketx", folder.path(), &["-shadow", "-o", "foo.sm", "foo.z"]);
        assert_eq!((status, err.as_str()), (0, ""), "{err}");
        let shader = "surface looks () { C = color (dso (point (\"world\", 0, 0, 2)), dso (point (\"world\", 1.7, 0, 2)), 0.5); }";
        let (color, said) = shaded(folder.path(), shader, "looks", &[]);
        assert_eq!(color, [1.0, 0.0, 0.5], "{said}");
        assert!(said.contains("Warning: you really should use a bigger shadow map"), "{said}");
    }
}

#[test]
fn shadeops_take_all_types_of_arguments() {
    for compiler in compilers() {
        let folder = tempfile::tempdir().unwrap();
        let source = own(folder.path(), "ops.cpp");
        plugin(compiler, &source, "ops.so", &[]);
        let run = |name: &str, body: &str| {
            let shader = format!("surface {name} (float Kd = 0) {{ {body} }}");
            let one = shaded(folder.path(), &shader, name, &["-threads", "1"]);
            assert_eq!(one, shaded(folder.path(), &shader, name, &["-threads", "4"]), "{name}");
            one
        };
        let quiet = |name: &str, body: &str, color: [f32; 3]| {
            assert_eq!(run(name, body), (color, String::new()), "{name}");
        };
        quiet("sn", "C = same_noise (P, noise (P), snoise (P[0]), pnoise (P[0], 3));", [1.0; 3]);
        quiet(
            "la",
            "float n = 0, m = 0; string s = label (\"row\", 3 * v * 0 + 12, n); C = color (n, s == \"row12\", label (\"\", 1, m) == \"1\");",
            [5.0, 1.0, 1.0],
        );
        quiet(
            "to",
            "float w[3] = { 1, 2, v * 0 + 3 }; C = color (total (w), total (matrix (2)), 0);",
            [6.0, 8.0, 0.0],
        );
        quiet(
            "nu",
            "float k = -1; if (u > 0.25) number (k); C = color (k >= 0, k == gridindex (), 1);",
            [1.0; 3],
        );
        quiet("su", "C = surroundings (u) + 0 * Kd;", [511.0; 3]);
        let (color, said) = run("wr", "C = color (0.5, wrong (v) * 0, 0.25);");
        assert_eq!(color, [0.5, 0.0, 0.25]);
        assert!(
            said.contains("shadeop `wrong`: told 7") && said.contains("threw an exception: no use"),
            "{said}"
        );
        assert_eq!(said.matches("told 7").count(), 1, "{said}");
        // These are arguments that no form accepts, and a function that no library declares.
        let (_, said) = run("mi", "C = total (\"x\");");
        assert!(said.contains("no form of `total` takes (string)") && said.contains("float[3]"), "{said}");
        let (_, said) = run("no", "C = nobody (1);");
        assert!(said.contains("unknown function `nobody`"), "{said}");
        // This is a red texture of 8 x 8 texels.
        let made = "P3\n8 8\n255\n".to_owned() + &"255 0 0\n".repeat(64);
        std::fs::write(folder.path().join("t.ppm"), made).unwrap();
        let (status, _, err) = tool("maketx", folder.path(), &["-o", "t.tx", "t.ppm"]);
        assert_eq!((status, err.as_str()), (0, ""));
        quiet("lo", "C = looked (\"t.tx\", u, v);", [1.0, 0.0, 0.0]);
        // The rays of a shadeop hit deferred input whose bound no camera sees.
        let wall = "Attribute (\"string geometryset\", \"mirror\")\nAttribute (\"color C\", (0, 1, 0))\n\
             Shader (\"surface\", \"constant\")\n\
             Parameter (\"vertex point P\", (-9, -9, -3, 9, -9, -3, -9, 9, -3, 9, 9, -3))\nPatch (\"linear\", 2, 2)\n";
        std::fs::write(folder.path().join("wall.pyg"), wall).unwrap();
        let input = "World ()\nInput (\"wall.pyg\", (-9, 9, -9, 9, -3.1, -2.9))\n";
        let shader = "surface be (float Kd = 0) { C = behind (\"mirror\"); }";
        assert_eq!(shaded_in(folder.path(), shader, "be", &[], input), ([0.0, 1.0, 0.0], String::new()));
        let shader = "surface nb (float Kd = 0) { C = behind (\"other\") + Kd; }";
        assert_eq!(shaded_in(folder.path(), shader, "nb", &[], input).0, [0.25; 3]);
        // The function is not available where plugins are not allowed.
        std::fs::write(folder.path().join("a.gsl"), "surface a () { C = label (\"\", 1, u); }").unwrap();
        let (_, said) = shaded(
            folder.path(),
            "surface sa () { float n; C = label (\"\", 1, n) == \"1\"; }",
            "sa",
            &["-safe"],
        );
        assert!(said.contains("unknown function `label`"), "{said}");
    }
}
