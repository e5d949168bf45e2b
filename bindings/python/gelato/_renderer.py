"""A renderer that is another process. The package uses it, and so does ``CreateRenderer`` in a scene file that is a
script. For scripts, the renderer runs this file after ``_stream.py``, as one program.
"""

import atexit
import os
import shutil
import struct
import subprocess
import sys
import weakref

try:
    from ._calls import CALLS
    from ._stream import call, decode, receive, send
except ImportError:
    # The functions are part of the same program, and CALLS has the names without descriptions.
    pass

# The calls that return only when they are done.
_SLOW = ("Render", "Command", "Input")


class GelatoError(RuntimeError):
    """The renderer cannot be started, or ended early."""


def _command_line(options):
    """Returns the options of the program for the arguments of CreateRenderer: a type of renderer, then options."""
    options = list(options)
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


def _program():
    named = os.environ.get("GELATO")
    if named:
        return named
    home = os.environ.get("GELATOHOME")
    if home:
        path = os.path.join(home, "bin", "gelato.exe" if os.name == "nt" else "gelato")
        if os.path.exists(path):
            return path
    found = shutil.which("gelato")
    if found is None:
        raise GelatoError("there is no program gelato on the search path; set GELATO to its place")
    return found


def _drop(child, owner):
    """Ends a renderer whose result is not needed, unless it belongs to the process that this one was forked from."""
    if os.getpid() != owner:
        return
    if child.poll() is None:
        child.terminate()
    _leave(child)


def _leave(child):
    """Closes the connection to a renderer, waits for its end, and returns its exit status."""
    for pipe in (child.stdin, child.stdout):
        try:
            pipe.close()
        except (OSError, ValueError):
            pass
    try:
        child.wait(5)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()
    return child.returncode


class GelatoAPI:
    """A renderer, which is a process that receives calls."""

    def __init__(self, *options):
        self._options = _command_line(options)
        self._child = None
        self._status = None
        self._file = None
        # True while the renderer is busy and an answer is expected.
        self._busy = False

    def _start(self):
        if self._status is not None:
            raise GelatoError("the renderer has been finished")
        command = [_program(), "-stream", *self._options]
        try:
            self._child = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=1 << 18
            )
        except OSError as error:
            raise GelatoError("cannot run %s: %s" % (command[0], error)) from None
        self._owner = os.getpid()
        _running.add(self)
        self._drop = weakref.finalize(self, _drop, self._child, os.getpid())
        # At the end of the program, finish_all ends the renderers instead.
        self._drop.atexit = False

    def _ended(self):
        child, self._child = self._child, None
        self._drop.detach()
        self._status = _leave(child)
        raise GelatoError("the renderer ended with status %d" % self._status) from None

    def _send(self, kind, payload):
        if self._child is None:
            self._start()
        try:
            send(self._child.stdin, kind, payload)
        except (BrokenPipeError, OSError):
            self._ended()

    def _answer(self):
        """Returns the answer of the renderer. Text that it prints before goes to standard output."""
        try:
            self._child.stdin.flush()
        except (BrokenPipeError, OSError):
            self._ended()
        self._busy = True
        while True:
            frame = receive(self._child.stdout)
            if frame is None:
                self._ended()
            kind, payload = frame
            if kind != b"P":
                self._busy = False
                return payload
            sys.stdout.write(payload.decode("utf-8", "replace"))

    def _call(self, name, args):
        frame = sys._getframe(2)
        payload = call(frame.f_lineno, name, args)
        file = frame.f_code.co_filename
        if file != self._file:
            self._send(b"F", file.encode("utf-8", "surrogateescape"))
            self._file = file
        self._send(b"C", payload)
        if name == "Command" and args[:1] == ("exit",):
            self.finish()
        elif name in _SLOW:
            self._send(b"W", b"")
            self._answer()

    def GetAttribute(self, name):
        self._send(b"A", str(name).encode("utf-8", "replace"))
        return decode(self._answer())

    GetAttribute.__doc__ = CALLS["GetAttribute"]

    @property
    def errors(self):
        """The number of errors that the renderer has reported so far."""
        if self._child is None:
            return 0
        self._send(b"W", b"")
        return struct.unpack("<I", self._answer())[0]

    def finish(self):
        """Ends the renderer and returns its exit status. A scene that was not rendered is dropped."""
        if self._child is not None:
            child, self._child = self._child, None
            self._drop.detach()
            if self._busy:
                # The wait for the answer was interrupted.
                _drop(child, os.getpid())
                self._status = child.returncode
                return self._status
            try:
                child.stdin.close()
            except OSError:
                pass
            while True:
                frame = receive(child.stdout)
                if frame is None:
                    break
                if frame[0] == b"P":
                    sys.stdout.write(frame[1].decode("utf-8", "replace"))
            child.stdout.close()
            self._status = child.wait()
        elif self._status is None:
            self._status = 0
        return self._status

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.finish()

    @staticmethod
    def CreateRenderer(*options):
        """Returns another renderer of a type: none, "pyg", "pyg FILE" or "FILE.pyg"."""
        return GelatoAPI(*options)


def _method(name):
    def method(self, *args):
        self._call(name, args)

    method.__name__ = name
    method.__qualname__ = "GelatoAPI." + name
    method.__doc__ = CALLS[name]
    return method


for _name in CALLS:
    if _name != "GetAttribute":
        setattr(GelatoAPI, _name, _method(_name))

_running = weakref.WeakSet()


@atexit.register
def finish_all():
    """Ends all renderers of this process, after they have completed their calls."""
    for renderer in list(_running):
        if renderer._child is not None and renderer._owner == os.getpid():
            renderer.finish()
