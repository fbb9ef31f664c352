#!/usr/bin/env python3
"""What attention and the soft Procrustes term are worth, in validation.

    tests/bench/claims.py VOLALIGN MODELS [--validations 5] [--samples 400] [--scores FOLDER]

MODELS holds one checkpoint of each model, m01.safetensors for example. Each is scored (volalign validate) on so many validation sets of its own recipe; scores that
are there already are kept. Printed as Markdown: mean and standard deviation over sets; the differences that the paper claims, with Student's 95 % interval over sets
(models of the same range see the same samples). Intervals speak of these very networks and not of others that the same recipe would give. Needs SciPy.
"""

import argparse
import json
import pathlib
import statistics

from common import run, table

CLAIMS = [("attention", "m01", "m02"), ("Procrustes, 150-225 cm", "m02", "m03"),
          ("Procrustes, 150-275 cm", "m04", "m05"), ("Procrustes, 150-350 cm", "m06", "m07")]
# Name in the file, heading, factor, decimals.
METRICS = [("miou", "mIoU", 100, 1), ("miou_authors", "mIoU, authors'", 100, 1), ("posed_share", "with a pose, %", 100, 1),
           ("keypoint_rmse_m", "3D RMSE, cm", 100, 2), ("median_translation_error_m", "translation, cm", 100, 2),
           ("median_rotation_error_deg", "rotation, deg", 1, 2)]


def interval(gains, decimals):
    """Mean of paired differences and their 95 % interval, as text."""
    from scipy import stats
    if len(gains) < 2:
        return "-"
    half = stats.t.ppf(0.975, len(gains) - 1) * statistics.stdev(gains) / len(gains) ** 0.5
    return f"{statistics.mean(gains):+.{decimals}f} ± {half:.{decimals}f}"


def score(arguments, model, seed):
    path = arguments.scores / f"{model.stem}_{seed}.json"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        run(arguments.program, "validate", "--model", model, "--samples", arguments.samples, "--threads", 1, "-o", path, "--set", f"run.validation_seed={seed}")
    scores = json.loads(path.read_text())[0]
    return {**scores, "posed_share": scores["posed"] / scores["samples"]}


def mean_and_spread(scores, metric, factor, decimals):
    values = [factor * one[metric] for one in scores if metric in one]
    if not values:
        return "-"
    spread = f" ± {statistics.stdev(values):.{decimals}f}" if len(values) > 1 else ""
    return f"{statistics.mean(values):.{decimals}f}{spread}"


def difference(before, after, metric, factor, decimals):
    return interval([factor * (b[metric] - a[metric]) for a, b in zip(before, after) if metric in a and metric in b], decimals)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("models", type=pathlib.Path)
    parser.add_argument("--samples", type=int, default=400)
    parser.add_argument("--validations", type=int, default=5)
    parser.add_argument("--scores", type=pathlib.Path, default=pathlib.Path("out/claims"))
    arguments = parser.parse_args()
    seeds = range(2000001, 2000001 + arguments.validations)
    scores = {model.stem: [score(arguments, model, seed) for seed in seeds] for model in sorted(arguments.models.glob("*.safetensors"))}
    headings = [heading for _, heading, _, _ in METRICS]
    print(table(["model", *headings], [[model, *(mean_and_spread(of, m, f, d) for m, _, f, d in METRICS)] for model, of in scores.items()]) + "\n")
    print(table(["added", "from", "to", *headings], [[what, a, b, *(difference(scores[a], scores[b], m, f, d) for m, _, f, d in METRICS)]
                                                     for what, a, b in CLAIMS if a in scores and b in scores]))


if __name__ == "__main__":
    main()
