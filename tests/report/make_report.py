#!/usr/bin/env python3
"""Writes the report that the tests beside this file look at: four rendered sensors, one of them blind.

    tests/report/make_report.py VOLALIGN FOLDER

FOLDER then has calibration/report.html, rig.glb and extrinsics.json.
"""

import os
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, "tests"))
from grey_png import write_png  # noqa: E402

BLIND = "S4"
NOTE = "S4's lens was covered; <b>S2</b> on the new tripod"


def main(volalign, folder, note=NOTE):
    capture, output = os.path.join(folder, "capture"), os.path.join(folder, "calibration")
    subprocess.run([volalign, "render", "--rig", "configs/rig_ring4.yaml", "--force", "-o", capture], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    write_png(os.path.join(capture, f"{BLIND}_depth.png"), [[0] * 320] * 288)
    run = subprocess.run([volalign, "calibrate", "--model", "models/m05-lite.safetensors", "--capture", os.path.join(capture, "capture.json"), "-o", output, "--note", note], cwd=ROOT)
    if run.returncode != 2:
        sys.exit(f"calibrate ended with {run.returncode}; with a blind sensor 2 is expected")


if __name__ == "__main__":
    main(*(os.path.abspath(path) for path in sys.argv[1:3]))
