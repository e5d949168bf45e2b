//! Tests that every construct of the grammar (reference 5.9) compiles. A few are also compared as IR.

mod common;
use common::module;

/// The bodies of surface shaders. `f` and `g` are floats, `c` is a color, `p` a point, `w` a vector, `m` a matrix and
/// `s` a string.
const STATEMENTS: &[&str] = &[
    ";",
    "{ }",
    "{ f = 1; { g = 2; } }",
    "f = 1 + 2 * 3 - 4 / 5;",
    "f = .5; f = 1.; f = 1.5e3; f = 1e-3; f = 2E+2; f = 1.0f;",
    "f = -f; f = !f; f = - - f; f = +f;",
    "f = (f == g) + (f != g) + (f < g) + (f <= g) + (f > g) + (f >= g);",
    "f = f < g && g < 3 || !f;",
    "f = c == color (1, 0, 0); f = p != P; f = m == 1; f = s == \"x\" || s != \"\";",
    "f = f ? 1 : g ? 2 : 3;",
    "f += 1; f -= 2; f *= 3; f /= 4; c *= 2; c += c; w -= w; m *= m; m /= 2;",
    "f = g = 3;",
    "f++; ++f; f--; --f; g = f++ + --f;",
    "c[0] = 1; c[f] = c[2]; p[1] += 3; m[1][2] = m[0][f]; c[0]++;",
    "float a[3]; a[0] = 1; a[f] = a[1] + 1; a[2]++; g = a[0];",
    "float a[3] = { 1, 2, f }; float b[2] = { 1 }; b[1] = a[0]; g = b[1];",
    "color a[2] = { 0, color (1, 2, 3) }; a[1][2] = a[0][1]; a[f] = c; c = a[0];",
    "matrix a[2]; a[1][2][3] = 4; f = a[0][1][2]; a[0] = 1;",
    "string a[2] = { \"x\", s }; s = a[1];",
    "float x, y = 2, z[2] = { 1, 2 }; x = y + z[0]; g = x;",
    "if (f) g = 1;",
    "if (f > 1) { g = 1; } else if (f > 0) g = 2; else { g = 3; }",
    "if (c) g = 1; if (s) g = 2; if (m) g = 3; if (p) g = 4; if (!s) g = 5;",
    "while (f < 3) f += 1;",
    "while (1) { f += 1; if (f > 3) break; if (f > 2) continue; g += 1; }",
    "do f += 1; while (f < 3);",
    "do { f += 1; if (f > 2) continue; } while (f < 3);",
    "for (f = 0; f < 3; f += 1) g += f;",
    "for (float i = 0, j = 1; i < 3; ++i) { g += i * j; }",
    "for (; f < 3;) ++f;",
    "for (;;) break;",
    "while (s) s = \"\";",
    "return;",
    "exit ();",
    "if (f) return; g = 1;",
    "c = color (1); c = color (1, 2, 3); c = color (\"hsv\", 1); c = color (\"hsv\", 1, 2, 3);",
    "p = point (1); p = point (1, 2, 3); p = point (s, 1); p = point (\"world\", f, g, 3);",
    "w = vector (1, 2, 3); w = vector (\"world\", 1, 2, 3); w = normal (1, 2, 3); w = normal (\"world\", 1);",
    "m = matrix (1); m = matrix (\"shader\", 1); m = 1 / m; m = m * m; m = 2; \
     m = matrix (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16); \
     m = matrix (\"world\", 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16);",
    "w = (vector) p; p = (point) f; c = (color) p; m = (matrix) f; p = (point) (c); w = (vector) 1;",
    "w = p - P; p = p + w; p = P * f; w = w / 2; w = N; p = w; w = -N + w;",
    "c = f; p = 0; w = 1; m = 0; N = 0;",
    "c = noise (p); f = noise (p); p = noise (f); w = snoise (f, g); c = cnoise (p, f); f = pnnoise (f, 2);",
    "c = 0.5 * noise (p) + 0.5; w = N + snoise (p); f = length ((vector) noise (p));",
    "c = texture (s, f, g); f = texture (s, f, g, \"blur\", 0.1); w = (normal) texture (s, f, g);",
    "c = (color) texture (s, f, g, f, f, g, g, \"alpha\", f, \"wrap\", \"black\");",
    "c = environment (s, w); c = environment (s, p, w, \"hitdist\", f, \"Phit\", p, \"Nhit\", w);",
    "c = environment (s, w, w, w); c = environment (s, p, w, w, w, \"space\", s);",
    "f = shadow (s, p); c = shadow (s, p, w, w, \"bias\", f);",
    "f = occlusion (s, p, w, 1, w, \"samples\", 16); f = occlusion (s, p, N, 1, \"samples\", 16);",
    "c = indirect (s, p, w, \"samples\", 64); c = subsurface (s, p, N, \"eta\", 1.3);",
    "c = min (c, 1); f = max (f, g); p = clamp (p, 0, 1); c = mix (c, c, f); m = mix (m, m, f);",
    "f = spline (f, 0, 1, 2, 3); c = spline (\"linear\", f, c, c, 0, 1, c); float k[5] = { 1, 2, 3, 4, 5 }; \
     f = spline (f, k); f = spline (\"bspline\", f, k);",
    "f = atan (f); f = atan (f, g); f = log (f); f = log (f, g); f = hypot (f, g); f = hypot (f, g, 1);",
    "p = transform (s, p); p = transform (s, s, p); p = transform (m, p); p = transform (m, s, p); \
     p = transform (s, m, p); p = transform (m, m, p); w = transformv (s, w); N = transformn (s, N);",
    "f = transformu (s, f); f = transformu (s, \"mm\", f); c = transformc (s, c); c = transformc (s, s, c);",
    "p = rotate (p, f, p, p); m = rotate (m, f, w); m = translate (m, p); m = scale (m, p); m = transpose (m);",
    "fresnel (w, N, f, f, g, w, w);",
    "f = random (); c = random (); p = random (f); f = random (p); c = randomgrid ();",
    "f = deltau (f); w = deltau (p); w = deltav (w); c = deltav (c); f = filterwidth (p); N = surfacenormal (p);",
    "f = aastep (0.5, f); f = aastep (0.5, f, g, \"filter\", \"box\"); f = samplearea (P);",
    "f = gridn () + gridnu () + gridnv () + gridindex (); f = gridany (s); f = gridany (f > 1); c = gridmin (c);",
    "printf (\"%f %c %p %m %s %d\\n\", f, c, p, m, s, g); error (\"x\"); fprintf (s, \"%g%%\", f);",
    "s = format (\"%f\", f); s = concat (s); s = concat (s, s, \"x\"); f = match (s, s); s = substr (s, 1, 2);",
    "c = ambient () + diffuse (N) + specular (N, w, f); f = luminance (specularbrdf (w, w, w, f));",
    "float r[2] = { 1, 2 }; spatialdbsave (s, p, N, c, \"resolution\", r); spatialdbsave (s, f, g, f);",
    "f = spatialdbquery (s, p, c, \"maxerror\", 1); f = spatialdbquery (s, p, N, f); f = spatialdbquery (s, f, g, w);",
    "f = getattribute (\"user:x\", c); f = getmessage (\"trace\", \"P\", p); setmessage (s, m);",
    "float r[2]; f = gettextureinfo (s, \"resolution\", r); f = r[0]; f = arraylength (r);",
    "bump (f); bump (\"shader\", f); bump (w);",
    "f = raylevel () + isshadowray () + isindirectray ();",
    "lights (P) { c += Cl; }",
    "lights (P, N, PI / 2) c += Cl * max (0, dot (normalize (L), N));",
    "lights (\"key & !rim\", P) { w = L; } lights (s, P, N, 1) { p = Pl; w = Nl; }",
    "trace (s, P, w, f, 16) { getmessage (\"trace\", \"hitdist\", f); }",
    "trace (s, P, w, f, 16, \"bias\", 0.1, \"distribution\", \"uniform\", \"shade\", 0) { g += 1; }",
    "f = PI + M_PI + M_PI_2 + M_E + M_LN2 + M_LN10 + M_SQRT2 + M_SQRT1_2;",
    "float x = 1; { float x = 2; f = x; } g = x;",
    "float twice (float x) { return 2 * x; } f = twice (twice (3));",
    "void put (float x, output float y) { y = x; } put (1, f); put (f, c[1]); float a[2]; put (2, a[1]); g = a[1];",
    "float sum (float a[]) { float t = 0; for (float i = 0; i < arraylength (a); ++i) t += a[i]; return t; } \
     float x[3] = { 1, 2, 3 }; f = sum (x);",
    "void nothing () { } nothing ();",
    "float clip (float x) { if (x > 1) return 1; if (x < 0) return 0; return x; } f = clip (g);",
    "float outer (float x) { float inner (float y) { return x + y; } return inner (1) + inner (x); } f = outer (2);",
    "float y = 3; float see () { return y; } f = see ();",
    "void inc (float x) { x += 1; } inc (f); inc (3); inc (f + 1);",
    "f = 1; // comment\n g = 2; /* more\n comment */ g = 3;",
    "s = \"a\\n\\t\\\\\\\"\\r\" \"b\";",
    "f = g; f = (f); f = ((f) + (g));",
    "float noise = 1; f = noise;",
    "float scale (float x) { return x; } f = scale (2);",
];

