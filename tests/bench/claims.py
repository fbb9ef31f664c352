#!/usr/bin/env python3
"""What attention, the soft Procrustes term and the range of distances are worth, over seeds.

  claims.py VOLALIGN RUNS [--samples 1008]
  claims.py VOLALIGN MODELS --validations 5 [--samples 400] [--scores FOLDER]

RUNS holds the runs of `volalign train --sweep SWEEP -o RUNS`, SWEEP configs/paper/claims.yaml or lite_seeds.yaml; those that are not finished
are left out. Each model is scored (volalign validate) on samples of its own recipe, and m03, m05 and m07 on those of m07's distances, 150 to 350 cm;
scores that are there already are kept (RUNS/NAME/own.json, far.json). Printed as Markdown: mean and standard deviation over seeds of each model; the
differences that the paper claims, with Student's paired t-test over seeds (two-sided; models with the same seed and range see
the same samples); and scores by distance. Needs SciPy.

MODELS holds one checkpoint of each model, m01.pt to m07.pt: seeds are then those of so many validation sets, so that intervals speak
of these very networks and not of others that the same recipe would give.
"""

import argparse
import json
import math
import pathlib
import re
import statistics
import subprocess
import sys

from scipy import stats

CLAIMS = [("attention", "m01", "m02"), ("Procrustes, 150-225 cm", "m02", "m03"),
          ("Procrustes, 150-275 cm", "m04", "m05"), ("Procrustes, 150-350 cm", "m06", "m07")]
RANGES = ["m03", "m05", "m07"]
BANDS = ["150-225", "225-275", "275-350"]
# Name in the file, heading, factor, decimals.
METRICS = [("miou", "mIoU", 100, 1), ("miou_authors", "mIoU, authors'", 100, 1), ("posed_share", "with a pose, %", 100, 1),
           ("keypoint_rmse_m", "3D RMSE, cm", 100, 2), ("median_translation_error_m", "translation, cm", 100, 2),
           ("median_rotation_error_deg", "rotation, deg", 1, 2)]


def finished(run):
    """Whether the run has trained for as long as its recipe says."""
    if not (run / "model.pt").exists():
        return False
    wanted = int(re.search(r"^run:\n(?:  .*\n)*?  samples: (\d+)$", (run / "config.yaml").read_text(), re.MULTILINE)[1])
    rows = (run / "metrics.jsonl").read_text().splitlines()
    return json.loads(rows[-1])["samples"] >= wanted


def score(program, model, path, samples, assignments):
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        command = [program, "validate", "--model", str(model), "--samples", str(samples), "--threads", "1", "-o", str(path)]
        for assignment in assignments:
            command += ["--set", assignment]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return json.loads(path.read_text())[0]


def values(scores, metric):
    """Of each seed that has the metric."""
    found = {}
    for seed, of in scores.items():
        if metric == "posed_share":
            found[seed] = of["posed"] / of["samples"]
        elif metric in of:
            found[seed] = of[metric]
    return found


def mean_and_spread(scores, metric, factor, decimals):
    all_of = [factor * v for v in values(scores, metric).values()]
    if not all_of:
        return "-"
    spread = f" ± {statistics.stdev(all_of):.{decimals}f}" if len(all_of) > 1 else ""
    return f"{statistics.mean(all_of):.{decimals}f}{spread}"


def difference(before, after, metric, factor, decimals):
    a, b = values(before, metric), values(after, metric)
    seeds = sorted(set(a) & set(b))
    if len(seeds) < 2:
        return "-"
    gains = [factor * (b[s] - a[s]) for s in seeds]
    p = stats.ttest_rel([b[s] for s in seeds], [a[s] for s in seeds]).pvalue
    half = stats.t.ppf(0.975, len(gains) - 1) * statistics.stdev(gains) / len(gains) ** 0.5
    told = "" if math.isnan(p) else f" (p = {p:.3f})"  # without variation there is no p
    return f"{statistics.mean(gains):+.{decimals}f} ± {half:.{decimals}f}{told}"


def table(heading, rows):
    print("| " + " | ".join(heading) + " |\n|" + "---|" * len(heading))
    for row in rows:
        print("| " + " | ".join(str(cell) for cell in row) + " |")
    print()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("runs", type=pathlib.Path)
    parser.add_argument("--samples", type=int, default=1008)
    parser.add_argument("--validations", type=int, default=0)
    parser.add_argument("--scores", type=pathlib.Path, default=pathlib.Path("out/claims"))
    arguments = parser.parse_args()
    entries = []  # model, seed, checkpoint, folder of its scores, settings
    if arguments.validations:
        for model in sorted(arguments.runs.glob("m0?.pt")):
            for seed in range(2000001, 2000001 + arguments.validations):
                entries.append((model.stem, seed, model, arguments.scores / f"{model.stem}_{seed}", [f"run.validation_seed={seed}"]))
    else:
        for run in sorted(arguments.runs.iterdir()):
            name = re.fullmatch(r"(m0\d)_run\.seed=(\d+)", run.name)
            if name and finished(run):
                entries.append((name[1], int(name[2]), run / "model.pt", run, []))
    own, far = {}, {}  # model -> seed -> scores
    for model, seed, checkpoint, folder, settings in entries:
        own.setdefault(model, {})[seed] = score(arguments.program, checkpoint, folder / "own.json", arguments.samples, settings)
        if model in RANGES:
            far.setdefault(model, {})[seed] = score(arguments.program, checkpoint, folder / "far.json", arguments.samples,
                                                    settings + ["data.pose.rho_cm=[150,350]"])
    if not own:
        sys.exit(f"{arguments.runs} holds no finished run of a sweep over seeds, and no m01.pt for --validations")

    headings = [heading for _, heading, _, _ in METRICS]
    print("Mean and standard deviation over seeds, each model on samples of its own distances:\n")
    table(["model", "seeds"] + headings,
          [[model, len(of)] + [mean_and_spread(of, m, f, d) for m, _, f, d in METRICS] for model, of in own.items()])
    print("What is added changes the mean by (95 % interval; p of Student's paired t-test over seeds):\n")
    table(["added", "from", "to"] + headings,
          [[what, a, b] + [difference(own[a], own[b], m, f, d) for m, _, f, d in METRICS]
           for what, a, b in CLAIMS if a in own and b in own])
    print("By distance, on the same samples for all (150 to 350 cm):\n")
    rows = []
    for model, of in far.items():
        for band in BANDS:
            inside = {seed: s["by_rho_cm"][band] for seed, s in of.items()}
            rows.append([model, band] + [mean_and_spread(inside, m, f, d) for m, _, f, d in METRICS])
    table(["model", "distance, cm"] + headings, rows)


if __name__ == "__main__":
    main()
