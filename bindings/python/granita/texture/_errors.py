"""The exceptions and warnings of the module."""


class TextureError(Exception):
    """An error of the texture system."""


class TextureArgumentError(TextureError, ValueError):
    """An argument is not valid: an unknown word, or arrays whose shapes do not fit."""


class TextureFileError(TextureError):
    """A texture does not exist or cannot be used."""


class TextureWarning(UserWarning):
    """A message of a texture system, such as one about a tile that cannot be read and is black."""
