#!/usr/bin/env python3
"""Wrong descriptions of hand-built stacks, calibrated without a model: is the fault named, and is anything wrong without doubt?

  wrong_stacks.py VOLALIGN FOLDER [--rigs own5_realsense own6_kinects] [--only turned] [--frames] [--model MODEL]

The captures are folders of $VOLALIGN_CAPTURES/foreign with capture.json, which has ground_truth, and boxes.yaml, whose boxes stand
on each other. Each description is boxes.yaml with one change: a box turned by 90 deg, laid on another edge, left out, put in
where none is, shifted by 15 cm, 2 cm higher, two exchanged, or the whole mirrored; what stands on a box that is changed is let down or lifted.
--frames: the true description, and instead the frame of each sensor, then all, mirrored, turned by 180 deg or with a depth scale 2 %
too large; those of two sensors exchanged; and one of another capture. Printed as Markdown, a row each:
how many sensors are ok, weak and failed; whether the fault is named, in `assembly`, of the sensors or of the rig; whether
the file says "as described"; sensors more than 0.1 m or 10 deg (of scales and heights 20 mm or 1 deg) wrong, after the best rigid
alignment of most sensors onto the truth, and those of them of which nothing says that they may stand elsewhere.
"""

import argparse
import copy
import itertools
import json
import math
import os
import pathlib
import re
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from grey_png import read_png, write_png  # noqa: E402

AXES = "xyz"
WRONG_M, WRONG_DEG = 0.1, 10
SHIFT_MM, HIGHER_MM, SCALE = 150, 20, 1.02
# m, deg: of what is wrong by little.
LITTLE = {"higher": (0.02, 1), "frames scaled": (0.02, 1)}
# Reasons to be weak that say that the sensor may stand elsewhere, or the boxes.
DOUBTS = {"ambiguous", "duplicate_depth", "same_pose", "unsolved", "intrinsics_suspect"}


def read_boxes(path):
    boxes = []
    for name, rest in re.findall(r"\{name: (\w+), (.*)\}", path.read_text()):
        spans = {axis: [float(n) for n in re.search(rf"{axis}: \[([^\]]*)\]", rest)[1].split(",")] for axis in AXES}
        boxes.append({"name": name, **spans})
    return boxes


def size(box, axis):
    return box[axis][1] - box[axis][0]


def resized(box, x, y, z):
    """About its middle, and from its foot up."""
    out = dict(box)
    for axis, edge in (("x", x), ("z", z)):
        middle = sum(box[axis]) / 2
        out[axis] = [middle - edge / 2, middle + edge / 2]
    out["y"] = [box["y"][0], box["y"][0] + y]
    return out


def piled(boxes, foot):
    out = []
    for box in boxes:
        out.append({**box, "y": [foot, foot + size(box, "y")]})
        foot = out[-1]["y"][1]
    return out


def changes(boxes):
    """(kind, fault, description): what the description has, seen from what is there."""
    foot = boxes[0]["y"][0]

    def with_box(i, box):
        return piled(boxes[:i] + [box] + boxes[i + 1:], foot)

    for i, box in enumerate(boxes):
        x, y, z = (size(box, axis) for axis in AXES)
        yield "turned", box["name"], with_box(i, resized(box, z, y, x))
        yield "edge", box["name"], with_box(i, resized(box, y, x, z) if i % 2 else resized(box, x, z, y))
        yield "left out", box["name"], piled(boxes[:i] + boxes[i + 1:], foot)
        more = {**resized(boxes[-1 - i], 330, 260, 390), "name": "more"}
        yield "put in", f"on {box['name']}", piled(boxes[:i + 1] + [more] + boxes[i + 1:], foot)
        along, sign = ("x", 1) if i % 2 else ("z", -1)
        yield "shifted", box["name"], with_box(i, {**box, along: [n + sign * SHIFT_MM for n in box[along]]})
        yield "higher", box["name"], with_box(i, resized(box, x, y + HIGHER_MM, z))
    for i, j in itertools.combinations(range(len(boxes)), 2):
        swapped = list(boxes)
        for to, of in ((i, j), (j, i)):
            swapped[to] = {**boxes[of], "name": boxes[to]["name"]}
        yield "exchanged", f"{boxes[i]['name']} {boxes[j]['name']}", piled(swapped, foot)
    yield "mirrored", "", [{**box, "z": [-box["z"][1], -box["z"][0]]} for box in boxes]


NAMES = {"turned": ["turned"], "edge": ["edge"], "left out": ["higher than described"], "put in": ["missing"],
         "shifted": ["shifted"], "higher": [], "exchanged": ["swapped", "exchanged"], "mirrored": ["mirrored"]}
