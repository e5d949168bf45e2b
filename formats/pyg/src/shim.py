# Runs inside the child interpreter: executes pieces of a Pyg script and sends their calls back.
#
# Frames on both pipes: one byte kind, four bytes length, payload; numbers are little endian.
# In:  I file name | X line, source | G value (answer to A)
# Out: C line, name, arguments | A declaration | P text | D rebound | E line, kind, text, name | Q line, code, text


def _granita_main():
    import array
    import builtins
    import os
    import struct
    import sys
    import types

    source = os.fdopen(os.dup(0), "rb")
    sink = os.fdopen(os.dup(1), "wb", 1 << 18)
    # The script's own standard input is empty, and programs that it runs write to standard error.
    empty = os.open(os.devnull, os.O_RDONLY)
    os.dup2(empty, 0)
    os.close(empty)
    os.dup2(2, 1)
    swap = sys.byteorder == "big"

    def send(kind, payload=b""):
        sink.write(kind + struct.pack("<I", len(payload)))
        sink.write(payload)

    def receive():
        head = source.read(5)
        if len(head) < 5:
            raise SystemExit
        kind, length = head[:1], struct.unpack("<I", head[1:])[0]
        payload = source.read(length)
        if len(payload) < length:
            raise SystemExit
        return kind, payload

    def text(s):
        data = s.encode("utf-8", "surrogateescape")
        return struct.pack("<I", len(data)) + data

    class Printed:
        encoding = "utf-8"
        errors = "strict"
        closed = False

        def write(self, s):
            if s:
                send(b"P", str(s).encode("utf-8", "replace"))
            return len(s)

        def writelines(self, lines):
            for line in lines:
                self.write(line)

        def flush(self):
            sink.flush()

        def isatty(self):
            return False

        def writable(self):
            return True

        def fileno(self):
            return 1

    sys.stdout = Printed()

    def numbers(value):
        """A flat array of a sequence of numbers: integers if all are, else floats."""
        try:
            return b"I", array.array("i", value)
        except (TypeError, OverflowError):
            return b"F", array.array("f", value)

    def leaves(value, depth=0):
        if depth > 64:
            raise TypeError("sequences nested too deep")
        for item in value:
            if isinstance(item, (str, bytes)) or not hasattr(item, "__iter__"):
                yield item
            else:
                yield from leaves(item, depth + 1)

    def encode(value):
        if value is None:
            return b"N"
        if isinstance(value, str):
            return b"s" + text(value)
        if isinstance(value, bytes):
            return b"s" + text(value.decode("utf-8", "surrogateescape"))
        if isinstance(value, int):
            if -(1 << 63) <= value < 1 << 63:
                return b"i" + struct.pack("<q", value)
            return b"f" + struct.pack("<d", float(value))
        if isinstance(value, float):
            return b"f" + struct.pack("<d", value)
        if hasattr(value, "__iter__") or hasattr(value, "__getitem__"):
            flat = value if isinstance(value, (list, tuple, range)) else list(value)
            try:
                code, data = numbers(flat)
            except TypeError:
                flat = list(leaves(flat))
                if any(isinstance(item, (str, bytes)) for item in flat):
                    words = [w.decode("utf-8", "replace") if isinstance(w, bytes) else w for w in flat]
                    if not all(isinstance(w, str) for w in words):
                        raise TypeError("a sequence mixes strings and numbers") from None
                    return b"S" + struct.pack("<I", len(words)) + b"".join(map(text, words))
                code, data = numbers(flat)
            if swap:
                data.byteswap()
            return code + struct.pack("<I", len(data)) + data.tobytes()
        if hasattr(value, "__index__"):
            return encode(value.__index__())
        if hasattr(value, "__float__"):
            return b"f" + struct.pack("<d", float(value))
        raise TypeError("cannot pass a value of type %s to the renderer" % type(value).__name__)

    def decode(data):
        kind, rest = data[:1], data[1:]
        if kind == b"i":
            return struct.unpack("<q", rest)[0]
        if kind == b"f":
            return struct.unpack("<d", rest)[0]
        if kind == b"s":
            return rest[4:].decode("utf-8")
        if kind in (b"I", b"F"):
            values = array.array("i" if kind == b"I" else "f", rest[4:])
            if swap:
                values.byteswap()
            return tuple(values)
        if kind == b"S":
            words, at = [], 4
            while at < len(rest):
                length = struct.unpack_from("<I", rest, at)[0]
                words.append(rest[at + 4 : at + 4 + length].decode("utf-8"))
                at += 4 + length
            return tuple(words)
        return None

    file = "<string>"

    def line_of(frame):
        """The line of the script that the innermost call comes from."""
        while frame is not None:
            if frame.f_code.co_filename == file:
                return frame.f_lineno
            frame = frame.f_back
        return 0

    def call_of(name):
        def call(*args):
            parts = [struct.pack("<I", line_of(sys._getframe(1))), text(name), struct.pack("<I", len(args))]
            parts.extend(map(encode, args))
            send(b"C", b"".join(parts))
            if name in ("Render", "Command", "Input"):
                sink.flush()

        call.__name__ = call.__qualname__ = name
        return call

    def get_attribute(name):
        send(b"A", str(name).encode("utf-8", "replace"))
        sink.flush()
        return decode(receive()[1])

    get_attribute.__name__ = "GetAttribute"
    kind, payload = receive()
    file, names = payload.decode("utf-8", "surrogateescape").split("\n", 1)
    api = {name: call_of(name) for name in names.split()}
    api["GetAttribute"] = get_attribute

    class GelatoAPI:
        """The renderer that reads this scene."""

        __slots__ = ()

    for name, function in api.items():
        setattr(GelatoAPI, name, staticmethod(function))
    renderer = GelatoAPI()
    module = types.ModuleType("gelato", "The calls of the scene interface.")
    module.__dict__.update(api)
    module.GelatoRenderer = renderer
    module.__all__ = list(api) + ["GelatoRenderer"]
    sys.modules["gelato"] = module
    scope = {"__name__": "__main__", "__file__": file, "__builtins__": builtins, "GelatoRenderer": renderer}
    scope.update(api)
    # Scenes of this format's time use it.
    scope["xrange"] = range
    sys.argv = [file]
    sys.path[0:1] = [os.path.dirname(os.path.abspath(file)) if os.path.exists(file) else ""]

    def place(error):
        line, where = 0, error.__traceback__
        while where is not None:
            if where.tb_frame.f_code.co_filename == file:
                line = where.tb_lineno
            where = where.tb_next
        return line

    def report(error):
        line = place(error)
        what = str(error)
        if isinstance(error, SyntaxError) and error.filename == file:
            line, what = error.lineno or 0, error.msg
        missing = getattr(error, "name", None) if isinstance(error, NameError) else None
        payload = struct.pack("<I", line) + text(type(error).__name__) + text(what)
        send(b"E", payload + text(missing or ""))

    def moved(code, lines):
        """The code object as if it stood so many lines further down; walking a tree of long lists would be slow."""
        inner = tuple(moved(c, lines) if isinstance(c, types.CodeType) else c for c in code.co_consts)
        return code.replace(co_firstlineno=code.co_firstlineno + lines, co_consts=inner)

    def execute(line, source):
        try:
            code = compile(source, file, "exec", dont_inherit=True)
        except SyntaxError as error:
            if error.lineno:
                error.lineno += line - 1
            raise
        exec(moved(code, line - 1), scope)

    while True:
        kind, payload = receive()
        line = struct.unpack("<I", payload[:4])[0]
        try:
            execute(line, payload[4:])
            rebound = any(scope.get(name) is not function for name, function in api.items())
            rebound = rebound or scope.get("GelatoRenderer") is not renderer
            send(b"D", b"\1" if rebound else b"\0")
        except SystemExit as leave:
            code = leave.code
            number = code or 0 if code is None or isinstance(code, int) else 1
            words = "" if code is None or isinstance(code, int) else str(code)
            send(b"Q", struct.pack("<Ii", place(leave), max(min(number, 255), -255)) + text(words))
        except BaseException as error:
            report(error)
        sink.flush()


_granita_main()
