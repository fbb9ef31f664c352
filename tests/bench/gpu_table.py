#!/usr/bin/env python3
"""The table of tests/gpu.sh: what a device gives in training and calibration.

Every figure is measured by the program itself: the last row of a short run's metrics.jsonl (means over its steps, without the first
row, which has the start in it), or timings_s of an extrinsics.json. Lines are left out when the time is up.
"""

import argparse
import glob
import itertools
import json
import os
import subprocess
import tempfile
import time

from common import short_training

STEPS = 24  # of a run; two rows of 12, of which the second counts


class Table:
    def __init__(self, arguments):
        self.arguments = arguments
        self.end = time.monotonic() + arguments.seconds
        self.widths = (8, 16, 32)
        self.precisions = ("fp32", "bf16")
        self.batches = (2, 4) if arguments.device == "cpu" else (16, 64)
        self.loaders = max(1, (os.cpu_count() or 1) - 2)

    def late(self):
        return time.monotonic() > self.end

    def run(self, command):
        """Status and last line of the messages; a command that outlasts the time that is left is ended, with the status None."""
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=max(1, self.end - time.monotonic()))
        except subprocess.TimeoutExpired:
            return None, "the time was up"
        return done.returncode, (done.stderr.strip().splitlines() or ["no message"])[-1]

    def train(self, folder, width, precision, batch, renderer, steps=STEPS):
        """The last row of a run, or None where it failed (out of memory, no such renderer)."""
        run = os.path.join(folder, "run")
        settings = {"model.base_channels": width, "run.precision": precision, "run.channels_last": "auto", "data.renderer": renderer,
                    "run.loader_threads": self.loaders, "run.log_every": steps // 2 * batch}
        command = [*short_training(self.arguments.program, run, steps, batch, settings), "--device", self.arguments.device]
        status, message = self.run(command)
        if status != 0:
            print(f"\nNot measured: width {width}, {precision}, batch {batch}, {renderer}: {message}\n", flush=True)
            return None
        with open(os.path.join(run, "metrics.jsonl"), encoding="utf-8") as rows:
            return json.loads(rows.readlines()[-1])

    def training(self):
        print("\n| width | precision | batch | renderer | samples/s | waiting for data | forward | loss | backward | optimiser |\n|---|---|---|---|---|---|---|---|---|---|")
        # Where the time is short, the lines that it allows differ from the first in one choice each.
        choices = (self.widths, self.precisions, self.batches, ("cpu", "egl"))
        lines = sorted(itertools.product(*choices), key=lambda line: sum(choice.index(value) for choice, value in zip(choices, line)))
        for width, precision, batch, renderer in lines:
            if self.late():
                return
            with tempfile.TemporaryDirectory() as folder:
                row = self.train(folder, width, precision, batch, renderer)
            if row is None:
                continue
            parts = row["step_s"]
            whole = sum(parts.values())
            shares = " | ".join(f"{100 * parts[part] / whole:.0f} %" for part in ("data", "forward", "loss", "backward", "optim"))
            print(f"| {width} | {precision} | {batch} | {renderer} | {row['samples_per_s']:.1f} | {shares} |", flush=True)

    def largest_batch(self):
        """Batches are doubled until one fails, up to what memory or the time allows."""
        width, largest, batch = self.widths[-1], 0, self.batches[-1]
        while not self.late() and batch <= 4096:
            with tempfile.TemporaryDirectory() as folder:
                if self.train(folder, width, self.precisions[-1], batch, "cpu", steps=2) is None:
                    break
            largest, batch = batch, 2 * batch
        reason = "the time was up" if self.late() else "the next one failed or is over 4096"
        print(f"\nLargest batch at width {width}, bf16, 320x180, of those that were tried: {largest} ({reason}).", flush=True)

    def calibration(self):
        if self.late():
            return
        with tempfile.TemporaryDirectory() as folder:
            capture, result = os.path.join(folder, "capture"), os.path.join(folder, "result")
            rig = [self.arguments.program, "render", "--rig", "configs/rig_studio.yaml", "--renderer", "cpu", "-o", capture]
            calibrate = [self.arguments.program, "calibrate", "--model", "models/m05-lite.safetensors", "--device", self.arguments.device, "-o", result]
            for command in (rig, calibrate):
                status, message = self.run(command)
                if status not in (0, 2):
                    print(f"\nCalibration: {message}", flush=True)
                    return
                # The rig stands at several places.
                for still in sorted(glob.glob(os.path.join(capture, "**", "capture.json"), recursive=True)):
                    calibrate += ["--capture", still]
            with open(os.path.join(result, "extrinsics.json"), encoding="utf-8") as file:
                timings = json.load(file)["timings_s"]
        print("\n| stage of calibration | s |\n|---|---|")
        for stage, seconds in timings.items():
            print(f"| {stage} | {seconds:.2f} |")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", required=True)
    parser.add_argument("--device", required=True)
    parser.add_argument("--seconds", type=float, required=True)
    table = Table(parser.parse_args())
    table.calibration()
    table.training()
    table.largest_batch()


if __name__ == "__main__":
    main()
