"""Messages of a renderer, and the exceptions that they become."""

import re
import struct
from typing import List, Optional

# The numbers of severities, which are those of the renderer's error handlers.
INFO, WARNING, ERROR, SEVERE = 512, 1024, 2048, 4096

_SEVERITIES = {INFO: "info", WARNING: "warning", ERROR: "error", SEVERE: "severe error"}

_OBJECT = re.compile(r'\bobject "([^"]*)"')
_ATTRIBUTE = re.compile(r'\battribute "([^"]*)"|^Attribute(?:: | \()"([^"]*)"')
_PARAMETER = re.compile(r'\bparameter "([^"]*)"|^[A-Z]\w*: "([^"]*)"')


def _found(pattern: "re.Pattern[str]", text: str) -> Optional[str]:
    """Returns the name that a pattern finds in a text."""
    match = pattern.search(text)
    return next((group for group in match.groups() if group is not None), None) if match else None


def _without_type(declaration: Optional[str]) -> Optional[str]:
    """Returns the name of a declaration such as "float Kd"."""
    return declaration.split()[-1] if declaration and declaration.split() else None


class Message:
    """A message of the renderer.

    ``severity`` is "info", "warning", "error" or "severe error", and ``code`` is its number (512, 1024, 2048, 4096).
    ``file``, ``line`` and ``column`` tell where the call was made. ``object``, ``attribute`` and ``parameter`` are the
    names in the text. What is not known is None.
    """

    __slots__ = ("severity", "code", "text", "file", "line", "column", "object", "attribute", "parameter")

    def __init__(self, code: int, text: str, file: str = "", line: int = 0, column: int = 0) -> None:
        self.code = code
        self.severity: str = _SEVERITIES.get(code, "message")
        self.text = text
        self.file: Optional[str] = file or None
        self.line: Optional[int] = line or None
        self.column: Optional[int] = column or None
        self.object = _found(_OBJECT, text)
        self.attribute = _without_type(_found(_ATTRIBUTE, text))
        self.parameter = None if self.attribute else _without_type(_found(_PARAMETER, text))

    def __str__(self) -> str:
        places = [str(place) for place in (self.file, self.line, self.column) if place is not None]
        where = ":".join(places) + ": " if self.file else ""
        return "%s%s: %s" % (where, self.severity, self.text)

    def __repr__(self) -> str:
        return "<gelato.Message %s>" % self

    @classmethod
    def of_frame(cls, payload: bytes) -> "Message":
        """Returns the message of a frame. Raises struct.error for an invalid one."""
        code, line, column, length = struct.unpack_from("<4I", payload)
        file = payload[16 : 16 + length]
        size = struct.unpack_from("<I", payload, 16 + length)[0]
        text = payload[20 + length : 20 + length + size]
        return cls(code, text.decode("utf-8", "replace"), file.decode("utf-8", "replace"), line, column)


class GelatoError(RuntimeError):
    """An error of the renderer, or of the connection to it.

    The fields are those of the first message (see ``Message``), and None where they are not known. ``messages`` holds
    all messages since the last error, ``result`` the images of a frame that was rendered in spite of it, and
    ``status`` the exit status of a renderer that has ended.
    """

    def __init__(self, text: str, messages: "Optional[List[Message]]" = None, status: Optional[int] = None) -> None:
        super().__init__(text)
        self.messages: List[Message] = list(messages or ())
        self.status = status
        self.result: object = None
        first = next((m for m in self.messages if m.code in (ERROR, SEVERE)), None)
        first = first or next(iter(self.messages), Message(ERROR, ""))
        self.severity = first.severity
        self.code = first.code
        self.file = first.file
        self.line = first.line
        self.object = first.object
        self.attribute = first.attribute
        self.parameter = first.parameter


class GelatoArgumentError(GelatoError, TypeError, ValueError):
    """An argument of a call has the wrong type or shape. The call was not made.

    ``call`` is the name of the call, and ``parameter`` that of the parameter, or None for other arguments.
    """

    def __init__(self, text: str, call: Optional[str] = None, parameter: Optional[str] = None) -> None:
        super().__init__(text)
        self.call = call
        self.attribute = parameter if call == "Attribute" else None
        self.parameter = parameter


class GelatoWarning(UserWarning):
    """A warning of the renderer. ``message`` holds its fields."""

    def __init__(self, message: Message) -> None:
        super().__init__(message.text)
        self.message = message
