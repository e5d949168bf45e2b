//! Connections between layers: resolution of names with indexes, and compatible types.

use super::source::ConnectionSource;
use granita_base::Severity;
use granita_gsl::ir::{Global, Module, ValueType};

/// One end of a connection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Endpoint {
    /// Its register.
    pub(crate) slot: u32,
    /// The type of an element.
    pub(crate) value: ValueType,
    /// The number of elements.
    pub(crate) elements: u32,
    /// The single element; `None` for all of them.
    pub(crate) element: Option<u32>,
    /// The single component; `None` for all of them.
    pub(crate) component: Option<u32>,
}

impl Endpoint {
    /// True when the end is the whole symbol.
    pub(crate) fn is_whole(&self) -> bool {
        self.element.is_none() && self.component.is_none()
    }
}

/// A valid connection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Connection {
    pub(crate) source: Endpoint,
    pub(crate) target: Endpoint,
}

/// The meaning of a name at an end of a connection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Whole {
    /// The parameter with this index.
    Param(usize),
    Global(Global),
}

/// A name with indexes, before registers are assigned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Named {
    pub(crate) end: Whole,
    pub(crate) value: ValueType,
    /// The array length; `None` when it is not an array.
    pub(crate) array: Option<u32>,
    /// True when it is declared with `[]`.
    pub(crate) open: bool,
    pub(crate) element: Option<u32>,
    pub(crate) component: Option<u32>,
}

impl Named {
    /// Returns the type of the value, and the length of whole arrays.
    fn shape(&self) -> (ValueType, Option<u32>) {
        if self.component.is_some() {
            (ValueType::Float, None)
        } else {
            (self.value, if self.element.is_some() { None } else { self.array })
        }
    }
}

/// Resolves `"name"`, `"name[1]"`, `"name[1][2]"` in a module.
pub(crate) fn resolve(module: &Module, text: &str) -> Result<Named, String> {
    let (name, mut indexes) = split(text)?;
    let mut named = if let Some(k) = module.params.iter().position(|p| *module.symbol(p.symbol).name == *name)
    {
        let ty = module.symbol(module.params[k].symbol).ty;
        Named {
            end: Whole::Param(k),
            value: ty.value,
            array: ty.array,
            open: ty.open,
            element: None,
            component: None,
        }
    } else if let Some(g) = Global::ALL.into_iter().find(|g| g.word() == name) {
        Named {
            end: Whole::Global(g),
            value: g.value_type(),
            array: None,
            open: false,
            element: None,
            component: None,
        }
    } else {
        return Err(format!("shader \"{}\" has no parameter \"{name}\"", module.name));
    };
    if let (Some(length), Some(&index)) = (named.array, indexes.first()) {
        if index >= length && !named.open {
            return Err(format!("\"{text}\" is outside of the array's {length} elements"));
        }
        named.element = Some(index);
        indexes.remove(0);
    }
    if let Some(&index) = indexes.first() {
        if !named.value.is_triple() || indexes.len() > 1 {
            return Err(format!("\"{text}\" has an index, but is neither an array nor a triple"));
        }
        if index > 2 {
            return Err(format!("\"{text}\" is outside of the three components"));
        }
        named.component = Some(index);
    }
    Ok(named)
}

/// Splits a text into name and indexes.
fn split(text: &str) -> Result<(&str, Vec<u32>), String> {
    let Some(open) = text.find('[') else { return Ok((text.trim(), Vec::new())) };
    let fail = || format!("cannot read the index in \"{text}\"");
    let mut indexes = Vec::new();
    let mut rest = text[open..].trim();
    while !rest.is_empty() {
        let inner = rest.strip_prefix('[').ok_or_else(fail)?;
        let (number, after) = inner.split_once(']').ok_or_else(fail)?;
        indexes.push(number.trim().parse().map_err(|_| fail())?);
        rest = after.trim();
    }
    Ok((text[..open].trim(), indexes))
}

/// Returns the name and index of an array element, as in `name[2]`. A name without an index is that of a whole.
pub(crate) fn element_of(name: &str) -> (&str, Option<u32>) {
    let parts = name.strip_suffix(']').and_then(|n| n.split_once('['));
    match parts.and_then(|(base, k)| Some((base, k.parse().ok()?))) {
        Some((base, k)) => (base, Some(k)),
        None => (name, None),
    }
}

/// Checks that the types of the ends are compatible (reference 2.6). These are equal types, any two triples, a
/// float to a triple, and a triple to a float by its first component. Whole arrays need the same length.
pub(crate) fn compatible(source: &Named, target: &Named) -> Result<(), String> {
    let ((from, from_array), (to, to_array)) = (source.shape(), target.shape());
    let arrays = match (from_array, to_array) {
        (None, None) => true,
        (Some(a), Some(b)) => a == b || target.open,
        _ => false,
    };
    if !arrays {
        return Err("the array lengths differ".to_owned());
    }
    let numeric = |t: ValueType| t == ValueType::Float || t.is_triple();
    // Conversions are for single values. Arrays must have the same kind of element.
    let types = from == to
        || from.is_triple() && to.is_triple()
        || from_array.is_none() && numeric(from) && numeric(to);
    if types { Ok(()) } else { Err(format!("a {} does not connect to a {}", from.word(), to.word())) }
}

/// Reports a connection that is not made.
pub(crate) fn refuse(c: &ConnectionSource<'_>, why: &str, report: &mut dyn FnMut(Severity, String)) {
    report(
        Severity::Error,
        format!(
            "cannot connect \"{}\" of layer \"{}\" to \"{}\" of layer \"{}\": {why}",
            c.source, c.source_layer, c.target, c.target_layer
        ),
    );
}
