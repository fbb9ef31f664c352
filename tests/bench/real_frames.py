#!/usr/bin/env python3
"""What recorded frames are worth in training: a checkpoint trained on with rendered samples alone, and with recorded frames mixed in, scored on the frames of rigs that are left out.

    tests/bench/real_frames.py --program build/release/cli/volalign [--samples 5000] [--left-out real_kinects,kinects5_lens_said,far4] [--work out/real_frames]

VOLALIGN_CAPTURES names the folder of captures (foreign/*/capture.json, and the frames that tests/accuracy.py names as real); none of them is in the repository.
The program calibrates each rig of the paper's stack; accepted calibrations are used, of sensors that lie on their sides, as the recipe's do. Then
models/m05-lite.safetensors is trained on by so many samples with a constant learning rate and averaged weights: once with rendered samples, and for each rig that is left
out once with a quarter of the samples from all other rigs. Runs that are there already are not made again. Run it from the repository's root.
"""

import argparse
import json
import os
import pathlib
import re
import subprocess

MODEL = "models/m05-lite.safetensors"


def run(program, *arguments):
    done = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if done.returncode not in (0, 2):
        raise SystemExit(f"{program} {' '.join(map(str, arguments))}\n{done.stderr}")
    return done.stdout


def first_device(kind, width):
    """fx, fy, cx, cy of the first device of a kind in configs/intrinsics.yaml."""
    text = pathlib.Path("configs/intrinsics.yaml").read_text(encoding="utf-8")
    return [float(x) for x in re.search(rf"sensor: {kind}\n  resolution: \[{width}, .*?- \[(.*?)\]", text, re.S)[1].split(",")]


def captures_of(captures, work):
    """The captures of each rig of the paper's stack, by the rig's name."""
    rigs = {}
    for path in sorted((captures / "foreign").glob("**/capture.json")):
        if not (path.parent / "boxes.yaml").exists():
            rigs.setdefault(path.relative_to(captures / "foreign").parts[0], []).append(path)
    fx, fy, cx, cy = first_device("realsense_d415", 1280)
    real = {"real_kinects": (["KA03_Depth.pgm", "KA04_Depth.pgm", "KA06_Depth.pgm", "KAX1_Depth.pgm"], "azure_kinect_nfov_binned", (320, 288, *first_device("azure_kinect_nfov_binned", 320))),
            "real_d415": (["input.pgm"], "realsense_d415", (320, 180, fx / 4, fy / 4, (cx + 0.5) / 4 - 0.5, (cy + 0.5) / 4 - 0.5))}
    for name, (files, kind, numbers) in real.items():
        path = work / name / "capture.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        intrinsics = dict(zip(("width", "height", "fx", "fy", "cx", "cy"), numbers), distortion=[])
        sensors = [{"name": file[:-4], "depth": os.path.relpath(captures / file, path.parent), "intrinsics": intrinsics, "sensor": kind} for file in files]
        path.write_text(json.dumps({"format": "volalign.capture/1", "depth_scale": 0.001, "sensors": sensors}), encoding="utf-8")
        rigs[name] = [path]
    return rigs


def calibrate(program, rigs, work):
    """The accepted extrinsics.json of each rig, and how many frames they have."""
    accepted = {}
    for name, captures in rigs.items():
        for i, capture in enumerate(captures):
            result = work / "calibrations" / f"{name}_{i}" / "extrinsics.json"
            if not result.exists():
                run(program, "calibrate", "--capture", capture, "--model", MODEL, "-o", result.parent, "--no-report")
            file = json.loads(result.read_text(encoding="utf-8"))
            good = [sensor for sensor, of in file["sensors"].items() if of["status"] == "ok"]
            # The recipe's sensors lie on their sides; frames of others have no image size there.
            upright = any(file["sensors"][sensor]["quarter_turns"] % 2 for sensor in good)
            print(f"{name}: {file['verdict']}, {len(good)} of {len(file['sensors'])} sensors ok{', not used: they stand upright' if upright else ''}", flush=True)
            if file["verdict"] == "ok" and not upright:
                accepted.setdefault(name, []).append((result, len(good)))
    return accepted


def listed(calibrations):
    return "[" + ", ".join(str(path) for path, _ in calibrations) + "]"


def train(args, name, settings):
    folder = args.work / f"{name}_{args.samples}"
    if not (folder / "model.safetensors").exists() or not (folder / "done").exists():
        command = ["train", "--config", "configs/m05-lite.yaml", "-o", folder, "--set", f"run.init={MODEL}", "optim.schedule=constant", f"optim.lr={args.lr}", "optim.ema_decay=0.99",
                   "optim.warmup_samples=320", "loss.lambda_warmup_samples=0", f"run.samples={args.samples}", "run.validation_samples=0", f"run.threads={args.threads}", *settings]
        run(args.program, *command, *(["--resume"] if (folder / "config.yaml").exists() else []))
        (folder / "done").touch()
    return folder / "model.safetensors"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", required=True)
    parser.add_argument("--samples", type=int, default=5000)
    parser.add_argument("--left-out", default="real_kinects,kinects5_lens_said,far4")
    parser.add_argument("--share", type=float, default=0.25)
    parser.add_argument("--lr", type=float, default=3e-4)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("out/real_frames"))
    args = parser.parse_args()
    captures = pathlib.Path(os.environ.get("VOLALIGN_CAPTURES") or "../shared/captures").resolve()
    if not captures.exists():
        raise SystemExit(f"{captures} does not exist: VOLALIGN_CAPTURES names the folder of captures")
    args.work.mkdir(parents=True, exist_ok=True)
    args.work = args.work.resolve()
    accepted = calibrate(args.program, captures_of(captures, args.work), args.work)
    left_out = args.left_out.split(",")
    missing = [rig for rig in left_out if rig not in accepted]
    if missing:
        raise SystemExit(f"no accepted calibration of {', '.join(missing)}")
    rendered = train(args, "rendered", [])
    print("\n| rig that is left out | frames | trained on with | miou | segmentation loss | frames with a pose | median error, cm | deg |\n|---|---|---|---|---|---|---|---|")
    for rig in left_out:
        others = [calibration for name, of in accepted.items() if name != rig for calibration in of]
        mixed = train(args, f"without_{rig}", [f"data.real.calibrations={listed(others)}", f"data.real.share={args.share}"])
        for name, model in (("nothing", MODEL), ("rendered samples", rendered), (f"{sum(n for _, n in others)} other frames mixed in", mixed)):
            row = json.loads(run(args.program, "validate", "--model", model, "--config", "configs/m05-lite.yaml", "--set", f"data.real.validation={listed(accepted[rig])}", "--json"))[0]
            print(f"| {rig} | {row['samples']} | {name} | {row['miou']:.3f} | {row['loss_seg']:.4f} | {row['posed']} | {100 * row.get('median_translation_error_m', float('nan')):.1f} | "
                  f"{row.get('median_rotation_error_deg', float('nan')):.2f} |", flush=True)


if __name__ == "__main__":
    main()
