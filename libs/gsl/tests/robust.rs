//! Tests that every input has a result, without a panic, an endless loop or a stack overflow.

mod common;
use common::said;
use granita_gsl::{CompileOptions, GsoArgs, ValidModule, compile, gso};
use proptest::prelude::*;

/// Checks that the messages about a deeply nested source contain `expected`.
fn refused(source: &str, expected: &str) {
    let found = said(source);
    assert!(found.contains(expected), "{}", found.chars().take(300).collect::<String>());
}

#[test]
fn deep_nesting_is_an_error() {
    let n = 100_000;
    let deep = "is nested more than";
    refused(&format!("surface t () {{ C = {}1{}; }}", "(".repeat(n), ")".repeat(n)), deep);
    refused(&format!("surface t () {{ C = {}1; }}", "-".repeat(n)), deep);
    refused(&format!("surface t () {{ C = {}1; }}", "! ".repeat(n)), deep);
    refused(&format!("surface t () {{ C = {}1; }}", "(color) ".repeat(n)), deep);
    refused(&format!("surface t () {{ C = u{}; }}", " = u".repeat(n)), deep);
    refused(&format!("surface t () {{ C = {}u{}; }}", "u ? ".repeat(n), " : u".repeat(n)), deep);
    refused(&format!("surface t () {{ C = {}1{}; }}", "sin (".repeat(n), ")".repeat(n)), deep);
    refused(&format!("surface t () {{ C = {}1{}; }}", "C[".repeat(n), "]".repeat(n)), deep);
    refused(&format!("surface t () {{ C = u{}; }}", "++".repeat(n)), "needs a variable");
    refused(&format!("surface t () {{ {}{} }}", "{".repeat(n), "}".repeat(n)), deep);
    refused(&format!("surface t () {{ {} C = 1; }}", "if (u) ".repeat(n)), deep);
    refused(&format!("surface t () {{ {} C = 1; }}", "if (u) ; else while (u) ".repeat(1000)), deep);
    refused(&format!("surface t () {{ {} C = 1; }}", "while (u) ".repeat(n)), deep);
    refused(&format!("surface t () {{ {} }}", "float f () {".repeat(n)), deep);
    refused(&format!("surface t {}", "[[ float a = 1 ]]".repeat(n)), "expected");
    refused(&format!("#if {}\n#endif\n", "(".repeat(n)), deep);
    refused(&format!("{}\n", "#if 1\n".repeat(n)), "has no `#endif`");
    let calls =
        |n: usize| format!("#define f(x) x\nsurface t () {{ C = {}1{}; }}", "f(".repeat(n), ")".repeat(n));
    refused(&calls(n), "grows too large");
    refused(&calls(500), "nested more than");
}

#[test]
fn nesting_up_to_the_limit_compiles() {
    // Everything that the parser accepts must pass through the later stages as well.
    let ok = |source: &str| {
        let compiled = compile(source, "t.gsl", &CompileOptions::default());
        let module = compiled.unwrap_or_else(|l| panic!("{}", l[0])).module;
        assert_eq!(gso::read(&gso::write(&module, true), "t").unwrap(), module);
    };
    ok(&format!("surface t () {{ C = {}u{}; }}", "(".repeat(80), ")".repeat(80)));
    ok(&format!("surface t () {{ C = u{}; }}", " + u".repeat(190)));
    ok(&format!("surface t () {{ C = {}u{}; }}", "sin (".repeat(90), ")".repeat(90)));
    ok(&format!("surface t () {{ {} C = 1; }}", "if (u) ".repeat(190)));
    ok(&format!("surface t () {{ {} C = 1; }}", "if (u) ; else ".repeat(190)));
    ok(&format!("surface t () {{ C = u{}; }}", " ? u : v".repeat(90)));
    ok(&format!("surface t () {{ C = {}noise (P){}; }}", "noise (".repeat(60), ")".repeat(60)));
}

