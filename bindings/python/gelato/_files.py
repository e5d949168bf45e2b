"""Images in files, read by a renderer of their own."""

import os
from typing import Union

from ._images import Image, ImageInfo
from ._renderer import Renderer


def _renderer() -> Renderer:
    return Renderer("-silent", on_error="warn", on_message=lambda message: None)


def image_info(path: "Union[str, os.PathLike[str]]") -> ImageInfo:
    """Returns the description of an image or texture file, in any format that the renderer reads."""
    with _renderer() as renderer:
        return renderer.image_info(path)


def read_image(path: "Union[str, os.PathLike[str]]", subimage: int = 0, level: int = 0) -> Image:
    """Reads an image or texture file: one of its images, and a level of that, both counted from 0."""
    with _renderer() as renderer:
        return renderer.read_image(path, subimage, level)
