"""Writes the wheel of the packages gelato and granita with the program inside. `cargo xtask dist` runs it.

    wheel.py PACKAGE HOME DOC OUT TAG

PACKAGE is bindings/python, HOME becomes gelato/suite, DOC has the licences and the bill of materials, OUT is the folder
of the wheel. The time of all files is SOURCE_DATE_EPOCH, so that the same files give the same bytes.
"""

import base64
import hashlib
import os
import pathlib
import sys
import time
import tomllib
import zipfile

# The names in the folder bin of an environment. maketx and iv are not among them, because the wheel of OpenImageIO has
# them: they are "granita maketx" and "granita iv", and scripts in gelato/suite/bin.
COMMANDS = ("granita", "gelato", "gslc", "gsoinfo", "topyg")
TOOLS = ("gelato", "maketx", "oiio-maketx", "gslc", "gsoinfo", "topyg", "imgtool", "iv")

SCRIPT = """#!/bin/sh
exec "$(dirname -- "$(readlink -f -- "$0")")/granita" %s "$@"
"""

# The files of DOC that go into the folder of metadata.
LICENCES = ("LICENSE-MIT", "LICENSE-APACHE", "LICENSES-OF-OTHERS")


def metadata(project, readme, version):
    """Returns the file METADATA for the table "project" of pyproject.toml."""
    lines = [
        "Metadata-Version: 2.4",
        "Name: " + project["name"],
        "Version: " + version,
        "Summary: " + project["description"],
        "Requires-Python: " + project["requires-python"],
    ]
    licence = project["license"]
    lines.append("License-Expression: " + (licence if isinstance(licence, str) else licence["text"]))
    lines += ["License-File: " + name for name in LICENCES]
    lines += ["Requires-Dist: " + name for name in project.get("dependencies", ())]
    for extra, names in project.get("optional-dependencies", {}).items():
        lines.append("Provides-Extra: " + extra)
        for name in names:
            name, _, marker = name.partition(";")
            marker = "(%s) and " % marker.strip() if marker else ""
            lines.append('Requires-Dist: %s; %sextra == "%s"' % (name.strip(), marker, extra))
    lines.append("Description-Content-Type: text/markdown")
    return "\n".join(lines) + "\n\n" + readme


def files(package, home, doc, tag):
    """Yields the name, the bytes and the permissions of every file, and the name of the folder of metadata."""
    with open(package / "pyproject.toml", "rb") as source:
        project = tomllib.load(source)["project"]
    version = next(
        line.split('"')[1]
        for line in (package / "gelato/__init__.py").read_text("utf-8").splitlines()
        if line.startswith("__version__")
    )
    info = "%s-%s.dist-info" % (project["name"].replace("-", "_"), version)
    found = {}
    for path in sorted((package / "gelato").rglob("*")) + sorted((package / "granita").rglob("*")):
        if path.is_file() and path.suffix != ".pyc":
            found[path.relative_to(package).as_posix()] = (path.read_bytes(), 0o644)
    for path in sorted(home.rglob("*")):
        if path.is_file():
            mode = 0o755 if path.parent.name == "bin" else 0o644
            found["gelato/suite/" + path.relative_to(home).as_posix()] = (path.read_bytes(), mode)
    for tool in TOOLS:
        found["gelato/suite/bin/" + tool] = ((SCRIPT % tool).encode(), 0o755)
    for name in LICENCES:
        found["%s/licenses/%s" % (info, name)] = ((doc / name).read_bytes(), 0o644)
    found[info + "/sboms/granita.cdx.json"] = ((doc / "sbom.cdx.json").read_bytes(), 0o644)
    scripts = ["%s = gelato.__main__:run_%s\n" % (name, name) for name in COMMANDS]
    readme = (package / project["readme"]).read_text("utf-8")
    wheel = "Wheel-Version: 1.0\nGenerator: granita\nRoot-Is-Purelib: false\nTag: %s\n" % tag
    found[info + "/entry_points.txt"] = (("[console_scripts]\n" + "".join(scripts)).encode(), 0o644)
    found[info + "/METADATA"] = (metadata(project, readme, version).encode(), 0o644)
    found[info + "/WHEEL"] = (wheel.encode(), 0o644)
    return found, info


def main():
    package, home, doc, out = map(pathlib.Path, sys.argv[1:5])
    tag = sys.argv[5]
    found, info = files(package, home, doc, tag)
    record = ""
    for name, (data, _) in found.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
        record += "%s,sha256=%s,%d\n" % (name, digest, len(data))
    found[info + "/RECORD"] = ((record + info + "/RECORD,,\n").encode(), 0o644)
    # Archives of this kind have no times before 1980.
    moment = time.gmtime(max(int(os.environ["SOURCE_DATE_EPOCH"]), 315532800))[:6]
    path = out / ("%s-%s.whl" % (info[: -len(".dist-info")], tag))
    part = path.with_suffix(".part")
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, (data, mode) in found.items():
            entry = zipfile.ZipInfo(name, moment)
            entry.external_attr = (0o100000 | mode) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3
            archive.writestr(entry, data, compresslevel=9)
    os.replace(part, path)


if __name__ == "__main__":
    main()
