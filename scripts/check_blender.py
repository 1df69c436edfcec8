#!/usr/bin/env python3
"""What Blender's own reader makes of an EXR with cryptomattes: `pip install bpy==4.5.15` (Python 3.11).

    check_blender.py FILE.exr NAME [PIXELS]

Prints the passes that Blender finds and the area of the matte NAME by its Cryptomatte node; exit code 1 if
that is not PIXELS, as check_cryptomatte.py prints it. bpy is 370 MB, so CI does without.
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

crypto = nodes.new("CompositorNodeCryptomatteV2")
crypto.source = "IMAGE"
crypto.image = image
crypto.matte_id = name
out = nodes.new("CompositorNodeOutputFile")
out.base_path = tempfile.mkdtemp()
out.format.file_format = "OPEN_EXR"
out.format.color_mode = "BW"
out.format.color_depth = "32"
out.file_slots[0].path = "matte"
links.new(crypto.outputs["Matte"], out.inputs[0])
scene.render.engine = "CYCLES"
bpy.ops.object.select_all(action="SELECT")
bpy.ops.object.delete()
bpy.ops.object.camera_add()
scene.camera = bpy.context.object
scene.cycles.samples = 1
bpy.ops.render.render()
written = os.path.join(out.base_path, sorted(os.listdir(out.base_path))[0])
matte = bpy.data.images.load(written)
pixels = np.array(matte.pixels[:], np.float64).reshape(-1, matte.channels)[:, 0]
print(f"matte {name}: {pixels.sum():.4f} pixels by Blender's Cryptomatte node")
if len(sys.argv) > 3:
    sys.exit(bool(abs(pixels.sum() - float(sys.argv[3])) > 1e-3))
