#!/usr/bin/env python3
"""The table of docs/deployment.md: of each format and each runtime, size, agreement and time.

    tests/bench/deployment.py BUILD_FOLDER [ROUNDS]      (built with -DVOLALIGN_BENCHMARKS=ON)

Frames are the eight of configs/rig_ring8.yaml, every second pixel of every second row, as the network sees them (four of 160x144, four of
160x90), one by one, two threads. Agreement: of the pixels with depth, the share that has the label of LibTorch's own segmenter. Time: the
least of ROUNDS (default 20) passes over the frames, on an idle machine. Each runtime has a process of its own. Needs onnxruntime and torch beside numpy; what
is absent has no row.
"""

import json
import os
import subprocess
import sys
import tempfile
import time

import numpy

from common import ROOT
from grey_png import read_png

THREADS = 2
# Threads that wait for each other sleep, as in the tests: where other programs run, those that spin took three to six times as long.
ENVIRONMENT = {**os.environ, "OMP_WAIT_POLICY": "PASSIVE"}
CHECKPOINT = os.path.join(ROOT, "models", "m05-lite.safetensors")


def frames_of(path):
    height, width = (int(size) for size in reversed(os.path.basename(path)[: -len(".f32")].split("x")))
    return numpy.fromfile(path, "<f4").reshape(-1, 1, 1, height, width)


def run_here(model, rounds, paths):
    """In a process of its own: ms a frame, and labels beside the frames."""
    if model.endswith(".onnx"):
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = THREADS
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        run = lambda depth: session.run(None, {"depth": depth})[0]
    else:
        import torch

        torch.set_num_threads(THREADS)
        script = torch.jit.load(model, map_location="cpu")

        def run(depth):
            with torch.no_grad():
                return script(torch.from_numpy(depth)).numpy()

    least = float("inf")
    for round_ in range(rounds + 1):  # the first one makes what is kept
        start = time.perf_counter()
        labels = {path: [run(depth).argmax(1).astype(numpy.uint8) for depth in frames_of(path)] for path in paths}
        taken = 1000 * (time.perf_counter() - start) / sum(len(found) for found in labels.values())
        if round_ > 0:
            least = min(least, taken)
    for path, found in labels.items():
        numpy.concatenate(found).tofile(path + ".labels")
    print(f"{least:.2f}")


def make_frames(program, folder):
    subprocess.run([program, "render", "--rig", "configs/rig_ring8.yaml", "-o", folder + "/capture"], cwd=ROOT, stdout=subprocess.DEVNULL, check=True)
    with open(folder + "/capture/capture.json", encoding="utf-8") as file:
        sensors = json.load(file)["sensors"]
    by_size = {}
    for sensor in sensors:
        depth = numpy.array(read_png(os.path.join(folder, "capture", sensor["depth"])))[1::2, 1::2].astype("<f4") / 1000
        by_size.setdefault(f"{depth.shape[1]}x{depth.shape[0]}", []).append(depth)
    paths = []
    for size, depths in by_size.items():
        paths.append(f"{folder}/{size}.f32")
        numpy.stack(depths).tofile(paths[-1])
    return paths


def main(build, rounds):
    program, segment_time = os.path.join(build, "cli", "volalign"), os.path.join(build, "tests", "bench", "segment_time")
    with tempfile.TemporaryDirectory(prefix="volalign_deployment_") as folder:
        paths = make_frames(program, folder)
        measured = numpy.concatenate([frames_of(path).ravel() > 0 for path in paths])
        models = {}
        for name, format_ in (("ts", "torchscript"), ("onnx", "onnx")):
            for precision in ("fp32", "fp16"):
                models[name, precision] = f"{folder}/m.{precision}.{name}"
                subprocess.run([program, "export", "--model", CHECKPOINT, "--format", format_, "--precision", precision, "-o", models[name, precision]],
                               stdout=subprocess.DEVNULL, check=True)
        own = lambda model: [segment_time, model, str(rounds), *paths]
        here = lambda model: [sys.executable, os.path.abspath(__file__), "--here", model, str(rounds), *paths]
        rows = [("checkpoint, fp16", "volalign, LibTorch", CHECKPOINT, own)]
        rows += [(f"TorchScript, {p}", "`torch.jit.load`", models["ts", p], here) for p in ("fp32", "fp16")]
        rows += [(f"ONNX, {p}", "ONNX Runtime", models["onnx", p], here) for p in ("fp32", "fp16")]
        rows += [(f"ONNX, {p}", "volalign, OpenCV", models["onnx", p], own) for p in ("fp32", "fp16")]
        reference = None
        print("| format | size, MB | runtime | labels equal | ms per frame |\n|---|---|---|---|---|")
        for format_, runtime, model, command in rows:
            done = subprocess.run(command(model), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, check=False, env=ENVIRONMENT)
            if done.returncode != 0:
                print(f"{runtime}: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
                continue
            labels = numpy.concatenate([numpy.fromfile(path + ".labels", numpy.uint8) for path in paths])
            reference = labels if reference is None else reference
            share = (labels == reference)[measured].mean()
            print(f"| {format_} | {os.path.getsize(model) / 1e6:.1f} | {runtime} | {share:.3%} | {float(done.stdout):.1f} |", flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 3 and sys.argv[1] == "--here":
        run_here(sys.argv[2], int(sys.argv[3]), sys.argv[4:])
    elif len(sys.argv) in (2, 3):
        main(os.path.abspath(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) == 3 else 20)
    else:
        sys.exit(__doc__)
