#!/usr/bin/env python3
"""Do the tutorials' commands work, one after the other, exactly as they stand on the page?

    tests/cli/tutorials.py VOLALIGN [TEST]     (VOLALIGN: the program)

A page's commands are its indented lines that begin with the name of a program; a paragraph "`NAME.yaml`:" or "`NAME.json`:" names the block that
follows it. They run in an empty folder, from the state in which the page has its reader. CUT is added to runs of training that would
take hours, SHORTER makes other runs short and leaves out what the page puts into brackets; nothing else is changed. FAILS names the commands that do not end with status 0 here, NOT_RUN those that no test runs, and
why: a command of any page that is neither run nor named there is an error.
"""

import json
import math
import os
import re
import resource
import struct
import textwrap
import time

from program import PROGRAM, ROOT, InAFolder, main

from grey_png import read_png

CUT = "--set run.samples=32 run.validation_samples=8 optim.warmup_samples=16 run.batch_size=8"
SHORTER = [
    (r" \[-[^]]*\]| \[MORE[^]]*\]", ""),
    (r"(--count) \d\d+", r"\1 16"),
    (r"(--seeds \d+):\d+", r"\1"),
    (r"(volalign validate (?!.*--samples).*)", r"\1 --samples 8"),
]
FAILS = {
    # Without a GPU.
    "volalign train --config configs/m05.yaml --device cuda -o runs/m05": (1, "no CUDA device"),
    # The test moves B.
    "volalign check --extrinsics last/extrinsics.json --capture now/capture.json": (3, "B moved"),
}


# Of pages, commands, and why they are not run here. The first that fits counts.
NOT_RUN = [
    (r"", r"^alias volalign=", "run_command does the same"),
    (r"conversion|formats", r"FORMAT|FILE|init FOLDER", "has places to fill in: test_own_rig writes every format, test_readme runs init"),
    (r"install", r"^(\./quickstart\.sh|cmake --install|~/volalign/bin/volalign)", "install/program installs what quickstart.sh builds, and runs it"),
    (r"python", r"", "bindings/python runs the package; a build by pip takes as long as the quick start"),
    (r"", r"^(\./|tests/|packaging/|\.ci/|cmake |ninja |git |/usr/bin/python3 |python3 |apt|build/(?!release/cli)|taskset |venv/)",
     "builds, tests, measures or installs packages, for hours or as root"),
    (r"benchmarks|results|paper", r"", "hours; evaluate, suite and sweeps are tested at toy size by infer/evaluate, train and cli"),
    (r"install", r"build/cuda", "needs a GPU"),
    (r"training", r"--nproc|torchrun|^srun|data\.real", "needs several processes or machines, or calibrations of one's own; train tests them"),
    (r"models/", r"", "how the shipped weights were trained, in days"),
]
PROGRAMS = re.compile(r"(volalign|sed|python3|/usr/bin/python3|cmake|ninja|apt|apt-get|git|alias|taskset|torchrun|srun|pip|docker) |(\./|~/|build/|tests/|venv/|packaging/|\.ci/)\S")
# That a test below runs.
TESTED = ["README.md"] + [f"docs/{name}.md" for name in ("add", "check", "deployment", "known-poses", "meshes", "own-boxes", "own-rig", "sensor-models", "training", "world")]


def all_pages():
    """Names of the pages, which page() reads."""
    docs = sorted(name for name in os.listdir(os.path.join(ROOT, "docs")) if name.endswith(".md") and name != "config.md")
    return [os.path.join("docs", name) for name in docs] + ["README.md", "models/README.md", "CONTRIBUTING.md"]


def page(name):
    with open(os.path.join(ROOT, name), encoding="utf-8") as file:
        return file.read()


def why_not_run(name, command):
    return next((why for where, what, why in NOT_RUN if re.search(where, name) and re.search(what, command)), None)