#[test]
fn long_sequences_are_not_limited_by_the_nesting_limit() {
    // A sequence is not nesting, whatever its length is.
    let n = 10_000;
    let ok = |source: &str| {
        let compiled = compile(source, "t.gsl", &CompileOptions::default());
        let module = compiled.unwrap_or_else(|l| panic!("{}", l[0])).module;
        assert_eq!(gso::read(&gso::write(&module, true), "t").unwrap(), module);
        module.symbols.len()
    };
    // Sums need only a few temporaries.
    let few = 100;
    for term in [" + u", " - u * v", " * 2 / u", " + C[1]", " + (u + 1)", " + noise (P)"] {
        let symbols = ok(&format!("surface t () {{ C = u{}; }}", term.repeat(n)));
        assert!(symbols < few, "{term}: {symbols}");
    }
    for term in [" + 1", " < u", " == C", " != P", " && u", " || C", " && u || v < 1", " ? u : v"] {
        ok(&format!("surface t () {{ C = u{}; }}", term.repeat(n)));
    }
    let arms = |k: usize| format!("if (u < {k}) C = {k};");
    let chain: Vec<String> = (0..n).map(arms).collect();
    ok(&format!("surface t () {{ {} else C = 7; }}", chain.join(" else ")));
    ok(&format!("float f () {{ {} return 3; }} surface t () {{ C = f (); }}", chain.join(" else ")));
    ok(&format!("surface t () {{ {} }}", chain.join(" ")));
    let choice: Vec<String> = (0..n).map(|k| format!("u < {k} ? {k} : ")).collect();
    ok(&format!("surface t () {{ C = {}C; }}", choice.concat()));
    let list: Vec<String> = (0..n).map(|k| format!("u + {k}")).collect();
    ok(&format!("surface t () {{ float a[{n}] = {{ {} }}; C = a[3]; }}", list.join(", ")));
    ok(&format!("surface t () {{ C = spline (u, {}); }}", list.join(", ")));
    ok(&format!("surface t (string s = \"a\") {{ string r = concat (s{}); }}", ", s".repeat(n)));
    ok(&format!("surface t () {{ {} }}", "C = C + 1; ".repeat(n)));
    ok(&format!("#if 1{}\n#endif\nsurface t () {{ }}", " + 1".repeat(n)));
    let functions: Vec<String> = (0..n).map(|k| format!("float f{k} (float x) {{ return x; }}\n")).collect();
    ok(&format!("{}surface t () {{ C = f{} (u); }}", functions.concat(), n - 1));
}

#[test]
fn nested_conditional_expressions_compile_quickly() {
    // Exponential time results if each level determines the possible types of the next one twice.
    let n = 60;
    let source = format!("surface t () {{ C = {}noise (P){}; }}", "u ? ".repeat(n), " : 1".repeat(n));
    compile(&source, "t.gsl", &CompileOptions::default()).unwrap();
}

#[test]
fn messages_about_long_expressions_are_short() {
    let words = |source: &str| said(source).len();
    let long = " + u".repeat(10_000);
    assert!(words(&format!("surface t () {{ C = u{long} + unknown{long}; }}")) < 400);
    assert!(words(&format!("surface t () {{ C = min (u{}); }}", ", u".repeat(10_000))) < 600);
    let source = format!("surface t () {{ {} C = P; }}", "u + 1;\n".repeat(5000));
    let compiled = compile(&source, "t.gsl", &CompileOptions::default()).unwrap_err();
    assert_eq!(compiled.len(), 202);
    assert_eq!(compiled[201].message, "too many warnings: 4800 more are not shown");
}

#[test]
fn growth_by_inlining_is_limited() {
    // Each function calls the previous one twice.
    let mut source = String::from("float f0 (float x) { return x + 1; }\n");
    for i in 1..60 {
        source += &format!("float f{i} (float x) {{ return f{0} (x) + f{0} (x); }}\n", i - 1);
    }
    refused(
        &format!("{source}surface t () {{ C = f59 (u); }}"),
        "operations when functions are put in place",
    );
    // The blocks are nested through functions.
    let mut source = String::from("void f0 () { C = 1; }\n");
    for i in 1..300 {
        source += &format!("void f{i} () {{ if (u) f{} (); }}\n", i - 1);
    }
    refused(&format!("{source}surface t () {{ f299 (); }}"), "when functions are put in place");
    let mut source = String::from("float f0 (float x) { return x; }\n");
    for i in 1..2000 {
        source += &format!("float f{i} (float x) {{ return f{} (x); }}\n", i - 1);
    }
    refused(&format!("{source}surface t () {{ C = f1999 (u); }}"), "nested more than");
    // The macros double.
    let mut source = String::from("#define m0 1 +\n");
    for i in 1..60 {
        source += &format!("#define m{i} m{0} m{0}\n", i - 1);
    }
    refused(&format!("{source}surface t () {{ C = m59 1; }}"), "grows too large");
    let mut source = String::from("#define m0(x) x x\n");
    for i in 1..60 {
        source += &format!("#define m{i}(x) m{0} (x) m{0} (x)\n", i - 1);
    }
    refused(&format!("{source}surface t () {{ C = m59 (1); }}"), "grows too large");
}

