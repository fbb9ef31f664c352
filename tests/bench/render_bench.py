#!/usr/bin/env python3
"""How fast samples are drawn, with rooms, sensor models and imprecise assembly: the table of docs/benchmarks.md.

    export LP_NUM_THREADS=0 MALLOC_MMAP_MAX_=0 MALLOC_TRIM_THRESHOLD_=2000000000
    PYTHONPATH=build/release/bindings/python /usr/bin/python3 tests/bench/render_bench.py [--seconds 5]

The variables make a process what `train` and `render` are: Mesa draws on one thread, and images come from memory that is kept.
"""

import argparse
import time

import volalign

from common import D415, KINECT, table


def measure(sensor, size, renderer, threads, seconds):
    """Processor time of a sample, ms, and samples per second."""
    samples = volalign.samples(seed=1, renderer=renderer, threads=threads, **{"data.sensors": [sensor], "data.image_sizes": [size]})
    for _ in range(100):  # what is drawn ahead is there
        next(samples)
    begin, processor, count = time.monotonic(), time.process_time(), 0
    while time.monotonic() - begin < seconds:
        next(samples)
        count += 1
    return 1000 * (time.process_time() - processor) / count, count / (time.monotonic() - begin)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5, help="of each of 8 measurements")
    options = parser.parse_args()
    rows = []
    for name, sensor, size in (("D415", D415, "320x180"), ("Kinect", KINECT, "320x288")):
        for renderer in ("egl", "cpu"):
            (processor, one), (_, two) = (measure(sensor, size, renderer, threads, options.seconds) for threads in (1, 2))
            rows.append([f"{name}, {size}", f"`{renderer}`", f"{processor:.3f}", f"{one:,.0f}", f"{two:,.0f}"])
    print(table(["sample", "renderer", "processor time, ms", "1 thread, samples/s", "2 threads"], rows))


if __name__ == "__main__":
    main()
