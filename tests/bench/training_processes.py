#!/usr/bin/env python3
"""Training with one and two threads and with one and two processes: samples a second, and what the time goes to.

    tests/bench/training_processes.py --program build/release/cli/volalign [--samples 960] [--rounds 2] [--set KEY=VALUE ...] [--json out.json]

Each round trains m05-lite with group normalisation (batch normalisation is for one process) from the beginning in every set-up, in turn; the fastest
log row of all rounds counts, so that other work on the machine matters less. Run it from the repository's root.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile

SETUPS = [(1, 1), (1, 2), (2, 1)]  # processes, threads of each
PARTS = ["data", "forward", "loss", "backward", "optim"]


def rows_of(args, processes, threads):
    with tempfile.TemporaryDirectory() as folder:
        command = [args.program, "train", "--config", "configs/m05-lite.yaml", "-o", folder + "/run", "--set", "model.normalization=group",
                   f"run.samples={args.samples}", f"run.validate_every={args.samples}", "run.validation_samples=16", "optim.warmup_samples=160",
                   "loss.lambda_warmup_samples=0", f"run.threads={threads}", *args.set]
        if processes > 1:
            command += ["--nproc", str(processes)]
        subprocess.run(command, check=True, capture_output=True)
        lines = (pathlib.Path(folder) / "run" / "metrics.jsonl").read_text().splitlines()
    rows = [json.loads(line) for line in lines]
    return [row for row in rows if row["type"] == "train"][1:]  # the first has the start in it


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", required=True)
    parser.add_argument("--samples", type=int, default=960)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--set", nargs="*", default=[])
    parser.add_argument("--json")
    args = parser.parse_args()
    best = {}
    for _ in range(args.rounds):
        for setup in SETUPS:
            for row in rows_of(args, *setup):
                if setup not in best or row["samples_per_s"] > best[setup]["samples_per_s"]:
                    best[setup] = row
    print(f"| processes | threads of each | samples/s | {' | '.join(PARTS)} |")
    print("|---" * (3 + len(PARTS)) + "|")
    for (processes, threads), row in best.items():
        whole = sum(row["step_s"][part] for part in PARTS)
        shares = " | ".join(f"{100 * row['step_s'][part] / whole:.1f} %" for part in PARTS)
        print(f"| {processes} | {threads} | {row['samples_per_s']:.1f} | {shares} |")
    if args.json:
        pathlib.Path(args.json).write_text(json.dumps([{"processes": p, "threads": t, **row} for (p, t), row in best.items()], indent=1))


if __name__ == "__main__":
    main()
