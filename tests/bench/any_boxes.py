#!/usr/bin/env python3
"""Random stacks of boxes, seen by rings of four sensors and calibrated without a model.

  any_boxes.py VOLALIGN FOLDER [--stacks 50] [--first 0] [--sensors realsense_d415 ...] [--empty]

Each stack has two to eight boxes of a random size, half of them turned by any angle, each on the one before. It is rendered in
a furnished room (volalign render) with every sensor model and calibrated (volalign calibrate without --model). Printed as
Markdown: how many sensors were placed of those that see two boxes or more and some floor, how many in all, how many with `ok`
are over 10 cm or 5 deg off, and the errors. --empty: the same rooms without the stack, in which nothing may be placed.
"""

import argparse
import json
import math
import pathlib
import random
import sys

import numpy as np

from common import D415, KINECT, run
from grey_png import read_png
import accuracy

SENSORS = [KINECT, "kinect_v2", "kinect_v1", D415]
MOST_OFF_M, MOST_OFF_DEG = 0.10, 5  # of a pose that is not wrong
BOX_SHARE, FLOOR_SHARE = 0.005, 0.02  # of the picture: what counts as seen
FLOOR_M = 0.03


def stack(seed):
    """[name, [min, max] mm along x, y, z, yaw_deg] of each box."""
    draw = random.Random(seed)
    count = draw.randint(2, 8)
    heights = [draw.uniform(150, 450) for _ in range(count)]
    scale = min(1, 1600 / sum(heights))
    boxes, x, y, z = [], 0.0, 0.0, 0.0
    for k in range(count):
        a, b, h = draw.uniform(250, 600), draw.uniform(250, 600), heights[k] * scale
        yaw = draw.choice([0, draw.uniform(-45, 45)])
        boxes.append((f"box{k}", [x - a / 2, x + a / 2], [y, y + h], [z - b / 2, z + b / 2], yaw))
        x, y, z = x + draw.uniform(-120, 120), y + h, z + draw.uniform(-120, 120)
    return boxes


def write_inputs(folder, seed, sensor, boxes):
    lines = [f"name: stack{seed}", "boxes:"]
    for name, x, y, z, yaw in boxes:
        spans = ", ".join(f"{axis}: [{lo:.1f}, {hi:.1f}]" for axis, (lo, hi) in zip("xyz", (x, y, z)))
        lines.append(f"  - {{name: {name}, {spans}, yaw_deg: {yaw:.2f}}}")
    (folder / "stack.yaml").write_text("\n".join(lines) + "\n")
    top = boxes[-1][2][1] / 10
    draw = random.Random(1000 + seed)
    lines = [f"structure: {folder / 'stack.yaml'}", "room: true", "noise: sensor", f"seed: {seed}",
             "assembly: {position_mm: 3, yaw_deg: 0, size_scale_percent: 0}", "sensors:"]
    for k in range(4):
        lines.append(f"  - {{name: S{k}, sensor: {sensor}, rho_cm: {draw.uniform(170, 240):.0f}, "
                     f"phi_deg: {90 * k + draw.uniform(-20, 20):.0f}, height_cm: {draw.uniform(80, 150):.0f}, "
                     f"roll_deg: {draw.choice([0, 90])}, look_at_cm: [0, {top / 2:.0f}, 0]}}")
    (folder / "rig.yaml").write_text("\n".join(lines) + "\n")


