#!/usr/bin/env python3
"""Checks an EXR with cryptomattes in Blender's own reader: `pip install bpy==4.5.15` (Python 3.11).

    check_blender.py FILE.exr NAME [PIXELS]
    check_blender.py FILE.exr --uv TEXTURE

Prints the passes that Blender finds and the area of the matte NAME by its Cryptomatte node; exit code 1 if
that is not PIXELS, as check_cryptomatte.py prints it. With --uv, it maps the texture through the
layer `uv` with Blender's Map UV node and compares the result with the layer `albedo`; exit code 1 if they differ by more
than the filters explain. bpy is 370 MB, so CI does not run this.
"""
import os
import sys
import tempfile

import bpy
import numpy as np

path, name = os.path.abspath(sys.argv[1]), sys.argv[2]
scene = bpy.context.scene
image = bpy.data.images.load(path)
print(f"Blender {bpy.app.version_string}")

scene.use_nodes = True
nodes, links = scene.node_tree.nodes, scene.node_tree.links
nodes.clear()
node = nodes.new("CompositorNodeImage")
node.image = image
print("passes", " ".join(socket.name for socket in node.outputs if socket.enabled))


def shown(socket, mode):
    """Renders the output of a compositor socket at the image's size."""
    out = nodes.new("CompositorNodeOutputFile")
    folder = out.base_path = tempfile.mkdtemp()
    out.format.file_format = "OPEN_EXR"
    out.format.color_mode = mode
    out.format.color_depth = "32"
    links.new(socket, out.inputs[0])
    bpy.ops.render.render()
    nodes.remove(out)
    written = bpy.data.images.load(os.path.join(folder, os.listdir(folder)[0]))
    return np.array(written.pixels[:], np.float64).reshape(written.size[1], written.size[0], written.channels)


scene.render.engine = "CYCLES"
scene.render.resolution_x, scene.render.resolution_y = image.size
scene.render.resolution_percentage = 100
bpy.ops.object.select_all(action="SELECT")
bpy.ops.object.delete()
bpy.ops.object.camera_add()
scene.camera = bpy.context.object
scene.cycles.samples = 1

if name == "--uv":
    texture = nodes.new("CompositorNodeImage")
    texture.image = bpy.data.images.load(os.path.abspath(sys.argv[3]))
    mapped = nodes.new("CompositorNodeMapUV")
    links.new(texture.outputs["Image"], mapped.inputs["Image"])
    links.new(node.outputs["uv"], mapped.inputs["UV"])
    found, expected = shown(mapped.outputs["Image"], "RGB"), shown(node.outputs["albedo"], "RGB")
    off = np.abs(found - expected)[..., :3].mean()
    print(f"texture through Map UV and `uv`: {off:.4f} from `albedo` on average, whose mean is {expected.mean():.4f}")
    sys.exit(bool(off > 0.05 * expected.mean()))

crypto = nodes.new("CompositorNodeCryptomatteV2")
crypto.source = "IMAGE"
crypto.image = image
crypto.matte_id = name
pixels = shown(crypto.outputs["Matte"], "BW")[..., 0]
print(f"matte {name}: {pixels.sum():.4f} pixels by Blender's Cryptomatte node")
if len(sys.argv) > 3:
    sys.exit(bool(abs(pixels.sum() - float(sys.argv[3])) > 1e-3))
