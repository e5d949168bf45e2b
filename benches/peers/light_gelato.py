"""Renders the scenes of benches/peers/light.py and effects.py with gelato."""

import math
import os
import resource
import subprocess
import time


def processor_time():
    """Returns the processor time, in seconds, of the programs that were started and have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


class Gelato:
    """Renders with a program of this suite. Images are arrays of `side` x `side` x 3."""

    name = "gelato"

    def __init__(self, program, threads, place, read, processor):
        self.clock = processor_time if processor else time.time
        self.program, self.threads, self.place, self.read = program, threads, place, read
        self.image = f"{place}/out.exr"

    def panorama(self, path):
        """Makes an environment map of a panorama, once for all images. This is not timed. Those of OpenEXR have y up,
        like the scenes."""
        map = f"{self.place}/panorama.exr"
        command = f'Command ("system maketx -envlatl -format OpenEXR {os.path.abspath(path)} -o {map}")'
        subprocess.run([self.program, "-silent", "-"], input=command.encode(), check=True)

    def render(self, scene, files, side, measure, options, more=()):
        """Returns the image and the seconds of the whole program, with `more` words on its command line. `measure` is
        "direct", "bounce", "sky" (the unoccluded part of the sky), "panorama", "drawn" (the light of the panorama, in
        directions distributed by it), or "whole" (direct light, highlights and reflections). `options` are parameters of the
        light or the shader that is measured; for "whole" those of the mirror."""
        text = self.text(scene, files, side, measure, options)
        words = [self.program, "-silent", "-threads", str(self.threads), *more, "-"]
        begin = self.clock()
        subprocess.run(words, input=text.encode(), check=True)
        seconds = self.clock() - begin
        return self.read(self.image), seconds

    def text(self, scene, files, side, measure, options):
        o, t = scene.origin, scene.target
        x, y, z = (b - a for a, b in zip(o, t))
        turn, tilt = math.degrees(math.atan2(x, z)), math.degrees(math.atan2(y, math.hypot(x, z)))
        # Mitsuba moves the origins of rays along the normal by 9e-5 of this length. That is about half the distance at
        # which our rays start. (Our default, 0.01 units, is a twentieth of the size of Stanford's dragon.)
        bias = 1.8e-4 * (1 + max(abs(c) for c in t))
        lines = [
            f'Attribute ("float shadow:bias", {bias})',
            f'Attribute ("int[2] resolution", ({side}, {side}))',
            'Attribute ("string projection", "perspective")',
            'Attribute ("int[2] spatialquality", (4, 4))',
            # The other programs use the same filter.
            f'Output ("{self.image}", "OpenEXR", "rgb", "camera", "string filter", "box", "float[2] filterwidth", (1, 1))',
            f'Attribute ("float fov", {scene.fov})',
            *self.lens(scene),
            "Scale (-1, 1, 1)",
            f"Rotate ({tilt}, 1, 0, 0)", f"Rotate ({-turn}, 0, 1, 0)", f"Translate ({-o[0]}, {-o[1]}, {-o[2]})",
            "World ()",
        ]
        if measure == "panorama":
            lines += [
                "PushAttributes ()", 'Attribute ("string geometryset", "light")',
                f'Shader ("surface", "envsurf", "string envname", "{self.place}/panorama.exr")',
                "Scale (1e5, 1e5, 1e5)", "Sphere (1, -1, 1, 360)", "PopAttributes ()",
            ]
        elif measure in ("direct", "bounce", "whole") and scene.lamp:
            lines.append(f'Light ("lamp", "pointlight", "float intensity", {scene.strength}, "float falloff", 2, '
                         f'"point from", {scene.lamp}, "string shadowname", "light")')
        elif measure in ("direct", "bounce", "whole"):
            lines.append(f'Light ("sun", "distantlight", "float intensity", {scene.strength}, "point from", (0, 0, 0), '
                         f'"point to", {scene.sun}, "string shadowname", "light")')
        if measure in ("bounce", "panorama"):
            lines.append(f'Light ("bounce", "indirectlight", "string indirectname", "light", {options})')
        if measure == "drawn":
            lines.append(f'Light ("panorama", "envlight", "string occlusionname", "light", "string envname", "{self.place}/panorama.exr", {options})')
        if measure == "sky":
            lines.append(f'Shader ("surface", "ambocclude", "string occlusionname", "light", "float twosided", 1, {options})')
        else:
            lines.append('Shader ("surface", "matte", "float Ka", 0)')
        lines.append('Attribute ("string geometryset", "+light")')
        for shape in scene.shapes:
            lines.append(f'Attribute ("color C", {tuple(shape.color)})')
            if measure == "whole":
                lines.append(self.shader(shape, options))
            for x, y, z, r in shape.spheres:
                lines += ["PushTransform ()", f"Translate ({x}, {y}, {z})", f"Sphere ({r}, {-r}, {r}, 360)", "PopTransform ()"]
            for quad in shape.quads:
                lines.append(f'Mesh ("linear", (4,), (0, 1, 2, 3), "vertex point P", {tuple(v for p in quad for v in p)})')
            if shape.file:
                lines.append(f'Input ("{files[shape.name]}")')
        return "\n".join(lines + ["Render ()", ""])

    @staticmethod
    def lens(scene):
        if not scene.lens:
            return []
        radius, distance = scene.lens
        return ['Attribute ("float fstop", 1)', f'Attribute ("float focallength", {2 * radius})',
                f'Attribute ("float focaldistance", {distance})']

    @staticmethod
    def shader(shape, options):
        if shape.mirror:
            more = f", {options}" if options else ""
            return f'Shader ("surface", "shinymetal", "float Ka", 0, "float Ks", 0, "string envname", "light", "float blur", {shape.mirror}{more})'
        if shape.highlight:
            return f'Shader ("surface", "plastic", "float Ka", 0, "float roughness", 0.03, "float Ks", {shape.highlight})'
        return 'Shader ("surface", "matte", "float Ka", 0)'
