#!/usr/bin/env python3
"""Training steps of volalign and of the same network in PyTorch eager, side by side.

    tests/bench/training_step.py --program build/dev/tests/bench/training_step [--program LABEL=PATH ...] \
        --python /usr/bin/python3 [--python build/libtorch/newest/bin/python3 ...] [--rounds 20] [--json out.json]

Every contestant is a process that waits until it is told to take a step; they take turns, so that other work on the machine falls on all
alike, and the smallest time of each counts. Precisions, layouts, widths, threads: comma-separated lists, of which every combination is
measured. Run it from the repository's root.
"""

import argparse
import itertools
import json
import subprocess
import sys

PARTS = ["forward", "loss", "backward", "optimiser"]


class Contestant:
    def __init__(self, name, command):
        self.name, self.best, self.parts = name, float("inf"), None
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.version = self.process.stdout.readline().strip()
        if not self.version:
            raise SystemExit(f"{name} did not start: {' '.join(command)}")

    def step(self, count):
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline().split()
        if len(line) < len(PARTS):
            raise SystemExit(f"{self.name} stopped")
        seconds = [float(x) for x in line[: len(PARTS)]]
        if count and sum(seconds) < self.best:
            self.best, self.parts = sum(seconds), seconds

    def close(self):
        self.process.stdin.close()
        self.process.wait()


def contestants(args, width, threads, precision, layout):
    for program in args.program:
        label, _, path = program.rpartition("=")
        command = [path, f"model.base_channels={width}", f"run.threads={threads}", f"run.precision={precision}",
                   f"run.channels_last={'true' if layout == 'channels_last' else 'false'}", f"run.batch_size={args.batch}", f"size={args.size}",
                   f"model.normalization={args.normalization}", "loss.procrustes=false"]
        yield Contestant(label or "volalign", command)
        if args.geometric_loss:
            yield Contestant((label or "volalign") + " with the geometric loss", command[:-1])
    for python in args.python:
        command = [python, "tests/bench/eager_network.py", "--width", str(width), "--threads", str(threads), "--precision", precision,
                   "--layout", layout, "--batch", str(args.batch), "--size", args.size, "--normalization", args.normalization]
        contestant = Contestant("", command)
        contestant.name = f"PyTorch {contestant.version} eager"
        yield contestant


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", action="append", default=[])
    parser.add_argument("--python", action="append", default=[])
    parser.add_argument("--widths", default="8")
    parser.add_argument("--threads", default="1,2")
    parser.add_argument("--precisions", default="fp32,bf16")
    parser.add_argument("--layouts", default="contiguous,channels_last")
    parser.add_argument("--normalization", default="batch")
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--size", default="320x180")
    parser.add_argument("--rounds", type=int, default=12)
    parser.add_argument("--geometric-loss", action="store_true")
    parser.add_argument("--json")
    args = parser.parse_args()
    rows = []
    print(f"| width | threads | precision | layout | | ms per sample | {' | '.join(PARTS)} |")
    print("|---" * (6 + len(PARTS)) + "|")
    for width, threads, precision, layout in itertools.product(
            args.widths.split(","), args.threads.split(","), args.precisions.split(","), args.layouts.split(",")):
        taking_part = list(contestants(args, width, threads, precision, layout))
        for i in range(args.rounds + 1):
            for contestant in taking_part:
                contestant.step(count=i > 0)
        for c in taking_part:
            c.close()
            shares = " | ".join(f"{100 * p / c.best:.0f} %" for p in c.parts)
            print(f"| {width} | {threads} | {precision} | {layout} | {c.name} | {1e3 * c.best / args.batch:.1f} | {shares} |", flush=True)
            rows.append({"width": int(width), "threads": int(threads), "precision": precision, "layout": layout, "name": c.name,
                         "version": c.version, "seconds_per_sample": c.best / args.batch, "parts": dict(zip(PARTS, c.parts))})
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
