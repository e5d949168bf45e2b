//! Strings and printing (reference 5.8.9).

use super::compute_as;
use super::format::{Item, fill};
use crate::program::Op;
use crate::run::machine::Machine;
use crate::run::strings::{MAX_TEXT, StringId, cut};
use granita_base::Severity;
use granita_gsl::Func;
use granita_gsl::ir::{SymbolId, ValueType};
use std::sync::Arc;

/// Runs the functions. Those that print write one line for all lanes when their arguments are the same in all
/// active lanes, else one per active lane. The output does not depend on how values are stored.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    match func {
        Func::Format => strings(m, op, |m, i| formatted(m, &op.args, i)),
        Func::Concat => strings(m, op, |m, i| {
            let mut text = String::new();
            for part in op.args.iter().map(|&s| m.text(m.view(s).string(i))) {
                text.push_str(part);
                if text.len() > MAX_TEXT {
                    break;
                }
            }
            text
        }),
        Func::Substr => strings(m, op, |m, i| {
            let text = m.text(m.view(op.args[0]).string(i)).clone();
            let start = m.view(op.args[1]).get(i);
            let length = op.args.get(2).map(|&s| m.view(s).get(i));
            substr(&text, start, length)
        }),
        Func::Match => matches(m, op),
        Func::Printf => each_lane(m, op, |m, i| {
            let text = formatted(m, &op.args, i);
            m.services.say(Severity::Message, &text);
        }),
        Func::Error => each_lane(m, op, |m, i| {
            let text = formatted(m, &op.args, i);
            let text = text.trim_end().to_owned();
            let module = &m.code().module;
            let at = module.location(op.at);
            m.services.say_of(Severity::Error, &module.name, &at, &text);
        }),
        Func::Fprintf => each_lane(m, op, |m, i| {
            let file = m.text(m.view(op.args[0]).string(i)).clone();
            let text = formatted(m, &op.args[1..], i);
            m.services.append(&file, &text);
        }),
        _ => {}
    }
}

/// Formats a template and its values for lane `i`.
fn formatted(m: &Machine<'_>, args: &[SymbolId], i: usize) -> String {
    let Some((&template, values)) = args.split_first() else { return String::new() };
    // The numbers of all values are in one list. Strings are stored by their text.
    let mut numbers: Vec<f32> = Vec::new();
    let mut parts: Vec<(usize, usize, Option<Arc<str>>)> = Vec::new();
    for &value in values {
        let view = m.view(value);
        for e in 0..view.elements {
            if m.type_of(value) == ValueType::String {
                parts.push((0, 0, Some(m.text(StringId::from_register(view.lane_at(e, 0).get(i))).clone())));
            } else {
                let from = numbers.len();
                numbers.extend((0..view.components).map(|c| view.lane_at(e, c).get(i)));
                parts.push((from, numbers.len(), None));
            }
        }
    }
    let items = parts.iter().map(|(from, to, text)| match text {
        Some(text) => Item::Text(text),
        None => Item::Numbers(&numbers[*from..*to]),
    });
    fill(m.text(m.view(template).string(i)), items)
}

/// Computes a string per lane, none longer than [`MAX_TEXT`].
fn strings(m: &mut Machine<'_>, op: &Op, f: impl Fn(&Machine<'_>, usize) -> String) {
    let Some(dst) = op.dst else { return };
    let varying = m.varies(&op.args);
    let mut out = m.out(varying, 1);
    if varying {
        for k in 0..m.mask.count() {
            let i = m.mask.active[k] as usize;
            let text = f(m, i);
            let id = made(m, op, text);
            out.set_string(0, i, id);
        }
    } else {
        let text = f(m, 0);
        let id = made(m, op, text);
        out.set_string(0, 0, id);
    }
    m.commit(dst, out);
}

/// Returns the id of a text that an operation made.
fn made(m: &mut Machine<'_>, op: &Op, mut text: String) -> StringId {
    if cut(&mut text) {
        m.complain(op.at, &format!("a string is cut after {MAX_TEXT} bytes"));
    }
    m.intern_at(&text, op.at)
}

/// Runs a function once, or per active lane.
fn each_lane(m: &mut Machine<'_>, op: &Op, f: impl Fn(&mut Machine<'_>, usize)) {
    if op.args.iter().any(|&arg| differs(m, arg)) {
        for k in 0..m.mask.count() {
            let i = m.mask.active[k] as usize;
            f(m, i);
        }
    } else {
        f(m, m.first());
    }
}

/// True when active lanes hold different values. One text has one id, and all NaNs print alike.
fn differs(m: &Machine<'_>, arg: SymbolId) -> bool {
    let view = m.view(arg);
    if !view.varying {
        return false;
    }
    let is_text = m.type_of(arg) == ValueType::String;
    let bits = |x: f32| if x.is_nan() && !is_text { f32::NAN.to_bits() } else { x.to_bits() };
    (0..view.elements).any(|e| {
        (0..view.components).any(|c| {
            let lane = view.lane_at(e, c);
            let first = bits(lane.get(m.first()));
            m.mask.active.iter().any(|&i| bits(lane.get(i as usize)) != first)
        })
    })
}

/// Runs `match (pattern, subject)`.
fn matches(m: &mut Machine<'_>, op: &Op) {
    let Some(dst) = op.dst else { return };
    let varying = m.varies(&op.args);
    let mut out = m.out(varying, 1);
    let count = if varying { m.mask.count() } else { 1 };
    // Neighbouring lanes mostly have the same arguments.
    let mut last: Option<(StringId, StringId, f32)> = None;
    for k in 0..count {
        let i = if varying { m.mask.active[k] as usize } else { 0 };
        let (pattern, subject) = (m.view(op.args[0]).string(i), m.view(op.args[1]).string(i));
        let result = match last {
            Some((p, s, r)) if p == pattern && s == subject => r,
            _ => {
                let (pattern, subject) = (m.text(pattern).clone(), m.text(subject).clone());
                match m.st.regexes.matches(&pattern, &subject) {
                    Ok(found) => f32::from(found),
                    Err(what) => {
                        m.complain(op.at, &what);
                        0.0
                    }
                }
            }
        };
        last = Some((pattern, subject, result));
        out.set(0, i, result);
    }
    compute_as(m, dst, varying, 1, |_, to, _| to.data.copy_from_slice(&out.data));
    m.discard(out);
}

/// Returns the characters `start` to `start + length` (to the end without a length). A negative start counts from
/// the end. Positions outside of the string are skipped.
fn substr(text: &str, start: f32, length: Option<f32>) -> String {
    let count = text.chars().count() as f32;
    let start = if start < 0.0 { (count + start.floor()).max(0.0) } else { start.floor() };
    let length = length.map_or(count, f32::floor).max(0.0);
    // `as` turns NaN into 0.
    text.chars().skip(start as usize).take(length as usize).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn substrings_accept_any_start_and_length() {
        for (start, length, expected) in [
            (0.0, Some(2.0), "he"),
            (1.0, Some(3.0), "ell"),
            (3.0, None, "lo"),
            (-1.0, None, "o"),
            (-3.0, Some(2.0), "ll"),
            (-99.0, Some(2.0), "he"),
            (9.0, None, ""),
            (2.0, Some(99.0), "llo"),
            (2.0, Some(-1.0), ""),
            (f32::NAN, Some(1.0), "h"),
        ] {
            assert_eq!(substr("hello", start, length), expected, "{start} {length:?}");
        }
        assert_eq!(substr("äöü", 1.0, Some(1.0)), "ö");
    }
}
