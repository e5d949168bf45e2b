//! Tests that the headers compile, and that their classes have the memory layout of the reference.

use crate::support::{compilers, headers};
use granita_tests::repository;
use std::process::Command;

const HEADERS: [&str; 11] = [
    "export.h",
    "paramtype.h",
    "errormanager.h",
    "gelatoapi.h",
    "imageio.h",
    "shadeop.h",
    "gsoargs.h",
    "granita_texture.h",
    "noise.h",
    "color.h",
    "vecmat.h",
];

#[test]
fn each_header_compiles_alone() {
    let folder = tempfile::tempdir().unwrap();
    for compiler in compilers() {
        for standard in ["c++98", "c++11", "c++17", "c++20"] {
            for header in HEADERS {
                let source = folder.path().join("one.cpp");
                std::fs::write(&source, format!("#include \"{header}\"\n#include \"{header}\"\n")).unwrap();
                let output = Command::new(compiler)
                    .args(["-Wall", "-Wextra", "-Werror", "-Wno-unused-parameter", "-fsyntax-only"])
                    .arg(format!("-std={standard}"))
                    .arg("-I")
                    .arg(headers())
                    .arg(&source)
                    .output()
                    .unwrap();
                let said = String::from_utf8_lossy(&output.stderr);
                assert!(output.status.success(), "{compiler} {standard} {header}: {said}");
            }
        }
    }
}

/// The order of the virtual functions is the binary interface (Itanium ABI) of reference A.
#[test]
fn the_order_of_virtual_functions_is_that_of_the_reference() {
    if !compilers().contains(&"clang++") {
        return granita_needs::skip("clang++");
    }
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("layout.cpp");
    std::fs::write(
        &source,
        "#include \"gelatoapi.h\"\n#include \"imageio.h\"\nusing namespace Gelato;\n\
         struct R : GelatoAPI { ErrorManager &Err (); }; R *r = new R;\n\
         struct G : GelatoAPI::Generator { }; G *g = new G;\n\
         struct H : ErrorHandler { void operator() (ErrCode, const char *) { } }; H *h = new H;\n\
         struct O : ImageOutput { bool open (const char *, const ImageIOFormatSpec &, int, const ImageIOParameter *,\
         bool) { return true; } bool close () { return true; } }; O *o = new O;\n\
         struct I : ImageInput { bool open (const char *, ImageIOFormatSpec &, int, const ImageIOParameter *)\
         { return true; } bool close () { return true; } bool read_native_scanline (int, int, void *) { return true; }\
         }; I *i = new I;\n",
    )
    .unwrap();
    let output = Command::new("clang++")
        .args(["-w", "-Xclang", "-fdump-vtable-layouts", "-emit-llvm", "-c", "-o", "/dev/null", "-I"])
        .arg(headers())
        .arg(&source)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let mut found = String::new();
    for class in [
        "GelatoAPI",
        "GelatoAPI::Generator",
        "Gelato::ErrorHandler",
        "Gelato::ImageOutput",
        "Gelato::ImageInput",
    ] {
        let begin =
            text.find(&format!("VTable indices for '{class}'")).unwrap_or_else(|| panic!("{class}: {text}"));
        let lines = text[begin..].lines().take_while(|line| !line.trim().is_empty());
        lines.for_each(|line| found += &format!("{}\n", line.trim_end()));
        found += "\n";
    }
    assert!(found.starts_with("VTable indices for 'GelatoAPI' (83 entries)."), "{found}");
    let golden = repository().join("tests/cpp/layout.txt");
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&golden, &found).unwrap();
    }
    assert_eq!(std::fs::read_to_string(golden).unwrap(), found);
}

#[test]
fn parameter_types_are_parsed_and_printed() {
    let folder = tempfile::tempdir().unwrap();
    let source = crate::support::own(folder.path(), "paramtype.cpp");
    for compiler in compilers() {
        let program = source.with_extension(compiler);
        // Some installations of clang lack the library of the sanitizers.
        let sanitize: &[&str] = match compiler {
            "g++" => &["-fsanitize=undefined,address", "-fno-sanitize-recover=all"],
            _ => &[],
        };
        let made = Command::new(compiler)
            .args(["-Wall", "-Werror"])
            .args(sanitize)
            .arg("-I")
            .arg(headers())
            .arg("-I")
            .arg(crate::support::own_folder())
            .arg(&source)
            .arg("-o")
            .arg(&program)
            .output()
            .unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        let ran = Command::new(&program).output().unwrap();
        assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    }
}
