#!/usr/bin/env python3
"""Wrong descriptions of hand-built stacks, calibrated without a model: is the fault named, and is anything wrong without doubt?

  wrong_stacks.py VOLALIGN FOLDER [--rigs own5_realsense own6_kinects] [--only turned] [--mirror-frames] [--model MODEL]

The captures are folders of $VOLALIGN_CAPTURES/foreign with capture.json, which has ground_truth, and boxes.yaml, whose boxes stand
on each other. Each description is boxes.yaml with one change: a box turned by 90 deg, laid on another edge, left out, put in
where none is, shifted by 15 cm, two exchanged, or the whole mirrored; what stands on a box that is changed is let down or lifted.
--mirror-frames: the true description, and instead one frame after the other mirrored, then all. Printed as Markdown, a row each:
how many sensors are ok, weak and failed; whether the fault is named, in `assembly` or, of mirrored frames, of the sensors; whether
the file says "as described"; sensors more than 0.1 m or 10 deg wrong, after the best rigid alignment of most sensors onto the
truth, and those of them that are `ok`, or weak for a reason that does not put the place of the sensor in doubt.
"""

import argparse
import copy
import itertools
import json
import math
import os
import pathlib
import re
import struct
import subprocess
import sys
import time
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from grey_png import read_png  # noqa: E402

AXES = "xyz"
WRONG_M, WRONG_DEG = 0.1, 10
SHIFT_MM = 150
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
    for i, j in itertools.combinations(range(len(boxes)), 2):
        swapped = list(boxes)
        for to, of in ((i, j), (j, i)):
            swapped[to] = {**boxes[of], "name": boxes[to]["name"]}
        yield "exchanged", f"{boxes[i]['name']} {boxes[j]['name']}", piled(swapped, foot)
    yield "mirrored", "", [{**box, "z": [-box["z"][1], -box["z"][0]]} for box in boxes]


NAMES = {"turned": ["turned"], "edge": ["edge"], "left out": ["higher than described"], "put in": ["missing"],
         "shifted": ["shifted"], "exchanged": ["swapped", "exchanged"], "mirrored": ["mirrored"]}


def is_named(kind, fault, result):
    """Is it said, and of the right boxes? What else looks the same may be named beside it."""
    sentence = result.get("assembly", {}).get("sentence", "")
    if kind in ("turned", "edge") and any(finding["code"] == "box_off" and finding["about"] == [fault] for finding in result.get("findings", [])):
        return True
    if kind == "left out" and any("something nearer lies before most of it" in finding["reason"] for finding in result.get("findings", [])):
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


def write_png(path, rows):
    """16 bits."""
    def part(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    body = b"".join(b"\0" + struct.pack(f">{len(row)}H", *row) for row in rows)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + part(b"IHDR", struct.pack(">IIBBBBB", len(rows[0]), len(rows), 16, 0, 0, 0, 0))
                     + part(b"IDAT", zlib.compress(body)) + part(b"IEND", b""))


def wrong_sensors(placed, truth):
    """Names of sensors that are wrong after the alignment, by one sensor, that leaves fewest wrong."""
    best = list(placed)
    for anchor in placed:
        motion = multiplied(truth[anchor], inverse(placed[anchor]))
        wrong = []
        for name, pose in placed.items():
            metres, degrees = apart(multiplied(motion, pose), truth[name])
            if metres > WRONG_M or degrees > WRONG_DEG:
                wrong.append(name)
        if len(wrong) < len(best):
            best = wrong
    # Of two that contradict each other, either may be the wrong one.
    return list(placed) if len(placed) == 2 and len(best) == 1 else best


def calibrate(options, capture, structure, out):
    if not (out / "extrinsics.json").exists():
        begin = time.monotonic()
        done = subprocess.run([str(options.program), "calibrate", "--capture", str(capture), "--structure", str(structure),
                               "--model", options.model, "-o", str(out)], capture_output=True, text=True)
        if done.returncode not in (0, 2):
            sys.exit(done.stderr)
        (out / "seconds").write_text(f"{time.monotonic() - begin:.1f}")
    return json.loads((out / "extrinsics.json").read_text()), float((out / "seconds").read_text())


