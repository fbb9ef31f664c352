#!/usr/bin/env python3
"""What attention and the soft Procrustes term are worth, in validation.

  claims.py VOLALIGN RUNS [--samples 1008]
  claims.py VOLALIGN MODELS --validations 5 [--samples 400] [--scores FOLDER]

RUNS holds the runs of a sweep over seeds (`volalign train --sweep configs/paper/own.yaml -o RUNS` with `seeds: [1, 2, 3]` in the sweep); those that are not
finished are left out. MODELS holds one checkpoint of each model, m01.safetensors for example, which so many validation sets score: intervals then speak of these very
networks and not of others that the same recipe would give.

Each model is scored (volalign validate) on samples of its own recipe; scores that are there already are kept. Printed as Markdown: mean and standard deviation
over seeds or sets; the differences that the paper claims, with Student's 95 % interval over seeds or sets (models with the same seed and range see the same
samples). Needs SciPy.
"""

import argparse
import json
import pathlib
import re
import statistics
import subprocess
import sys

from scipy import stats

CLAIMS = [("attention", "m01", "m02"), ("Procrustes, 150-225 cm", "m02", "m03"),
          ("Procrustes, 150-275 cm", "m04", "m05"), ("Procrustes, 150-350 cm", "m06", "m07")]
# Name in the file, heading, factor, decimals.
METRICS = [("miou", "mIoU", 100, 1), ("miou_authors", "mIoU, authors'", 100, 1), ("posed_share", "with a pose, %", 100, 1),
           ("keypoint_rmse_m", "3D RMSE, cm", 100, 2), ("median_translation_error_m", "translation, cm", 100, 2),
           ("median_rotation_error_deg", "rotation, deg", 1, 2)]


def interval(gains, decimals):
    """Mean of paired differences and their 95 % interval, as text."""
    if len(gains) < 2:
        return "-"
    half = stats.t.ppf(0.975, len(gains) - 1) * statistics.stdev(gains) / len(gains) ** 0.5
    return f"{statistics.mean(gains):+.{decimals}f} ± {half:.{decimals}f}"


def table(heading, rows):
    lines = ["| " + " | ".join(map(str, row)) + " |" for row in [heading, *rows]]
    return "\n".join([lines[0], "|" + "---|" * len(heading), *lines[1:]])


def finished(run):
    """Whether the run has trained for as long as its recipe says."""
    if not (run / "model.safetensors").exists():
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
    scores = json.loads(path.read_text())[0]
    return {**scores, "posed_share": scores["posed"] / scores["samples"]}


def mean_and_spread(scores, metric, factor, decimals):
    values = [factor * of[metric] for of in scores.values() if metric in of]
    if not values:
        return "-"
    spread = f" ± {statistics.stdev(values):.{decimals}f}" if len(values) > 1 else ""
    return f"{statistics.mean(values):.{decimals}f}{spread}"


def difference(before, after, metric, factor, decimals):
    seeds = [seed for seed in sorted(before) if metric in before[seed] and metric in after.get(seed, {})]
    return interval([factor * (after[seed][metric] - before[seed][metric]) for seed in seeds], decimals)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("runs", type=pathlib.Path)
    parser.add_argument("--samples", type=int, default=1008)
    parser.add_argument("--validations", type=int, default=0)
    parser.add_argument("--scores", type=pathlib.Path, default=pathlib.Path("out/claims"))
    arguments = parser.parse_args()
    scores = {}  # model -> seed of its training or of a validation set -> what validate writes
    if arguments.validations:
        for model in sorted(arguments.runs.glob("*.safetensors")):
            for seed in range(2000001, 2000001 + arguments.validations):
                scores.setdefault(model.stem, {})[seed] = score(arguments.program, model, arguments.scores / f"{model.stem}_{seed}.json", arguments.samples,
                                                                [f"run.validation_seed={seed}"])
    else:
        for run in sorted(arguments.runs.iterdir()):
            name = re.fullmatch(r"(m0\d)_run\.seed=(\d+)", run.name)
            if name and finished(run):
                scores.setdefault(name[1], {})[int(name[2])] = score(arguments.program, run / "model.safetensors", run / "own.json", arguments.samples, [])
    if not scores:
        sys.exit(f"{arguments.runs} holds no finished run of a sweep over seeds, and no checkpoint for --validations")

    headings = [heading for _, heading, _, _ in METRICS]
    print(table(["model", "sets" if arguments.validations else "seeds", *headings],
                [[model, len(of), *(mean_and_spread(of, m, f, d) for m, _, f, d in METRICS)] for model, of in scores.items()]) + "\n")
    print(table(["added", "from", "to", *headings],
                [[what, a, b, *(difference(scores[a], scores[b], m, f, d) for m, _, f, d in METRICS)]
                 for what, a, b in CLAIMS if a in scores and b in scores]))


if __name__ == "__main__":
    main()
