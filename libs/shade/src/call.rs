//! Calls with options, resolved when code is linked.
//!
//! Names of options may be any string expressions in the language. Nearly all are constants, which are matched once
//! at link time. A call with a name that is not constant is resolved each time it runs.

use crate::MapHandle;
use crate::services::{
    EnvironmentOptions, GatherOptions, OptionTable, QueryOptions, SaveOptions, ShadowOptions, StepOptions,
    SubsurfaceOptions, TextureOptions, TraceOptions, is_lookup_option,
};
use granita_gsl::Func;
use granita_gsl::ir::{ConstValue, Symbol, SymbolId, SymbolKind, ValueType};

/// A call with options.
#[derive(Debug)]
pub(crate) struct Call {
    /// The operands before the options.
    pub(crate) operands: Vec<SymbolId>,
    /// The handle of a lookup with a constant name, where the renderer keeps the map that it finds by this name.
    pub(crate) handle: Option<MapHandle>,
    kind: Kind,
    options: Vec<(SymbolId, SymbolId)>,
    /// The resolved options; `None` when some name is not constant.
    resolved: Option<Resolved>,
}

/// The kind of options that a call has.
#[derive(Clone, Copy, Debug)]
enum Kind {
    Texture,
    Environment,
    Shadow,
    Trace,
    Gather,
    Save,
    Query,
    Subsurface,
    Step,
}

/// Options by the symbols of their values.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Options {
    Texture(TextureOptions<SymbolId, SymbolId>),
    Environment(EnvironmentOptions<SymbolId, SymbolId>),
    Shadow(ShadowOptions<SymbolId, SymbolId>),
    Trace(TraceOptions<SymbolId, SymbolId>),
    Gather(GatherOptions<SymbolId, SymbolId>),
    Save(SaveOptions<SymbolId, SymbolId>),
    Query(QueryOptions<SymbolId, SymbolId>),
    Subsurface(SubsurfaceOptions<SymbolId, SymbolId>),
    Step(StepOptions<SymbolId, SymbolId>),
}

/// The variables that receive further results of a lookup.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Results {
    pub(crate) alpha: Option<SymbolId>,
    pub(crate) hitdist: Option<SymbolId>,
    pub(crate) p_hit: Option<SymbolId>,
    pub(crate) n_hit: Option<SymbolId>,
    pub(crate) direction: Option<SymbolId>,
}

impl Results {
    fn set(&mut self, name: &str, variable: SymbolId) -> bool {
        let place = match name {
            "alpha" => &mut self.alpha,
            "hitdist" => &mut self.hitdist,
            "Phit" => &mut self.p_hit,
            "Nhit" => &mut self.n_hit,
            "direction" => &mut self.direction,
            _ => return false,
        };
        *place = Some(variable);
        true
    }
}

/// The options of a call with constant names.
#[derive(Clone, Debug)]
pub(crate) struct Resolved {
    pub(crate) options: Options,
    pub(crate) results: Results,
    /// Names that the call does not support.
    pub(crate) unknown: Vec<String>,
}

impl Call {
    /// Returns a call of a function; `None` for functions without options.
    pub(crate) fn of(func: Func, args: &[SymbolId], symbols: &[Symbol]) -> Option<Self> {
        let (kind, first) = match func {
            Func::Texture => (Kind::Texture, 3),
            Func::Texture3d => (Kind::Texture, 2),
            Func::Environment => (Kind::Environment, 2),
            Func::Shadow => (Kind::Shadow, 2),
            Func::Indirect => (Kind::Gather, 3),
            Func::Occlusion => (Kind::Gather, 4),
            Func::SpatialDbSave => (Kind::Save, 3),
            Func::SpatialDbQuery => (Kind::Query, 3),
            Func::Subsurface => (Kind::Subsurface, 3),
            Func::AaStep => (Kind::Step, 2),
            _ => return None,
        };
        let first = (first..args.len()).find(|&k| is_text(symbols, args[k])).unwrap_or(args.len());
        let options = args[first..].chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
        Some(Self::new(kind, args[..first].to_vec(), options, symbols))
    }

    /// Returns a `trace` statement.
    pub(crate) fn of_trace(options: &[(SymbolId, SymbolId)], symbols: &[Symbol]) -> Self {
        Self::new(Kind::Trace, Vec::new(), options.to_vec(), symbols)
    }

    fn new(
        kind: Kind,
        operands: Vec<SymbolId>,
        options: Vec<(SymbolId, SymbolId)>,
        symbols: &[Symbol],
    ) -> Self {
        let constant = |s: SymbolId| match &symbols[s.0 as usize].kind {
            SymbolKind::Const(ConstValue::Strings(texts)) => texts.first().map(|text| &**text),
            _ => None,
        };
        let is_map = matches!(kind, Kind::Texture | Kind::Environment | Kind::Shadow);
        let handle = operands.first().filter(|&&name| is_map && constant(name).is_some());
        let known = options.iter().all(|(name, _)| constant(*name).is_some());
        let resolved = known.then(|| {
            let name = |s: SymbolId| constant(s).unwrap_or_default();
            resolve(kind, &options, &name, &|s| is_text(symbols, s))
        });
        Self { handle: handle.map(|_| MapHandle::default()), operands, kind, options, resolved }
    }

