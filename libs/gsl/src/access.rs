//! Which global a kind of shader may read and write, and what it may do (reference 5.1.2, table 5.4).

use crate::ir::{Global, ShaderKind};

/// Why `global` cannot be read here; `None` when it can. Lax for generic shaders: their use is known when they
/// are attached.
pub(crate) fn read(kind: ShaderKind, global: Global, in_lights: bool) -> Option<String> {
    use Global::{C, Cl, I, L, Nl, Ns, Pl, Ps, opacity};
    let word = global.word();
    let light_variable = matches!(global, L | Cl | Pl | Nl);
    let never = match kind {
        ShaderKind::Generic => false,
        ShaderKind::Surface | ShaderKind::Volume => {
            if light_variable && !in_lights {
                return Some(format!("`{word}` can be read in a `lights` loop only"));
            }
            matches!(global, Ps | Ns)
        }
        ShaderKind::Displacement => light_variable || matches!(global, I | Ps | Ns | C | opacity),
        ShaderKind::Light => matches!(global, C | opacity),
    };
    never.then(|| format!("there is no `{word}` in a {} shader", kind.word()))
}

/// Why `global` cannot be written here; `None` when it can.
pub(crate) fn write(kind: ShaderKind, global: Global) -> Option<String> {
    use Global::{C, Cl, L, N, P, opacity};
    let allowed = match kind {
        ShaderKind::Generic => matches!(global, P | N | C | opacity | L | Cl),
        ShaderKind::Surface => matches!(global, N | C | opacity),
        ShaderKind::Volume => matches!(global, C | opacity),
        ShaderKind::Displacement => matches!(global, P | N),
        ShaderKind::Light => matches!(global, L | Cl),
    };
    (!allowed).then(|| format!("a {} shader cannot change `{}`", article_free(kind), global.word()))
}

/// Why there can be no `lights` statement; `None` when there can.
pub(crate) fn lights(kind: ShaderKind) -> Option<String> {
    let allowed = matches!(kind, ShaderKind::Surface | ShaderKind::Volume | ShaderKind::Generic);
    (!allowed).then(|| format!("there can be no `lights` in a {} shader", article_free(kind)))
}

/// Why a function that gathers light cannot be called; `None` when it can.
pub(crate) fn gather(kind: ShaderKind, function: &str) -> Option<String> {
    lights(kind).map(|_| format!("`{function}` gathers light, which a {} shader cannot", article_free(kind)))
}

/// Why there can be no `emit` statement; `None` when there can.
pub(crate) fn emit(kind: ShaderKind) -> Option<String> {
    let allowed = matches!(kind, ShaderKind::Light | ShaderKind::Generic);
    (!allowed).then(|| "`emit` is for light shaders".to_owned())
}

fn article_free(kind: ShaderKind) -> &'static str {
    match kind {
        ShaderKind::Generic => "generic",
        other => other.word(),
    }
}
