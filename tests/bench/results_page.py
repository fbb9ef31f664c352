#!/usr/bin/env python3
"""Measures the part of docs/results.md between BEGIN and END and writes it, and the accuracy of the README from it.

    tests/bench/results_page.py VOLALIGN [--share 1] [--sections rigs,frames] [--work out/results] [-o docs/results.md]

The whole takes hours; --share 0.2 takes a fifth of the rigs (at least one). What an earlier run left in --work for the same program
(the same bytes) is not measured again, so that the command may be stopped and given again. Frames that are not part of the
repository are read from the folder that VOLALIGN_CAPTURES names; without it the page says that they were not there. Needs NumPy;
runs from the root of the repository.
"""

import argparse
import collections
import hashlib
import json
import os
import pathlib
import subprocess
import sys

import numpy as np

import results_readme
from common import D415, KINECT, ROOT, table
import accuracy

MODEL = "models/m05-lite.safetensors"
RIGS = [f"configs/rig_{name}.yaml" for name in ("ring8", "arc8", "ring4", "irregular")]
STATUSES = ["ok", "weak", "failed"]
BEGIN, END = "<!-- measured: written by tests/bench/results_page.py -->\n", "<!-- end of measured -->\n"

# Name, keys of --set-rig, keys of --set; what the page says of them, if not just these.
SITUATIONS = [
    ("lens stated", [], [], ""),
    ("lens not stated", ["state_lens=false"], [], None),
    ("devices vary by 0.1 %", ["state_lens=false", "lens_spread_percent=0.1"], [], "also `lens_spread_percent=0.1`"),
    ("devices vary by 1 %", ["state_lens=false", "lens_spread_percent=1"], [], None),
    ("one lens for each sensor", ["state_lens=false", "lens_spread_percent=1"], ["refine.lens_per_sensor=true"], "also `--set refine.lens_per_sensor=true`"),
    ("nothing estimated", ["state_lens=false"], ["refine.estimate=none"], None),
    ("boxes in place", ["assembly.position_mm=0"], [], None),
    ("nothing estimated", ["assembly.position_mm=0"], ["refine.estimate=none"], "also `--set refine.estimate=none`"),
    ("only the stack in view", ["room=false"], [], None),
]


class Page:
    """Runs commands, keeps what they measured, and gathers the text."""

    def __init__(self, options):
        self.options, self.program = options, options.program
        digest = hashlib.sha256(pathlib.Path(self.program).read_bytes()).hexdigest()[:12]
        self.work = options.work / digest
        self.work.mkdir(parents=True, exist_ok=True)
        self.text = []

    def count(self, most):
        """How many of the rigs of a section are taken."""
        return max(1, round(most * self.options.share))

    def seeds(self, first, most):
        return f"{first}:{first + self.count(most)}"

    def run(self, name, command):
        """What the command prints; kept as NAME.txt."""
        kept = self.work / f"{name}.txt"
        if not kept.exists():
            print(" ".join(map(str, command)), file=sys.stderr, flush=True)
            done = subprocess.run([str(part) for part in command], stdout=subprocess.PIPE, text=True)
            if done.returncode not in (0, 2):
                sys.exit(f"{command[0]} failed: {' '.join(map(str, command))}")
            kept.write_text(done.stdout)
        return kept.read_text()

    def evaluate(self, name, *arguments):
        """(summaries, cases) of `volalign evaluate`."""
        folder = self.work / name
        self.run(name, [self.program, "evaluate", "--model", MODEL, *arguments, "-o", folder])
        result = json.loads((folder / "evaluation.json").read_text())
        return result["summary"], result["cases"]

    def add(self, text):
        self.text.append(text.strip("\n"))

    def command(self, *lines):
        self.add("\n".join("    " + line for line in lines))

    def table(self, head, rows):
        self.add(table(head, rows))


def position(summary, key):
    """Median / 95th percentile / largest, mm."""
    return " / ".join(f"{summary[f'{key}_mm'][part]:.1f}" for part in ("median", "p95", "max")) if summary["measured"] else "-"


def errors(summary, key):
    """The position's, and median / 95th percentile of the angle, deg."""
    return [position(summary, key), " / ".join(f"{summary[f'{key}_deg'][part]:.2f}" for part in ("median", "p95")) if summary["measured"] else "-"]


def covered(summary):
    """Percent of the error components within the 68 and the 95 % intervals."""
    return f"{100 * summary['cover_68']:.0f}, {100 * summary['cover_95']:.0f}"


def of_kind(summary, kind):
    return next(row for row in summary if row["sensor_model"] == kind)