    /// Returns the options resolved at link time; `None` when some name is available only when the call runs.
    pub(crate) fn resolved(&self) -> Option<&Resolved> {
        self.resolved.as_ref()
    }

    /// Resolves the options by the names at run time.
    pub(crate) fn resolve<'t>(
        &self,
        name: &dyn Fn(SymbolId) -> &'t str,
        is_text: &dyn Fn(SymbolId) -> bool,
    ) -> Resolved {
        resolve(self.kind, &self.options, name, is_text)
    }

    /// Returns the symbols of the names.
    pub(crate) fn names(&self) -> impl Iterator<Item = SymbolId> + '_ {
        self.options.iter().map(|(name, _)| *name)
    }
}

fn is_text(symbols: &[Symbol], s: SymbolId) -> bool {
    symbols[s.0 as usize].ty.value == ValueType::String
}

/// Sorts options by their names. The last value of a repeated option counts.
fn resolve<'t>(
    kind: Kind,
    options: &[(SymbolId, SymbolId)],
    name: &dyn Fn(SymbolId) -> &'t str,
    is_text: &dyn Fn(SymbolId) -> bool,
) -> Resolved {
    let mut list = Vec::with_capacity(options.len());
    list.extend(options.iter().map(|(option, value)| (name(*option), *value, is_text(*value))));
    match kind {
        Kind::Texture => lookup(&list, Options::Texture),
        Kind::Environment => lookup(&list, Options::Environment),
        Kind::Shadow => lookup(&list, Options::Shadow),
        Kind::Trace => lookup(&list, Options::Trace),
        Kind::Gather => lookup(&list, Options::Gather),
        Kind::Save => strict(&list, Options::Save),
        Kind::Query => strict(&list, Options::Query),
        Kind::Subsurface => strict(&list, Options::Subsurface),
        Kind::Step => strict(&list, Options::Step),
    }
}

/// A name, the symbol of its value, and true when the value is a string.
type Given<'t> = (&'t str, SymbolId, bool);

/// Resolves options of lookups and rays. Options of other such calls are ignored.
fn lookup<O: OptionTable<SymbolId, SymbolId>>(list: &[Given<'_>], wrap: fn(O) -> Options) -> Resolved {
    let (mut options, mut results, mut unknown) = (O::default(), Results::default(), Vec::new());
    for &(name, value, text) in list {
        if results.set(name, value) {
            continue;
        }
        if O::takes_text(name).is_some() {
            options.set(name, (!text).then_some(value), text.then_some(value));
        } else if !is_lookup_option(name) {
            unknown.push(name.to_owned());
        }
    }
    Resolved { options: wrap(options), results, unknown }
}

/// Resolves options of other calls. A value of the wrong type counts as an unknown name.
fn strict<O: OptionTable<SymbolId, SymbolId>>(list: &[Given<'_>], wrap: fn(O) -> Options) -> Resolved {
    let (mut options, mut unknown) = (O::default(), Vec::new());
    for &(name, value, text) in list {
        if O::takes_text(name) == Some(text) {
            options.set(name, (!text).then_some(value), text.then_some(value));
        } else {
            unknown.push(name.to_owned());
        }
    }
    Resolved { options: wrap(options), results: Results::default(), unknown }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_gsl::help;

    type Names = (Vec<&'static str>, fn(&str) -> Option<bool>);

    fn names<O: OptionTable<SymbolId, SymbolId>>() -> Names {
        (O::names(), O::takes_text)
    }

    /// The compiler accepts exactly the options that calls understand, with the same kind of value.
    #[test]
    fn options_are_those_of_the_compiler() {
        let functions: [(&str, Names); 10] = [
            ("texture", names::<TextureOptions<_, _>>()),
            ("texture3d", names::<TextureOptions<_, _>>()),
            ("environment", names::<EnvironmentOptions<_, _>>()),
            ("shadow", names::<ShadowOptions<_, _>>()),
            ("indirect", names::<GatherOptions<_, _>>()),
            ("occlusion", names::<GatherOptions<_, _>>()),
            ("subsurface", names::<SubsurfaceOptions<_, _>>()),
            ("spatialdbsave", names::<SaveOptions<_, _>>()),
            ("spatialdbquery", names::<QueryOptions<_, _>>()),
            ("aastep", names::<StepOptions<_, _>>()),
        ];
        let with_options = Func::ALL.iter().filter(|func| !help::options_of(**func).is_empty());
        assert_eq!(with_options.count(), functions.len());
        let trace = [("trace", names::<TraceOptions<_, _>>())];
        for (function, (known, takes_text)) in functions.into_iter().chain(trace) {
            let entry = help::entry(function).expect("an entry");
            for option in &entry.options {
                let name = option.name;
                if option.output {
                    assert!(Results::default().set(name, SymbolId(0)), "{function} \"{name}\"");
                } else {
                    let is_text = option.value == ValueType::String;
                    assert_eq!(takes_text(name), Some(is_text), "{function} \"{name}\"");
                }
            }
            for name in known {
                let is_known = entry.options.iter().any(|option| option.name == name);
                // The light of a whole hemisphere has one distribution.
                assert!(
                    is_known || (function, name) == ("indirect", "distribution"),
                    "{function} \"{name}\""
                );
            }
        }
    }
}
