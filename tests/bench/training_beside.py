#!/usr/bin/env python3
"""Training alone on the machine and beside compilers, with OpenMP's threads waiting passively and actively: samples a second, and the share of time that a step waits for data.

    tests/bench/training_beside.py NAME=PROGRAM [NAME=PROGRAM ...] [--seconds 20] [--compilers 2] [--set KEY=VALUE ...] [--json out.json]

Each program (ROOT/build/NAME/cli/volalign) trains ROOT/configs/m05-lite.yaml for so many seconds, in turn, at its batch of 16; the first log row, which has the start in it, is left
out. `as it is` leaves OMP_WAIT_POLICY unset: what `train` makes of it is the program's choice. The compilers compile render/scene.cc again and again. With two
threads beside C compilers on P processors a fair share is P / (2 + C) of what the threads get alone, each at most a whole processor.
"""

import argparse
import json
import os
import pathlib
import signal
import subprocess
import tempfile
import threading
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
THREADS = 2  # run.threads of m05-lite
COMPILE = ["c++", "-std=c++17", "-O2", "-c", str(ROOT / "render/scene.cc"), "-I", str(ROOT), "-I", "/usr/include/eigen3", "-o", "/dev/null"]


class Compilers:
    """So many compilers at work until it is left."""

    def __init__(self, count):
        self.stop = threading.Event()
        self.threads = [threading.Thread(target=self.work) for _ in range(count)]

    def work(self):
        while not self.stop.is_set():
            process = subprocess.Popen(COMPILE)
            while process.poll() is None:
                if self.stop.wait(0.05):
                    process.kill()
                    process.wait()
                    return
            if process.returncode != 0:
                raise SystemExit("the compiler failed: it keeps nobody from working")

    def __enter__(self):
        for thread in self.threads:
            thread.start()

    def __exit__(self, *unused):
        self.stop.set()
        for thread in self.threads:
            thread.join()


def train(args, program, policy):
    """Samples a second, share of the time that waits for data, processor time of a sample, s."""
    environment = {key: value for key, value in os.environ.items() if key != "OMP_WAIT_POLICY"}
    if policy != "as it is":
        environment["OMP_WAIT_POLICY"] = policy
    program = pathlib.Path(program).absolute()
    with tempfile.TemporaryDirectory() as folder:
        command = [str(program), "train", "--config", "configs/m05-lite.yaml", "-o", folder + "/run", "--set", "run.log_every=16", "run.validation_samples=0", "run.tensorboard=false", *args.set]
        with open(folder + "/log", "w", encoding="utf-8") as log:
            process = subprocess.Popen(command, cwd=program.parents[3], env=environment, stdout=log, stderr=log)
            file = pathlib.Path(folder) / "run" / "metrics.jsonl"
            start = time.monotonic()
            time.sleep(args.seconds)
            # Steps may take seconds where threads spin beside others.
            while process.poll() is None and time.monotonic() < start + 4 * args.seconds and (not file.exists() or len(file.read_text().splitlines()) < 4):
                time.sleep(0.5)
            process.send_signal(signal.SIGINT)
            _, _, used = os.wait4(process.pid, 0)
        rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
        rows = [row for row in rows if row["type"] == "train"]
        if len(rows) < 2:
            raise SystemExit(f"{' '.join(command)}: too few rows in {args.seconds} s\n" + pathlib.Path(folder, "log").read_text())
    steps = [{part: row["step_s"][part] for part in ("data", "forward", "loss", "backward", "optim")} for row in rows[1:]]
    whole = sum(sum(step.values()) for step in steps)
    samples = rows[-1]["samples"] - rows[0]["samples"]
    return samples / whole, sum(step["data"] for step in steps) / whole, (used.ru_utime + used.ru_stime) / rows[-1]["samples"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", nargs="+", metavar="NAME=PROGRAM")
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--compilers", type=int, default=2)
    parser.add_argument("--set", nargs="*", default=[])
    parser.add_argument("--json")
    args = parser.parse_args()
    processors = len(os.sched_getaffinity(0))
    fair = min(1.0, processors / (THREADS + args.compilers)) / min(1.0, processors / THREADS)
    print("| program | OMP_WAIT_POLICY | beside | samples/s | of fair shares | waiting for data | processor time a sample, ms |\n|---|---|---|---|---|---|---|")
    results = []
    for name, program in (text.split("=", 1) for text in args.programs):
        for policy in ("as it is", "PASSIVE", "ACTIVE"):
            alone = None
            for beside in (0, args.compilers):
                with Compilers(beside):
                    rate, data, used = train(args, program, policy)
                share = f"{rate / (alone * fair):.2f}" if alone else "-"
                alone = alone or rate
                results.append({"program": name, "policy": policy, "beside": beside, "samples_per_s": rate, "data": data, "processor_s": used})
                print(f"| {name} | {policy} | {beside} compilers | {rate:.1f} | {share} | {100 * data:.1f} % | {1000 * used:.1f} |", flush=True)
    if args.json:
        pathlib.Path(args.json).write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