#[test]
fn all_statements_compile() {
    for body in STATEMENTS {
        module(&format!(
            "surface t (output float f = 0, output float g = 0, output color c = 0, output point p = 0,
                        output vector w = 0, output matrix m = 1, output string s = \"\") {{ {body} }}"
        ));
    }
}

#[test]
fn all_kinds_of_files_compile() {
    for source in [
        "surface a () { }",
        "surface a (float x = 1) { C = x; }",
        "displacement a (float x = 1) { P += x * N; N = surfacenormal (P); displace (x); displace (\"world\", x); }",
        "volume a (float x = 1) { C *= exp (-x * length (I)); opacity = 1; }",
        "light a () { Cl = 1; }",
        "light a () { emit (Ps + 1) { Cl = 1; } }",
        "light a () { emit (point (\"shader\", 0), vector (\"shader\", 0, 0, 1), 0.5) Cl = u; }",
        "light a () { emit (vector (0, 0, 1), 0) { Cl = 1; } }",
        "light a () { emit () { Cl = 1; L = -L; } }",
        "shader a () { P = P + L; C = Cl; }",
        "shader a () { emit (P) Cl = 1; lights (P) C = Cl; }",
        "float f () { return 1; } color g (float x) { return x * f (); } surface a () { C = g (2); }",
        "surface a [[ string description = \"d\", float layer = 1 ]] () { }",
        "surface a [[ ]] (float x = 1 [[ float UImin = 0, float UImax = -1, color k = color (1, 2, 3) ]]) { C = x; }",
        "surface a (float x = u [[ string d = \"x\" ]], point q = P, float y = x / 4) { C = x + y + q[0]; }",
        "surface a (float x[2] = { 1, 2 }, float y[] = { 1, 2, 3 }, output color z = 0) { z = x[0] + y[1]; }",
        "surface a (string n[] = { \"a\", \"b\" } [[ string d = \"x\" ]]) { C = texture (n[0], u, v); }",
        "surface a (normal n = normal (0, 0, 1), vector v = n, matrix m = 1) { N = n; C = v[0] + m[0][0]; }",
        "surface surface () { float light = 1, shader = 2, volume = 3, displacement = 4; C = light + shader + volume + displacement; }",
        "surface a (float C = 1) { opacity = C; }",
    ] {
        module(source);
    }
}

