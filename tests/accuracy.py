#!/usr/bin/env python3
"""How accurate calibration is and how true its covariances are: a row for each family of frames, of one program or of two side by side.

    tests/accuracy.py VOLALIGN [VOLALIGN] [--parts foreign,alone,real,table,places,rendered,physics] [--model FILE] [--rigs 40] [--json FILE]
    tests/accuracy.py VOLALIGN [VOLALIGN] --guard [--quick] [--keep]

Needs NumPy and Pillow; runs from the root of the project. What an earlier run left in --work for the same program and model (the same bytes) is not done again.
After the table come real sensors, those without a pose, the wrong ones, and those whose status or error changed by more than 3 mm.

Families of frames, and what they are compared with (VOLALIGN_CAPTURES names the folder of frames that are not in the repository):
- foreign: rigs of another simulator, with and without the network; true poses, after the best rigid motion
- real: four Azure Kinects, a D415, cartons on a pallet; nothing: residuals and sigmas
- rendered, physics: --rigs rigs of each kind, seeds from 1000; boxes 3 mm and 0.5 deg off, sizes 1 %; true poses in the nominal frame
- table: two sensors before cartons on a table; a relative pose from colour images, known to 3 to 5 cm and 0.4 deg
- places: six sensors, a stack at four placements, and the rig irregular with one and four; true poses
- alone: single frames of foreign, of which only the stack is left, so that several poses may look alike; true poses

Columns: median, 95th percentile and largest error of the sensors that are not wrong, mm, or RMS of their points to the structure; percent of the six
components of delta within one and two standard deviations; beside both, what they were.

Each family is compared with the first program, or with the kept table tests/accuracy_kept.json if one program is given. --keep writes the kept table anew.
--guard measures every family, and has the status 1 if one is worse by one of these:
- its median or 95th percentile grows by more than 3 % (10 % for fewer than 40 sensors)
- a sensor is lost, wrong, wrong and ok, or ambiguous that was not
- the share of errors within one or two sigmas moves away from 68 or 95 % by more than 2 points (10 for fewer than 40 sensors)
"""

import argparse
import hashlib
import itertools
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

import numpy as np

from grey_png import read_png, write_png

STRUCTURE = "configs/structure.yaml"
RIGS = ["ring8", "arc8", "ring4", "irregular"]
KINDS = ["azure_kinect_nfov_binned", "realsense_d415"]
ASSEMBLY = ["position_mm=3", "yaw_deg=0.5", "size_scale_percent=1"]  # standard deviations, as of training's stacks
GOLDEN_ANGLE_DEG = 137.50776405003785  # between seeds, as in volalign evaluate
WRONG_M, WRONG_DEG = 0.1, 10


# Poses are 4 x 4, structure_from_sensor.

def rotation_log(r):
    axis = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2
    sine = np.linalg.norm(axis)
    return axis * (np.arctan2(sine, (np.trace(r) - 1) / 2) / sine if sine > 1e-12 else 1)


def difference(estimate, truth):
    """delta in truth = Exp(delta) estimate, a movement about the structure's origin."""
    r = truth[:3, :3] @ estimate[:3, :3].T
    return np.concatenate([truth[:3, 3] - r @ estimate[:3, 3], rotation_log(r)])


def errors(estimate, truth):
    """Distance of the positions, m, and angle between the orientations, deg."""
    turn = rotation_log(truth[:3, :3] @ estimate[:3, :3].T)
    return np.linalg.norm(estimate[:3, 3] - truth[:3, 3]), np.degrees(np.linalg.norm(turn))


def is_wrong(error):
    return bool(error[0] > WRONG_M or error[1] > WRONG_DEG)