def statuses(cases):
    """How many sensors have which status and code: "48 ok, 16 weak (14 uncertain, 2 disagrees)"."""
    found = {status: collections.Counter() for status in STATUSES}
    for case in cases:
        for sensor in case["sensors"]:
            found[sensor["status"]][sensor.get("code", "")] += 1
    parts = []
    for status, codes in found.items():
        if codes:
            named = ", ".join(f"{count} `{code}`" for code, count in codes.most_common() if code)
            parts.append(f"{sum(codes.values())} {status}" + (f" ({named})" if named else ""))
    return ", ".join(parts)


def culprits(cases):
    """Sensors that were lost or placed wrongly, as a list."""
    lines = []
    for case in cases:
        for sensor in case["sensors"]:
            error = sensor.get("error", {}).get("refined")
            wrong = error and (error["translation_m"] > 0.1 or error["rotation_deg"] > 5)
            lost = sensor["status"] == "failed" and sensor.get("sides_fix_pose")
            if wrong or lost:
                what = f"{1000 * error['translation_m']:.0f} mm and {error['rotation_deg']:.1f} deg off" if wrong else "lost"
                lines.append(f"- {case['rig']}, {case['sensor_model']}, seed {case['seed']}, sensor {sensor['name']}: "
                             f"`{sensor['status']}`" + (f" (`{sensor['code']}`)" if "code" in sensor else "") + f", {what}")
    return lines


def rendered_rigs(page):
    seeds = page.seeds(1000, 20)
    summary, cases = page.evaluate("rigs", "--rigs", *RIGS, "--sensors", KINECT, D415, "--seeds", seeds, "--set-rig", "assembly.position_mm=3")
    sensors = sum(len(case["sensors"]) for case in cases)
    page.add("## Rendered rigs")
    page.command(f"volalign evaluate --model {MODEL} --rigs {' '.join(RIGS[:3])} \\", f"  {RIGS[3]} --sensors {KINECT} {D415} \\",
                 f"  --seeds {seeds} --set-rig assembly.position_mm=3 -o out/eval")
    page.add(f"""
{sensors} sensors in {len(cases)} rigs, in furnished rooms, with sensor noise and the Azure Kinect's lens; boxes 3 mm off (standard deviation along each axis). Refined poses:""")
    by_rig = {}
    for row in summary:
        by_rig.setdefault(row["rig"], []).append(row)
    page.table(["rig", "Azure Kinect, mm", "deg", "D415, mm", "deg"],
               [[rig, *errors(of_kind(rows, KINECT), "refined"), *errors(of_kind(rows, D415), "refined")] for rig, rows in by_rig.items() if not rig.startswith("all")])
    page.add("All rigs:")
    page.table(["sensors", "placed", "weak", "lost", "wrong", "initial, mm", "refined, mm", "deg", "68, 95 %"],
               [[s["sensor_model"], f"{s['placed']} of {s['sensors']}", str(s["weak"]), str(s["lost"]), str(s["wrong"]), position(s, "initial"), *errors(s, "refined"), covered(s)]
                for s in summary if s["rig"].startswith("all")])
    if culprits(cases):
        page.add("Lost or wrong:")
        page.add("\n".join(culprits(cases)))
    uncertainty(page, cases)
    what_limits(page)


def uncertainty(page, cases):
    ratios = np.array([np.array(sensor["error"]["delta"]) / np.array(sensor["sigma"]) for case in cases for sensor in case["sensors"]
                       if "error" in sensor])
    page.add("### Uncertainty")
    page.add("""
Percent of each error component within the stated standard deviations. Some of the seeds were also used to choose constants of the noise model.""")
    rows = [[name, *(", ".join(f"{100 * (abs(ratios[:, k]) < sigmas).mean():.0f}" for k in columns) + " %" for columns in ((0, 1, 2), (3, 4, 5)))]
            for name, sigmas in (("one sigma (normal: 68 %)", 1), ("two (normal: 95 %)", 2))]
    page.table(["within", "position x, y (up), z", "rotation about x, y, z"], rows)


def what_limits(page):
    page.add("""
### What limits accuracy

Depth errors of the [sensor models](sensor-models.md) do. At 2 m the smooth warp is about 15 mm (D415) or 1.4 to 5.6 mm (Kinect). A constant and multipath come to it. A
rotation error of 0.1 deg moves a sensor at 2 m by 3.5 mm. Boxes that are 3 mm off move the frame by 1.5 mm along each axis.""")


