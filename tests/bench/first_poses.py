#!/usr/bin/env python3
"""Where first poses should come from: the network, geometry, or both.

  first_poses.py VOLALIGN MODEL FOLDER --seeds 4000:4002 [--only irregular,hidden_0.4]

Runs `volalign evaluate --compare initial.method=network,geometry,auto` in several situations (below: rig and what is changed in
it) with Azure Kinects and D415s and prints one Markdown table. A cell: sensors placed, of all; those placed more than 10 cm or
5 deg off, with how many of them are `ok`; median and 95th percentile of the initial poses' errors, mm; seconds of the stages
that choose initial poses and of all stages, each for one sensor. The network's answers are shared by the three, so that the time
of the first one, `network`, alone contains the network. What is in the folder already is not done again.
"""

import argparse
import json
import pathlib
import re

from common import D415, KINECT, run
import accuracy

SENSORS = [KINECT, D415]
METHODS = ["network", "geometry", "auto"]
RING = "configs/rig_ring4.yaml"
SITUATIONS = {
    "irregular": ("configs/rig_irregular.yaml", []),
    "arc8": ("configs/rig_arc8.yaml", []),
    "ring4": (RING, []),
    "at 1.5 m": (RING, ["rho_cm=150"]),
    "at 3 m": (RING, ["rho_cm=300"]),
    "at 4 m": (RING, ["rho_cm=400"]),
    "20 % hidden": (RING, ["hidden_share=0.2"]),
    "40 % hidden": (RING, ["hidden_share=0.4"]),
    "60 % hidden": (RING, ["hidden_share=0.6"]),
    "10 % missing": (RING, ["missing_share=0.1"]),
    "40 % missing": (RING, ["missing_share=0.4"]),
    "70 % missing": (RING, ["missing_share=0.7"]),
    "40 objects and boxes": (RING, ["scene.clutter_count=[40,40]", "scene.distractor_probability=1"]),
    "no floor and no room": (RING, ["room=false"]),
}


def evaluate(options, name):
    """The cases of a situation."""
    folder = options.folder / re.sub(r"[^a-z0-9]+", "_", name.lower())
    folder.mkdir(parents=True, exist_ok=True)
    rig, changes = SITUATIONS[name]
    rho = [change[7:] for change in changes if change.startswith("rho_cm=")]
    if rho:  # of every sensor
        text = re.sub(r"rho_cm: [0-9.]+", f"rho_cm: {rho[0]}", pathlib.Path(rig).read_text())
        rig = folder / "rig.yaml"
        rig.write_text(text)
        changes = []
    run(options.program, "evaluate", "--model", options.model, "--rigs", rig, "--sensors", *SENSORS,
        "--seeds", options.seeds, "--compare", "initial.method=" + ",".join(METHODS),
        "--set-rig", "assembly.position_mm=3", *changes, "--set", "threads=1", "-o", folder)
    return json.loads((folder / "evaluation.json").read_text())["cases"]


def cell(cases):
    sensors = [sensor for case in cases for sensor in case["sensors"]]
    placed = [sensor for sensor in sensors if sensor["status"] != "failed"]
    wrong = [s for s in placed if s["error"]["refined"]["translation_m"] > 0.1 or s["error"]["refined"]["rotation_deg"] > 5]
    right = [s for s in placed if s not in wrong]
    errors = [1000 * sensor["error"]["initial"]["translation_m"] for sensor in right]
    seconds = [sum(case["timings_s"].get(stage, 0) for case in cases) / len(sensors) for stage in ("initial_pose", "total")]
    false = f"{len(wrong)} ({sum(s['status'] == 'ok' for s in wrong)} ok)" if wrong else "0"
    return (f"{len(placed)} of {len(sensors)} | {false} | {accuracy.quantiles(errors, (0.5, 0.95), 0)} | "
            f"{seconds[0]:.2f}, {seconds[1]:.2f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("model", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--seeds", default="4000:4002")
    parser.add_argument("--only", help="names of situations, with commas")
    options = parser.parse_args()
    print("| situation | sensors | initial poses | placed | wrong | initial, mm | s: initial poses, all |\n|---|---|---|---|---|---|---|")
    for name in options.only.split(",") if options.only else SITUATIONS:
        cases = evaluate(options, name)
        for model in SENSORS:
            for method in METHODS:
                some = [case for case in cases if case["sensor_model"] == model and case["variant"] == method]
                print(f"| {name} | {model} | {method} | {cell(some)} |", flush=True)


if __name__ == "__main__":
    main()