#[test]
fn listings_show_the_expected_operations() {
    let listing = |body: &str| {
        let m = module(&format!(
            "surface t (output float f = 0, output float g = 0, output color c = 0) {{ {body} }}"
        ));
        let text = m.listing();
        let at = text.find("surface t:\n").unwrap() + 11;
        text[at..].lines().map(|l| l.trim_start().to_owned()).collect::<Vec<_>>().join("; ")
    };
    for (body, expected) in [
        ("f = g + 1;", "f = Add g, 1"),
        ("c = f; c *= 2;", "c = Assign f; c = Mul c, 2"),
        ("c = 2 * 3;", "c = Assign (6)"),
        ("f = length (N - P);", "%1 = Sub N, P; f = length %1"),
        ("f++; g = f++;", "f = Add f, 1; %1 = Assign f; f = Add f, 1; g = Assign %1"),
        (
            "f = f > 1 && g > 2;",
            "%1 = Gt f, 1; %2 = Truth %1; $3 = Assign %2; if %2; %4 = Gt g, 2; $3 = Truth %4; f = Assign $3",
        ),
        ("f = f || g;", "%1 = Not f; $2 = Not %1; if %1; $2 = Truth g; f = Assign $2"),
        ("f = g ? 1 : 2;", "if g; $1 = Assign 1; else; $1 = Assign 2; f = Assign $1"),
        (
            "for (float i = 0; i < 3; ++i) { if (i > 1) continue; f += i; }",
            "i = Assign 0; loop while %1; test; %1 = Lt i, 3; body; %2 = Gt i, 1; if %2; continue; f = Add f, i; \
             step; i = Add i, 1",
        ),
        ("do f += 1; while (f < 3);", "loop, body first while %1; test; %1 = Lt f, 3; body; f = Add f, 1"),
        ("while (1) break;", "loop; body; break"),
        // A function with one return at its end needs no scope. Others do.
        ("float t (float x) { return 2 * x; } f = t (g);", "$1 = Mul 2, g; f = Assign $1"),
        (
            "float t (float x) { if (x > 1) return 1; return x; } f = t (g);",
            "scope 0; %1 = Gt g, 1; if %1; $2 = Assign 1; leave 0; $2 = Assign g; leave 0; f = Assign $2",
        ),
        // Arguments are passed by reference. The function changes the variable itself, or a copy that is stored back.
        ("void inc (float x) { x += 1; } inc (f);", "f = Add f, 1"),
        (
            "void inc (float x) { x += 1; } inc (c[1]);",
            "%1 = Component c, 1; $2 = Assign %1; $2 = Add $2, 1; c = ComponentSet 1, $2",
        ),
        ("void inc (float x) { x += 1; } inc (f + 1);", "%1 = Add f, 1; $2 = Assign %1; $2 = Add $2, 1"),
        // A result is stored directly where it is assigned, unless the function also reads it.
        ("c = color (c[2], 0, 0);", "%1 = Component c, 2; c = Construct %1, 0, 0"),
        ("c = mix (c, 1, f);", "%1 = mix c, (1), f; c = Assign %1"),
        ("return; f = 1;", "exit; f = Assign 1"),
        ("float x; x = f; g = x;", "x = Assign 0; x = Assign f; g = Assign x"),
        (
            "float a[2] = { 1, 2 }; a[0] = f; g = a[1];",
            "a = Assign (1 2); a = IndexSet 0, f; %1 = Index a, 1; g = Assign %1",
        ),
    ] {
        assert_eq!(renumbered(&listing(body)), expected, "{body}");
    }
}

