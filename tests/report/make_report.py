#!/usr/bin/env python3
"""Writes the report that the tests beside this file look at: four rendered sensors, one of them blind.

    tests/report/make_report.py VOLALIGN FOLDER

FOLDER then has calibration/report.html, rig.glb and extrinsics.json.
"""

import os
import struct
import subprocess
import sys
import zlib

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BLIND = "S4"
NOTE = "S4's lens was covered; <b>S2</b> on the new tripod"


def write_blank_depth(path, width, height):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = (b"\0" + bytes(2 * width)) * height
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0))
                   + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def main(volalign, folder, note=NOTE):
    capture, output = os.path.join(folder, "capture"), os.path.join(folder, "calibration")
    subprocess.run([volalign, "render", "--rig", "configs/rig_ring4.yaml", "--force", "-o", capture], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    write_blank_depth(os.path.join(capture, f"{BLIND}_depth.png"), 320, 288)
    run = subprocess.run([volalign, "calibrate", "--model", "models/m05-lite.safetensors", "--capture", os.path.join(capture, "capture.json"), "-o", output, "--note", note], cwd=ROOT)
    if run.returncode != 2:
        sys.exit(f"calibrate ended with {run.returncode}; with a blind sensor 2 is expected")


if __name__ == "__main__":
    main(*(os.path.abspath(path) for path in sys.argv[1:3]))
