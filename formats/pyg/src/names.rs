//! Names of the calls that Pyg has (reference 3.3).

/// Every function of Pyg.
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
    // The renderer object and the module that scripts outside of the reader import.
    "GelatoRenderer",
    "gelato",
    "CreateRenderer",
    "GelatoAPI",
];

/// True when `name` is a call with effects (not `GetAttribute`, which returns a value).
pub(crate) fn is_call(name: &str) -> bool {
    CALLS[..35].contains(&name)
}

/// Functions of Python that a script may call without having defined anything.
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
