//! Tests that the bundled shaders compile without messages and survive encoding and decoding.

use granita_gsl::{CompileOptions, GsoArgs, compile, gso};

#[test]
fn bundled_shaders_compile_without_warnings() {
    let mut said = Vec::new();
    for name in granita_bundled::shader_names() {
        let file = format!("{name}.gsl");
        match compile(granita_bundled::shader(name).unwrap(), &file, &CompileOptions::default()) {
            Ok(compiled) => {
                assert_eq!(&*compiled.module.name, name);
                said.extend(compiled.warnings);
            }
            Err(list) => said.extend(list),
        }
    }
    let said: Vec<String> = said.iter().map(ToString::to_string).collect();
    assert!(said.is_empty(), "{}", said.join("\n"));
}

#[test]
fn modules_survive_write_and_read() {
    for name in granita_bundled::shader_names() {
        let source = granita_bundled::shader(name).unwrap();
        let module = compile(source, name, &CompileOptions::default()).unwrap().module;
        for encrypt in [false, true] {
            let bytes = gso::write(&module, encrypt);
            assert_eq!(bytes, gso::write(&module, encrypt), "{name}: the same bytes every time");
            assert_eq!(gso::read(&bytes, name).unwrap_or_else(|e| panic!("{e}")), module, "{name}");
            assert_eq!(GsoArgs::from_bytes(&bytes, name).unwrap(), GsoArgs::from_module(&module), "{name}");
        }
    }
}
