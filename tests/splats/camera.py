"""The first of a model's photos as a viewer's camera, in the capture's coordinates.

    camera.py MODEL OUT.json
"""

import json
import math
import pathlib
import struct
import sys

path = pathlib.Path(sys.argv[1])
path = path / "model.safetensors" if path.is_dir() else path
with open(path, "rb") as file:
    (length,) = struct.unpack("<Q", file.read(8))
    header = json.loads(json.loads(file.read(length))["__metadata__"]["impasto"])
scene = header["scene"]
photo = next(p for p in scene["photos"] if p["split"] == "train")
centre, scale = scene["normalisation"]["centre"], scene["normalisation"]["scale"]
rows = photo["camera_to_world"]
position = [rows[i][3] / scale + centre[i] for i in range(3)]
size = 640 / max(photo["w"], photo["h"])
camera = {
    "position": position,
    "look_at": [position[i] + rows[i][2] / scale for i in range(3)],
    "up": [-rows[i][1] for i in range(3)],
    "fov": math.degrees(2 * math.atan(photo["h"] / 2 / photo["fl_y"])),
    "width": round(photo["w"] * size),
    "height": round(photo["h"] * size),
}
pathlib.Path(sys.argv[2]).write_text(json.dumps(camera))
