#!/usr/bin/env python3
"""The table of docs/deployment.md: of each format and each runtime, size, agreement and time.

    tests/bench/deployment.py VOLALIGN [ROUNDS]

Frames are those of configs/rig_ring8.yaml at half the size, which the network sees as they are: four of 160x144, four of 160x90. Those of one size go
through it together, as in a calibration, on two threads. Agreement: of the pixels with depth, the share that has the label of LibTorch's own segmenter.
Time: the least of ROUNDS (default 10) passes, on an idle machine; volalign's are of `evaluate`, with the preparation of the frames. Each runtime has a
process of its own. Needs onnxruntime and torch beside numpy; what is absent has no row.
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy

from common import D415, KINECT, ROOT, run
from grey_png import read_png

sys.path.insert(0, str(ROOT / "tests/core/nn"))
from export_onnx_check import THREADS, onnx_runner, script_runner

# Threads that wait for each other sleep, as in the tests: where other programs run, those that spin took three to six times as long.
os.environ["OMP_WAIT_POLICY"] = "PASSIVE"
CHECKPOINT = ROOT / "models/m05-lite.safetensors"


def run_here(model, rounds, folder):
    """In a process of its own: prints ms a frame, and leaves the labels of each size in the folder."""
    scores = (onnx_runner if model.endswith(".onnx") else script_runner)(model)
    frames = {kind: numpy.load(f"{folder}/{kind}.npy") for kind in (KINECT, D415)}
    seconds = []
    for _ in range(rounds + 1):  # the first one makes what is kept
        start = time.perf_counter()
        labels = {kind: scores(depth).argmax(1).astype(numpy.uint8) for kind, depth in frames.items()}
        seconds.append(time.perf_counter() - start)
    for kind, found in labels.items():
        numpy.save(f"{folder}/{kind}_labels.npy", found)
    print(1000 * min(seconds[1:]) / sum(map(len, frames.values())))


def make_frames(program, folder, rounds):
    """The names of each kind's sensors. Their depths are in KIND.npy, and capture/0.json and so on are captures of the same frames."""
    rig = (ROOT / "configs/rig_ring8.yaml").read_text()
    for kind, size in ((KINECT, "160x144"), (D415, "160x90")):
        rig = rig.replace(f"sensor: {kind},", f"sensor: {kind}, image_size: {size},")
    (folder / "rig.yaml").write_text(rig)
    run(program, "render", "--rig", folder / "rig.yaml", "-o", folder / "capture")
    capture = json.loads((folder / "capture/capture.json").read_text())
    for sensor in capture["sensors"]:
        sensor["quarter_turns"] = 0
    for k in range(rounds + 1):
        (folder / f"capture/{k}.json").write_text(json.dumps(capture))
    names = {kind: [sensor["name"] for sensor in capture["sensors"] if sensor["sensor"] == kind] for kind in (KINECT, D415)}
    for kind, of in names.items():
        numpy.save(folder / f"{kind}.npy", numpy.stack([read_png(folder / f"capture/{name}_depth.png") for name in of])[:, None].astype("f4") / 1000)
    return names


def run_volalign(program, model, rounds, folder, names):
    """As run_here, by calibrations."""
    options, out = ("--model", model, "--set", f"threads={THREADS}"), folder / f"{pathlib.Path(model).name}_out"
    run(program, "evaluate", *options, "--captures", *(folder / f"capture/{k}.json" for k in range(rounds + 1)), "-o", out / "evaluation")
    cases = json.loads((out / "evaluation/evaluation.json").read_text())["cases"]
    run(program, "calibrate", *options, "--capture", folder / "capture/0.json", "--no-report", "-o", out / "calibration")
    for kind, of in names.items():
        numpy.save(folder / f"{kind}_labels.npy", numpy.stack([read_png(out / f"calibration/labels/{name}.png") for name in of]))
    return 1000 * min(case["timings_s"]["segmentation"] for case in cases) / sum(map(len, names.values()))


def main(program, rounds):
    with tempfile.TemporaryDirectory(prefix="volalign_deployment_") as folder:
        folder = pathlib.Path(folder)
        names = make_frames(program, folder, rounds)
        load = lambda suffix: numpy.concatenate([numpy.load(folder / f"{kind}{suffix}.npy").ravel() for kind in names])
        models = {"checkpoint, fp16": CHECKPOINT}
        for title, format_, end in (("TorchScript", "torchscript", "ts"), ("ONNX", "onnx", "onnx")):
            for precision in ("fp32", "fp16"):
                models[f"{title}, {precision}"] = folder / f"m.{precision}.{end}"
                run(program, "export", "--model", CHECKPOINT, "--format", format_, "--precision", precision, "-o", models[f"{title}, {precision}"])
        rows = [("checkpoint, fp16", "volalign, LibTorch"), *((f"TorchScript, {p}", "`torch.jit.load`") for p in ("fp32", "fp16")),
                *((f"ONNX, {p}", runtime) for runtime in ("ONNX Runtime", "volalign, OpenCV") for p in ("fp32", "fp16"))]
        reference = None
        print("| format | size, MB | runtime | labels equal | ms per frame |\n|---|---|---|---|---|")
        for format_, runtime in rows:
            model = models[format_]
            if runtime.startswith("volalign"):
                taken = run_volalign(program, model, rounds, folder, names)
            else:
                done = subprocess.run([sys.executable, __file__, "--here", str(model), str(rounds), str(folder)], capture_output=True, text=True, check=False)
                if done.returncode != 0:
                    print(f"{runtime}: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
                    continue
                taken = float(done.stdout)
            labels = load("_labels")
            reference = labels if reference is None else reference
            share = (labels == reference)[load("") > 0].mean()
            print(f"| {format_} | {os.path.getsize(model) / 1e6:.1f} | {runtime} | {share:.3%} | {taken:.1f} |", flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 3 and sys.argv[1] == "--here":
        run_here(sys.argv[2], int(sys.argv[3]), sys.argv[4])
    elif len(sys.argv) in (2, 3):
        main(os.path.abspath(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) == 3 else 10)
    else:
        sys.exit(__doc__)