def best_rigid(source, target):
    """Rigid transform that minimises the sum of |target - T source|^2 (Kabsch)."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    u, _, vt = np.linalg.svd((target - b).T @ (source - a))
    transform = np.eye(4)
    transform[:3, :3] = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    transform[:3, 3] = b - transform[:3, :3] @ a
    return transform


def best_motion(estimates, truths):
    """The motion that takes estimates onto truths best: by each sensor's position and the points 1 m from it along its axes, over the
    sensors that it does not leave wrong. It begins with the one that makes a single sensor right and the fewest others wrong."""
    arms = np.vstack([np.zeros(3), np.eye(3), -np.eye(3)]).T
    points = [[(pose[:3, :3] @ arms).T + pose[:3, 3] for pose in poses] for poses in (estimates, truths)]

    def left(motion):
        return [errors(motion @ e, t) for e, t in zip(estimates, truths)]

    starts = [t @ np.linalg.inv(e) for e, t in zip(estimates, truths)]
    motion = min(starts, key=lambda m: sum(min(error[0], WRONG_M) + is_wrong(error) for error in left(m)))
    for _ in range(5):
        right = [i for i, error in enumerate(left(motion)) if not is_wrong(error)]
        motion = best_rigid(*(np.vstack([side[i] for i in right]) for side in points))
    return motion


# Calibrations.

def digest(path):
    return hashlib.sha256(pathlib.Path(path).read_bytes()).hexdigest()[:12]


class Program:
    def __init__(self, path, options):
        self.path, self.options = path, options
        self.work = options.work / digest(path)
        self.work.mkdir(parents=True, exist_ok=True)

    def run(self, *arguments):
        done = subprocess.run([self.path, *map(str, arguments)], capture_output=True, text=True)
        if done.returncode not in (0, 2):
            sys.exit(f"{self.path} {' '.join(map(str, arguments))}\n{done.stderr}")

    def calibrate(self, name, captures, model, structure=None):
        """extrinsics.json of a calibration; whatever else it writes is dropped."""
        kept = self.work / f"{name}_{digest(self.options.model) if model else 'no_model'}.json"
        if not kept.exists():
            print(kept, file=sys.stderr)
            structure = structure or (None if model else STRUCTURE)
            arguments = [x for capture in captures for x in ("--capture", capture)]
            arguments += ["--model", self.options.model if model else "none"]
            arguments += ["--structure", structure] if structure else []
            folder = kept.with_suffix(".out")
            self.run("calibrate", *arguments, "-o", folder, "--no-report", "--threads", self.options.threads)
            (folder / "extrinsics.json").rename(kept)
            shutil.rmtree(folder)
        return json.loads(kept.read_text())


def truth_of(capture):
    return {name: np.array(pose) for name, pose in json.loads(capture.read_text()).get("ground_truth", {}).items()}


def measure(result, set_name, capture, extrinsics, truths, align=False):
    """Adds a row of every sensor ("sensors"), and of every pair whose clouds overlap ("clouds")."""
    where = {"set": set_name, "capture": capture}
    poses = {name: np.array(s["structure_from_sensor"]) for name, s in extrinsics["sensors"].items() if "structure_from_sensor" in s}
    known = [name for name in poses if name in truths]
    if align and known:
        back = np.linalg.inv(best_motion([poses[n] for n in known], [truths[n] for n in known]))
        truths = {name: back @ truth for name, truth in truths.items()}
    for name, found in extrinsics["sensors"].items():
        row = dict(where, sensor=name, status=found["status"], code=found.get("code", ""), source=found.get("initial_source", ""),
                   placed=name in poses)
        result["sensors"].append(row)
        if name in poses:
            row["rms_mm"] = 1000 * found.get("rms_to_structure_m", np.nan)
            row["sigma_mm"] = 1000 * max(found.get("sigma_position_m", [np.nan]))
        if name not in known:
            continue
        error = errors(poses[name], truths[name])
        row.update(mm=1000 * error[0], deg=error[1], wrong=is_wrong(error))
        if not row["wrong"] and "covariance" in found:
            row["sigmas"] = list(difference(poses[name], truths[name]) / np.sqrt(np.diag(found["covariance"])))
    for pair in extrinsics["pairs"]:
        if "rms_m" in pair:
            result["clouds"].append(dict(where, a=pair["a"], b=pair["b"], rms_mm=1000 * pair["rms_m"]))


def foreign(program, captures, result, models=(True, False)):
    for model, folder in itertools.product(models, sorted((captures / "foreign").iterdir())):
        files, boxes = sorted(folder.rglob("capture.json")), folder / "boxes.yaml"
        if model and boxes.exists():
            continue  # the model was trained on other boxes
        extrinsics = program.calibrate(f"foreign_{folder.name}", files, model, boxes if boxes.exists() else None)
        measure(result, "foreign, " + ("model" if model else "no model"), folder.name, extrinsics, truth_of(files[0]), align=True)


def alone(program, captures, result):
    """Without a floor and the room, a symmetry may fit as well: such a sensor has to be ambiguous."""
    low, high = [-0.75, -0.77, -0.75], [0.75, 0.9, 0.75]  # m, structure frame, from 4 cm above the floor
    for folder in sorted((captures / "foreign").iterdir()):
        if (folder / "boxes.yaml").exists():
            continue
        file = next(iter(sorted(folder.rglob("capture.json"))))
        capture = json.loads(file.read_text())
        truths = truth_of(file)
        for sensor in capture["sensors"]:
            name, lens = sensor["name"], sensor["intrinsics"]
            depth = read_png(file.parent / sensor["depth"])
            v, u = np.indices(depth.shape)
            z = depth * sensor["depth_scale"]
            points = np.stack([(u - lens["cx"]) / lens["fx"] * z, (v - lens["cy"]) / lens["fy"] * z, z], -1)
            points = points @ truths[name][:3, :3].T + truths[name][:3, 3]
            path = program.options.work / "alone" / f"{folder.name}_{name}" / "capture.json"
            path.parent.mkdir(parents=True, exist_ok=True)
            write_png(path.parent / "depth.png", np.where(((points > low) & (points < high)).all(-1), depth, 0))
            path.write_text(json.dumps({"format": capture["format"], "sensors": [{**sensor, "depth": "depth.png"}]}))
            extrinsics = program.calibrate(f"alone_{folder.name}_{name}", [path], False)
            measure(result, "foreign alone, no model", f"{folder.name}_{name}", extrinsics, truths)


def first_intrinsics(kind, width):
    """fx, fy, cx, cy of the first device of a kind in configs/intrinsics.yaml."""
    text = pathlib.Path("configs/intrinsics.yaml").read_text()
    return [float(x) for x in re.search(rf"sensor: {kind}\n  resolution: \[{width}, .*?- \[(.*?)\]", text, re.S)[1].split(",")]


def real(program, captures, result):
    fx, fy, cx, cy = first_intrinsics(KINDS[1], 1280)
    quarter = (fx / 4, fy / 4, (cx + 0.5) / 4 - 0.5, (cy + 0.5) / 4 - 0.5)
    rigs = {"kinects": ([f"{name}_Depth.pgm" for name in ("KA03", "KA04", "KA06", "KAX1")], KINDS[0],
                        (320, 288, *first_intrinsics(KINDS[0], 320))),
            "d415": (["input.pgm"], KINDS[1], (320, 180, *quarter))}
    for model, (name, (files, kind, numbers)) in itertools.product((True, False), rigs.items()):
        path = program.options.work / f"real_{name}" / "capture.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        intrinsics = dict(zip(("width", "height", "fx", "fy", "cx", "cy"), numbers), distortion=[])
        path.write_text(json.dumps({"format": "volalign.capture/1", "depth_scale": 0.001, "sensors": [
            {"name": file[:-4], "depth": os.path.relpath(captures / file, path.parent), "intrinsics": intrinsics, "sensor": kind}
            for file in files]}))
        measure(result, f"real {name}, " + ("model" if model else "no model"), name,
                program.calibrate(f"real_{name}", [path], model), {})
    pallet = captures / "pallet"
    measure(result, "real pallet, no model", "pallet",
            program.calibrate("pallet", [pallet / "capture.json"], False, pallet / "pal.yaml"), {})


def table(program, captures, result):
    """Two sensors before cartons on a table. One pose in the other's frame is known from colour and ICP to 3 to 5 cm and 0.4 degrees."""
    references = json.loads((captures / "table/reference.json").read_text())
    for scene in ("cho11", "mai7"):
        folder, reference = captures / "table" / scene, np.array(references[scene])
        extrinsics = program.calibrate(f"table_{scene}", [folder / "capture.json"], False, folder / "boxes.yaml")
        poses = {name: np.array(s["structure_from_sensor"]) for name, s in extrinsics["sensors"].items() if "structure_from_sensor" in s}
        truths = {"cam1": poses["cam1"], "cam2": poses["cam1"] @ reference} if len(poses) == 2 else {}
        measure(result, "real table, no model", scene, extrinsics, truths)


