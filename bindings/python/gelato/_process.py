"""The process of a renderer, and the frames to and from it.

A thread reads the frames of the renderer all the time, so that neither side blocks the other one. The program takes
them when it waits, or at its next call.
"""

import os
import queue
import subprocess
import threading
from typing import Any, List, Optional, Sequence, Tuple

try:
    from ._errors import GelatoError
    from ._stream import receive, send
except ImportError:
    # The names are part of the same program.
    pass

# The number of bytes of calls that are sent at once, and of an array that is sent without a copy.
_PIECE = 1 << 18
_LARGE = 1 << 14

# The time in seconds after which a renderer without an answer is looked at, and in which one without a connection ends.
_LOOK = 1.0
_ENDING = 5


def _listen(source: Any, frames: "queue.SimpleQueue[Optional[Tuple[bytes, bytes]]]") -> None:
    """Reads frames until the end, which is None."""
    frame: Optional[Tuple[bytes, bytes]] = (b"", b"")
    while frame is not None:
        try:
            frame = receive(source)
        except (OSError, ValueError, MemoryError):
            frame = None
        frames.put(frame)
    source.close()


class Process:
    """A renderer in another process."""

    def __init__(self, command: Sequence[str]) -> None:
        try:
            # The pipe to the renderer has no buffer that would have to be flushed in order to close it.
            self.child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        except OSError as error:
            raise GelatoError("cannot run %s: %s" % (command[0], error)) from None
        self.owner = os.getpid()
        self._pending = bytearray()
        self._frames: "queue.SimpleQueue[Optional[Tuple[bytes, bytes]]]" = queue.SimpleQueue()
        source = os.fdopen(os.dup(self.child.stdout.fileno()), "rb", 1 << 18)  # type: ignore[union-attr]
        self.child.stdout.close()  # type: ignore[union-attr]
        arguments = (source, self._frames)
        threading.Thread(target=_listen, args=arguments, name="gelato", daemon=True).start()

    def send(self, kind: bytes, payload: Any = b"") -> None:
        """Sends a frame, at once or together with later ones. Raises OSError when the renderer has ended."""
        send(self, kind, payload)

    def write(self, data: Any) -> None:
        """Takes a piece of a frame."""
        if len(data) >= _LARGE:
            self.flush()
            self._write(memoryview(data))
            return
        self._pending += data
        if len(self._pending) >= _PIECE:
            self.flush()

    def flush(self) -> None:
        """Sends the frames that wait."""
        pending, self._pending = self._pending, bytearray()
        self._write(memoryview(pending))

    def _write(self, data: memoryview) -> None:
        pipe = self.child.stdin
        while len(data):
            written = pipe.write(data)  # type: ignore[union-attr]
            data = data[written:]

    def arrived(self) -> "List[Optional[Tuple[bytes, bytes]]]":
        """Returns the frames that have arrived. None stands for the end."""
        frames = []
        while not self._frames.empty():
            frames.append(self._frames.get())
        return frames

    def wait(self) -> Optional[Tuple[bytes, bytes]]:
        """Waits for a frame, and returns None at the end. A renderer that has ended without closing its pipe, which a
        program of the scene may have inherited, counts as ended, too.
        """
        while True:
            ended = self.child.poll() is not None
            try:
                return self._frames.get(timeout=_LOOK)
            except queue.Empty:
                if ended:
                    return None

    def close(self) -> None:
        """Ends the stream of calls. The renderer completes them and ends."""
        try:
            self.flush()
        except OSError:
            pass
        self.leave()

    def leave(self) -> None:
        """Closes the pipe to the renderer."""
        try:
            self.child.stdin.close()  # type: ignore[union-attr]
        except OSError:
            pass

    def end(self) -> int:
        """Waits for the end of a renderer whose stream has ended, and returns its exit status."""
        self.leave()
        try:
            self.child.wait(_ENDING)
        except subprocess.TimeoutExpired:
            self.child.kill()
            self.child.wait()
        return self.child.returncode

    def drop(self) -> int:
        """Ends a renderer whose result is not needed, and returns its exit status. A renderer goes on that belongs to
        the process that this one was forked from.
        """
        if os.getpid() != self.owner:
            return 0
        if self.child.poll() is None:
            self.child.terminate()
        return self.end()