NAMED_BY = {"frames scaled": ("size_off", "depth_off", "depth_scale", "pair_apart"), "frames exchanged": ("files_exchanged",)}


def is_named(kind, fault, result):
    """Is it said, and of the right boxes? What else looks the same may be named beside it."""
    sentence = result.get("assembly", {}).get("sentence", "")
    if kind == "left out" and any("does not have" in finding["hint"] for finding in result.get("findings", [])):
        return True
    if kind in ("turned", "edge", "higher") and any(finding["code"] == "box_off" and finding["about"] == [fault] for finding in result.get("findings", [])):
        return True
    if kind == "left out" and any("something nearer hides most of it" in finding["reason"] for finding in result.get("findings", [])):
        return True
    boxes = [] if kind in ("left out", "put in") else fault.split()
    return any(word in sentence for word in NAMES[kind]) and all(re.search(rf"\b{box}\b", sentence) for box in boxes)


def write_boxes(path, boxes, sides):
    lines = ["boxes:"]
    for box in boxes:
        spans = ", ".join(f"{axis}: [{box[axis][0]:g}, {box[axis][1]:g}]" for axis in AXES)
        lines.append(f"  - {{name: {box['name']}, {spans}}}")
    path.write_text("\n".join(lines + [sides]) + "\n")


def multiplied(a, b):
    """Of poses, 4x4."""
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def inverse(pose):
    turn = [[pose[j][i] for j in range(3)] for i in range(3)]
    return [row + [-sum(row[k] * pose[k][3] for k in range(3))] for row in turn] + [[0, 0, 0, 1]]


def apart(a, b):
    """m and deg between two poses."""
    trace = sum(multiplied(inverse(a), b)[i][i] for i in range(3))
    return math.dist([row[3] for row in a], [row[3] for row in b]), math.degrees(math.acos(max(-1, min(1, (trace - 1) / 2))))


def wrong_sensors(placed, truth, limits):
    """Names of sensors that are wrong by more than (m, deg) after the alignment, by one sensor, that leaves fewest wrong."""
    best = list(placed)
    for anchor in placed:
        motion = multiplied(truth[anchor], inverse(placed[anchor]))
        wrong = []
        for name, pose in placed.items():
            metres, degrees = apart(multiplied(motion, pose), truth[name])
            if metres > limits[0] or degrees > limits[1]:
                wrong.append(name)
        if len(wrong) < len(best):
            best = wrong
    # Of two that contradict each other, either may be the wrong one.
    return list(placed) if len(placed) == 2 and len(best) == 1 else best


def calibrate(options, capture, structure, out):
    if not (out / "extrinsics.json").exists():
        begin = time.monotonic()
        done = subprocess.run([str(options.program.absolute()), "calibrate", "--capture", str(capture), "--structure", str(structure),
                               "--model", options.model, "-o", str(out)], capture_output=True, text=True)
        if done.returncode not in (0, 2):
            sys.exit(done.stderr)
        (out / "seconds").write_text(f"{time.monotonic() - begin:.1f}")
    return json.loads((out / "extrinsics.json").read_text()), float((out / "seconds").read_text())


def is_doubted(name, result):
    """By a reason that puts the place of the sensor in doubt, or by a finding of the rig that is about it, or about all."""
    return result["sensors"][name].get("code", "") in DOUBTS or any(
        name in finding.get("about", [name]) or finding["code"] == "box_off" for finding in result.get("findings", []))


def judge(result, truth, named, limits):
    sensors = result["sensors"]
    statuses = [sensor["status"] for sensor in sensors.values()]
    placed = {name: sensor["structure_from_sensor"] for name, sensor in sensors.items()
              if "structure_from_sensor" in sensor}
    wrong = wrong_sensors(placed, truth, limits)
    return {"statuses": [statuses.count(status) for status in ("ok", "weak", "failed")], "named": named,
            "described": "as described" in result.get("assembly", {}).get("sentence", "")
                         and not re.search("not known|but for", result["assembly"]["sentence"]),
            "wrong": wrong, "silent": [name for name in wrong if not is_doubted(name, result)],
            "sentence": result.get("assembly", {}).get("sentence", "-"),
            "codes": ", ".join(f"{name} {sensor['status']} {sensor.get('code', '')}" for name, sensor in sensors.items())}


def stack_cases(options, rig, folder):
    source = options.captures / rig
    truth = json.loads((source / "capture.json").read_text())["ground_truth"]
    sides = re.search(r"^sides:.*$", (source / "boxes.yaml").read_text(), re.M)[0]
    for kind, fault, boxes in changes(read_boxes(source / "boxes.yaml")):
        if options.only and kind not in options.only:
            continue
        case = folder / f"{rig}_{kind}_{fault}".replace(" ", "_")
        case.mkdir(parents=True, exist_ok=True)
        write_boxes(case / "boxes.yaml", boxes, sides)
        result, seconds = calibrate(options, source / "capture.json", case / "boxes.yaml", case / "out")
        yield rig, kind, fault, judge(result, truth, is_named(kind, fault, result), LITTLE.get(kind, (WRONG_M, WRONG_DEG))), seconds