def judge(result, truth, named):
    sensors = result["sensors"]
    statuses = [sensor["status"] for sensor in sensors.values()]
    placed = {name: sensor["structure_from_sensor"] for name, sensor in sensors.items()
              if "structure_from_sensor" in sensor}
    wrong = wrong_sensors(placed, truth)
    return {"statuses": [statuses.count(status) for status in ("ok", "weak", "failed")], "named": named,
            "described": "as described" in result.get("assembly", {}).get("sentence", "")
                         and not re.search("not known|but for", result["assembly"]["sentence"]),
            "wrong": wrong, "silent": [name for name in wrong if sensors[name].get("code", "") not in DOUBTS],
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
        yield rig, kind, fault, judge(result, truth, is_named(kind, fault, result)), seconds


def mirrored_cases(options, rig, folder):
    source = options.captures / rig
    capture = json.loads((source / "capture.json").read_text())
    truth = capture["ground_truth"]
    names = [sensor["name"] for sensor in capture["sensors"]]
    for mirrored in [[name] for name in names] + [names]:
        case = folder / f"{rig}_mirrored_{len(mirrored)}_{mirrored[0]}"
        case.mkdir(parents=True, exist_ok=True)
        changed = copy.deepcopy(capture)
        changed.pop("ground_truth")
        for sensor in changed["sensors"]:
            rows = read_png(source / sensor["depth"])
            write_png(case / sensor["depth"], [row[::-1] for row in rows] if sensor["name"] in mirrored else rows)
        (case / "capture.json").write_text(json.dumps(changed))
        structure = next(path for path in (source / "boxes.yaml", options.paper) if path and path.exists())
        result, seconds = calibrate(options, case / "capture.json", structure, case / "out")
        codes = {name: result["sensors"][name].get("code") for name in mirrored}
        named = ("mirrored" in result.get("assembly", {}).get("sentence", "") if len(mirrored) > 1 else
                 set(codes.values()) == {"frame_mirrored"})
        yield rig, "frames", " ".join(mirrored) if len(mirrored) == 1 else "all", judge(result, truth, named), seconds


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--rigs", nargs="+", default=["own5_realsense", "own6_kinects"])
    parser.add_argument("--model", default="none")
    parser.add_argument("--only", nargs="+", choices=NAMES)
    parser.add_argument("--mirror-frames", action="store_true")
    parser.add_argument("--paper", type=pathlib.Path, help="structure of rigs without boxes.yaml, with --mirror-frames")
    options = parser.parse_args()
    options.captures = pathlib.Path(os.environ["VOLALIGN_CAPTURES"]) / "foreign"
    rows = []
    print("| rig | change | of | ok, weak, failed | named | \"as described\" | wrong | without doubt | s | sentence |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for rig in options.rigs:
        cases = mirrored_cases if options.mirror_frames else stack_cases
        for rig_name, kind, fault, row, seconds in cases(options, rig, options.folder):
            rows.append(row)
            print(f"| {rig_name} | {kind} | {fault} | {', '.join(map(str, row['statuses']))} | {'yes' if row['named'] else 'no'} | "
                  f"{'yes' if row['described'] else 'no'} | {' '.join(row['wrong'])} | {' '.join(row['silent'])} | {seconds:.0f} | "
                  f"{row['sentence']} |", flush=True)
    print(f"\n{len(rows)} in all: named {sum(row['named'] for row in rows)}, \"as described\" {sum(row['described'] for row in rows)}, "
          f"sensors wrong {sum(len(row['wrong']) for row in rows)}, without doubt {sum(len(row['silent']) for row in rows)}")


if __name__ == "__main__":
    main()
