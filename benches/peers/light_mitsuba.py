"""Renders the scenes of benches/peers/light.py and effects.py with Mitsuba 3 (package `mitsuba`), which also makes the references."""

import pickle
import sys
import time

import mitsuba as mi
import numpy as np

# The largest number of samples that are traced at once.
AT_ONCE = 1 << 24


class Mitsuba:
    name = "Mitsuba"

    def __init__(self, variant, processor):
        """Selects the fastest available variant. The just-in-time compiler needs an LLVM library of a known version
        (DRJIT_LIBLLVM_PATH)."""
        self.clock = time.process_time if processor else time.time
        for name in [variant] if variant else ["llvm_ad_rgb", "scalar_rgb"]:
            try:
                mi.set_variant(name)
                self.variant = name
                break
            except ImportError:
                continue
        else:
            raise ImportError(f"no variant {variant}")

    @staticmethod
    def read(path):
        return np.array(mi.Bitmap(path).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))

    @staticmethod
    def layer(path, names):
        """Returns the channels of the layer of a file whose name ends in one of `names`."""
        parts = mi.Bitmap(path).split()
        found = [part for title, part in parts if title.split(".")[-1] in names]
        return np.array(found[0].convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))

    def load(self, scene, files, side, measure):
        t = mi.ScalarTransform4f()
        white = measure == "sky"
        self.camera = {
            "type": "perspective", "fov": scene.fov, "near_clip": 0.001 * np.linalg.norm(np.subtract(scene.target, scene.origin)),
            "far_clip": 1e7, "to_world": t.look_at(origin=scene.origin, target=scene.target, up=[0, 1, 0]),
            "film": {"type": "hdrfilm", "width": side, "height": side, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
            "sampler": {"type": "multijitter"},
        }
        if scene.lens:
            radius, distance = scene.lens
            self.camera.update(type="thinlens", aperture_radius=radius, focus_distance=distance)
        words = {"type": "scene", "sensor": self.camera}
        self.sensors = {}
        strength = {"type": "rgb", "value": [np.pi * scene.strength] * 3}
        if measure == "sky":
            words["light"] = {"type": "constant", "radiance": {"type": "rgb", "value": [1, 1, 1]}}
        elif measure == "panorama":
            words["light"] = {"type": "envmap", "filename": scene.panorama}
        elif scene.lamp:
            words["light"] = {"type": "point", "position": list(scene.lamp), "intensity": strength}
        else:
            words["light"] = {"type": "directional", "direction": list(scene.sun), "irradiance": strength}
        for shape in scene.shapes:
            color = (1, 1, 1) if white else shape.color
            bsdf = {"type": "twosided", "bsdf": self.reflection(shape, color)}
            for k, (x, y, z, r) in enumerate(shape.spheres):
                words[f"{shape.name}_{k}"] = {"type": "sphere", "center": [x, y, z], "radius": r, "bsdf": bsdf}
            if not shape.spheres:
                words[shape.name] = {"type": "obj", "filename": files[shape.name], "face_normals": not shape.file, "bsdf": bsdf}
        self.scene = mi.load_dict(words, optimize=False)
        self.side = side

    @staticmethod
    def reflection(shape, color):
        color = {"type": "rgb", "value": list(color)}
        if shape.mirror:
            # The root mean square of the angles of reflected rays is about that of the cone.
            return {"type": "roughconductor", "distribution": "ggx", "alpha": shape.mirror / 2.8, "material": "none",
                    "specular_reflectance": color}
        if shape.highlight:
            # A highlight of about the same size. In its middle, 4 % are reflected, times 1 / (4 pi alpha^2), of the
            # irradiance pi.
            alpha = 0.24
            return {"type": "roughplastic", "distribution": "ggx", "alpha": alpha, "diffuse_reflectance": color,
                    "specular_reflectance": shape.highlight * 4 * alpha * alpha / 0.04}
        return {"type": "diffuse", "reflectance": color}

    def integrator(self, measure):
        if measure == "sky":
            # Only cosine-distributed rays are traced. The result is better than with additional rays towards the
            # uniform sky.
            return mi.load_dict({"type": "direct", "emitter_samples": 0, "bsdf_samples": 1})
        if measure == "panorama":
            return mi.load_dict({"type": "direct", "hide_emitters": True})
        return mi.load_dict({"type": "path", "max_depth": {"direct": 2, "bounce": 3, "whole": 3}[measure]})

    def render(self, measure, spp, seed=0):
        integrator = self.integrator(measure)
        bands = self.bands(max(1, spp * self.side * self.side // AT_ONCE))
        begin = self.clock()
        parts = [np.array(mi.render(self.scene, sensor=band, integrator=integrator, spp=spp, seed=seed + 7919 * k))
                 for k, band in enumerate(bands)]
        return np.concatenate(parts), self.clock() - begin

    def clean(self, denoise, spp, seed=0):
        """Returns the whole image without its noise, with albedo and normals, and the seconds."""
        integrator = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal", "inner": self.integrator("whole")})
        begin = self.clock()
        parts = [np.array(mi.render(self.scene, sensor=band, integrator=integrator, spp=spp, seed=seed + 7919 * k))
                 for k, band in enumerate(self.bands(max(1, spp * self.side * self.side // AT_ONCE)))]
        image = np.concatenate(parts)
        image = denoise(image[..., :3], image[..., 3:6], image[..., 6:9])
        return image, self.clock() - begin

    def bands(self, count):
        """Returns cameras that show some rows each. All samples of a pixel are then traced together and stay well
        distributed."""
        if count not in self.sensors:
            edges = [self.side * k // count for k in range(count + 1)]
            film = dict(self.camera["film"], crop_width=self.side, crop_offset_x=0)
            self.sensors[count] = [
                mi.load_dict(dict(self.camera, film=dict(film, crop_offset_y=a, crop_height=b - a))) for a, b in zip(edges, edges[1:])
            ]
        return self.sensors[count]

    def shapes(self):
        """Returns the number of the shape that each pixel shows, counted from 1; -1 for none and on edges of shapes."""
        integrator = mi.load_dict({"type": "aov", "aovs": "s:shape_index,t:depth"})
        image = np.array(mi.render(self.scene, integrator=integrator, spp=64))
        index, depth = image[..., -2], image[..., -1]
        whole = np.where(depth > 0, np.round(index), -1)
        mixed = np.abs(index - np.round(index)) > 1e-3
        out = np.where(around(whole, np.ptp) | around(mixed, np.max), -1, whole)
        return out.astype(int)


def around(image, what):
    """Returns for each pixel whether `what` of it and its eight neighbours is greater than 0."""
    all = [np.roll(image, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1)]
    return what(np.stack(all).astype(float), 0) > 0


if __name__ == "__main__":
    # Renders one small image, to measure the start of the program, which the times of images do not contain.
    with open(sys.argv[1], "rb") as file:
        variant, scene, files, side, measure = pickle.load(file)
    program = Mitsuba(variant, False)
    program.load(scene, files, side, measure)
    program.render(measure, 4)
