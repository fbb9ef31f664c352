#!/usr/bin/env python3
"""Does a capture of recordings calibrate as the depth files do that were recorded?

    tests/compat/read_recordings.py VOLALIGN      (the program)

Renders a RealSense and an Azure Kinect, has librealsense record the one and ffmpeg and mkvmerge write the other, drafts a
capture.json from the two recordings, and compares the poses. Needs pyrealsense2 2.56 (2.59 records no .bag) and imageio-ffmpeg of PyPI,
numpy, and mkvmerge (Debian's mkvtoolnix).
"""

import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "cli"))
sys.dont_write_bytecode = True

import record_depth  # noqa: E402
from program import TWO_SENSORS, InAFolder, main  # noqa: E402

from grey_png import read_png  # noqa: E402


class Recordings(InAFolder):
    def test_poses_are_those_of_the_depth_files(self):
        self.write("rig.yaml", TWO_SENSORS)
        self.expect("render --rig rig.yaml -o files", 0)
        sensors = self.json("files/capture.json")["sensors"]
        frames = {sensor["name"]: record_depth.np.array(read_png(self.path("files", sensor["depth"])), "uint16") for sensor in sensors}
        os.mkdir(self.path("recordings"))
        a, b = (sensor["intrinsics"] for sensor in sensors)
        # A raw calibration has shares of the chip's side, of the binned chip of 512 pixels.
        d = a["distortion"]
        raw = [(a["cx"] + 96.5) / 512, (a["cy"] + 90.5) / 512, a["fx"] / 512, a["fy"] / 512]
        raw += [d[0], d[1], d[4], d[5], d[6], d[7], 0, 0, d[3], d[2]]
        record_depth.record_mkv(self.path("recordings/A.mkv"), [frames["A"]], raw)
        record_depth.record_bag(self.path("recordings/B.bag"), [frames["B"]], (b["fx"], b["fy"], b["cx"], b["cy"]))

        self.expect("init recordings", 0)
        poses = []
        for name in ("files", "recordings"):
            self.expect(f"calibrate --capture {name}/capture.json --model models/m05-lite.safetensors -o out_{name}", 0)
            poses.append(self.json(f"out_{name}/extrinsics.json")["sensors"])
        for name in ("A", "B"):
            x, y = (record_depth.np.array(p[name]["structure_from_sensor"]) for p in poses)
            difference = abs(x - y).max()
            print(f"{name}: {poses[1][name]['status']}, poses differ by {1000 * difference:.3f} mm")
            # The recorder says that the RealSense is rectified, the rendered capture only what kind of device it is.
            assert difference < 5e-4, name
            assert poses[0][name]["status"] == poses[1][name]["status"]
        assert poses[1]["A"]["serial"] == "000123492812" and poses[1]["B"]["sensor"] == "realsense_d415"


if __name__ == "__main__":
    main(__doc__)