def estimates(page):
    seeds = page.seeds(1000, 4)
    page.add("### Estimating more than poses")
    page.command(f"volalign evaluate ... --seeds {seeds} --compare refine.estimate=none,auto -o out/estimate")
    page.add("""
The same rigs, and rigs with worse boxes (`--set-rig assembly.position_mm=5 assembly.yaw_deg=0.5 assembly.size_scale_percent=1`). Refined poses:""")
    rows = []
    for name, words, changes in (("3mm", "3 mm", ["assembly.position_mm=3"]),
                                 ("5mm", "5 mm, 0.5 deg, 1 %", ["assembly.position_mm=5", "assembly.yaw_deg=0.5", "assembly.size_scale_percent=1"])):
        summary, _ = page.evaluate(f"estimates_{name}", "--rigs", *RIGS, "--sensors", KINECT, D415, "--seeds", seeds, "--set-rig", *changes,
                                   "--compare", "refine.estimate=none,auto")
        for variant in ("none", "auto"):
            whole = [s for s in summary if s["rig"].startswith("all") and s["variant"] == variant]
            rows.append([words, variant, *(position(of_kind(whole, kind), "refined") for kind in (KINECT, D415))])
    page.table(["boxes off by", "estimated", "Azure Kinect, mm", "D415, mm"], rows)


def other_frames(page):
    page.add("## Frames that volalign did not render")
    captures = pathlib.Path(os.environ.get("VOLALIGN_CAPTURES") or "../shared/captures")
    if not captures.exists():
        page.add("These frames were not there when this page was made (VOLALIGN_CAPTURES names their folder).")
        return
    result = page.work / "captures.json"
    page.run("captures", [sys.executable, "tests/accuracy.py", page.program, "--parts", "foreign,real", "--work", page.work / "accuracy", "--json", result])
    result = json.loads(result.read_text())["results"][0]
    page.command("VOLALIGN_CAPTURES=FOLDER tests/accuracy.py build/release/cli/volalign --parts foreign,real")
    page.add("""
- `foreign`: rigs of another simulator, compared with the true poses after the best rigid motion.
- `real`: four Azure Kinects, a D415 (both of VCL3D/StructureNet), and cartons on a pallet. Their true poses are not known. They may not be shipped.
- *RMS*: of points to the structure, and between two sensors: median / largest.""")
    rows = []
    for name in dict.fromkeys(row["set"] for row in result["sensors"]):
        sensors = [row for row in result["sensors"] if row["set"] == name]
        right = [row for row in sensors if not row.get("wrong")]
        clouds = accuracy.of([row for row in result["clouds"] if row["set"] == name], "rms_mm")
        some = accuracy.of(right, "mm")
        rows.append([name, f"{sum(accuracy.of(sensors, 'placed'))} of {len(sensors)}", str(sum(row["status"] == "weak" for row in sensors)),
                     str(sum(accuracy.of(sensors, "wrong"))) if some else "-", accuracy.quantiles(some, (0.5, 0.95, 1)),
                     accuracy.quantiles(accuracy.of(right, "deg"), (0.5, 0.95), 2), accuracy.quantiles(accuracy.of(right, "rms_mm"), (0.5, 1)),
                     accuracy.quantiles(clouds, (0.5, 1))])
    page.table(["frames", "placed", "weak", "wrong", "position, mm", "rotation, deg", "to the structure, mm RMS", "between sensors, mm RMS"], rows)
    page.add("""
The intrinsics of the real frames are those of another device of the same kind.""")


def situations(page):
    seeds = page.seeds(2000, 4)
    page.add("## Situations of real rigs")
    page.command(f"volalign evaluate --model {MODEL} --rigs configs/rig_irregular.yaml configs/rig_arc8.yaml \\",
                 f"  --sensors {KINECT} --seeds {seeds} [--set-rig ...] [--set ...] -o out/rows")
    page.add("""
Azure Kinects with their lens, boxes 3 mm off. *Set*: by `--set-rig`, or by `--set` if it is named; *also*: beside the row above. No constant was chosen on these seeds.""")
    rows = []
    for number, (name, rig, options, words) in enumerate(SITUATIONS, 1):
        arguments = ["--rigs", "configs/rig_irregular.yaml", "configs/rig_arc8.yaml", "--sensors", KINECT, "--seeds", seeds, "--set-rig", "assembly.position_mm=3", *rig]
        summary, cases = page.evaluate(f"situation_{number}", *arguments, *(["--set", *options] if options else []))
        if words is None:
            words = ", ".join([f"`{' '.join(rig)}`"] * bool(rig) + [f"`--set {option}`" for option in options])
        rows.append([name, words, position(summary[-1], "refined"), covered(summary[-1]), statuses(cases)])
    page.table(["situation", "set", "mm", "68, 95 %", "status"], rows)
    page.add("""
If only the stack is in view, up and down look alike. If devices of one kind may differ by a percent, state the intrinsics of each device or set `refine.lens_per_sensor`.""")


