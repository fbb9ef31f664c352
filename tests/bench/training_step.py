#!/usr/bin/env python3
"""Training steps of volalign and of the same network in PyTorch eager, side by side.

    tests/bench/training_step.py --program build/release/cli/volalign [--program LABEL=PATH ...] \
        --python /usr/bin/python3 [--python build/libtorch/newest/bin/python3 ...] [--rounds 6] [--json out.json]

In each round every contestant takes three steps at 320x180, of which the first does not count. They take turns, so that other work on the
machine falls on all alike, and the smallest time of each counts. Precisions, layouts, widths, threads: comma-separated lists, of which
every combination is measured. Run it from the repository's root.
"""

import argparse
import itertools
import json
import pathlib
import sys
import tempfile

from common import run, short_training

PARTS = {"forward": "forward", "loss": "loss", "backward": "backward", "optim": "optimiser"}
STEPS = 3


class Contestant:
    """`rows` returns the text of a round's steps, a line of JSON each, as in metrics.jsonl."""

    def __init__(self, name, rows):
        self.name, self.rows, self.best, self.parts = name, rows, float("inf"), None

    def take_turn(self):
        for row in self.rows().splitlines()[1:]:
            seconds = [json.loads(row)["step_s"][part] for part in PARTS]
            if sum(seconds) < self.best:
                self.best, self.parts = sum(seconds), seconds


def trained(program, batch, settings):
    with tempfile.TemporaryDirectory() as folder:
        run(*short_training(program, f"{folder}/run", STEPS, batch, {"run.log_every": batch, **settings}))
        return pathlib.Path(folder, "run/metrics.jsonl").read_text(encoding="utf-8")


def contestants(args, width, threads, precision, layout):
    for program in args.program:
        label, _, path = program.rpartition("=")
        label = label or "volalign"
        settings = {"model.base_channels": width, "run.threads": threads, "run.precision": precision, "run.channels_last": str(layout == "channels_last").lower(),
                    "loss.procrustes": "false"}
        yield Contestant(label, lambda path=path: trained(path, args.batch, settings))
        if args.geometric_loss:
            yield Contestant(f"{label} with the geometric loss", lambda path=path: trained(path, args.batch, {**settings, "loss.procrustes": "true"}))
    for python in args.python:
        version = run(python, "-c", "import torch; print(torch.__version__)").strip()
        command = [python, "tests/bench/eager_network.py", "--width", width, "--threads", threads, "--precision", precision, "--layout", layout,
                   "--batch", args.batch, "--steps", STEPS]
        yield Contestant(f"PyTorch {version} eager", lambda command=command: run(*command))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", action="append", default=[])
    parser.add_argument("--python", action="append", default=[])
    parser.add_argument("--widths", default="8")
    parser.add_argument("--threads", default="1,2")
    parser.add_argument("--precisions", default="fp32,bf16")
    parser.add_argument("--layouts", default="contiguous,channels_last")
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--geometric-loss", action="store_true")
    parser.add_argument("--json")
    args = parser.parse_args()
    rows = []
    print(f"| width | threads | precision | layout | | ms per sample | {' | '.join(PARTS.values())} |")
    print("|---" * (6 + len(PARTS)) + "|")
    for width, threads, precision, layout in itertools.product(
            args.widths.split(","), args.threads.split(","), args.precisions.split(","), args.layouts.split(",")):
        taking_part = list(contestants(args, width, threads, precision, layout))
        for _ in range(args.rounds):
            for contestant in taking_part:
                contestant.take_turn()
        for c in taking_part:
            shares = " | ".join(f"{100 * p / c.best:.0f} %" for p in c.parts)
            print(f"| {width} | {threads} | {precision} | {layout} | {c.name} | {1e3 * c.best / args.batch:.1f} | {shares} |", flush=True)
            rows.append({"width": int(width), "threads": int(threads), "precision": precision, "layout": layout, "name": c.name,
                         "seconds_per_sample": c.best / args.batch, "parts": dict(zip(PARTS.values(), c.parts))})
    for width, threads in itertools.product(args.widths.split(","), args.threads.split(",")):
        best = {}
        for row in rows:
            if row["width"] == int(width) and row["threads"] == int(threads) and "geometric" not in row["name"]:
                best[row["name"]] = min(best.get(row["name"], float("inf")), row["seconds_per_sample"])
        fastest = min(best.values())
        print(f"\nwidth {width}, {threads} threads, best of each: " + ", ".join(f"{k} {1e3 * v:.1f} ms ({v / fastest:.2f})" for k, v in best.items()))
    if args.json:
        with open(args.json, "w", encoding="utf-8") as file:
            json.dump({"arguments": sys.argv[1:], "rows": rows}, file, indent=1)


if __name__ == "__main__":
    main()