#[test]
fn truncated_and_changed_files_are_refused() {
    let source = granita_bundled::shader("spotlight").unwrap();
    let module = compile(source, "spotlight.gsl", &CompileOptions::default()).unwrap().module;
    for encrypt in [false, true] {
        let bytes = gso::write(&module, encrypt);
        for n in 0..bytes.len() {
            let error = gso::read(&bytes[..n], "s.gso").unwrap_err().to_string();
            let expected =
                if n < 8 { "s.gso: it is not a compiled shader" } else { "s.gso: the file ends too early" };
            assert!(error.starts_with(expected), "{n}: {error}");
            assert!(GsoArgs::from_bytes(&bytes[..n], "s.gso").is_err());
        }
        for i in 0..bytes.len() {
            let mut altered = bytes.clone();
            altered[i] ^= 0x10;
            assert!(gso::read(&altered, "s.gso").is_err(), "byte {i}");
            assert!(GsoArgs::from_bytes(&altered, "s.gso").is_err(), "byte {i}");
        }
        let mut longer = bytes.clone();
        longer.push(0);
        assert!(gso::read(&longer, "s.gso").unwrap_err().to_string().contains("too long"));
        let mut newer = bytes.clone();
        newer[8] = 2;
        let error = gso::read(&newer, "s.gso").unwrap_err().to_string();
        assert_eq!(error, "s.gso: version 2 of compiled shaders is not supported, only 1; compile it again");
    }
    assert_eq!(
        gso::read(source.as_bytes(), "s.gsl").unwrap_err().to_string(),
        "s.gsl: it is not a compiled shader; it may be source text"
    );
    assert!(gso::read(&[], "s").is_err());
}

#[test]
fn encrypted_files_hide_variable_names_but_not_parameters() {
    let source = "surface t (float visible = 1) { float hidden = u * visible; C = hidden; }";
    let module = compile(source, "t.gsl", &CompileOptions::default()).unwrap().module;
    let has = |bytes: &[u8], word: &str| bytes.windows(word.len()).any(|w| w == word.as_bytes());
    let (plain, mixed) = (gso::write(&module, false), gso::write(&module, true));
    assert!(has(&plain, "hidden") && has(&plain, "visible"));
    assert!(!has(&mixed, "hidden") && has(&mixed, "visible"));
}

