#!/usr/bin/env python3
"""How much of a view the sensor's pose explains, and how much other candidates do: the figures in infer/initial/view_fit.cc.

    tests/bench/shape_shares.py VOLALIGN SHAPE_SHARES FOLDER [--real FOLDER] [--stacks 14] [--seeds 3]

SHAPE_SHARES is the program of tests/bench/shape_shares.cc. Views are rendered: random stacks (any_boxes.py, from stack 7000 on) with and without
the stack, and the situations of first_poses.py from seed 5000 on; recorded are those of an independent simulator in VOLALIGN_CAPTURES, and those
of which tests/accuracy.py has written captures into the folder of --real (out/accuracy, after --parts real). Asked are the candidates of the search
by geometry and the poses that the program ends with (by the network where there is one, as then nobody has asked for the shape). A pose is right
within 15 cm and 6 deg of the sensor's; of real frames, that is what the program ends with. It is wrong where another structure is asked for than
the one that stands there, or where none does; others of the right structure may be its twins, and do not count.

Printed: how much of the most that any pose of a sensor explains its right poses do, quantiles; the parameters of both distributions of each share
(the prior is that of cause_shares.py), for cells of 5, 10 and 20 cm; quantiles of the log odds of right and wrong poses, and how many are less and
more probable than not. What is in the folder already is not done again. Needs NumPy; runs from the root of the project.
"""

import argparse
import concurrent.futures
import os
import pathlib
import re
import subprocess

import numpy as np

import any_boxes
from cause_shares import fit, log_probability, quantiles
from first_poses import SENSORS, SITUATIONS

PAPER, MODEL = pathlib.Path("configs/structure.yaml"), "models/m05-lite.safetensors"
RIGHT_M, RIGHT_DEG = 0.15, 6
# Columns of the program's output, for a pose and against it. What is measured is a part of the surface.
SHARES = {"is it": (0, 1), "ends": (2, 3), "planes": (5, 6), "measured": (0, 4)}