def steps_of(text):
    """What a page has one do: ("write", file, content) and ("run", command), in its order."""
    steps, name = [], None
    for block in re.split(r"\n\s*\n", text):
        lines = block.strip("\n").replace("\\\n", " ").split("\n")
        if all(line.startswith("    ") for line in lines):
            content = [re.sub(r"^   (?=\S)", "", line[4:]) for line in lines]
            if name:
                steps.append(("write", name, "\n".join(content) + "\n"))
            else:
                steps += [("run", re.sub(r"\s+", " ", re.sub(r"\s# .*", "", line)).strip()) for line in content if PROGRAMS.match(line)]
            name = None
        else:
            named = re.fullmatch(r"`([\w.-]+\.(?:yaml|json))`:", block.strip())
            name = named.group(1) if named else None
    return steps


def write_orbbec_bag(path, depth_png, intrinsics_json):
    """A bag as the Orbbec SDK records one of a Femto Bolt (src/media/ros of OrbbecSDK v2)."""
    def block(data):
        return struct.pack("<I", len(data)) + data

    def record(fields, data):
        return block(b"".join(block(name.encode() + b"=" + value) for name, value in fields)) + block(data)

    def message(number, topic, kind, data):
        connection = ("conn", struct.pack("<I", number))
        about = block(b"type=" + kind.encode())
        return record([("op", b"\x07"), connection, ("topic", topic.encode())], about) + record([("op", b"\x02"), connection], data)

    rows = read_png(depth_png)
    height, width = rows.shape
    with open(intrinsics_json, encoding="utf-8") as file:
        camera = json.load(file)
    k1, k2, p1, p2, k3, k4, k5, k6 = camera["distortion"]
    header = bytes(12) + block(b"")
    image = header + struct.pack("<II", height, width) + block(b"mono16") + struct.pack("<BI", 0, 2 * width) + block(rows.astype("<u2").tobytes())
    image += struct.pack("<f4Q", 0, 1, 2, 3, 4) + block(b"") + struct.pack("<IB", 0, 16)
    profile = header + struct.pack("<BB9f3f3H4f8fB", 3, 1, *[0] * 12, width, height, 30, *(camera[key] for key in ("fx", "fy", "cx", "cy")),
                                   k1, k2, k3, k4, k5, k6, p1, p2, 4)
    content = message(0, "/cam/sensor_3/frameType_3", "sensor_msgs/Image", image)
    content += message(1, "/cam/streamProfileType_3", "custom_msg/StreamProfileInfo", profile)
    content += message(2, "/cam/deviceInfo", "custom_msg/DeviceInfo", header + block(b"Orbbec Femto Bolt"))
    chunk = record([("op", b"\x05"), ("compression", b"none"), ("size", struct.pack("<I", len(content)))], content)
    with open(path, "wb") as file:
        file.write(b"#ROSBAG V2.0\n" + record([("op", b"\x03"), ("index_pos", bytes(8))], b"") + chunk)