def places(program, captures, result, counts=(1, 2, 4)):
    """Sensors that stand still and a stack that is moved: captures of the first place, of the first two, of four."""
    for count, folder in itertools.product(counts, sorted((captures / "foreign_places").iterdir())):
        files = [folder / f"p{k}" / "capture.json" for k in range(count)]
        measure(result, f"places {folder.name.split('_')[0]}, {count} of 4", folder.name,
                program.calibrate(f"{folder.name}_{count}", files, True), truth_of(files[0]), align=True)


def rendered_places(program, renderer, result, rigs, counts=(1, 4)):
    """The rig `irregular`, the boxes built anew at each place; places are drawn from the seed within 0.8 m of the first."""
    options = program.options
    for kind, seed in itertools.product(KINDS, range(3000, 3000 + rigs)):
        name = f"places_{kind}_{seed}"
        folder = options.work / "rendered" / name
        if not folder.exists():
            draws = np.random.default_rng(seed).uniform(-0.56, 0.56, (3, 3)) * [100, 100, 320]
            spots = ", ".join(f"{{x_cm: {x:.0f}, z_cm: {z:.0f}, yaw_deg: {yaw:.0f}}}" for x, z, yaw in draws)
            folder.mkdir(parents=True, exist_ok=True)
            text = pathlib.Path("configs/rig_irregular.yaml").read_text()
            (folder / "rig.yaml").write_text(re.sub(r"sensor: \w+,", f"sensor: {kind},", text) + f"placements: [{spots}]\n")
            renderer.run("render", "--rig", folder / "rig.yaml", "-o", folder, "--force", "--set", f"seed={seed}")
        files = sorted(folder.glob("placement_*/capture.json"))
        for count in counts:
            measure(result, f"rendered places {kind}, {count} of 4", name, program.calibrate(f"{name}_{count}", files[:count], True),
                    truth_of(files[0]), align=True)


