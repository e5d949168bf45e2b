"""A renderer that is another process. The package uses it, and so does ``CreateRenderer`` in a scene file that is a
script. For scripts, the renderer runs this file after the others of the package, as one program.
"""

import atexit
import os
import shutil
import struct
import sys
import warnings
import weakref
from collections import deque
from types import TracebackType
from typing import Any, Callable, Deque, List, Optional, Tuple, Type, Union, overload

try:
    from ._calls import Calls
    from ._errors import ERROR, SEVERE, GelatoError, GelatoWarning, Message
    from ._images import Arriving, Image, ImageInfo, Reader
    from ._process import Process
    from ._stream import call, decode, text
except ImportError:
    # The names are part of the same program.
    pass

# The calls that return only when they are done.
_SLOW = ("Render", "Command", "Input")

# What may become of errors.
_POLICIES = ("raise", "warn", "print")

# The number of messages that are kept.
_KEPT = 1000

# The files of the package, which are not the place of a call.
_OWN = {function.__code__.co_filename for function in (call, Calls._call, Process.wait)}
_OWN.add((lambda: 0).__code__.co_filename)


def _command_line(options: Tuple[Any, ...]) -> List[str]:
    """Returns the options of the program for the arguments of CreateRenderer: a type of renderer, then options."""
    if not options or (isinstance(options[0], str) and options[0].startswith("-")):
        return [str(option) for option in options]
    kind, rest = options[0], [str(option) for option in options[1:]]
    kind = "" if kind is None else str(kind).strip()
    if not kind:
        return rest
    if kind == "pyg":
        return ["-archive", "-"] + rest
    if kind.startswith("pyg") and kind[3].isspace():
        return ["-archive", kind[3:].strip()] + rest
    if kind.endswith(".pyg"):
        return ["-archive", kind] + rest
    raise GelatoError(
        'there is no renderer of the type "%s" (known: none, "pyg", "pyg FILE", "FILE.pyg")' % kind
    )


def _program() -> str:
    named = os.environ.get("GELATO")
    if named:
        return named
    home = os.environ.get("GELATOHOME")
    if home:
        path = os.path.join(home, "bin", "gelato.exe" if os.name == "nt" else "gelato")
        if os.path.exists(path):
            return path
    # The program inside of the package, which has all tools. Scripts of the renderer have no file.
    own = os.path.join(os.path.dirname(globals().get("__file__") or ""), "suite", "bin", "granita")
    if os.path.isabs(own) and os.access(own, os.X_OK):
        return own
    found = shutil.which("gelato")
    if found is None:
        raise GelatoError("there is no program gelato on the search path; set GELATO to its place")
    return found


class _Block:
    """Calls that come in pairs, as a ``with`` statement. The second one is also made after an exception."""

    def __init__(self, renderer: "Renderer", begin: "List[str]", end: str) -> None:
        self._renderer = renderer
        self._begin = begin
        self._end = end

    def __enter__(self) -> "Renderer":
        for name in self._begin:
            self._renderer._call(name, ())
        self._renderer._blocks.append(self)
        return self._renderer

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        if self not in self._renderer._blocks:
            # A frame was rendered inside of the block.
            return
        self._renderer._blocks.remove(self)
        try:
            self._renderer._call(self._end, ())
        except GelatoError:
            # The exception that ends the block is the reason.
            if kind is None:
                raise


