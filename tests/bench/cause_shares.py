#!/usr/bin/env python3
"""What recorded frames show along their rays, where poses are right and where they are wrong: the figures in infer/depth.

    tests/bench/cause_shares.py CAUSE_SHARES ACCURACY_FOLDER [--tsv FILE]

CAUSE_SHARES is the program of tests/bench/cause_shares.cc, ACCURACY_FOLDER what tests/accuracy.py has left for a program
(out/accuracy/HASH, after --parts foreign,real). Frames of an independent simulator and real ones are asked, those in VOLALIGN_CAPTURES.
Printed: the mean shares of the causes at right poses; for each share by which right and wrong poses are told apart, the parameters of its
two beta distributions and how well it tells them; and what each factor of the likelihood is worth where a sensor's right pose competes with
its wrong ones, the others being where they are. Needs NumPy and SciPy; runs from the root of the project.

The parameters are the most probable ones under the prior of Gelman et al., "Bayesian Data Analysis", section 5.3, which is proportional
to (a + b)^-5/2: without a prior, shares that never vary by more than few cells do would be taken not to vary at all.
"""

import argparse
import itertools
import math
import os
import pathlib
import subprocess

import numpy as np
from scipy import optimize
from scipy.special import gammaln

CAUSES = ["surface", "before", "behind", "missing"]
# What is told by which share: cells for a pose and against it, of the columns of causes, named so, named otherwise, labelled on the structure.
SHARES = [("view", "not behind", lambda c: (c[0], c[2])), ("view", "named so", lambda c: (c[4], c[5])),
          ("view", "in outline", lambda c: (c[6], c[0] + c[4] + c[5] - 2 * c[6])),
          ("pair", "not floating", lambda c: (c[0] + c[1], c[2])), ("floor", "on floor", lambda c: (c[0], c[1]))]
PAPER, OTHER, MODEL = "configs/structure.yaml", "foreign/own6_kinects/boxes.yaml", "models/m05-lite.safetensors"
LEAST_CELLS = 2  # less says nothing


def runs(captures, folder):
    """Arguments of the program."""
    def with_model(name):
        return next(folder.glob(f"{name}_{'[0-9a-f]' * 12}.json"))
    for rig in sorted((captures / "foreign").iterdir()):
        own = rig / "boxes.yaml"
        capture = rig / "capture.json" if (rig / "capture.json").exists() else rig / "p0" / "capture.json"
        if own.exists():
            yield own, PAPER, capture, folder / f"foreign_{rig.name}_no_model.json"
        else:
            yield PAPER, captures / OTHER, capture, with_model(f"foreign_{rig.name}"), MODEL
    for name in ("kinects", "d415"):
        yield PAPER, captures / OTHER, folder.parent / f"real_{name}" / "capture.json", with_model(f"real_{name}"), MODEL


def log_probability(parameters, counts):
    """Of each row of counts, as ShareModel::LogProbability has it."""
    return (gammaln(parameters.sum()) - gammaln(parameters.sum() + counts.sum(1))
            + (gammaln(parameters + counts) - gammaln(parameters)).sum(1))


def fit(counts):
    def cost(logs):
        return 2.5 * np.log(np.exp(logs).sum()) - log_probability(np.exp(logs), counts).sum()
    return np.exp(optimize.minimize(cost, np.zeros(2), method="Nelder-Mead").x)


def quantiles(values, digits):
    return " / ".join(f"{v:.{digits}f}" for v in np.quantile(values, (0, 0.05, 0.5, 0.95, 1)))


FACTORS = ["depths", "outline", "labels", "pairs", "floor"]
MOST_OF_LABELS = math.log(1000)  # as infer/initial/rig_choice.cc has it


def ablation(rows):
    """Log odds of each sensor's right pose against each wrong one, by each factor, and what is left without one."""
    right, number, against = None, 0, []
    for row in (row for row in rows if row[0] == "sensor"):
        odds = np.array([float(x) for x in row[3:8]])
        if row[1] == "right":
            right, number = odds, number + 1
        else:
            against.append((number, right - odds))
            against[-1][1][2] = 0 if row[8] == "true" else min(against[-1][1][2], MOST_OF_LABELS)
    sensor, odds = np.array([of for of, _ in against]), np.stack([each for _, each in against])
    print(f"{len(set(sensor))} sensors, {len(odds)} wrong poses; log odds of the right one: 1 / 5 / 50 %; wrong poses preferred, not refuted at "
          "100 : 1; sensors with a wrong pose preferred")
    every = range(len(FACTORS))
    kinds = [("all", list(every))] + [(f"without {name}", [k for k in every if k != without]) for without, name in enumerate(FACTORS)]
    for name, factors in kinds + [(f"{name} alone", [k]) for k, name in enumerate(FACTORS)]:
        total = odds[:, factors].sum(1)
        print(f"  {name:16} {' / '.join(f'{x:.1f}' for x in np.quantile(total, (0.01, 0.05, 0.5)))}; {(total < 0).sum()}, "
              f"{(total < math.log(100)).sum()}; {len(set(sensor[total < 0]))}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program")
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--tsv", type=pathlib.Path, help="keeps what the program has counted")
    options = parser.parse_args()
    captures = pathlib.Path(os.environ.get("VOLALIGN_CAPTURES") or "../shared/captures").resolve()
    rows = []
    if options.tsv and options.tsv.exists():
        rows = [line.split("\t") for line in options.tsv.read_text().splitlines()]
    else:
        for arguments in runs(captures, options.folder.resolve()):
            done = subprocess.run([options.program, *map(str, arguments)], stdout=subprocess.PIPE, text=True, check=True)
            rows += [line.split("\t") for line in done.stdout.splitlines()]
        if options.tsv:
            options.tsv.write_text("\n".join("\t".join(row) for row in rows))
    table = {}
    for what, pose in itertools.product(("view", "pair", "floor"), ("right", "wrong")):
        of = np.array([[float(x) for x in row[3:]] for row in rows if row[:2] == [what, pose]])
        table[what, pose] = of[of[:, :4].sum(1) >= LEAST_CELLS]
    for what in ("view", "pair"):
        causes = table[what, "right"][:, :4]
        shares = causes / causes.sum(1, keepdims=True)
        print(f"{what}: {len(causes)} right poses, cells {quantiles(causes.sum(1), 1)}; mean shares: "
              + ", ".join(f"{cause} {share:.4f}" for cause, share in zip(CAUSES, shares.mean(0))))
    for what, name, cells in SHARES:
        counts = {}
        for pose in ("right", "wrong"):
            of = np.stack(cells(table[what, pose].T), 1)
            if name == "in outline":
                of = of[table[what, pose][:, 4:6].sum(1) >= LEAST_CELLS]  # those that have labels
            counts[pose] = of[of.sum(1) >= LEAST_CELLS]
        parameters = {pose: fit(of) for pose, of in counts.items()}
        print(f"{what}, {name}: {{{{{', '.join(f'{x:.3g}' for x in parameters['right'])}}}, {{{', '.join(f'{x:.3g}' for x in parameters['wrong'])}}}}}")
        for pose, of in counts.items():
            odds = log_probability(parameters["right"], of) - log_probability(parameters["wrong"], of)
            print(f"  {len(of)} {pose}: % against {quantiles(100 * of[:, 1] / of.sum(1), 2)}; log odds {quantiles(odds, 1)}; "
                  f"% below -ln 100: {100 * np.mean(odds < -math.log(100)):.1f}")
    ablation(rows)


if __name__ == "__main__":
    main()