def rendered(program, renderer, result, noise):
    """Rigs as those of README's table, which `volalign evaluate` renders: but that each is drawn with a seed of its own: boxes of one seed are displaced alike. `noise`: of rig.yaml."""
    part = {"sensor": "rendered"}.get(noise, noise)
    options = program.options
    for kind, k in itertools.product(KINDS, range(options.rigs)):
        rig, seed = options.rig[k % len(options.rig)], options.seed + k
        name = f"{rig}_{kind}_{seed}" + ("" if part == "rendered" else f"_{part}")
        folder = options.work / "rendered" / name
        if not (folder / "capture.json").exists():
            folder.mkdir(parents=True, exist_ok=True)
            text = pathlib.Path(f"configs/rig_{rig}.yaml").read_text()
            (folder / "rig_of_one_kind.yaml").write_text(re.sub(r"sensor: \w+,", f"sensor: {kind},", text))
            renderer.run("render", "--rig", folder / "rig_of_one_kind.yaml", "-o", folder, "--set", f"seed={seed}", "--set",
                         f"structure_yaw_deg={GOLDEN_ANGLE_DEG * seed % 360}", "--set", f"noise={noise}",
                         *itertools.chain(*(("--set", f"assembly.{text}") for text in ASSEMBLY)))
        measure(result, f"{part} {kind}", name, program.calibrate(name, [folder / "capture.json"], True),
                truth_of(folder / "capture.json"))


