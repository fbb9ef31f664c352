#!/usr/bin/env python3
"""Does a capture of recordings calibrate as the depth files do that were recorded?

    tests/compat/read_recordings.py VOLALIGN      (the program)

Renders a RealSense and an Azure Kinect, has librealsense record the one and ffmpeg and mkvmerge write the other, drafts a
capture.json from the two recordings, and compares the poses. Needs pyrealsense2 2.56 (2.59 records no .bag) and imageio-ffmpeg of PyPI,
numpy, and mkvmerge (Debian's mkvtoolnix).
"""

import json
import os
import subprocess
import sys
import tempfile

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
sys.dont_write_bytecode = True

import record_depth

RIG = """
room: true
noise: none
seed: 3
sensors:
  - {name: A, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: 30}
  - {name: B, sensor: realsense_d415, rho_cm: 200, phi_deg: 80}
"""


def read_png(path):
    """A 16-bit grey PNG, by ffmpeg."""
    command = [record_depth.imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-i", path]
    raw = subprocess.run(command + ["-f", "rawvideo", "-pix_fmt", "gray16le", "-"], stdout=subprocess.PIPE, check=True).stdout
    return record_depth.np.frombuffer(raw, dtype="<u2")


def main():
    program = os.path.abspath(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:

        def volalign(*arguments):
            subprocess.run([program, *arguments], cwd=folder, stdout=subprocess.DEVNULL, check=True)

        with open(os.path.join(folder, "rig.yaml"), "w", encoding="utf-8") as file:
            file.write(RIG)
        volalign("render", "--rig", "rig.yaml", "-o", "files")
        with open(os.path.join(folder, "files", "capture.json"), encoding="utf-8") as file:
            capture = json.load(file)
        frames = {}
        for sensor in capture["sensors"]:
            k = sensor["intrinsics"]
            frames[sensor["name"]] = read_png(os.path.join(folder, "files", sensor["depth"])).reshape(k["height"], k["width"])
        os.makedirs(os.path.join(folder, "recordings"))
        a, b = (sensor["intrinsics"] for sensor in capture["sensors"])
        # A raw calibration has shares of the chip's side, of the binned chip of 512 pixels.
        d = a["distortion"]
        raw = [(a["cx"] + 96.5) / 512, (a["cy"] + 90.5) / 512, a["fx"] / 512, a["fy"] / 512]
        raw += [d[0], d[1], d[4], d[5], d[6], d[7], 0, 0, d[3], d[2]]
        record_depth.record_mkv(os.path.join(folder, "recordings", "A.mkv"), [frames["A"]], raw)
        lens = (b["fx"], b["fy"], b["cx"], b["cy"])
        record_depth.record_bag(os.path.join(folder, "recordings", "B.bag"), [frames["B"]], lens)

        volalign("init", "recordings")
        for name in ("files", "recordings"):
            arguments = ["--model", "models/m05-lite.safetensors", "-o", "out_" + name]
            volalign("calibrate", "--capture", name + "/capture.json", *arguments)
        poses = []
        for name in ("files", "recordings"):
            with open(os.path.join(folder, "out_" + name, "extrinsics.json"), encoding="utf-8") as file:
                poses.append(json.load(file)["sensors"])
        for name in ("A", "B"):
            x, y = (record_depth.np.array(p[name]["structure_from_sensor"]) for p in poses)
            difference = abs(x - y).max()
            print(f"{name}: {poses[1][name]['status']}, poses differ by {1000 * difference:.3f} mm")
            # The recorder says that the RealSense is rectified, the rendered capture only what kind of device it is.
            assert difference < 5e-4, name
            assert poses[0][name]["status"] == poses[1][name]["status"]
        assert poses[1]["A"]["serial"] == "000123492812" and poses[1]["B"]["sensor"] == "realsense_d415"


if __name__ == "__main__":
    main()
