#!/usr/bin/env python3
"""Objects of other forms than boxes: ten meshes, each before six sensors, rendered by both noise models and calibrated by shape.

    tests/bench/meshes.py PROGRAM WRITE_MESHES FOLDER [--only shelf ...] [--seeds 1]

WRITE_MESHES: build/release/tests/bench/write_meshes, which writes the ten meshes. Beside each mesh, the paper's stack scaled to the same diagonal
is calibrated in the same way. Printed as Markdown: per mesh the facets with a label; sensors ok, weak and failed; median and worst error of those
that are placed, mm; sensors more than 0.1 m or 10 deg wrong, and those of them that are "ok"; and the reasons of the others.
"""

import argparse
import json
import pathlib
import re
import statistics

import numpy as np

from common import D415, KINECT, ROOT, run
from accuracy import errors, is_wrong

KINDS = [KINECT, D415]


def rig(structure, noise, seed, height_cm):
    sensors = "\n".join(f"  - {{name: S{i}, sensor: {KINDS[i % 2]}, rho_cm: 200, phi_deg: {60 * i + 17 * seed}, height_cm: {height_cm}, roll_deg: 90, "
                        "look_at_cm: [0, 0, 0]}" for i in range(6))
    return f"structure: {structure}\nstructure_yaw_deg: 0\nroom: true\nnoise: {noise}\nseed: {seed}\nsensors:\n{sensors}\n"


def measure(program, structure, folder, noise, seed):
    """Status, code and error of each sensor."""
    out = folder / f"{structure.stem}_{noise}_{seed}"
    if not (out / "extrinsics.json").exists():
        out.mkdir(parents=True, exist_ok=True)
        (out / "rig.yaml").write_text(rig(structure.absolute(), noise, seed, 60))
        run(program, "render", "--rig", out / "rig.yaml", "-o", out / "frames", "--force")
        run(program, "calibrate", "--capture", out / "frames/capture.json", "--model", "none", "-o", out / "calibrated", "--no-report")
        (out / "calibrated/extrinsics.json").rename(out / "extrinsics.json")
    truth = json.loads((out / "frames/capture.json").read_text())["ground_truth"]
    for name, sensor in json.loads((out / "extrinsics.json").read_text())["sensors"].items():
        pose = sensor.get("structure_from_sensor")
        yield sensor["status"], sensor.get("code", ""), errors(*np.array([pose, truth[name]])) if pose else None


def row_of(sensors):
    wrong = [status for status, _, error in sensors if error and is_wrong(error)]
    right = [1e3 * error[0] for _, _, error in sensors if error and not is_wrong(error)]
    statuses = [status for status, _, _ in sensors]
    return {"statuses": ", ".join(str(statuses.count(status)) for status in ("ok", "weak", "failed")),
            "median": statistics.median(right) if right else float("nan"), "worst": max(right, default=float("nan")),
            "wrong": len(wrong), "silent": wrong.count("ok"), "codes": " ".join(sorted({code for _, code, _ in sensors if code}))}


def scaled_stack(diagonal_mm, path):
    """The paper's stack, scaled."""
    text = (ROOT / "configs/structure.yaml").read_text()
    spans = {axis: [[float(n) for n in span.split(",")] for span in re.findall(rf"\b{axis}: \[([^\]]*)\]", text)] for axis in "xyz"}
    own = sum((max(b for _, b in s) - min(a for a, _ in s)) ** 2 for s in spans.values()) ** 0.5
    scale = diagonal_mm / own
    path.write_text(re.sub(r"\b([xyz]): \[([^\]]*)\]", lambda m: f"{m[1]}: [{', '.join(f'{scale * float(n):g}' for n in m[2].split(','))}]", text))
    return path


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("program", "write_meshes", "folder"):
        parser.add_argument(name, type=lambda path: pathlib.Path(path).absolute())
    parser.add_argument("--only", nargs="+")
    parser.add_argument("--seeds", type=int, default=1)
    options = parser.parse_args()
    shapes = options.folder / "meshes"
    run(options.write_meshes, shapes)
    print("| mesh | labels | noise | ok, weak, failed | median mm | worst mm | stack median mm | stack worst mm | wrong | wrong and ok | reasons |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for mesh in sorted(shapes.iterdir()):
        if mesh.suffix == ".bin" or options.only and mesh.stem not in options.only:
            continue
        shown = run(options.program, "structure", "build", mesh, "-o", options.folder / f"{mesh.stem}.yaml")
        vertices = re.findall(r"vertices: \[([^\]]*)\]", (options.folder / f"{mesh.stem}.yaml").read_text())
        numbers = [float(n) for part in vertices for n in part.split(",")]
        diagonal = sum((max(numbers[axis::3]) - min(numbers[axis::3])) ** 2 for axis in range(3)) ** 0.5
        labels = re.search(r"(\d+) labels", shown)[1]
        stack = scaled_stack(diagonal, options.folder / f"{mesh.stem}_stack.yaml")
        for noise in ("sensor", "physics"):
            seeds = range(1, 1 + options.seeds)
            own, other = (row_of([s for seed in seeds for s in measure(options.program, structure, options.folder / "runs", noise, seed)])
                          for structure in (mesh, stack))
            print(f"| {mesh.stem} | {labels} | {noise} | {own['statuses']} | {own['median']:.1f} | {own['worst']:.1f} | "
                  f"{other['median']:.1f} | {other['worst']:.1f} | {own['wrong']} | {own['silent']} | {own['codes']} |", flush=True)


if __name__ == "__main__":
    main()