# Families.

KEPT = pathlib.Path("tests/accuracy_kept.json")


def family(rows):
    """One family of frames in figures: lengths in mm, shares in percent."""
    right = [row for row in rows if row["placed"] and not row.get("wrong")]
    lengths = np.array(of(right, "mm") or of(right, "rms_mm"))
    sigmas = np.abs(of(right, "sigmas"))
    return {"sensors": len(rows), "placed": sum(of(rows, "placed")), "wrong": sum(of(rows, "wrong")),
            "wrong_ok": sum(row["status"] == "ok" for row in rows if row.get("wrong")),
            "ambiguous": of(rows, "code").count("ambiguous"), "of": "error" if of(right, "mm") else "RMS to the structure",
            **{key: round(float(np.quantile(lengths, q)), 2) if lengths.size else None for key, q in (("median", 0.5), ("p95", 0.95), ("worst", 1))},
            **{f"in_{k}": round(100 * float(np.mean(sigmas < k)), 1) if sigmas.size else None for k in (1, 2)}}


def complaints(now, kept):
    """How a family is worse than it was: by more than 3 % of its median or 95th percentile (10 % below 40 sensors), by a sensor that is lost or wrong,
    by 2 points of coverage, away from the nominal one (10 below 40 sensors, whose coverage varies by as much)."""
    few = now["sensors"] < 40
    found = [f"{key} {kept[key]} -> {now[key]}" for key in ("median", "p95")
             if None not in (now[key], kept[key]) and now[key] > kept[key] * (1.1 if few else 1.03) + 0.05]
    found += [f"placed {kept['placed']} -> {now['placed']}"] if now["placed"] < kept["placed"] else []
    found += [f"{key} {kept[key]} -> {now[key]}" for key in ("wrong", "wrong_ok", "ambiguous") if now[key] > kept[key]]
    for key, nominal in (("in_1", 68.3), ("in_2", 95.4)):
        if None not in (now[key], kept[key]) and abs(now[key] - nominal) > max(abs(kept[key] - nominal), 2) + (10 if few else 2):
            found.append(f"{key} {kept[key]} -> {now[key]} %")
    return found


def guard(results, options):
    """Prints a row of every family and returns whether one is worse than in the first program, or than the kept table has it."""
    form = "quick" if options.quick else "full"
    families = [{name: family([row for row in result["sensors"] if row["set"] == name])
                 for name in dict.fromkeys(of(result["sensors"], "set"))} for result in results]
    kept = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    before = families[0] if len(families) > 1 else kept.get(form, {})
    worse = False
    print("| family | sensors | placed | wrong (ok) | ambiguous | mm: median / 95 % / worst | before | in 1, 2 sigmas, % | before | worse |\n" + "|---" * 10 + "|")
    for name, now in families[-1].items():
        was = before.get(name)
        found = complaints(now, was) if was else []
        worse = worse or bool(found)
        lengths, shares = (lambda f: " / ".join(str(f[key]) for key in ("median", "p95", "worst")) if f else "-",
                           lambda f: f"{f['in_1']}, {f['in_2']}" if f and f["in_1"] is not None else "-")
        rms = "" if now["of"] == "error" else " (RMS)"
        print(f"| {name} | {now['sensors']} | {now['placed']} | {now['wrong']} ({now['wrong_ok']}) | {now['ambiguous']} | {lengths(now)}{rms} | {lengths(was)} | "
              f"{shares(now)} | {shares(was)} | {'; '.join(found) or '-'} |")
    if options.keep:
        KEPT.write_text(json.dumps({**kept, form: families[-1]}).replace("}, ", "},\n") + "\n")  # a family a line
    return worse


def of(rows, key):
    return [row[key] for row in rows if key in row]


