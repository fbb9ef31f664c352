#!/usr/bin/env python3
"""What `volalign check` finds: a rendered rig is calibrated, one of its sensors is moved, the stack is built up elsewhere, and the
rig is calibrated again. Devices keep their errors.

  moved_sensors.py VOLALIGN MODEL FOLDER [--seeds 3000:3010] [--mm 5,10,15,20,30] [--deg 0.2,0.4,0.6,1.2]

mm and deg: movements to try, each of one of the eight Azure Kinects of configs/rig_ring8.yaml. The stack stands anywhere within
0.5 m of where it stood, its boxes 3 mm off their places. A row: of how many moved sensors that both calibrations place and call
ok the movement was found, and how many of all others were accused. Sensor and direction are drawn from the seed.
"""

import argparse
import json
import math
import pathlib
import random

from common import D415, KINECT, ROOT, run, table


def rendered(options, trials, seed, folder):
    """The name of the sensor that every trial moves; its captures lie in folder/placement_2 and on, the first one in placement_1."""
    draw = random.Random(seed)
    mover = f"S{draw.randint(1, 8)}"
    radius, angle, yaw = 0.5 * math.sqrt(draw.random()), draw.uniform(0, 2 * math.pi), draw.uniform(0, 360)
    rig = (ROOT / "configs/rig_ring8.yaml").read_text().replace(D415, KINECT) + "placements:\n"
    for _, mm, deg in trials:
        axis = [draw.gauss(0, 1) for _ in range(3)]
        moved = {"sensor": mover, **{key: [size * a / math.hypot(*axis) for a in axis] for key, size in (("translation_mm", mm), ("rotation_deg", deg))}}
        place = {"x_cm": 100 * radius * math.cos(angle), "z_cm": 100 * radius * math.sin(angle), "yaw_deg": yaw, "moved": [moved]}
        rig += f"  - {json.dumps(place)}\n"
    (folder / "rig.yaml").write_text(rig)
    run(options.program, "render", "--rig", folder / "rig.yaml", "--set", "assembly.position_mm=3", f"seed={seed}",
        f"structure_yaw_deg={137.50776405003785 * seed % 360}", "-o", folder)
    return mover


def ok(calibration):
    sensors = json.loads((calibration / "extrinsics.json").read_text())["sensors"]
    return {name for name, sensor in sensors.items() if sensor["status"] == "ok"}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("model", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", default="3000:3010")
    parser.add_argument("--mm", default="5,10,15,20,30")
    parser.add_argument("--deg", default="0.2,0.4,0.6,1.2")
    options = parser.parse_args()
    trials = [("nothing", 0, 0), *((f"{mm} mm", float(mm), 0) for mm in options.mm.split(",")), *((f"{deg} deg", 0, float(deg)) for deg in options.deg.split(","))]
    found, accused = {label: [] for label, _, _ in trials}, {label: [] for label, _, _ in trials}
    undecided = dict.fromkeys(found, 0)
    for seed in range(*map(int, options.seeds.split(":"))):
        folder = options.folder / str(seed)
        folder.mkdir(parents=True, exist_ok=True)
        mover, last = rendered(options, trials, seed, folder), folder / "last"
        common = ("--model", options.model, "--no-report", "--threads", "2")
        run(options.program, "calibrate", "--capture", folder / "placement_1/capture.json", *common, "-o", last)
        for k, (label, mm, deg) in enumerate(trials, 2):
            now = folder / f"check_{k}"
            run(options.program, "check", "--extrinsics", last / "extrinsics.json", "--capture", folder / f"placement_{k}/capture.json", *common, "-o", now)
            for sensor in json.loads((now / "check.json").read_text())["sensors"]:
                undecided[label] += sensor["movement"] == "undecided"
                if sensor["name"] != mover or mm + deg == 0:
                    accused[label].append(sensor["movement"] == "moved")
                elif mover in ok(last) & ok(now):
                    found[label].append(sensor["movement"] == "moved")
    rows = [(label, f"{sum(found[label])} of {len(found[label])}" if found[label] else "-", f"{sum(accused[label])} of {len(accused[label])}", undecided[label])
            for label in found]
    print(table(["movement", "found", "others accused", "undecided"], rows))


if __name__ == "__main__":
    main()