class Renderer(Calls):
    """A renderer, which is a process that receives calls.

    The first argument may be a type: none renders images, "pyg FILE" and "FILE.pyg" write the calls to a scene file,
    and "pyg" writes them to sys.stdout. Options of the command line follow, such as "-threads", 4.

    ``on_error`` tells what becomes of errors in calls, which leave out the call or a part of it. "raise" raises
    ``GelatoError`` when the next call returns that waits for the renderer (Render, render, Command, Input,
    GetAttribute, finish). "warn" makes them warnings. "print" writes them to standard error. Warnings go to
    Python's ``warnings``, or to standard error. ``on_message`` is called with each ``Message`` instead.
    """

    def __init__(
        self,
        *options: Any,
        on_error: str = "raise",
        on_message: Optional[Callable[[Message], object]] = None,
    ) -> None:
        if on_error not in _POLICIES:
            raise ValueError("on_error is %r, and takes %s" % (on_error, ", ".join(map(repr, _POLICIES))))
        self._options = _command_line(options)
        self._on_error = on_error
        self._on_message = on_message
        self._process: Optional[Process] = None
        self._status: Optional[int] = None
        self._why = "the renderer has been finished"
        self._file: Optional[str] = None
        self._blocks: List[_Block] = []
        self._arriving = Arriving()
        self._errors: List[Message] = []
        self.messages: Deque[Message] = deque(maxlen=_KEPT)

    # The connection.

    def _start(self) -> Process:
        if self._status is not None:
            raise GelatoError(self._why, status=self._status)
        command = [_program(), "-stream", *self._options]
        # The renderer prints messages itself where standard error is that of the process.
        if self._on_error != "print" or self._on_message is not None or sys.stderr is not sys.__stderr__:
            command.append("-messages")
        process = self._process = Process(command)
        _running.add(self)
        self._drop = weakref.finalize(self, Process.drop, process)
        # At the end of the program, finish_all ends the renderers instead.
        self._drop.atexit = False
        return process

    def _connected(self) -> Process:
        """Returns the process, and takes what has arrived from it."""
        process = self._process or self._start()
        if process.owner != os.getpid():
            raise GelatoError("the renderer belongs to the process that this one was forked from")
        for frame in process.arrived():
            if frame is None:
                self._ended(process, True)
            else:
                self._take(*frame)
        return process

    def _ended(self, process: Process, is_read: bool) -> None:
        """Raises the error of a renderer that has ended. ``is_read`` is True when all its frames have been read."""
        self._process = None
        self._drop.detach()
        while not is_read:
            frame = process.wait()
            is_read = frame is None
            if frame is not None:
                self._take(*frame)
        status = self._status = process.end()
        how = "with status %d" % status if status >= 0 else "by signal %d" % -status
        self._why = "the renderer ended " + how
        errors = [message for message in self.messages if message.code in (ERROR, SEVERE)]
        reason = ": %s" % errors[-1] if errors else ""
        raise GelatoError(self._why + reason, errors[-1:], status)

    def _abandon(self) -> None:
        """Ends a renderer after an interrupt. A frame that it was sent in part cannot be completed."""
        process, self._process = self._process, None
        if process is not None:
            self._drop.detach()
            self._status = process.drop()
            self._why = "the renderer was ended by an interrupt"

    def _send(
        self, frames: "List[Tuple[bytes, Any]]", answer: Optional[bytes] = None, file: Optional[str] = None
    ) -> bytes:
        """Sends frames, which come from a file. Waits for the answer of this kind, and returns its payload."""
        process = self._connected()
        try:
            try:
                if file is not None and file != self._file:
                    process.send(b"F", file.encode("utf-8", "surrogateescape"))
                    self._file = file
                for kind, payload in frames:
                    process.send(kind, payload)
                if answer is None:
                    return b""
                process.flush()
            except OSError:
                self._ended(process, False)
            return self._wait(process, answer)
        except Exception:
            raise
        except BaseException:
            self._abandon()
            raise

    def _wait(self, process: Process, answer: Optional[bytes]) -> bytes:
        problem: Optional[Exception] = None
        while True:
            frame = process.wait()
            if frame is None:
                self._ended(process, True)
                continue
            if frame[0] == answer:
                break
            try:
                self._take(*frame)
            except Exception as error:
                # The answer is still to come.
                problem = problem or error
        if problem is not None:
            raise problem
        return frame[1]

    def _take(self, kind: bytes, payload: bytes) -> None:
        """Takes a frame that is not an answer."""
        if kind == b"P":
            sys.stdout.write(payload.decode("utf-8", "replace"))
        elif kind == b"M":
            try:
                self._tell(Message.of_frame(payload))
            except struct.error:
                raise GelatoError("the renderer sent something unreadable") from None
        elif kind in (b"O", b"S", b"L"):
            self._arriving.take(kind, payload)

    def _tell(self, message: Message) -> None:
        """Passes a message on."""
        self.messages.append(message)
        is_error = message.code in (ERROR, SEVERE)
        if is_error and self._on_error == "raise":
            self._errors.append(message)
        if self._on_message is not None:
            self._on_message(message)
        elif self._on_error == "print":
            sys.stderr.write("gelato: %s\n" % message)
        elif message.severity == "warning" or (is_error and self._on_error == "warn"):
            place = (message.file or "<gelato>", message.line or 1)
            warnings.warn_explicit(GelatoWarning(message), GelatoWarning, *place)

    def _raise(self, result: object = None) -> None:
        """Raises an error for those that the renderer has reported."""
        errors, self._errors = self._errors, []
        if errors:
            more = " (and %d more errors)" % (len(errors) - 1) if len(errors) > 1 else ""
            error = GelatoError(str(errors[0]) + more, errors)
            error.result = result
            raise error

    def _place(self) -> Tuple[int, str]:
        """Returns the line of the program that makes a call, and its file."""
        frame = sys._getframe(2)
        while frame.f_code.co_filename in _OWN and frame.f_back is not None:
            frame = frame.f_back
        return frame.f_lineno, frame.f_code.co_filename

    # The calls.

    def _call(self, name: str, args: Tuple[Any, ...]) -> None:
        line, file = self._place()
        frames: List[Tuple[bytes, Any]] = [(b"C", call(line, name, args))]
        if name == "Render":
            self._close_blocks()
        if name in _SLOW and args[:1] != ("exit",):
            self._send(frames + [(b"W", b"")], b"W", file)
            self._raise()
            return
        self._send(frames, None, file)
        if name == "Command":
            self.finish()

    def _close_blocks(self) -> None:
        """Ends the blocks that are open. Nothing stays open when a frame is rendered."""
        while self._blocks:
            self._call(self._blocks.pop()._end, ())

    def GetAttribute(self, name: str) -> Any:
        """Returns the current value of an attribute: a number, a string or a tuple, or None when there is none."""
        value = decode(self._send([(b"A", str(name).encode("utf-8", "replace"))], b"G"))
        self._raise()
        return value

    @property
    def errors(self) -> int:
        """The number of errors that the renderer has reported so far."""
        if self._process is None:
            return 0
        return int(struct.unpack("<I", self._send([(b"W", b"")], b"W"))[0])

    def finish(self) -> int:
        """Ends the renderer and returns its exit status: 0 success, 1 with errors, 2 nothing could be rendered. A scene
        that was not rendered is dropped.
        """
        process, self._process = self._process, None
        if process is None:
            self._status = self._status or 0
            return self._status
        self._drop.detach()
        self._blocks.clear()
        problem: Optional[Exception] = None
        try:
            process.close()
            frame = process.wait()
            while frame is not None:
                try:
                    self._take(*frame)
                except Exception as error:
                    problem = problem or error
                frame = process.wait()
            self._status = process.end()
        except BaseException:
            self._status = process.drop()
            raise
        if problem is not None:
            raise problem
        self._raise()
        return self._status

    # Images.

    @overload
    def render(self, data: str = "rgba", /, *, camera: str = "") -> Image: ...

    @overload
    def render(self, data: str, second: str, /, *more: str, camera: str = "") -> Tuple[Image, ...]: ...

    def render(self, *data: str, camera: str = "") -> Union[Image, Tuple[Image, ...]]:
        """Renders a frame and returns its image, or a tuple with one for each of the data.

        The data are those of ``Output``, such as "rgba" (the default), "z" or "normal N". The values are floats, before
        gain, gamma and quantization. The images of ``Output`` are written as well, and without any there is no file.
        ``camera`` is the name of a camera; the first one by default.
        """
        if "-archive" in self._options:
            raise GelatoError("a renderer that writes the calls renders nothing")
        for name in data:
            if not isinstance(name, str):
                raise TypeError("the data of an image are a text such as \"rgba\", not %r" % (name,))
        wanted = data or ("rgba",)
        self._close_blocks()
        line, file = self._place()
        payload = struct.pack("<I", line) + text(camera) + struct.pack("<I", len(wanted)) + b"".join(map(text, wanted))
        self._arriving = arriving = Arriving()
        try:
            self._send([(b"V", payload)], b"V", file)
        finally:
            self._arriving = Arriving()
        found = [arriving.done.get(number + 1) for number in range(len(wanted))]
        images = []
        for name, image in zip(wanted, found):
            if image is None:
                self._raise(found)
                raise GelatoError('no image of "%s" was rendered' % name, list(self.messages)[-1:])
            image.name = name
            images.append(image)
        result = tuple(images) if len(data) > 1 else images[0]
        self._raise(result)
        return result

    def _read(
        self, path: "Union[str, os.PathLike[str]]", subimage: int, level: int, pixels: bool
    ) -> Tuple[Reader, Optional[Image]]:
        """Returns the description of a file, and one of its images."""
        name = os.fspath(path)
        for what, number in (("subimage", subimage), ("level", level)):
            if not 0 <= number < 1 << 32:
                raise ValueError("%s is %d, and counts from 0" % (what, number))
        payload = struct.pack("<IIB", subimage, level, pixels) + text(name)
        self._arriving = arriving = Arriving()
        try:
            reader = Reader(self._send([(b"I", payload)], b"I"))
        finally:
            self._arriving = Arriving()
        if reader.take(1) == b"\0":
            raise GelatoError(reader.text())
        return reader, arriving.done.get(0)

    def image_info(self, path: "Union[str, os.PathLike[str]]") -> ImageInfo:
        """Returns the description of an image or texture file."""
        return ImageInfo(os.fspath(path), self._read(path, 0, 0, False)[0])

    def read_image(
        self, path: "Union[str, os.PathLike[str]]", subimage: int = 0, level: int = 0
    ) -> Image:
        """Reads an image or texture file: one of its images, and a level of that."""
        reader, image = self._read(path, subimage, level, True)
        if image is None:
            raise GelatoError("%s: no pixels were sent" % os.fspath(path))
        image.name = os.fspath(path)
        image.spec = ImageInfo(image.name, reader).subimages[subimage][level]
        return image

    # Blocks.

    def world(self) -> _Block:
        """Returns a block of the objects and lights of the scene: ``with r.world (): ...``. It begins with World. Its
        attributes are restored at the end, and before a frame.
        """
        return _Block(self, ["World", "PushAttributes"], "PopAttributes")

    def attributes(self) -> _Block:
        """Returns a block that restores the attributes and the transformation at its end."""
        return _Block(self, ["PushAttributes"], "PopAttributes")

    def transform(self) -> _Block:
        """Returns a block that restores the transformation at its end."""
        return _Block(self, ["PushTransform"], "PopTransform")

    def shader_group(self) -> _Block:
        """Returns a block of the layers of a shader group."""
        return _Block(self, ["ShaderGroupBegin"], "ShaderGroupEnd")

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        try:
            self.finish()
        except GelatoError:
            # The exception that ends the block is the reason.
            if kind is None:
                raise

    @staticmethod
    def CreateRenderer(*options: Any) -> "Renderer":
        """Returns another renderer of a type: none, "pyg", "pyg FILE" or "FILE.pyg". It prints its messages."""
        return Renderer(*options, on_error="print")


GelatoAPI = Renderer

_running: "weakref.WeakSet[Renderer]" = weakref.WeakSet()


@atexit.register
def finish_all() -> None:
    """Ends all renderers of this process, after they have completed their calls."""
    for renderer in list(_running):
        if renderer._process is not None and renderer._process.owner == os.getpid():
            try:
                renderer.finish()
            except (GelatoError, GelatoWarning) as error:
                # The program has ended, and cannot handle it.
                sys.stderr.write("gelato: %s\n" % error)