def quantiles(values, at=(0.5, 0.9, 0.95, 1), digits=1):
    values = [v for v in values if np.isfinite(v)]
    return " / ".join(f"{np.quantile(values, q):.{digits}f}" for q in at) if values else "-"


def text_of(row):
    numbers = (("mm", "mm"), ("deg", "deg"), ("rms_mm", "mm RMS"), ("sigma_mm", "mm sigma"))
    return f"{row['status']} {row['code']}" + "".join(f", {row[key]:.1f} {word}" for key, word in numbers if key in row)


def print_sensors(results):
    """Single sensors: the real ones, those without a pose, the wrong ones; and where two programs differ."""
    by_sensor = [{" ".join((row["set"], row["capture"], row["sensor"])): row for row in result["sensors"]} for result in results]
    for number, rows in enumerate(by_sensor, 1):
        print(f"\nProgram {number}: real sensors, sensors without a pose, and wrong ones")
        for name, row in rows.items():
            if row["set"].startswith("real") or not row["placed"] or row.get("wrong"):
                print(f"- {name}: {text_of(row)}")
    if len(results) == 2:
        print("\nWhere status, code or, by 3 mm, the error differs")
        for name, a in by_sensor[0].items():
            b = by_sensor[1].get(name, a)
            if (a["status"], a["code"]) != (b["status"], b["code"]) or not abs(a.get("mm", 0) - b.get("mm", 0)) <= 3:
                print(f"- {name}: {text_of(a)}\n  -> {text_of(b)}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("programs", nargs="+", help="volalign, or two to compare")
    parser.add_argument("--model", type=pathlib.Path, default="models/m05-lite.safetensors")
    parser.add_argument("--parts", default="foreign,real,rendered,physics")
    parser.add_argument("--rigs", type=int, default=40, help="rendered rigs of each kind of sensor")
    parser.add_argument("--rig", nargs="+", default=RIGS, help="rigs of configs/, in turn")
    parser.add_argument("--seed", type=int, default=1000, help="the first one")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("out/accuracy"))
    parser.add_argument("--guard", action="store_true", help="all families, compared with the first program or with the kept table")
    parser.add_argument("--quick", action="store_true", help="with --guard: fewer frames, about 5 minutes")
    parser.add_argument("--keep", action="store_true", help="with --guard: write the kept table anew")
    parser.add_argument("--json", type=pathlib.Path, help="file for the figures of every sensor")
    options = parser.parse_args()
    if options.guard:
        options.parts, options.rigs = "foreign,alone,real,table,places,rendered,physics", 2 if options.quick else 16
    captures = pathlib.Path(os.environ.get("VOLALIGN_CAPTURES") or "../shared/captures").resolve()
    parts = options.parts.split(",")
    if not captures.exists():
        print(f"{captures} does not exist (VOLALIGN_CAPTURES names it): rendered rigs alone", file=sys.stderr)
        parts = [part for part in parts if part in ("rendered", "physics")]
    options.work = options.work.resolve()
    programs = [Program(path, options) for path in options.programs]
    results = [{"sensors": [], "clouds": []} for _ in programs]
    for program, result in zip(programs, results):
        if "foreign" in parts:
            foreign(program, captures, result, (False,) if options.guard and options.quick else (True, False))
        if "alone" in parts:
            alone(program, captures, result)
        if "real" in parts:
            real(program, captures, result)
        if "table" in parts:
            table(program, captures, result)
        if "places" in parts:
            places(program, captures, result, (4,) if options.quick else (1, 2, 4))
        if "rendered" in parts:
            rendered(program, programs[0], result, "sensor")
        if "places" in parts and not options.quick:
            rendered_places(program, programs[0], result, 2)
        if "physics" in parts:
            rendered(program, programs[0], result, "physics")
    for number, path in enumerate(options.programs, 1):
        print(f"Program {number}: {path}")
    worse = guard(results, options)
    print_sensors(results)
    if options.json:
        options.json.write_text(json.dumps({"programs": options.programs, "results": results}, indent=1))
    return options.guard and worse


if __name__ == "__main__":
    sys.exit(main())
