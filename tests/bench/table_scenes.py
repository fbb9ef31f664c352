#!/usr/bin/env python3
"""Two depth cameras see two cartons on a table (cho11, mai7): how far calibration without any option is from a reference by other means.

    VOLALIGN_CAPTURES=FOLDER tests/bench/table_scenes.py build/release/cli/volalign [--set KEY=VALUE ...]

FOLDER/table has the scenes, and reference.json with cam1_from_cam2 of each, which is known to 3 to 5 cm and 0.4 deg; the frames have no licence to be shipped.
One line a sensor, and one of each scene: the distance between the reference and the calibration's cam1_from_cam2, mm, and the angle, deg. Also the pallet
(FOLDER/pallet), whose cartons are seen from straight above, as it is and with every depth 1 cm longer or shorter: how far the pose moves beyond that. Needs NumPy
and Pillow.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from PIL import Image


def calibrate(options, capture, structure, folder):
    """The sensors of extrinsics.json, by name."""
    command = [options.program, "calibrate", "--capture", capture, "--structure", structure, "-o", folder]
    for change in options.set:
        command += ["--set", change]
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True)
    if done.returncode not in (0, 2):
        sys.exit(done.stderr)
    return json.loads((folder / "extrinsics.json").read_text())["sensors"]


def show(name, sensor):
    gain = f", gain {sensor['depth_gain']:.4f}" if "depth_gain" in sensor else ""
    print(f"{name}: {sensor['status']}{gain} {sensor.get('reason', '')}")


def moved(sensor, reference):
    """mm and deg from one pose to another."""
    off = np.linalg.inv(reference) @ sensor
    return 1000 * np.linalg.norm(off[:3, 3]), np.degrees(np.arccos(np.clip((np.trace(off[:3, :3]) - 1) / 2, -1, 1)))


def scene(options, name, reference, folder):
    base = options.captures / "table" / name
    sensors = calibrate(options, base / "capture.json", base / "boxes.yaml", folder)
    for sensor in sensors:
        show(f"{name} {sensor}", sensors[sensor])
    poses = [np.array(sensor["structure_from_sensor"]) for sensor in sensors.values() if "structure_from_sensor" in sensor]
    if len(poses) == 2:
        off = moved(np.linalg.inv(poses[0]) @ poses[1], np.array(reference))
        print(f"{name}: {off[0]:.0f} mm, {off[1]:.2f} deg from the reference")


def pallet(options, folder):
    base = options.captures / "pallet"
    capture = json.loads((base / "capture.json").read_text())
    depth = np.array(Image.open(base / "cam.png")).astype(int)
    first = None
    for shift in (0, 10, -10):  # mm
        shifted = folder / f"pallet_{shift}"
        shifted.mkdir()
        Image.fromarray(np.where(depth > 0, depth + shift, 0).astype(np.uint16)).save(shifted / "cam.png")
        (shifted / "capture.json").write_text(json.dumps({key: value for key, value in capture.items() if key != "structure"}))
        sensor = calibrate(options, shifted / "capture.json", base / "pal.yaml", shifted / "out")["cam"]
        show(f"pallet {shift:+d} mm", sensor)
        if "structure_from_sensor" not in sensor:
            continue
        pose = np.array(sensor["structure_from_sensor"])
        first = pose if first is None else first
        along = np.eye(4)
        along[2, 3] = -shift / 1000  # the sensor is nearer by as much
        off = moved(pose @ np.linalg.inv(along), first)
        print(f"pallet {shift:+d} mm: moved by {off[0]:.0f} mm and {off[1]:.2f} deg")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("--set", nargs="+", default=[])
    options = parser.parse_args()
    options.captures = pathlib.Path(os.environ["VOLALIGN_CAPTURES"])
    references = json.loads((options.captures / "table" / "reference.json").read_text())
    with tempfile.TemporaryDirectory() as folder:
        for name in ("cho11", "mai7"):
            scene(options, name, references[name], pathlib.Path(folder) / name)
        pallet(options, pathlib.Path(folder))


if __name__ == "__main__":
    main()