class Tutorials(InAFolder):
    def run_command(self, command):
        cut = CUT if command.startswith("volalign train ") and "run.samples=320" not in command else ""
        begin, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        got, output = self.run_line(f'volalign() {{ "{PROGRAM}" "$@" {cut}; }}; {command}')
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        processor = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
        print(f"{time.monotonic() - begin:6.1f} s, {processor:5.1f} s of processor  {command}", flush=True)
        status, said = FAILS.get(command, (0, "")) if got else (0, "")
        self.assertEqual(got, status, f"{command}\n{output}")
        self.assertIn(said, output)
        return output

    def run_page(self, name):
        """All that the page has one do; says what each command printed."""
        printed = {}
        for step in steps_of(page(name)):
            if step[0] == "write":
                self.write(*step[1:])
            elif step[1].startswith("build/release/cli/volalign "):
                printed[step[1]] = self.run_command(step[1].replace("build/release/cli/", "", 1))
            elif not why_not_run(name, step[1]):
                command = step[1]
                for long, short in SHORTER:
                    command = re.sub(long, short, command)
                printed[step[1]] = self.run_command(command)
        self.assertTrue(printed)
        return printed

    def files_of(self, name):
        return {step[1]: step[2] for step in steps_of(page(name)) if step[0] == "write"}

    def expect_ok(self, folder, count):
        sensors = self.json(folder, "extrinsics.json")["sensors"]
        self.assertEqual(len(sensors), count)
        for name, sensor in sensors.items():
            self.assertEqual(sensor["status"], "ok", (folder, name, sensor))
        return sensors

    def expect_files(self, *names):
        for name in names:
            self.assertTrue(os.path.exists(self.path(name)), name)

    def test_every_command_is_run_or_is_named(self):
        for name in all_pages():
            for kind, *command in steps_of(page(name)):
                if kind == "run" and name not in TESTED:
                    self.assertTrue(why_not_run(name, command[0]), f"{name}: {command[0]}")
        for name in TESTED:
            self.assertTrue(any(kind == "run" for kind, *_ in steps_of(page(name))), name)

    def test_readme(self):
        """With the boxes that its first step suggests, seen by rendered sensors."""
        inline = [re.sub(r"\s+", " ", command) for command in re.findall(r"`(?:build/release/cli/)?(volalign [^`]*|build/release/cli/volalign [^`]*)`", page("README.md"))]
        suggest, init = (next(command for command in inline if command.startswith(f"volalign {word} ")) for word in ("structure suggest", "init"))
        self.run_command(suggest)
        self.write("rig.yaml", self.files_of("docs/own-boxes.md")["my_rig.yaml"])
        self.run_command("volalign render --rig rig.yaml -o frames")
        self.run_command(init.replace("FOLDER", "frames") + " --sensor azure_kinect_nfov_binned")
        self.run_page("README.md")
        self.expect_ok("out", 3)
        self.expect_files("out/report.html", "my_boxes.svg")

    def test_own_boxes(self):
        self.run_page("docs/own-boxes.md")
        for sensor in self.expect_ok("rendered_out", 3).values():
            self.assertEqual(sensor["initial_source"], "geometry")
            self.assertLess(sensor["error"]["translation_m"], 0.03)
        self.expect_ok("out", 3)
        # The model began with the shipped weights and has this stack.
        shown = self.run_command("volalign runs list runs")
        self.assertIn("my_boxes", shown)
        self.expect_files("suggested.yaml", "build.svg", "plan.svg", "scores.json", "evaluated/evaluation.json", "rendered_out/report.html")

    def write_recordings(self):
        """Of three Femto Bolts, in recordings/; returns their true poses."""
        self.write("bolts.yaml", self.paper_rig().replace("azure_kinect", "orbbec_femto_bolt"))
        self.run_command("volalign render --rig bolts.yaml -o bolts")
        os.mkdir(os.path.join(self.folder, "recordings"))
        for name in "ABC":
            frame = os.path.join(self.folder, "bolts", name)
            write_orbbec_bag(os.path.join(self.folder, "recordings", f"{name}.bag"), f"{frame}_depth.png", f"{frame}_intrinsics.json")
        with open(os.path.join(self.folder, "bolts/capture.json"), encoding="utf-8") as file:
            return json.load(file)["ground_truth"]

    def paper_rig(self):
        return self.files_of("docs/own-boxes.md")["my_rig.yaml"].replace("my_boxes.yaml", "configs/structure.yaml")

    def test_own_rig(self):
        truth = self.write_recordings()
        printed = self.run_page("docs/own-rig.md")
        self.assertIn("nothing moved", printed["volalign check --extrinsics out/extrinsics.json --capture my_rig.json"])
        self.expect_ok("out", 6)
        self.expect_files("trajectory.json", "unity.json", "out/report.html", "out/clouds/merged.ply", "out/rig.glb", "plan.svg")
        self.assertGreater(len(self.json("studio/out", "extrinsics.json")["placements"]), 2)
        with open(os.path.join(self.folder, "recordings.json"), encoding="utf-8") as file:
            for sensor in json.load(file)["sensors"]:
                self.assertEqual((sensor["sensor"], sensor["depth_scale"]), ("orbbec_femto_bolt", 0.001))
        for name, sensor in self.expect_ok("recordings_out", 3).items():
            error = math.dist(*([row[3] for row in pose[:3]] for pose in (sensor["structure_from_sensor"], truth[name])))
            self.assertLess(error, 0.03)
        formats = re.findall(r"^\| `(\w+)` \|", page("docs/conversion.md").split("## Formats")[1], re.MULTILINE)
        self.assertIn("tum", formats)
        for name in formats:
            if name != "livescan3d_azure":  # it needs what these sensors have not, a colour camera
                self.run_command(f"volalign convert out --to {name} -o converted_{name}")
                self.expect_files(f"converted_{name}")

    def test_check(self):
        rig = self.paper_rig()
        self.write("then.yaml", rig)
        self.write("now.yaml", rig.replace("seed: 1", "seed: 2").replace("rho_cm: 210", "rho_cm: 215"))
        self.run_command("volalign render --rig then.yaml -o then")
        self.run_command("volalign calibrate --capture then/capture.json -o last")
        self.run_command("volalign render --rig now.yaml -o now")
        (printed,) = self.run_page("docs/check.md").values()
        self.assertIn("the other 2 agree", printed)

    def test_add(self):
        rig = self.paper_rig()
        sensors = [line for line in rig.split("\n") if "rho_cm" in line]
        self.write("then.yaml", rig)
        self.write("new.yaml", rig.replace(sensors[2], sensors[2].replace("name: C", "name: D").replace("phi_deg: 270", "phi_deg: 210")))
        self.run_command("volalign render --rig then.yaml -o then")
        self.run_command("volalign calibrate --capture then/capture.json -o last")
        self.run_command("volalign render --rig new.yaml -o new")
        by_tests, by_name = self.run_page("docs/add.md").values()
        self.assertIn("New poses: D. ", by_tests)
        self.assertIn("New poses: B, D. ", by_name)

    def test_known_poses(self):
        self.run_page("docs/known-poses.md")
        for name, sensor in self.expect_ok("out", 4).items():
            self.assertTrue(sensor["prior_used"], name)
            self.assertLess(math.dist(*([row[3] for row in pose[:3]] for pose in (sensor["structure_from_sensor"], sensor["prior"]))), 0.005)

    def test_world(self):
        rendered, calibrated, _ = self.run_page("docs/world.md").values()
        self.assertRegex(calibrated, r"the structure stands at \+1\.(49|50)\d, .* m in robot_base")
        self.expect_files("rig.launch.py")
        base = [[1, 0, 0, 1.5], [0, 0, -1, 0.2], [0, 1, 0, 0.81], [0, 0, 0, 1]]
        for name, sensor in self.expect_ok("out", 4).items():
            x, y, z = (row[3] for row in sensor["structure_from_sensor"][:3])
            expected = [row[0] * x + row[1] * y + row[2] * z + row[3] for row in base[:3]]
            self.assertLess(math.dist([row[3] for row in sensor["world_from_sensor"][:3]], expected), 0.03, name)

    def test_meshes(self):
        said, _, _, built = self.run_page("docs/meshes.md").values()
        self.assertNotIn("looks the same", said)
        self.expect_files("workbench.yaml")
        self.expect_ok("out", 4)
        self.run_command("volalign structure show cell.yaml")

    def test_deployment(self):
        self.run_page("docs/deployment.md")
        self.expect_files("out/m05-lite.onnx")

    def test_sensor_models(self):
        self.run_page("docs/sensor-models.md")
        self.expect_files("samples/contact_sheet.png")

    def test_training(self):
        sweep = next(block for block in re.split(r"\n\s*\n", page("docs/training.md")) if block.startswith("    recipes:"))
        self.write("sweep.yaml", textwrap.dedent(sweep).replace("seeds: [1, 2, 3]", "seeds: [1]"))
        self.run_page("docs/training.md")
        for run in ("m05-lite", "toy", "m03", "a"):
            self.expect_files(f"runs/{run}/model.safetensors")
        self.expect_files("runs/sweep/summary.csv", "out/samples/contact_sheet.png", "samples/contact_sheet.png", "out/report.html", "evaluated/evaluation.json")


if __name__ == "__main__":
    main(__doc__)