def run(command, statuses=(0, 2)):
    done = subprocess.run([str(part) for part in command], stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode not in statuses:
        raise SystemExit(f"failed: {' '.join(map(str, command))}")
    return done.stdout


class View:
    """A capture, the structure that stands there, or none, and those that do not."""

    def __init__(self, folder, own, others, capture=None, rig=None, changes=()):
        self.folder, self.own, self.others, self.rig, self.changes = folder, own, others, rig, changes
        self.capture = capture or folder / "capture.json"

    def ask(self, options):
        """(right, wrong, recorded): rows of counts, of right ones also of what is explained as a share of the most that any pose of this sensor explains."""
        self.folder.mkdir(parents=True, exist_ok=True)
        if self.rig and not self.capture.exists():
            (self.folder / "rig.yaml").write_text(self.rig)
            run([options.program, "render", "--rig", self.folder / "rig.yaml", "-o", self.folder, *(part for change in self.changes for part in ("--set", change))])
        right, wrong = [], []
        if self.own:
            result = self.folder / "result" / "extrinsics.json"
            if not result.exists():
                run([options.program, "calibrate", "--capture", self.capture, "--structure", self.own, "--model", MODEL if self.own == PAPER else "none",
                     "--no-report", "--threads", "1", "-o", result.parent])
            rows = self.rows(options, self.own, result)
            most = {name: max(row[0] for of, row in rows if of == name) for name, _ in rows}
            right = [row[:7] + [row[0] / most[name]] for name, row in rows if row[7] < RIGHT_M and row[8] < RIGHT_DEG]
        for other in self.others:
            wrong += [row[:7] for _, row in self.rows(options, other)]
        return right, wrong, not self.rig

    def rows(self, options, structure, *result):
        kept = self.folder / f"{re.sub('[^a-z0-9]+', '_', str(structure))[-40:]}.tsv"
        if not kept.exists():
            kept.write_text(run([options.shape_shares, structure, self.capture, *result], (0,)))
        lines = [line.split("\t") for line in kept.read_text().splitlines()]
        return [(line[0], [float(x) for x in line[1:]]) for line in lines]


def random_stacks(options):
    def inputs(seed, sensor):
        folder = options.folder / f"{seed}_{sensor}"
        folder.mkdir(parents=True, exist_ok=True)
        any_boxes.write_inputs(folder, seed, sensor, any_boxes.stack(seed))
        return folder / "stack.yaml", (folder / "rig.yaml").read_text()
    for seed in range(7000, 7000 + options.stacks):
        for sensor in SENSORS + ["kinect_v2"]:
            own, rig = inputs(seed, sensor)
            others = [inputs(seed + k, sensor)[0] for k in (1, 2)]
            yield View(own.parent / "with", own, others, rig=rig)
            yield View(own.parent / "without", None, [own], rig=rig, changes=["structure_present=false"])


def situations(options, others):
    for seed in range(5000, 5000 + options.seeds):
        for k, (name, (rig, changes)) in enumerate(SITUATIONS.items()):
            for sensor in SENSORS:
                text = re.sub(r"sensor: \w+", f"sensor: {sensor}", pathlib.Path(rig).read_text())
                rho = [change[7:] for change in changes if change.startswith("rho_cm=")]
                if rho:
                    text = re.sub(r"rho_cm: [0-9.]+", f"rho_cm: {rho[0]}", text)
                yield View(options.folder / f"{re.sub('[^a-z0-9]+', '_', name.lower())}_{sensor}_{seed}", PAPER, [others[k % len(others)]], rig=text,
                           changes=[f"seed={seed}", *([] if rho else changes)])


def recorded(options, others):
    captures = pathlib.Path(os.environ.get("VOLALIGN_CAPTURES") or "../shared/captures").resolve()
    files = [(capture, capture.parent / "boxes.yaml") for capture in sorted(captures.glob("foreign/**/capture.json"))]
    files += [(captures / "pallet" / "capture.json", captures / "pallet" / "pal.yaml")]
    files += [(capture, PAPER) for capture in (sorted(options.real.glob("real_*/capture.json")) if options.real else [])]
    for k, (capture, own) in enumerate(files):
        if capture.exists():
            name = "_".join(capture.parts[-3:-1])
            yield View(options.folder / name, own if own.exists() else PAPER, [others[k % len(others)]], capture=capture)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("shape_shares", type=pathlib.Path)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--real", type=pathlib.Path)
    parser.add_argument("--stacks", type=int, default=14)
    parser.add_argument("--seeds", type=int, default=3)
    options = parser.parse_args()
    options.folder = options.folder.resolve()
    views = list(random_stacks(options))
    others = [view.own for view in views if view.own][:: len(views) // 6]
    views += [*situations(options, others), *recorded(options, others)]
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        asked = list(pool.map(lambda view: view.ask(options), views))
    sets = {"rendered": [row for right, _, is_recorded in asked if not is_recorded for row in right],
            "recorded": [row for right, _, is_recorded in asked if is_recorded for row in right],
            "wrong": [row for _, wrong, _ in asked for row in wrong]}
    sets = {name: np.array(rows) for name, rows in sets.items()}
    shares = np.concatenate([sets[name][:, 7] for name in ("rendered", "recorded")])
    print("of the most that is explained, right poses explain: " + ", ".join(f"{100 * q:g} %: {np.quantile(shares, q):.3f}" for q in (0.001, 0.005, 0.01, 0.05)))
    for cell in (0.05, 0.1, 0.2):
        def counts(rows, share):
            columns = rows[:, SHARES[share]].copy()
            if share in ("planes", "measured"):  # of all
                columns[:, 1] = np.maximum(columns[:, 1] - columns[:, 0], 0)
            return columns if share == "planes" else columns / cell ** 2
        odds = {name: 0 for name in sets}
        print(f"cells of {100 * cell:.0f} cm")
        for share in SHARES:
            right = np.concatenate([counts(sets[name], share) for name in ("rendered", "recorded")])
            wrong = counts(sets["wrong"], share)
            models = [fit(of[of.sum(1) >= 1]) for of in (right, wrong)]
            print(f"  {share}: {{{{{', '.join(f'{x:.3g}' for x in models[0])}}}, {{{', '.join(f'{x:.3g}' for x in models[1])}}}}}")
            for name, rows in sets.items():
                of = counts(rows, share)
                odds[name] = odds[name] + log_probability(models[0], of) - log_probability(models[1], of)
        for name, values in odds.items():
            print(f"  {name}: {len(values)}; log odds {quantiles(values, 1)}; below 0: {(values < 0).sum()}; above: {(values > 0).sum()}")


if __name__ == "__main__":
    main()
