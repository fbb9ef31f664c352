#!/usr/bin/env python3
"""Do the tutorials' commands work, one after the other, as they stand on the page?

    tests/cli/tutorials.py VOLALIGN      (the program)

A page's commands are its indented lines that begin with `volalign` or `sed`; a paragraph "`NAME.yaml`:" names the block that
follows it. They run in a folder that has the repository's configs and models, only smaller: SMALLER says what is replaced.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
PROGRAM = os.path.abspath(sys.argv.pop(1)) if len(sys.argv) > 1 else ""

# Parts of commands and what stands for them here, so that each takes seconds.
SMALLER = (
    ("run.samples=40000", "run.samples=32 --set run.validation_samples=8 --set optim.warmup_samples=16 --set data.image_sizes=[80x72,80x45] "
                          "--set loss.min_side_pixels=5 --set run.batch_size=8"),
    ("--samples 500", "--samples 8"),
    ("run.samples=320", "run.samples=48 --set run.batch_size=8"),
    ("--config configs/m05-lite.yaml -o runs/m05-lite", "--config configs/m05-lite.yaml --set run.samples=16 --set run.validation_samples=8 --set optim.warmup_samples=8 "
                                                         "--set data.image_sizes=[80x72,80x45] --set run.batch_size=8 -o runs/m05-lite"),
    ("configs/m05.yaml --device cuda", "configs/m05.yaml --set run.samples=2 --set run.validation_samples=2 --set optim.warmup_samples=2 --set run.batch_size=2 --set data.image_sizes=[40x36] "
                                       "--set data.sensors=[azure_kinect_nfov_binned]"),
    ("--seeds 1:4", "--seeds 1"),
)


def page(name):
    with open(os.path.join(ROOT, "docs", name), encoding="utf-8") as file:
        return file.read()


def steps_of(text):
    """What a page has one do: ("write", file, content) and ("run", command), in its order."""
    steps, name = [], None
    for block in re.split(r"\n\s*\n", text):
        lines = block.strip("\n").split("\n")
        if all(line.startswith("    ") for line in lines):
            content = [line[4:] for line in lines]
            if name:
                steps.append(("write", name, "\n".join(content) + "\n"))
            else:
                steps += [("run", line) for line in content if re.match(r"(\./build/release/cli/)?volalign |sed ", line)]
            name = None
        else:
            named = re.fullmatch(r"`([\w.-]+\.yaml)`:", block.strip())
            name = named.group(1) if named else None
    return steps


class Tutorials(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="volalign_tutorial_")
        self.addCleanup(shutil.rmtree, self.folder)
        for name in ("configs", "models"):
            os.symlink(os.path.join(ROOT, name), os.path.join(self.folder, name))

    def run_command(self, command):
        command = command.replace("./build/release/cli/volalign ", "volalign ")
        for part, smaller in SMALLER:
            command = command.replace(part, smaller)
        done = subprocess.run(
            ["bash", "-c", f'volalign() {{ "{PROGRAM}" "$@"; }}; {command}'],
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        # What a network after a few steps calls a side may leave a sensor without a pose.
        expected = (0, 2) if " calibrate " in command and "--model runs/" in command else (0,)
        self.assertIn(done.returncode, expected, f"{command}\n{done.stdout}")
        return done.stdout

    def capture_frames(self, source, target):
        """The folder of a user's own frames: those that were rendered, and a file of intrinsics each."""
        os.makedirs(os.path.join(self.folder, target))
        with open(os.path.join(self.folder, source, "capture.json"), encoding="utf-8") as file:
            sensors = json.load(file)["sensors"]
        for sensor in sensors:
            name = os.path.join(self.folder, target, sensor["name"])
            shutil.copy(os.path.join(self.folder, source, sensor["depth"]), name + "_depth.png")
            with open(name + "_intrinsics.json", "w", encoding="utf-8") as file:
                json.dump(sensor["intrinsics"], file)

    def extrinsics(self, folder):
        with open(os.path.join(self.folder, folder, "extrinsics.json"), encoding="utf-8") as file:
            return json.load(file)["sensors"]

    def test_own_boxes(self):
        steps = steps_of(page("own-boxes.md"))
        commands = [step[1].split()[1] for step in steps if step[0] == "run"]
        for verb in ("structure", "plan", "render", "calibrate", "capture", "train", "validate", "evaluate"):
            self.assertIn(verb, commands)
        for step in steps:
            if step[0] == "write":
                with open(os.path.join(self.folder, step[1]), "w", encoding="utf-8") as file:
                    file.write(step[2])
                continue
            if "init captured" in step[1]:
                self.capture_frames("rendered", "captured")
            self.run_command(step[1])
        for folder in ("rendered_out", "out", "rendered_with_model"):
            sensors = self.extrinsics(folder)
            self.assertEqual(sorted(sensors), ["A", "B", "C"])
            for name, sensor in sensors.items():
                if folder != "rendered_with_model":
                    self.assertEqual(sensor["status"], "ok", (folder, name, sensor))
        for sensor in self.extrinsics("rendered_out").values():
            self.assertEqual(sensor["initial_source"], "geometry")
            self.assertLess(sensor["error"]["translation_m"], 0.03)
        # The model began with the shipped weights and has this stack.
        shown = self.run_command("volalign runs list runs")
        self.assertIn("my_boxes", shown)
        for file in ("target.svg", "plan.svg", "scores.json", "evaluated/evaluation.json", "rendered_out/report.html"):
            self.assertTrue(os.path.exists(os.path.join(self.folder, file)), file)

    def test_own_rig(self):
        for step in steps_of(page("own-rig.md")):
            if "init frames" in step[1]:
                self.capture_frames("rendered", "frames")
            output = self.run_command(step[1])
            if step[1].startswith("volalign check"):
                self.assertIn("nothing moved", output)
        sensors = self.extrinsics("out")
        self.assertEqual(len(sensors), 6)
        for name, sensor in sensors.items():
            self.assertEqual(sensor["status"], "ok", (name, sensor))
        for file in ("trajectory.json", "unity.json", "out/report.html", "out/clouds/merged.ply", "out/rig.glb"):
            self.assertTrue(os.path.exists(os.path.join(self.folder, file)), file)

    def test_retrain(self):
        for step in steps_of(page("retrain.md")):
            self.run_command(step[1])
        for file in ("preview/preview.png", "runs.svg", "runs/m05/model.pt", "evaluated/evaluation.json"):
            self.assertTrue(os.path.exists(os.path.join(self.folder, file)), file)

    def test_placements(self):
        steps = [step for step in steps_of(page("placements.md")) if "studio" in step[1]]
        self.assertEqual(len(steps), 2)
        for step in steps:
            self.run_command(step[1])
        with open(os.path.join(self.folder, "studio/out/extrinsics.json"), encoding="utf-8") as file:
            self.assertGreater(len(json.load(file)["placements"]), 2)

    def test_planning(self):
        steps = [step for step in steps_of(page("planning.md")) if step[1].startswith("volalign plan")]
        self.assertTrue(steps)
        for step in steps:
            self.run_command(step[1])


if __name__ == "__main__":
    if not PROGRAM:
        sys.exit(__doc__)
    unittest.main()
