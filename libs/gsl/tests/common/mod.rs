//! Functions that are shared by the tests of the compiler.

use granita_base::Severity;
use granita_gsl::{CompileOptions, ValidModule, compile, gso};

/// Compiles a shader that must be without errors and warnings.
#[allow(dead_code, reason = "not every test file uses it")]
pub(crate) fn module(source: &str) -> ValidModule {
    let compiled = compile(source, "t.gsl", &CompileOptions::default()).unwrap_or_else(|list| {
        panic!("{source}\n{}", list.iter().map(|d| d.to_string() + "\n").collect::<String>())
    });
    let warnings: Vec<String> = compiled.warnings.iter().map(ToString::to_string).collect();
    assert!(warnings.is_empty(), "{source}\n{}", warnings.join("\n"));
    let bytes = gso::write(&compiled.module, false);
    assert_eq!(gso::read(&bytes, "t.gso").as_ref(), Ok(&compiled.module), "{source}");
    compiled.module
}

/// Returns `line:column: severity: message` for all messages about a source, one per line.
#[allow(dead_code, reason = "not every test file uses it")]
pub(crate) fn said(source: &str) -> String {
    said_with(source, &CompileOptions::default())
}

/// Returns the messages as [`said`] does, with options.
pub(crate) fn said_with(source: &str, options: &CompileOptions<'_>) -> String {
    let list = match compile(source, "t.gsl", options) {
        Ok(compiled) => {
            assert!(compiled.warnings.iter().all(|d| d.severity == Severity::Warning));
            compiled.warnings
        }
        Err(list) => {
            assert!(list.iter().any(|d| d.severity == Severity::Error));
            list
        }
    };
    let lines: Vec<String> = list
        .iter()
        .map(|d| {
            let help = d.help.as_ref().map_or(String::new(), |h| format!(" [{h}]"));
            format!("{}:{}: {}: {}{help}", d.at.line, d.at.column, d.severity, d.message)
        })
        .collect();
    lines.join("\n")
}
