# Runs inside the child interpreter: executes pieces of a Pyg script and sends their calls back. Stands behind
# bindings/python/gelato/_errors.py and _stream.py, which know the frames.
#
# In:  I file name, names of calls | N file name | X line, source | G value (answer to A)
# Out: C line, name, arguments | A declaration | P text | U files | D rebound | W (ready) | E, R, Y line, kind, text, name | Q line, code, text


def _granita_main():
    import ast
    import builtins
    import os
    import types

    # The folders of the interpreter and of installed packages, whose files belong to the machine.
    variable = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    installed = tuple(place.rstrip("/") + "/" for place in sys.path if place and place not in variable)
    opened, reported = set(), set()

    def note(event, args):
        """Keeps the names of files that are opened for reading."""
        if event != "open" or not isinstance(args[0], (str, bytes)):
            return
        name, mode, flags = args
        writes = isinstance(flags, int) and flags & (os.O_WRONLY | os.O_RDWR) == os.O_WRONLY
        if not writes and not (mode and ("w" in mode or "a" in mode or "x" in mode)):
            opened.add(os.fsdecode(name))

    if hasattr(sys, "addaudithook"):
        sys.addaudithook(note)

    source = os.fdopen(os.dup(0), "rb")
    sink = os.fdopen(os.dup(1), "wb", 1 << 18)
    # The script's own standard input is empty, and programs that it runs write to standard error.
    empty = os.open(os.devnull, os.O_RDONLY)
    os.dup2(empty, 0)
    os.close(empty)
    os.dup2(2, 1)

    def say(kind, payload=b""):
        send(sink, kind, payload)

    def hear():
        frame = receive(source)
        if frame is None:
            raise SystemExit
        return frame

    class Printed:
        encoding = "utf-8"
        errors = "strict"
        closed = False

        def write(self, s):
            if s:
                say(b"P", str(s).encode("utf-8", "replace"))
            return len(s)

        def writelines(self, lines):
            for line in lines:
                self.write(line)

        def flush(self):
            sink.flush()

        def close(self):
            """What is printed later is still heard."""

        def isatty(self):
            return False

        def writable(self):
            return True

        def fileno(self):
            return 1

    sys.stdout = Printed()

    file = "<string>"

    def line_of(frame):
        """The line of the script that the innermost call comes from."""
        while frame is not None:
            if frame.f_code.co_filename == file:
                return frame.f_lineno
            frame = frame.f_back
        return 0

    def call_of(name):
        def made(*args):
            say(b"C", call(line_of(sys._getframe(1)), name, args))
            if name in ("Render", "Command", "Input"):
                sink.flush()

        made.__name__ = made.__qualname__ = name
        return made

    def get_attribute(name):
        say(b"A", str(name).encode("utf-8", "replace"))
        sink.flush()
        return decode(hear()[1])

    get_attribute.__name__ = "GetAttribute"
    kind, payload = hear()
    file, names = payload.decode("utf-8", "surrogateescape").split("\n", 1)
    api = {name: call_of(name) for name in names.split()}
    api["GetAttribute"] = get_attribute

    # What stands behind renderers of the script's own, once it has made one.
    others = {}

    def create_renderer(*options):
        if not others:
            # Relative imports of a package that is not there fail, as they should.
            others.update(globals(), __name__="__main__", __package__=None)
            exec(compile(_RENDERER, "<gelato>", "exec"), others)
        return others["GelatoAPI"].CreateRenderer(*options)

    create_renderer.__name__ = create_renderer.__qualname__ = "CreateRenderer"

    def finish_renderers():
        if others:
            others["finish_all"]()

    class GelatoAPI:
        """The renderer that reads this scene."""

        __slots__ = ()
        CreateRenderer = staticmethod(create_renderer)

    for name, function in api.items():
        setattr(GelatoAPI, name, staticmethod(function))
    renderer = GelatoAPI()
    module = types.ModuleType("gelato", "The calls of the scene interface.")
    module.__dict__.update(api)
    module.GelatoRenderer = renderer
    module.GelatoAPI = GelatoAPI
    module.CreateRenderer = create_renderer
    module.__all__ = list(api) + ["CreateRenderer", "GelatoAPI", "GelatoRenderer"]
    sys.modules["gelato"] = module
    scope = {"__name__": "__main__", "__file__": file, "__builtins__": builtins, "GelatoRenderer": renderer}
    scope.update(api)
    # The line "import gelato" is passed over where it is flat: the module is there.
    scope.update(CreateRenderer=create_renderer, GelatoAPI=GelatoAPI, gelato=module)
    scope["__granita_finish__"] = finish_renderers
    # Scenes of this format's time use it.
    scope["xrange"] = range
    sys.argv = [file]

    def folder():
        """Where modules of the file lie."""
        return os.path.dirname(os.path.abspath(file)) if os.path.exists(file) else ""

    def tell_opened():
        """Reports the files that were opened since the last time."""
        new, found = sorted(opened - reported), []
        reported.update(new)
        for name in new:
            place = os.path.dirname(name)
            if os.path.basename(place) == "__pycache__":
                # A module is its source, not what Python keeps of it.
                name = os.path.join(os.path.dirname(place), os.path.basename(name).split(".")[0] + ".py")
            if os.path.isfile(name) and not os.path.abspath(name).startswith(installed + ("/proc/",)):
                found.append(name)
        if found:
            say(b"U", struct.pack("<I", len(found)) + b"".join(text(name) for name in found))

    def is_rebound():
        changed = any(scope.get(name) is not function for name, function in api.items())
        return changed or scope.get("GelatoRenderer") is not renderer

    sys.path[0:1] = [folder()]

    def places(error):
        """Lines of the script that the exception went through, outermost first, with the name of the function."""
        found, where = [], error.__traceback__
        while where is not None:
            if where.tb_frame.f_code.co_filename == file:
                found.append((where.tb_lineno, where.tb_frame.f_code.co_name))
            where = where.tb_next
        return found

    def place(error):
        found = places(error)
        return found[-1][0] if found else 0

    def report(kind, error):
        found = places(error)
        line = found[-1][0] if found else 0
        try:
            what = str(error)
        except Exception:
            what = ""
        if isinstance(error, SyntaxError) and error.filename == file:
            # Where Python found it is a line of the piece, not of the file.
            line, what = error.lineno or 0, error.msg.partition(" (detected at line")[0]
        if len(found) > 1:
            what += " (in %s, called from line %d)" % (found[-1][1], found[0][0])
        missing = getattr(error, "name", None) if isinstance(error, NameError) else None
        say(kind, struct.pack("<I", line) + text(type(error).__name__) + text(what) + text(missing or ""))

    def moved(code, lines):
        """The code object as if it stood so many lines further down; walking a tree of long lists would be slow."""
        inner = tuple(moved(c, lines) if isinstance(c, types.CodeType) else c for c in code.co_consts)
        return code.replace(co_firstlineno=code.co_firstlineno + lines, co_consts=inner)

    def begin(statement):
        return min([statement.lineno] + [d.lineno for d in getattr(statement, "decorator_list", ())])

    def execute(line, source):
        """Runs a piece; a statement that raises an exception is reported, and the next one follows."""
        try:
            code = compile(source, file, "exec", dont_inherit=True)
        except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
            if getattr(error, "lineno", None):
                error.lineno += line - 1
            # Nothing of the piece was executed.
            report(b"Y", error)
            return False
        try:
            exec(moved(code, line - 1), scope)
            return True
        except Exception as error:
            report(b"R", error)
            here = error.__traceback__.tb_next
            raised = here.tb_lineno - (line - 1) if here is not None else sys.maxsize
        # One by one from here on: where one has failed, others may, too.
        for statement in ast.parse(source, file).body:
            if begin(statement) <= raised:
                continue
            code = compile(ast.Module([statement], []), file, "exec", dont_inherit=True)
            try:
                exec(moved(code, line - 1), scope)
            except Exception as error:
                report(b"R", error)
        return True

    say(b"W")
    sink.flush()
    while True:
        kind, payload = hear()
        if kind == b"N":
            file = payload.decode("utf-8", "surrogateescape")
            scope["__file__"] = file
            sys.argv = [file]
            if folder() not in sys.path:
                sys.path.insert(0, folder())
            say(b"D", b"\1" if is_rebound() else b"\0")
            sink.flush()
            continue
        line = struct.unpack("<I", payload[:4])[0]
        try:
            try:
                done = execute(line, payload[4:])
            finally:
                tell_opened()
            if done:
                say(b"D", b"\1" if is_rebound() else b"\0")
        except SystemExit as leave:
            code = leave.code
            number = code or 0 if code is None or isinstance(code, int) else 1
            words = "" if code is None or isinstance(code, int) else str(code)
            say(b"Q", struct.pack("<Ii", place(leave), max(min(number, 255), -255)) + text(words))
        except BaseException as error:
            report(b"E", error)
        sink.flush()


_granita_main()