def placements(page):
    seeds = page.seeds(3000, 6)
    page.add("## Several placements")
    page.command(f"volalign evaluate --model {MODEL} --rigs configs/rig_irregular.yaml --seeds {seeds} --placements 1 2 4 6 -o out/placements")
    page.add("""
The stack was built up again for each placement, within 0.8 m of the first one, with boxes 3 mm off. No constant was chosen on these seeds. Refined poses in the frame of
the first placement, by kind (`--sensors`):""")
    rows = {}
    for kind in (KINECT, D415):
        summary, _ = page.evaluate(f"placements_{kind}", "--rigs", "configs/rig_irregular.yaml", "--sensors", kind, "--seeds", seeds, "--placements", 1, 2, 4, 6,
                                   "--set-rig", "assembly.position_mm=3")
        for s in summary:
            if s["rig"] == "irregular":
                number = str(s.get("placements", 1))
                rows.setdefault(number, [number]).extend([*errors(s, "refined"), covered(s)])
    page.table(["placements", "Azure Kinect, mm", "deg", "68, 95 %", "D415, mm", "deg", "68, 95 %"], rows.values())
    page.add("""
The boxes of the first placement fix the frame. More placements do not reduce their error.""")


def without_model(page):
    stacks = page.count(50)
    page.add("## Without a model")
    page.command(f"tests/bench/any_boxes.py build/release/cli/volalign out/boxes --sensors {KINECT} {D415} kinect_v2 kinect_v1 \\",
                 f"  --first 5000 --stacks {stacks}")
    page.add(f"""
A ring of four sensors in a furnished room sees {stacks} random stacks of two to eight boxes. Half of the boxes are turned by any angle, all are 3 mm off. A sensor *sees enough* if it sees two
boxes and some floor. Errors are those of sensors that are not wrong.""")
    kinds = [KINECT, D415, "kinect_v2", "kinect_v1"]
    printed = page.run("boxes", [sys.executable, "tests/bench/any_boxes.py", page.program, page.work / "boxes", "--sensors", *kinds, "--first", 5000,
                                 "--stacks", stacks])
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in printed.splitlines() if line.startswith("| ")]
    page.table(["sensors", "placed of those that see enough", "wrong", "initial, mm", "refined, mm"],
               [[kind, enough, str(int(ok) + int(weak)), initial, refined] for kind, enough, _, ok, weak, initial, refined, _ in rows if kind in kinds])
    page.add("\n".join(line for line in printed.splitlines() if line.startswith("- ")))
    empty = page.run("empty", [sys.executable, "tests/bench/any_boxes.py", page.program, page.work / "empty", "--sensors", KINECT, D415, "--first", 6000,
                               "--stacks", page.count(20), "--empty"])
    found = collections.Counter()
    for path in (page.work / "empty").glob("*_empty/out/extrinsics.json"):
        for sensor in json.loads(path.read_text())["sensors"].values():
            found[sensor["status"]] += 1
    page.add(f"In {page.count(20)} rooms without the stack (`--empty`, first two kinds, from 6000): "
             + ", ".join(f"{found[status]} `{status}`" for status in STATUSES) + ".")
    page.add("\n".join(line for line in empty.splitlines() if line.startswith("- ")))


SECTIONS = {"rigs": rendered_rigs, "estimates": estimates, "frames": other_frames, "situations": situations,
            "placements": placements, "boxes": without_model}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("program")
    parser.add_argument("--share", type=float, default=1, help="of the rigs of each section; 1: all")
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("out/results"))
    parser.add_argument("-o", "--output", type=pathlib.Path, default=ROOT / "docs/results.md")
    parser.add_argument("--sections", default=",".join(SECTIONS), help="those to take, with commas; all: %(default)s")
    options = parser.parse_args()
    names = options.sections.split(",")
    if set(names) - set(SECTIONS):
        sys.exit(f"no section is called {', '.join(sorted(set(names) - set(SECTIONS)))}; they are {', '.join(SECTIONS)}")
    page = Page(options)
    version = subprocess.run([options.program, "--version"], capture_output=True, text=True, check=True).stdout.split("\n")[0].strip()
    share = "" if options.share == 1 else f" --share {options.share:g}"
    if names != list(SECTIONS):
        share += f" --sections {options.sections}"
    page.add(f"""
The sections from here to *Without a model* are measured and written by one command. Every number is of `{version}`
with `{MODEL}` ([model card](../models/README.md)).""" +
             ("" if options.share == 1 else f""" A share of {options.share:g} of the rigs of each section was taken.
Medians of so few sensors vary by a tenth or more, and the largest errors by much more."""))
    page.command(f"tests/bench/results_page.py build/release/cli/volalign{share}")
    for name in names:
        SECTIONS[name](page)
    old = options.output.read_text() if options.output.exists() else BEGIN + END
    measured = "\n\n".join(part for part in page.text if part)
    options.output.write_text(f"{old.split(BEGIN)[0]}{BEGIN}\n{measured}\n\n{END}{old.split(END)[1]}")
    if options.output.resolve() == ROOT / "docs/results.md" and names == list(SECTIONS):
        results_readme.main()


if __name__ == "__main__":
    main()
