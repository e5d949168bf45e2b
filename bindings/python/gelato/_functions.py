"""The calls of the scene interface, as functions for the renderer of the module. ``generate.py`` writes this file."""

from ._renderer import GelatoAPI

GelatoRenderer = GelatoAPI.CreateRenderer()

AppendTransform = GelatoRenderer.AppendTransform
Attribute = GelatoRenderer.Attribute
Camera = GelatoRenderer.Camera
Command = GelatoRenderer.Command
Comment = GelatoRenderer.Comment
ConnectShaders = GelatoRenderer.ConnectShaders
Curves = GelatoRenderer.Curves
GetAttribute = GelatoRenderer.GetAttribute
Input = GelatoRenderer.Input
Light = GelatoRenderer.Light
LightSwitch = GelatoRenderer.LightSwitch
Mesh = GelatoRenderer.Mesh
Modify = GelatoRenderer.Modify
Motion = GelatoRenderer.Motion
Output = GelatoRenderer.Output
Parameter = GelatoRenderer.Parameter
Patch = GelatoRenderer.Patch
Points = GelatoRenderer.Points
PopAttributes = GelatoRenderer.PopAttributes
PopTransform = GelatoRenderer.PopTransform
PushAttributes = GelatoRenderer.PushAttributes
PushTransform = GelatoRenderer.PushTransform
Render = GelatoRenderer.Render
RestoreAttributes = GelatoRenderer.RestoreAttributes
Rotate = GelatoRenderer.Rotate
SaveAttributes = GelatoRenderer.SaveAttributes
Scale = GelatoRenderer.Scale
SetTransform = GelatoRenderer.SetTransform
Shader = GelatoRenderer.Shader
ShaderGroupBegin = GelatoRenderer.ShaderGroupBegin
ShaderGroupEnd = GelatoRenderer.ShaderGroupEnd
Sphere = GelatoRenderer.Sphere
Translate = GelatoRenderer.Translate
TrimCurve = GelatoRenderer.TrimCurve
World = GelatoRenderer.World

__all__ = [
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
]
