"""Runs the tools that come with the package.

    python -m gelato first [FOLDER]    renders the first example in FOLDER, by default gelato-first
    python -m gelato TOOL ...          runs gelato, maketx, imgtool, iv, gslc, gsoinfo or topyg
    python -m gelato home              prints the folder of the tools, for $GELATOHOME

A package without tools uses those of $GELATOHOME.
"""

import os
import shutil
import signal
import subprocess
import sys


def _home():
    """Returns the folder of the tools."""
    own = os.path.join(os.path.dirname(os.path.abspath(__file__)), "suite")
    for folder in (own, os.environ.get("GELATOHOME")):
        if folder and os.path.exists(os.path.join(folder, "bin", "granita")):
            return folder
    sys.exit("gelato: there are no tools in this package; set GELATOHOME to the folder of an installation")


def _run(*words):
    """Replaces this program by the one with all tools."""
    program = os.path.join(_home(), "bin", "granita")
    # Python ignores the signal, and the program would inherit that.
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    os.execv(program, [program, *words])


def run_granita():
    _run(*sys.argv[1:])


def run_gelato():
    _run("gelato", *sys.argv[1:])


def run_gslc():
    _run("gslc", *sys.argv[1:])


def run_gsoinfo():
    _run("gsoinfo", *sys.argv[1:])


def run_topyg():
    _run("topyg", *sys.argv[1:])


def _first(folder):
    """Copies the examples of the package into a folder, and renders the first one there."""
    home = _home()
    example = os.path.join("examples", "first")
    try:
        shutil.copytree(
            os.path.join(home, "examples"), os.path.join(folder, "examples"), dirs_exist_ok=True
        )
    except (OSError, shutil.Error) as error:
        sys.exit("gelato: first: %s" % error)
    words = [os.path.join(home, "bin", "granita"), "gelato", "-cwd", folder, "-threads", str(os.cpu_count() or 1)]
    status = subprocess.call([*words, os.path.join(example, "first.pyg")])
    if status == 0:
        print(os.path.join(folder, example, "out", "first.png"))
    sys.exit(status)


def main():
    words = sys.argv[1:]
    if words[:1] == ["first"] and len(words) <= 2:
        _first(words[1] if len(words) == 2 else "gelato-first")
    elif words == ["home"]:
        print(_home())
    elif words and words[0] not in ("-h", "-help", "--help", "first", "home"):
        _run(*words)
    else:
        print(__doc__.strip())
        sys.exit(0 if words[:1] in (["-h"], ["-help"], ["--help"]) else 2)


if __name__ == "__main__":
    main()
