//! The globals that a kind of shader may read and write, and the statements that it may use (reference 5.1.2, table
//! 5.4).

use crate::ir::{Global, ShaderKind};

/// Returns the reason why `global` cannot be read here; `None` when it can. Generic shaders are checked when they
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

/// Returns the reason why `global` cannot be written here; `None` when it can.
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

/// Returns the reason why a `lights` statement is not permitted; `None` when it is.
pub(crate) fn lights(kind: ShaderKind) -> Option<String> {
    let allowed = matches!(kind, ShaderKind::Surface | ShaderKind::Volume | ShaderKind::Generic);
    (!allowed).then(|| format!("there can be no `lights` in a {} shader", article_free(kind)))
}

/// Returns the reason why a function that gathers light cannot be called; `None` when it can.
pub(crate) fn gather(kind: ShaderKind, function: &str) -> Option<String> {
    lights(kind).map(|_| format!("`{function}` gathers light, which a {} shader cannot", article_free(kind)))
}

/// Returns the reason why an `emit` statement is not permitted; `None` when it is.
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
