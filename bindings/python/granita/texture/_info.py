"""Data about textures."""

import json
from typing import Any, Dict, List, NamedTuple, Optional, Tuple


class TextureInfo(NamedTuple):
    """Data about a texture. For a set of textures they are those of its first square."""

    path: str
    """The file that was found."""
    kind: str
    """ "Plain Texture", "LatLong Environment", "CubeFace Environment", "Shadow", "Volume Texture" and so on."""
    type: str
    """ "texture", "environment", "shadow" or "volume"."""
    format: str
    """The type of stored values: "uint8", "uint16", "uint32", "half" or "float"."""
    width: int
    """The texels of a row of the largest level."""
    height: int
    """The rows of the largest level."""
    face: Tuple[int, int]
    """The width and height of one face of a cube; otherwise those of the level."""
    tile: Optional[Tuple[int, int]]
    """The width and height of a tile; None when the levels are held in memory."""
    channels: int
    """The number of channels."""
    channel_names: Tuple[str, ...]
    """The name of each channel."""
    levels: Tuple[Tuple[int, int], ...]
    """The width and height of each MIP level, the largest first."""
    wrap: Tuple[str, str]
    """The wrap modes in s and t: "black", "clamp", "periodic" or "mirror"."""
    up: str
    """The axis that points to the upper edge of a latitude-longitude map: "y" or "z"."""
    squares: Tuple[Tuple[int, int], ...]
    """The column and row of each texture of a set, rows counted upward; empty for a single texture."""
    average: Optional[Tuple[float, ...]]
    """The mean of each channel; None for shadow maps and volumes."""
    world_to_camera: Optional[Tuple[float, ...]]
    """The matrix of a shadow map from world space to the camera of its light: 16 numbers, row by row."""
    world_to_screen: Optional[Tuple[float, ...]]
    """The matrix of a shadow map from world space to the map, -1 to 1."""
    metadata: Dict[str, Any]
    """The metadata of the file by name: numbers, texts and lists of them."""

    @classmethod
    def of_json(cls, text: str) -> "TextureInfo":
        """Returns the data of the text that the library returns."""
        values = json.loads(text)
        return cls(**{name: value if name == "metadata" else _tuples(value) for name, value in values.items()})


def _tuples(value: Any) -> Any:
    """Returns lists as tuples."""
    items: List[Any] = value if isinstance(value, list) else []
    return tuple(_tuples(item) for item in items) if isinstance(value, list) else value