def sees_enough(folder, capture, sensor, truth):
    """Two boxes or more, and some floor?"""
    labels, depth = (read_png(folder / name)[1::3, 1::3] for name in (f"{sensor['name']}_labels.png", sensor["depth"]))
    k, z = sensor["intrinsics"], depth * sensor.get("depth_scale", capture.get("depth_scale", 0.001))
    v, u = np.mgrid[1 : k["height"] : 3, 1 : k["width"] : 3]
    height = np.dstack([(u - k["cx"]) / k["fx"] * z, (v - k["cy"]) / k["fy"] * z, z, np.ones(z.shape)]) @ truth[1]
    floor = (labels == 0) & (z > 0) & (abs(height) < FLOOR_M)
    boxes = np.bincount((labels[labels > 0].astype(int) - 1) // 5)
    return sum(boxes > BOX_SHARE * labels.size) >= 2 and floor.mean() > FLOOR_SHARE


def calibrate(options, seed, sensor):
    """(asked, found, capture) of one rig: the rows of its sensors."""
    folder = options.folder / f"{seed}_{sensor}{'_empty' if options.empty else ''}"
    folder.mkdir(parents=True, exist_ok=True)
    result = folder / "out" / "extrinsics.json"
    if not result.exists():
        write_inputs(folder, seed, sensor, stack(seed))
        run(options.program, "render", "--rig", folder / "rig.yaml", "-o", folder, *(["--set", "structure_present=false"] if options.empty else []))
        run(options.program, "calibrate", "--capture", folder / "capture.json", "--structure", folder / "stack.yaml", "--model", "none", "-o", folder / "out")
    capture, extrinsics = json.loads((folder / "capture.json").read_text()), json.loads(result.read_text())
    rows = []
    for one in capture["sensors"]:
        found = extrinsics["sensors"][one["name"]]
        truth = capture.get("ground_truth", {}).get(one["name"])
        enough = not options.empty and sees_enough(folder, capture, one, truth)
        error = found.get("error", {})
        rows.append({"stack": seed, "sensor": sensor, "name": one["name"], "enough": enough, "status": found["status"],
                     "code": found.get("code", ""), "mm": 1000 * error.get("translation_m", math.nan),
                     "deg": error.get("rotation_deg", math.nan),
                     "initial_mm": 1000 * distance(found, truth), "seconds": extrinsics["timings_s"]["initial_pose"] / 4})
        row = rows[-1]
        row["off"] = row["status"] != "failed" and not (row["mm"] <= 1000 * MOST_OFF_M and row["deg"] <= MOST_OFF_DEG)
    return rows


def distance(found, truth):
    if "initial" not in found or truth is None:
        return math.nan
    return math.dist([found["initial"][i][3] for i in range(3)], [truth[i][3] for i in range(3)])


def quantiles(values):
    return accuracy.quantiles(values, (0.5, 0.95, 1))


def print_table(rows, sensors):
    print("| sensors | placed of those that see enough | of all | wrong `ok` | wrong `weak` | initial, mm | refined, mm | s |")
    print("|---|---|---|---|---|---|---|---|")
    for sensor in sensors + (["all"] if len(sensors) > 1 else []):
        some = [row for row in rows if sensor in (row["sensor"], "all")]
        enough = [row for row in some if row["enough"]]
        placed = [row for row in some if row["status"] != "failed"]
        right = [row for row in placed if not row["off"]]
        wrong = {status: sum(row["off"] and row["status"] == status for row in placed) for status in ("ok", "weak")}
        print(f"| {sensor} | {sum(row['status'] != 'failed' and not row['off'] for row in enough)} of {len(enough)} | {len(right)} of {len(some)} | "
              f"{wrong['ok']} | {wrong['weak']} | {quantiles([row['initial_mm'] for row in right])} | "
              f"{quantiles([row['mm'] for row in right])} | {quantiles([row['seconds'] for row in some])} |")
    print()
    for row in rows:
        if row["off"] or (row["enough"] and row["status"] == "failed"):
            print(f"- stack {row['stack']}, {row['sensor']} {row['name']}: {row['status']} {row['code']}, "
                  f"{row['mm']:.0f} mm and {row['deg']:.1f} deg off")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path, help="what is there already is not done again")
    parser.add_argument("--stacks", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--sensors", nargs="+", default=SENSORS)
    parser.add_argument("--empty", action="store_true")
    options = parser.parse_args()
    rows = []
    for seed in range(options.first, options.first + options.stacks):
        for sensor in options.sensors:
            rows += calibrate(options, seed, sensor)
            print(f"{len(rows)} sensors", end="\r", file=sys.stderr, flush=True)
    print_table(rows, options.sensors)


if __name__ == "__main__":
    main()