def frame_changes(options, source, sensors, truth):
    """(kind, names of the sensors whose frames are changed, description of sensors, rows and poses of each name): what an operator may do
    to frames. What is turned, or in another's file, has the pose of what the file shows."""
    rows = {sensor["name"]: read_png(source / sensor["depth"]) for sensor in sensors}
    names = list(rows)
    for of in [[name] for name in names] + [names]:
        yield "frames mirrored", of, sensors, {**rows, **{name: [row[::-1] for row in rows[name]] for name in of}}, truth
        turned = {name: [[-row[0], -row[1], *row[2:]] for row in truth[name]] for name in of}
        yield "frames turned", of, sensors, {**rows, **{name: [row[::-1] for row in rows[name][::-1]] for name in of}}, {**truth, **turned}
        scaled = [{**sensor, "depth_scale": sensor["depth_scale"] * (SCALE if sensor["name"] in of else 1)} for sensor in sensors]
        yield "frames scaled", of, scaled, rows, truth
    for a, b in itertools.combinations(names, 2):
        yield "frames exchanged", [a, b], sensors, {**rows, a: rows[b], b: rows[a]}, {**truth, a: truth[b], b: truth[a]}
    size = len(rows[names[0]]), len(rows[names[0]][0])
    for other in sorted(options.captures.glob("*/s00.png")):
        strange = read_png(other)
        if other.parent != source and (len(strange), len(strange[0])) == size:
            for name in names:
                yield f"frames of {other.parent.name}", [name], sensors, {**rows, name: strange}, truth
            break


def frame_cases(options, rig, folder):
    source = options.captures / rig
    capture = json.loads((source / "capture.json").read_text())
    truth = capture.pop("ground_truth")
    for kind, of, sensors, rows, poses in frame_changes(options, source, capture["sensors"], truth):
        if options.only and not any(word in kind for word in options.only):
            continue
        case = folder / f"{rig}_{kind}_{len(of)}_{'_'.join(of[:2])}".replace(" ", "_")
        case.mkdir(parents=True, exist_ok=True)
        for sensor in sensors:
            write_png(case / sensor["depth"], rows[sensor["name"]])
        (case / "capture.json").write_text(json.dumps({**capture, "sensors": sensors}))
        structure = next(path for path in (source / "boxes.yaml", options.paper) if path and path.exists())
        result, seconds = calibrate(options, case / "capture.json", structure, case / "out")
        named = {result["sensors"][name].get("code") for name in of} == {"frame_mirrored"} or \
            "mirrored" in kind and "mirrored" in result.get("assembly", {}).get("sentence", "") or \
            any(finding["code"] in NAMED_BY.get(kind, ()) for finding in result.get("findings", []))
        yield rig, kind, " ".join(of) if len(of) < len(sensors) else "all", judge(result, poses, named, LITTLE.get(kind, (WRONG_M, WRONG_DEG))), seconds


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--rigs", nargs="+", default=["own5_realsense", "own6_kinects"])
    parser.add_argument("--model", default="none")
    parser.add_argument("--only", nargs="+")
    parser.add_argument("--frames", action="store_true")
    parser.add_argument("--paper", type=pathlib.Path, help="structure of rigs without boxes.yaml, with --frames")
    options = parser.parse_args()
    options.captures = pathlib.Path(os.environ["VOLALIGN_CAPTURES"]) / "foreign"
    rows = []
    print("| rig | change | of | ok, weak, failed | named | \"as described\" | wrong | without doubt | s | sentence |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for rig in options.rigs:
        cases = frame_cases if options.frames else stack_cases
        for rig_name, kind, fault, row, seconds in cases(options, rig, options.folder):
            rows.append(row)
            print(f"| {rig_name} | {kind} | {fault} | {', '.join(map(str, row['statuses']))} | {'yes' if row['named'] else 'no'} | "
                  f"{'yes' if row['described'] else 'no'} | {' '.join(row['wrong'])} | {' '.join(row['silent'])} | {seconds:.0f} | "
                  f"{row['sentence']} |", flush=True)
    print(f"\n{len(rows)} in all: named {sum(row['named'] for row in rows)}, \"as described\" {sum(row['described'] for row in rows)}, "
          f"sensors wrong {sum(len(row['wrong']) for row in rows)}, without doubt {sum(len(row['silent']) for row in rows)}")


if __name__ == "__main__":
    main()
