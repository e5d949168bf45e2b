//! The names that scenes in Pyg use (reference 3.3).

use granita_scene::interface::{TABLE, call_row};

/// The renderer object and the module that scripts outside of the reader import.
const OBJECTS: [&str; 4] = ["GelatoRenderer", "gelato", "CreateRenderer", "GelatoAPI"];

/// Returns the names of all calls, including `GetAttribute`.
pub(crate) fn calls() -> impl Iterator<Item = &'static str> {
    TABLE.iter().map(|row| row.name)
}

/// Returns the names of all calls and of the other objects of the interface.
pub(crate) fn known() -> impl Iterator<Item = &'static str> {
    calls().chain(OBJECTS)
}

/// True when `name` is a call of the scene interface, including `GetAttribute`.
pub(crate) fn is_call(name: &str) -> bool {
    call_row(name).is_some()
}

/// The functions of Python that a script may call without having defined anything.
const BUILTINS: [&str; 22] = [
    "print",
    "exec",
    "eval",
    "open",
    "len",
    "map",
    "filter",
    "list",
    "setattr",
    "getattr",
    "delattr",
    "globals",
    "locals",
    "vars",
    "exit",
    "quit",
    "compile",
    "execfile",
    "__import__",
    "breakpoint",
    "help",
    "input",
];

/// True when Python handles a call of `name` itself.
pub(crate) fn is_python_builtin(name: &str) -> bool {
    BUILTINS.contains(&name)
}
