#!/usr/bin/env python3
"""Calibrates the same captures with two builds of the program in turn and prints how far their results are apart.

    tests/bench/compare_programs.py OLD NEW MODEL CAPTURE.json... [--runs 3] [--set KEY=VALUE ...] [--save FOLDER]

OLD may be a folder into which an earlier call saved what its NEW gave; times are then not compared.

For each capture: sensors whose status differs, the largest difference of any element of a pose and of a covariance, of a
residual (RMS), and the median time of `timings_s.total` with the ratio NEW / OLD. With --tolerance, exit status 1 where a status or
a pose differs by more.
"""
import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile


def calibrate(program, model, capture, settings, folder):
    command = [program, "calibrate", "--capture", str(capture), "--model", model, "-o", folder]
    for setting in settings:
        command += ["--set", setting]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 2):
        sys.exit(f"{' '.join(command)}\n{done.stderr}")
    return json.loads((pathlib.Path(folder) / "extrinsics.json").read_text())


def recall(folder, name):
    return json.loads((pathlib.Path(folder) / f"{name}.json").read_text())


def flat(value):
    return [x for row in value for x in row]


def difference(old, new, key):
    return max(abs(a - b) for a, b in zip(flat(old[key]), flat(new[key])))


def compare(name, old, new, seconds):
    poses, initials, covariances, rms = 0.0, 0.0, 0.0, 0.0
    changed = []
    for sensor, before in old["sensors"].items():
        after = new["sensors"][sensor]
        state = [(x["status"], x.get("code", ""), x.get("sides")) for x in (before, after)]
        if state[0] != state[1]:
            changed.append(f"{sensor}: {state[0]} -> {state[1]}")
        if "structure_from_sensor" not in before or "structure_from_sensor" not in after:
            continue
        poses = max(poses, difference(before, after, "structure_from_sensor"))
        initials = max(initials, difference(before, after, "initial"))
        covariances = max(covariances, difference(before, after, "covariance"))
        rms = max(rms, abs(before["rms_to_structure_m"] - after["rms_to_structure_m"]))
    times = [statistics.median(s) for s in seconds]
    print(f"{name:24s} pose {poses:.1e}  initial {initials:.1e}  covariance {covariances:.1e}  rms {rms:.1e}  "
          f"{times[0]:.3f} s -> {times[1]:.3f} s ({times[1] / times[0]:.2f})")
    for line in changed:
        print("   ", line)
    return poses, bool(changed)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("model")
    parser.add_argument("captures", nargs="+")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--tolerance", type=float)
    parser.add_argument("--save", type=pathlib.Path, help="folder for what NEW gives")
    options = parser.parse_args()
    wrong = False
    ratios = []
    for capture in options.captures:
        name = pathlib.Path(capture).parent.name
        results, seconds = [None, None], [[], []]
        with tempfile.TemporaryDirectory() as folder:
            for _ in range(options.runs):
                for i, program in enumerate((options.old, options.new)):
                    if pathlib.Path(program).is_dir():
                        results[i] = recall(program, name)
                    else:
                        results[i] = calibrate(program, options.model, capture, options.set, folder)
                    seconds[i].append(results[i]["timings_s"]["total"])
        if options.save:
            options.save.mkdir(parents=True, exist_ok=True)
            (options.save / f"{name}.json").write_text(json.dumps(results[1]))
        poses, changed = compare(name, *results, seconds)
        ratios.append(statistics.median(seconds[1]) / statistics.median(seconds[0]))
        wrong = wrong or changed or (options.tolerance is not None and poses > options.tolerance)
    print(f"median time ratio {statistics.median(ratios):.3f}")
    return 1 if options.tolerance is not None and wrong else 0


if __name__ == "__main__":
    sys.exit(main())
