#!/usr/bin/env python3
"""Training samples a second of builds of render_bench, by renderer, sensor, threads and processes, in one run.

    tests/bench/samples_per_second.py NAME=RENDER_BENCH [NAME=RENDER_BENCH ...] [--rounds 2] [--seconds 1] [--json out.json]

Each contestant takes its turn in each round: whole samples on one thread by the thread's processor time (BM_Synthesize), and the stream with one thread, with two, and in
two processes of one thread by the clock (BM_SampleStream). The best of all rounds counts. All keep the memory that they free, as `train` does. The first build is
what the others are compared with, each in its own source tree. Run it from the repository's root.
"""

import argparse
import json
import os
import pathlib
import re
import subprocess

SIZES = {"D415, 320x180": 0, "Kinect, 320x288": 2}  # argument of the benchmarks
RENDERERS = ("egl", "cpu")
ENVIRONMENT = {**os.environ, "MALLOC_MMAP_MAX_": "0", "MALLOC_TRIM_THRESHOLD_": str(2**31 - 1), "LP_NUM_THREADS": "0"}


def start(command, root=None):
    return subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=ENVIRONMENT)


def output(process):
    text, message = process.communicate()
    if process.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, process.args))}\n{message}")
    return json.loads(text)


class Build:
    def __init__(self, program, seconds):
        self.program, self.seconds = pathlib.Path(program).absolute(), seconds
        self.root = self.program.parents[4]  # ROOT/build/NAME/tests/bench/render_bench
        names = subprocess.run([program, "--benchmark_list_tests"], check=True, capture_output=True, text=True).stdout.split()
        #: {(benchmark, size, threads, renderer): name}; a build without a choice draws by OpenGL.
        self.names = {}
        for name in names:
            stream = re.fullmatch(r"BM_SampleStream/(\d)/(\d)(?:/(\d))?(?:/process_time)?/real_time", name)
            sample = re.fullmatch(r"BM_Synthesize/(\d)(?:/(\d))?", name)
            if stream:
                self.names["stream", int(stream[1]), int(stream[2]), int(stream[3] or 0)] = name
            elif sample:
                self.names["sample", int(sample[1]), 1, int(sample[2] or 0)] = name

    def renderers(self):
        return sorted({key[3] for key in self.names})

    def start(self, *key):
        return start([self.program, f"--benchmark_filter=^{self.names[key]}$", f"--benchmark_min_time={self.seconds}", "--benchmark_format=json"], self.root)

    def measure(self, size, renderer):
        """ms of processor time for a sample; samples a second of one thread, two, two processes."""
        sample = output(self.start("sample", size, 1, renderer))["benchmarks"][0]
        rates = [output(self.start("stream", size, threads, renderer))["benchmarks"][0]["items_per_second"] for threads in (1, 2)]
        both = [self.start("stream", size, 1, renderer) for _ in range(2)]
        rates.append(sum(output(process)["benchmarks"][0]["items_per_second"] for process in both))
        return [sample["cpu_time"] / 1000, *rates]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("builds", nargs="+", metavar="NAME=RENDER_BENCH")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=1)
    parser.add_argument("--json")
    args = parser.parse_args()
    builds = {name: Build(program, args.seconds) for name, program in (build.split("=", 1) for build in args.builds)}
    turns = {(size, name, RENDERERS[r]): (lambda b=build, s=SIZES[size], r=r: b.measure(s, r)) for size in SIZES for name, build in builds.items() for r in build.renderers()}
    best = {}
    for _ in range(args.rounds):
        for key, measure in turns.items():
            new = measure()
            old = best.get(key, new)
            best[key] = [min(new[0], old[0]), *map(max, new[1:], old[1:])]
    print("| sample | build | renderer | processor time, ms | 1 thread, samples/s | 2 threads | 2 processes | 2 threads / 1 | processor time, first / this |\n|---|---|---|---|---|---|---|---|---|")
    for (size, name, renderer), (ms, one, two, processes) in best.items():
        reference = best[size, next(iter(builds)), "egl"][0]
        print(f"| {size} | {name} | {renderer} | {ms:.3f} | {one:,.0f} | {two:,.0f} | {processes:,.0f} | {two / one:.2f} | {reference / ms:.2f} |".replace("nan", "-"))
    if args.json:
        pathlib.Path(args.json).write_text(json.dumps([{"sample": k[0], "build": k[1], "renderer": k[2], "values": v} for k, v in best.items()], indent=1))


if __name__ == "__main__":
    main()
