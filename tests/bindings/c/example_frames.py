"""A rendered capture as the C and C# examples read it, and what they print."""

import json
import os
import struct
import zlib


def read_png(path):
    """(width, height, 16-bit values) of a grey PNG without interlacing."""
    with open(path, "rb") as file:
        data = file.read()
    at, packed = 8, b""
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        kind, chunk = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, bits, colour, _, _, interlace = struct.unpack(">IIBBBBB", chunk)
            assert (bits, colour, interlace) == (16, 0, 0), path
        elif kind == b"IDAT":
            packed += chunk
        at += 12 + length
    raw, stride, above, values = zlib.decompress(packed), 2 * width, bytearray(2 * width), []
    for v in range(height):
        kind, row = raw[v * (stride + 1)], bytearray(raw[v * (stride + 1) + 1 : (v + 1) * (stride + 1)])
        for i in range(stride):
            left, up, corner = row[i - 2] if i > 1 else 0, above[i], above[i - 2] if i > 1 else 0
            if kind == 1:
                guess = left
            elif kind == 2:
                guess = up
            elif kind == 3:
                guess = (left + up) // 2
            elif kind == 4:
                guess = min((left, up, corner), key=lambda x: abs(left + up - corner - x))
            else:
                guess = 0
            row[i] = (row[i] + guess) & 255
        above = row
        values += struct.unpack(f">{width}H", row)
    return width, height, values


def write_list(capture, folder):
    """Writes the frames of a capture.json as PGM and their list, sensors.txt. The list's path, and (sensor, width, height, depth) of each frame."""
    with open(capture, encoding="utf-8") as file:
        sensors = json.load(file)["sensors"]
    frames, path = [], os.path.join(folder, "sensors.txt")
    with open(path, "w", encoding="utf-8") as lines:
        for sensor in sensors:
            width, height, depth = read_png(os.path.join(os.path.dirname(capture), sensor["depth"]))
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