/// The pieces of generated sources.
const PIECES: &[&str] = &[
    "surface",
    "t",
    "(",
    ")",
    "{",
    "}",
    "[",
    "]",
    "[[",
    "]]",
    ";",
    ",",
    "=",
    "+",
    "-",
    "*",
    "/",
    "==",
    "&&",
    "||",
    "!",
    "?",
    ":",
    "++",
    "--",
    "+=",
    "float",
    "color",
    "point",
    "matrix",
    "string",
    "void",
    "output",
    "if",
    "else",
    "while",
    "do",
    "for",
    "break",
    "continue",
    "return",
    "lights",
    "emit",
    "trace",
    "C",
    "P",
    "N",
    "u",
    "x",
    "y",
    "noise",
    "texture",
    "mix",
    "spline",
    "transform",
    "getmessage",
    "printf",
    "exit",
    "\"a\"",
    "1",
    "0.5",
    "\n",
    "#",
    "#define",
    "#if",
    "#endif",
    "#else",
    "defined",
    "##",
    "\"%f\"",
    "PI",
    "arraylength",
    "fresnel",
    "<",
    ">",
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn random_text_does_not_panic(text in ".{0,200}") {
        let _ = compile(&text, "t.gsl", &CompileOptions::default());
        let _ = compile(&format!("surface t () {{ {text} }}"), "t.gsl", &CompileOptions::default());
    }

    #[test]
    fn random_bytes_do_not_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let _ = compile(&String::from_utf8_lossy(&bytes), "t.gsl", &CompileOptions::default());
        prop_assert!(gso::read(&bytes, "t").is_err());
        prop_assert!(GsoArgs::from_bytes(&bytes, "t").is_err());
    }

    #[test]
    fn random_tokens_do_not_panic(pieces in prop::collection::vec(prop::sample::select(PIECES), 0..60)) {
        let text = pieces.join(" ");
        for source in [
            text.clone(),
            format!("surface t (float x = 1, output color y = 0) {{ {text} }}"),
            format!("float x ({text}) {{ }} surface t () {{ }}"),
            format!("surface t (float x = {text}) {{ }}"),
            format!("surface t () {{ C = {text}; }}"),
        ] {
            if let Ok(compiled) = compile(&source, "t.gsl", &CompileOptions::default()) {
                let bytes = gso::write(&compiled.module, false);
                prop_assert_eq!(gso::read(&bytes, "t").unwrap(), compiled.module);
            }
        }
    }

    #[test]
    fn changed_bundled_shaders_do_not_panic(
        which in any::<prop::sample::Index>(),
        at in any::<prop::sample::Index>(),
        cut in 0usize..30,
        piece in prop::sample::select(PIECES),
    ) {
        let names: Vec<_> = granita_bundled::shader_names().collect();
        let text: Vec<char> = granita_bundled::shader(names[which.index(names.len())]).unwrap().chars().collect();
        let at = at.index(text.len());
        let end = (at + cut).min(text.len());
        let source: String = text[..at].iter().chain(&piece.chars().collect::<Vec<_>>()).chain(&text[end..]).collect();
        if let Ok(compiled) = compile(&source, "t.gsl", &CompileOptions::default()) {
            let bytes = gso::write(&compiled.module, true);
            prop_assert_eq!(gso::read(&bytes, "t").unwrap(), compiled.module);
        }
    }
}

#[test]
fn changed_modules_are_validated_again() {
    use granita_gsl::ir::{
        ConstValue, Op, OpCode, SourcePos, Stmt, Symbol, SymbolId, SymbolKind, SymbolType, ValueType,
    };
    let source = "surface t (float Kd = 0.5) { C = Kd * u; }";
    let module = compile(source, "t.gsl", &CompileOptions::default()).unwrap().module;
    let op = |code, dst, args: &[u32]| {
        let args = args.iter().copied().map(SymbolId).collect();
        Stmt::Op(Op { code, dst: Some(SymbolId(dst)), args, at: SourcePos::default() })
    };
    let kd = module.params[0].symbol.0;
    let missing = module.symbols.len() as u32;
    for (what, body) in [
        ("there is no symbol", op(OpCode::Assign, kd, &[missing])),
        ("there is no symbol", op(OpCode::Assign, missing, &[kd])),
        ("does not take its operands", op(OpCode::Add, kd, &[kd])),
        ("does not take its operands", op(OpCode::Call(granita_gsl::Func::Pow), kd, &[kd])),
        ("there is no loop", Stmt::Break),
    ] {
        let mut changed = (*module).clone();
        changed.body.push(body);
        let error = ValidModule::check(changed, "t.gsl").unwrap_err().to_string();
        assert!(error.starts_with("t.gsl: the code is not valid: ") && error.contains(what), "{error}");
    }
    let mut changed = (*module).clone();
    changed.params[0].symbol = SymbolId(missing);
    assert!(ValidModule::check(changed, "t").is_err());
    let mut changed = (*module).clone();
    changed.symbols.truncate(1);
    assert!(ValidModule::check(changed, "t").is_err());
    // A constant must have a value.
    let mut changed = (*module).clone();
    let ty = SymbolType { value: ValueType::Float, array: Some(0), open: true };
    let kind = SymbolKind::Const(ConstValue::Floats(Vec::new().into()));
    changed.symbols.push(Symbol { name: "".into(), ty, kind });
    assert!(ValidModule::check(changed, "t").is_err());
}