/// Renumbers temporaries and unnamed locals by order of appearance.
fn renumbered(text: &str) -> String {
    let mut known: Vec<String> = Vec::new();
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(['%', '$']) {
        let digits = rest[at + 1..].chars().take_while(char::is_ascii_digit).count();
        let word = rest[at..=at + digits].to_owned();
        out.push_str(&rest[..=at]);
        rest = &rest[at + 1 + digits..];
        let n = known.iter().position(|k| *k == word).unwrap_or_else(|| {
            known.push(word);
            known.len() - 1
        });
        out.push_str(&(n + 1).to_string());
    }
    out + rest
}

#[test]
fn a_module_knows_its_reads_writes_and_derivatives() {
    use granita_gsl::ir::Global;
    let m = module("surface t (float x = u) { lights (P) { C += Cl * dot (L, N); } N = 1; opacity = x; }");
    assert_eq!(m.reads, [Global::P, Global::N, Global::u, Global::L, Global::Cl, Global::C]);
    assert_eq!(m.writes, [Global::N, Global::C, Global::opacity]);
    assert!(!m.needs_derivatives);
    assert!(module("surface t () { C = texture (\"a\", u, v); }").needs_derivatives);
    assert!(!module("surface t () { C = texture (\"a\", u, v, 0, 0, 0, 0); }").needs_derivatives);
    let m = module("displacement t () { displace (1); }");
    assert_eq!(m.writes, [Global::P, Global::N]);
    // Functions that are never called do not count.
    assert!(module("void f () { P = 0; } surface t () { C = 1; }").writes == [Global::C]);
}

#[test]
fn the_best_fitting_overload_is_chosen() {
    let calls = |body: &str| {
        let m = module(&format!(
            "surface t (output float f = 0, output color c = 0, output point p = 0) {{ {body} }}"
        ));
        let symbol = |id: granita_gsl::ir::SymbolId| m.symbol(id).ty.value.word();
        let mut out = Vec::new();
        for s in &m.body {
            let granita_gsl::ir::Stmt::Op(op) = s else { continue };
            let granita_gsl::ir::OpCode::Call(func) = op.code else { continue };
            let args: Vec<_> = op.args.iter().map(|a| symbol(*a)).collect();
            out.push(format!("{} {} ({})", op.dst.map_or("void", symbol), func.word(), args.join(" ")));
        }
        out.join("; ")
    };
    assert_eq!(calls("f = noise (p);"), "float noise (point)");
    assert_eq!(calls("c = noise (f);"), "color noise (float)");
    assert_eq!(calls("c = 0.5 * noise (p, f);"), "color noise (point float)");
    assert_eq!(calls("f = noise (p) < 0.5;"), "float noise (point)");
    assert_eq!(
        calls("c = mix (c, noise (p), noise (p));"),
        "color noise (point); float noise (point); color mix (color color float)"
    );
    assert_eq!(calls("c = color (noise (f), 1, 2);"), "float noise (float)");
    assert_eq!(
        calls("displace_ (noise (p));".replace("displace_", "bump").as_str()),
        "float noise (point); void bump (float)"
    );
    assert_eq!(calls("c = max (f, 1);"), "float max (float float)");
    assert_eq!(calls("c = max (c, 1);"), "color max (color color)");
    assert_eq!(calls("c = clamp (noise (p), 0, 1);"), "color noise (point); color clamp (color color color)");
    assert_eq!(calls("p = (point) texture (\"\", f, f);"), "color texture (string float float)");
    assert_eq!(calls("f = distance (p, p, p);"), "float distance (point point point)");
    assert_eq!(
        calls("f = luminance (texture (\"\", f, f));"),
        "color texture (string float float); float luminance (color)"
    );
}
