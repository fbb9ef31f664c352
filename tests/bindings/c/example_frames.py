"""A rendered capture as the C example reads it, and what it prints."""

import json
import os
import struct
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", ".."))
from grey_png import read_png  # noqa: E402


def write_list(capture, folder):
    """Writes the frames of a capture.json as PGM and their list, sensors.txt. The list's path, and (sensor, width, height, depth) of each frame."""
    with open(capture, encoding="utf-8") as file:
        sensors = json.load(file)["sensors"]
    frames, path = [], os.path.join(folder, "sensors.txt")
    with open(path, "w", encoding="utf-8") as lines:
        for sensor in sensors:
            rows = read_png(os.path.join(os.path.dirname(capture), sensor["depth"]))
            (height, width), depth = rows.shape, rows.ravel().tolist()
            pgm = os.path.join(folder, sensor["name"] + ".pgm")
            with open(pgm, "wb") as file:
                file.write(b"P5 %d %d 65535\n" % (width, height) + struct.pack(f">{len(depth)}H", *depth))
            k = sensor["intrinsics"]
            frames.append((sensor, width, height, depth))
            numbers = [k["fx"], k["fy"], k["cx"], k["cy"]]
            print(sensor["name"], sensor.get("sensor", "-"), *map(repr, numbers), pgm, *map(repr, k.get("distortion", [])), file=lines)
    return path, frames


def poses_of(output):
    """Of what an example printed: name -> 16 numbers, or None."""
    found = {}
    for line in output.splitlines():
        name, _, *pose = line.split(" # ")[0].split()
        found[name] = list(map(float, pose)) or None
    return found
