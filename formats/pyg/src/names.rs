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

/// Whether `name` is a call with effects (not `GetAttribute`, which returns something).
pub(crate) fn is_call(name: &str) -> bool {
    CALLS[..35].contains(&name)
}
