//! The names of the calls of Pyg (reference 3.3).

/// The functions of Pyg and other names of its interface. The first 35 are calls.
pub(crate) const CALLS: [&str; 39] = [
    "AppendTransform",
    "Attribute",
    "Camera",
    "Command",
    "Comment",
    "ConnectShaders",
    "Curves",
    "GetAttribute",
    "Input",
    "Light",
    "LightSwitch",
    "Mesh",
    "Modify",
    "Motion",
    "Output",
    "Parameter",
    "Patch",
    "Points",
    "PopAttributes",
    "PopTransform",
    "PushAttributes",
    "PushTransform",
    "Render",
    "RestoreAttributes",
    "Rotate",
    "SaveAttributes",
    "Scale",
    "SetTransform",
    "Shader",
    "ShaderGroupBegin",
    "ShaderGroupEnd",
    "Sphere",
    "Translate",
    "TrimCurve",
    "World",
    // These are the renderer object and the module that scripts outside of the reader import.
    "GelatoRenderer",
    "gelato",
    "CreateRenderer",
    "GelatoAPI",
];

/// True when `name` is a call of the scene interface, including `GetAttribute`.
pub(crate) fn is_call(name: &str) -> bool {
    CALLS[..35].contains(&name)
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
