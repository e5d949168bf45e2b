"""Renders the scenes of benches/peers/light.py and effects.py with Cycles (package `bpy`)."""

import contextlib
import os
import pickle
import sys
import time

import bpy
import numpy as np
import bmesh  # only after bpy
from mathutils import Matrix, Vector

from light_scenes import normals, read_mesh


class Cycles:
    name = "Cycles"

    def __init__(self, threads, place, read, processor):
        """`read` reads a layer of a file, or the whole file where the whole image is measured."""
        self.clock = time.process_time if processor else time.time
        self.threads, self.place, self.read = threads, place, read

    def load(self, scene, side, measure):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.measure, self.strength = measure, scene.strength
        out = self.out = bpy.context.scene
        out.render.engine = "CYCLES"
        out.render.resolution_x = out.render.resolution_y = side
        out.render.threads_mode, out.render.threads = "FIXED", self.threads
        out.render.use_persistent_data = True
        out.render.film_transparent = True
        out.render.dither_intensity = 0
        out.view_settings.view_transform = "Raw"
        settings = out.render.image_settings
        if hasattr(settings, "media_type"):
            settings.media_type = "IMAGE" if measure == "whole" else "MULTI_LAYER_IMAGE"
        settings.file_format = "OPEN_EXR" if measure == "whole" else "OPEN_EXR_MULTILAYER"
        if hasattr(settings, "use_exr_interleave"):
            settings.use_exr_interleave = True
        settings.color_depth = "32"
        settings.exr_codec = "NONE"
        c = out.cycles
        c.device, c.use_adaptive_sampling, c.use_denoising = "CPU", False, False
        c.pixel_filter_type = "BOX"
        c.max_bounces = c.diffuse_bounces = 1 if measure == "bounce" else 0
        if measure == "whole":
            c.max_bounces = c.glossy_bounces = 1
            c.blur_glossy = 0
        c.sample_clamp_indirect = c.sample_clamp_direct = 0
        c.caustics_reflective = c.caustics_refractive = False
        layer = out.view_layers[0]
        layer.use_pass_combined = measure == "whole"
        for word in ("diffuse_direct", "diffuse_indirect", "diffuse_color"):
            setattr(layer, f"use_pass_{word}", True)
        if measure == "whole":
            c.denoiser, c.denoising_input_passes = "OPENIMAGEDENOISE", "RGB_ALBEDO_NORMAL"
        self.camera(scene)
        self.lights(scene, measure)
        for shape in scene.shapes:
            self.shape(shape, (1, 1, 1) if measure == "sky" else shape.color)

    def camera(self, scene):
        camera = bpy.data.cameras.new("camera")
        camera.angle = np.radians(scene.fov)
        size = (Vector(scene.target) - Vector(scene.origin)).length
        camera.clip_start, camera.clip_end = 0.001 * size, 1000 * size
        if scene.lens:
            radius, distance = scene.lens
            camera.dof.use_dof = True
            camera.dof.focus_distance = distance
            # The focal length is in millimetres and the scene in metres.
            camera.dof.aperture_fstop = 1e-3 * camera.lens / (2 * radius)
        thing = bpy.data.objects.new("camera", camera)
        back = (Vector(scene.origin) - Vector(scene.target)).normalized()
        right = Vector((0, 1, 0)).cross(back).normalized()
        matrix = Matrix((right, back.cross(right), back)).transposed().to_4x4()
        thing.matrix_world = Matrix.Translation(scene.origin) @ matrix
        self.out.collection.objects.link(thing)
        self.out.camera = thing

    def lights(self, scene, measure):
        world = self.out.world = bpy.data.worlds.new("world")
        world.use_nodes = True
        nodes, links = world.node_tree.nodes, world.node_tree.links
        background = nodes["Background"]
        background.inputs["Color"].default_value = (1, 1, 1, 1)
        background.inputs["Strength"].default_value = float(measure in ("sky", "panorama"))
        if measure == "panorama":
            image = nodes.new("ShaderNodeTexEnvironment")
            image.image = bpy.data.images.load(os.path.abspath(scene.panorama))
            image.image.colorspace_settings.name = "Linear Rec.709"
            # In Cycles, z is up in panoramas, and their middle is towards x.
            to = nodes.new("ShaderNodeMapping")
            to.vector_type = "POINT"
            to.inputs["Rotation"].default_value = (np.pi / 2, 0, np.pi / 2)
            places = nodes.new("ShaderNodeTexCoord")
            links.new(places.outputs["Generated"], to.inputs["Vector"])
            links.new(to.outputs["Vector"], image.inputs["Vector"])
            links.new(image.outputs["Color"], background.inputs["Color"])
        if measure not in ("bounce", "whole"):
            return
        if scene.lamp:
            light = bpy.data.lights.new("lamp", "POINT")
            light.shadow_soft_size = 0
            # The energy is the power over all directions in watts, divided by pi.
            light.energy = 4 * np.pi * np.pi * scene.strength
        else:
            light = bpy.data.lights.new("sun", "SUN")
            light.angle = 0
            light.energy = np.pi * scene.strength
        thing = bpy.data.objects.new("light", light)
        if scene.lamp:
            thing.location = scene.lamp
        else:
            thing.rotation_mode = "QUATERNION"
            thing.rotation_quaternion = Vector(scene.sun).to_track_quat("-Z", "Y")
        self.out.collection.objects.link(thing)

    def shape(self, shape, color):
        mesh = bpy.data.meshes.new(shape.name)
        if shape.spheres:
            # Cycles has no spheres of its own.
            whole = bmesh.new()
            for x, y, z, r in shape.spheres:
                bmesh.ops.create_uvsphere(whole, u_segments=96, v_segments=48, radius=r, matrix=Matrix.Translation((x, y, z)))
            whole.to_mesh(mesh)
            whole.free()
            mesh.shade_smooth()
        elif shape.file:
            vertices, triangles = read_mesh(shape.file)
            mesh.from_pydata(vertices.tolist(), [], triangles.tolist())
            mesh.normals_split_custom_set_from_vertices(normals(vertices, triangles).tolist())
        else:
            points = [p for quad in shape.quads for p in quad]
            mesh.from_pydata(points, [], [tuple(range(4 * k, 4 * k + 4)) for k in range(len(shape.quads))])
        material = bpy.data.materials.new(shape.name)
        material.use_nodes = True
        nodes = material.node_tree.nodes
        nodes.clear()
        out = nodes.new("ShaderNodeOutputMaterial")
        links = material.node_tree.links

        def lobe(kind, color, alpha):
            node = nodes.new(kind)
            node.inputs["Color"].default_value = (*color, 1)
            if kind == "ShaderNodeBsdfAnisotropic":
                # The roughness of Cycles is the root of the width of its lobe.
                node.distribution = "GGX"
                node.inputs["Roughness"].default_value = alpha ** 0.5
            return node.outputs[0]

        if shape.mirror:
            surface = lobe("ShaderNodeBsdfAnisotropic", color, shape.mirror / 2.8)
        else:
            surface = lobe("ShaderNodeBsdfDiffuse", color, 0)
        if shape.highlight:
            both = nodes.new("ShaderNodeAddShader")
            bright = 4 * 0.24 * 0.24 * shape.highlight
            links.new(surface, both.inputs[0])
            links.new(lobe("ShaderNodeBsdfAnisotropic", (bright,) * 3, 0.24), both.inputs[1])
            surface = both.outputs[0]
        links.new(surface, out.inputs["Surface"])
        mesh.materials.append(material)
        self.out.collection.objects.link(bpy.data.objects.new(shape.name, mesh))

    def render(self, spp, seed=0, denoise=False):
        """Returns the image of the measured light, without direct light of lamps (with all light where the whole image
        is measured), and the seconds. `denoise` removes its noise with Open Image Denoise."""
        self.out.cycles.use_denoising = denoise
        self.out.cycles.samples, self.out.cycles.seed = spp, seed
        self.out.render.filepath = f"{self.place}/cycles.exr"
        with silence():
            begin = self.clock()
            bpy.ops.render.render(write_still=True)
            seconds = self.clock() - begin
        # The names differ before version 5.
        if self.measure == "whole":
            return self.read(self.out.render.filepath), seconds
        part = ("Diffuse Indirect", "DiffInd") if self.measure == "bounce" else ("Diffuse Direct", "DiffDir")
        light, color = (self.read(self.out.render.filepath, names) for names in (part, ("Diffuse Color", "DiffCol")))
        return light * color, seconds


@contextlib.contextmanager
def silence():
    """Discards the standard output, on which Cycles prints every file that it saves."""
    kept, nothing = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nothing)


if __name__ == "__main__":
    # Renders one small image, to measure the start of the program, as light_mitsuba does.
    with open(sys.argv[1], "rb") as file:
        threads, place, scene, side, measure = pickle.load(file)
    program = Cycles(threads, place, lambda path, words: 1, False)
    program.load(scene, side, measure)
    program.render(4)
