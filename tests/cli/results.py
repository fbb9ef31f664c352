#!/usr/bin/env python3
"""What commands leave behind: results, refusals in one line, and nothing half-written where they are stopped.

    tests/cli/results.py VOLALIGN [CLASS]      (the program)
"""

import fcntl
import json
import math
import os
import random
import re
import resource
import shutil
import signal
import time

import numpy

from program import ROOT, TWO_SENSORS, InAFolder, main

from grey_png import read_png, write_png

os.environ.setdefault("SOURCE_DATE_EPOCH", "1764000000")  # files that are compared have one date
MODEL = "--model models/m05-lite.safetensors "
# Three times the error without noise that was measured (0.26 mm, and 0.008 deg). Half a pixel is 4 mm at 2 m.
EXACT_M, EXACT_DEG = 0.0007, 0.035


def positions(pose):
    return [row[3] for row in pose[:3]]


class WithACapture(InAFolder):
    def capture(self):
        """A small noise-free capture of two sensors."""
        self.write("rig.yaml", TWO_SENSORS)
        self.expect("render --rig rig.yaml -o capture", 0)
        return self.json("capture/capture.json")


class Results(WithACapture):
    def test_calibrates_a_capture_from_files(self):
        truth = self.capture()["ground_truth"]
        output = self.expect(f"calibrate --capture capture/capture.json {MODEL} --set refine.max_overlap_points=3999 -o out", 0, "options.yaml")
        sensors = self.json("out/extrinsics.json")["sensors"]
        self.assertEqual(sorted(sensors), ["A", "B"], output)
        for name, sensor in sensors.items():
            # Against what the renderer wrote, without the program's own comparison.
            self.assertLess(math.dist(positions(sensor["structure_from_sensor"]), positions(truth[name])), EXACT_M, name)
            self.assertLess(sensor["error"]["translation_m"], EXACT_M, name)
            self.assertLess(sensor["error"]["rotation_deg"], EXACT_DEG, name)
            # As many pixels are labelled as the file says, all with confidence.
            labels, confidences = (read_png(self.path("out", kind, name + ".png")) for kind in ("labels", "confidence"))
            self.assertEqual((labels > 0).sum(), sensor["points"], name)
            self.assertTrue(confidences[labels > 0].all(), name)
        self.assertIn("--set refine.max_overlap_points=3999 -o ", self.read("out/report.html"))
        # The resolved options, which --config reads again.
        self.assertEqual(self.expect("config show out/options.yaml", 0, "max_overlap_points: 3999"), self.read("out/options.yaml"))

    def test_known_poses_of_another_program(self):
        capture = self.capture()
        truth = capture["ground_truth"]
        # A world in centimetres, whose axes are the structure's in another order.
        turned = numpy.array([[0, 0, 1, 250], [1, 0, 0, -40], [0, 1, 0, 90], [0, 0, 0, 1]])
        for sensor in capture["sensors"]:
            pose = numpy.array(truth[sensor["name"]])
            pose[:3, 3] *= 100
            sensor["prior"] = {"world_from_sensor": (turned @ pose).tolist(), "scale": "free", "sigma_m": 0.05, "sigma_deg": 3}
        self.write("capture/known.json", json.dumps(capture))
        self.expect(f"calibrate --capture capture/known.json {MODEL} -o out", 0)
        self.assertNotIn("prior", self.json("out/extrinsics.json")["sensors"]["A"], "two sensors do not tell a scale")
        for sensor in capture["sensors"]:
            sensor["prior"] = {"structure_from_sensor": truth[sensor["name"]], "sigma_m": 0.05, "sigma_deg": 3}
        capture["sensors"][1]["prior"]["structure_from_sensor"][0][3] += 1
        self.write("capture/known.json", json.dumps(capture))
        self.expect(f"calibrate --capture capture/known.json {MODEL} -o out", 0, "the prior of B is 1.00 m")
        result = self.json("out/extrinsics.json")
        self.assertEqual([result["sensors"][name]["prior_used"] for name in "AB"], [True, False])
        self.assertEqual([(finding["code"], finding["about"]) for finding in result["findings"]], [("prior_off", ["B"])])
        # The result serves as a prior, through other formats, too.
        self.expect("convert out --to tum -o known.tum", 0)
        self.write("known.tum", "".join(line for line in self.read("known.tum").splitlines(True) if line[0] != "#"))
        given = f"calibrate --capture capture/capture.json {MODEL} -o again --prior-sigma 0.002,0.1 --prior"
        self.expect(f"{given} out/extrinsics.json", 0)
        self.assertTrue(self.json("again/extrinsics.json")["sensors"]["A"]["prior_used"])
        self.expect_error(f"{given} known.tum --prior-from tum", "known.tum", "none is a sensor of the capture")
        self.expect_error(f"{given} known.tum --prior-from nothing", "nothing", "tum")
        self.expect_error(given.replace("0.002", "0") + " out/extrinsics.json", "standard deviation")

    def test_calibrates_captures_of_several_placements(self):
        sensor = "sensor: azure_kinect_nfov_binned, rho_cm: 200, height_cm: 60, roll_deg: 90"
        self.write("rig.yaml", f"room: false\nnoise: none\nsensors: [{{name: A, phi_deg: 30, {sensor}}}, {{name: B, phi_deg: 100, {sensor}}}]\n"
                   "placements: [{x_cm: 30, z_cm: -20, yaw_deg: 60}]\n")
        first, second = (f"stills/placement_{i}/capture.json" for i in (1, 2))
        self.expect("render --rig rig.yaml -o stills", 0, first, second)
        self.assertFalse(os.path.exists(self.path("stills/capture.json")))
        self.expect(f"calibrate --capture {first} {second} {MODEL} -o out", 0, "in placement_2: the stack stood +0.3")
        extrinsics = self.json("out/extrinsics.json")
        self.assertEqual(len(extrinsics["capture"]), 2)
        placement = extrinsics["placements"][1]
        self.assertEqual((placement["name"], placement["sensors"]), ("placement_2", ["A", "B"]))
        for name in "AB":
            self.assertLess(extrinsics["sensors"][name]["error"]["translation_m"], 0.0015)  # 0.5 mm
            self.assertTrue(os.path.exists(self.path(f"out/labels/placement_2/{name}.png")))
        # The same picture twice is no second placement.
        self.expect(f"calibrate --capture {first} {first} {MODEL} -o twice", 1, "same depth map")

    def test_a_sensor_that_fails_gives_status_2(self):
        self.capture()
        write_png(self.path("capture/B_depth.png"), [[0] * 320] * 180)
        output = self.expect(f"calibrate --no-report --capture capture/capture.json {MODEL} -o out", 2)
        for name in ("report.html", "rig.glb"):
            self.assertFalse(os.path.exists(self.path("out", name)))
        sensors = self.json("out/extrinsics.json")["sensors"]
        self.assertEqual(sensors["A"]["status"], "ok")
        self.assertLess(sensors["A"]["error"]["translation_m"], EXACT_M)
        self.assertEqual((sensors["B"]["status"], sensors["B"]["code"]), ("failed", "no_depth"))
        self.assertNotIn("structure_from_sensor", sensors["B"])
        self.assertIn(sensors["B"]["reason"], output)

    def test_bad_captures_and_models(self):
        good = self.capture()
        stack = self.read(ROOT, "configs", "structure.yaml")

        def refused(*parts, capture="capture/capture.json", model="models/m05-lite.safetensors"):
            self.expect_error(f"calibrate --capture {capture} --model {model} -o out", *parts)
            self.assertFalse(os.path.exists(self.path("out/extrinsics.json")))

        def changed(sensor, change, *parts):
            bad = json.loads(json.dumps(good))
            change(bad["sensors"][sensor])
            self.write("capture/capture.json", json.dumps(bad))
            refused(*parts)

        refused("nowhere.json", "No such file", "capture.json", capture="nowhere.json")
        refused("is a folder", "capture.json", capture="capture")
        self.write("taken", "x")
        self.expect_error(f"calibrate --capture capture/capture.json {MODEL} -o taken", "taken", "choose another")
        refused("no.pt", "No such file", model="no.pt")
        self.write("bad.pt", self.read(ROOT, "models", "m05-lite.safetensors", mode="rb")[:100000])
        refused("bad.pt", model="bad.pt")
        changed(0, lambda sensor: sensor.update(depth="gone.png"), '"A"', "gone.png", "relative to the capture's folder")
        changed(1, lambda sensor: sensor.update(depth="contact_sheet.png"), 'sensor "B"', "is it the colour picture?")
        self.write("capture/capture.json", json.dumps(good))
        # A checkpoint of another structure: the capture's has one box more.
        last = "  - {name: top, "
        self.write("capture/structure.yaml", stack[: stack.index("labels:")].replace(last, "  - {name: extra, x: [-280, 50], y: [810, 1215], z: [-165, 165]}\n" + last))
        refused("structure")

    def test_evaluates_rigs_and_captures(self):
        self.capture()
        command = (f"evaluate {MODEL} --rigs rig.yaml --sensors azure_kinect_nfov_binned realsense_d415 --seeds 5:7 --captures capture/capture.json"
                   " --compare refine.box_sigma_deg=0.5,0.6 -o eval")
        self.expect(command, 0, "azure_kinect_nfov_binned", "initial mm", "capture/capture.json  A       ok")
        evaluation = self.json("eval/evaluation.json")
        # Two seeds of two sensor models, and the capture, under two variants each.
        self.assertEqual([len(case["sensors"]) for case in evaluation["cases"]], [2] * 10)
        for sensor in (sensor for case in evaluation["cases"] for sensor in case["sensors"]):
            # Depths are exact but for their millimetres, silhouettes but for a part of a pixel, which
            # tilts and bulges of the depth may make good: at most 3.3 mm and 0.092 deg were measured.
            self.assertLess(sensor["error"]["refined"]["translation_m"], 0.004, sensor)
            self.assertLess(sensor["error"]["refined"]["rotation_deg"], 0.11, sensor)
        again = self.expect(command, 0, "[5/5]")
        self.assertEqual(again.count("(done before)"), 5, again)
        self.assertEqual(self.json("eval/evaluation.json"), evaluation)

    def test_a_suite_says_which_models_it_has_not(self):
        methods = ("datasets: [{name: none}]\ntables: [{name: one, rows: [{label: a, method: a}]}]\n"
                   "methods: [{name: a, model: nowhere/a.pt}, {name: b, model: ")
        self.write("none.yaml", methods + "nowhere/b.pt}]\n")
        self.write("some.yaml", methods + os.path.join(ROOT, "models", "m05-lite.safetensors") + "}]\n")
        suite = "evaluate --suite all -o suite --suite-config "
        self.expect_error(suite + "none.yaml", "a (", "nowhere/a.pt", "data folder")
        self.expect(suite + "some.yaml", 2, "nowhere/a.pt")

    def test_check_finds_what_moved_and_updates_it(self):
        # B is moved by 30, 40 and 0 mm and turned by 2 deg, and the stack is built up elsewhere.
        sensors = (("A", 30, 100), ("B", 150, 120), ("C", 270, 110))
        self.write("rig.yaml", "room: false\nnoise: none\nsensors:\n" + "".join(
            f"  - {{name: {name}, sensor: azure_kinect_nfov_binned, rho_cm: 200, phi_deg: {phi}, height_cm: {height}}}\n" for name, phi, height in sensors)
            + "placements: [{x_cm: 30, z_cm: -20, yaw_deg: 60, moved: [{sensor: B, translation_mm: [30, 40, 0], rotation_deg: [0, 2, 0]}]}]\n")
        self.expect("render --rig rig.yaml -o stills", 0)
        self.expect(f"calibrate --capture stills/placement_1/capture.json {MODEL} -o last", 0)
        check = f"check --capture stills/placement_2/capture.json {MODEL} --extrinsics "
        self.expect(check + "last/extrinsics.json -o now", 3, "; the other 2 agree within ", "the stack stands 36")
        found = self.json("now/check.json")["sensors"]
        self.assertEqual([(s["name"], s["movement"]) for s in found], [("A", "stayed"), ("B", "moved"), ("C", "stayed")])
        self.assertAlmostEqual(found[1]["translation_m"], 0.05, delta=0.01)
        self.assertAlmostEqual(found[1]["rotation_deg"], 2, delta=0.2)
        self.assertTrue(self.read("now/extrinsics.json"))
        self.expect_error(check + "last/extrinsics.json --update updated.json", "volalign add")
        self.expect(check.replace("check", "add", 1) + "last/extrinsics.json -o updated.json", 0, "New poses: B. ", "poses kept: A, C")
        self.expect(check + "updated.json", 0, "nothing moved: all 3 agree")
        # Of other boxes, and neither the capture nor an option names any: the model's do not stand in for them.
        last, capture = self.json("last/extrinsics.json"), self.json("stills/placement_2/capture.json")
        last["structure"] = {**last["structure"], "name": "my boxes", "sha256": "0" * 64}
        capture.pop("structure", None)
        self.write("last/extrinsics.json", json.dumps(last))
        self.write("stills/placement_2/capture.json", json.dumps(capture))
        self.expect_error(check + "last/extrinsics.json", "my boxes", "--structure")

    def test_plan_names_a_sensor_that_sees_nothing(self):
        self.write("blind.yaml", "sensors: [{name: D, rho_cm: 200, look_at_cm: [900, 0, 0]}]\n")
        self.expect("plan blind.yaml --trials 1", 2, "D: it sees no side of the stack")

    def test_trains_on_a_dataset_without_a_renderer(self):
        """A node that has no EGL driver at all trains and validates on folders."""
        small = (" --config configs/m05-lite.yaml --set data.sensors=[azure_kinect_nfov_binned] data.image_sizes=[40x36] data.renderer=egl run.batch_size=2")
        for name, seed in (("train", 1), ("valid", 1000001)):
            self.expect(f"render{small} -o {name} --count 4 --seed {seed}", 0)
        train = (f"train{small} model.base_channels=2 run.samples=6 run.threads=1 optim.warmup_samples=2 run.validation_samples=4 run.dataset={self.path('train')}")
        blind = {"__EGL_VENDOR_LIBRARY_FILENAMES": self.path("none.json")}
        self.expect_error(train + " -o run", "run.validation_dataset", "run.validation_samples=0", **blind)
        self.expect(f"{train} run.validation_dataset={self.path('valid')} -o run", 0, **blind)
        self.assertEqual(json.loads(self.read("run/metrics.jsonl").splitlines()[-1])["samples"], 6)
        self.assertTrue(os.path.exists(self.path("run/model.safetensors")))

    def test_a_run_holds_what_it_is_trained_on_and_how_each_start_was_called(self):
        for source, copy in (("structure", "stack"), ("intrinsics", "pool")):
            shutil.copy(os.path.join(ROOT, "configs", f"{source}.yaml"), self.path(f"{copy}.yaml"))
        train = ("train --config configs/m01.yaml --set data.structure=stack.yaml data.intrinsics=pool.yaml data.image_sizes=[32x18] data.renderer=cpu model.base_channels=1"
                 " run.batch_size=2 run.validation_samples=0 run.checkpoint_every=2 -o run")
        killed = self.start(train)
        while not os.path.exists(self.path("run/states/000000000002.state")):
            time.sleep(0.01)
        killed.kill()
        killed.wait()
        self.assertIn("run.validation_samples=0", self.read("run/command.yaml"))
        for kept, source in (("structure", "structure"), ("intrinsics", "intrinsics")):
            self.assertEqual(self.read(f"run/{kept}.yaml"), self.read(ROOT, "configs", f"{source}.yaml"))
        self.assertNotIn("threads: 0", self.read("run/config.yaml"), "how many were chosen")
        # The files are gone; the run has copies.
        os.remove(self.path("stack.yaml"))
        os.remove(self.path("pool.yaml"))
        self.expect(train + " --resume --set run.samples=3000", 0, "stack.yaml is not there", "pool.yaml is not there")
        self.assertIn("run.samples=3000", self.read("run/command-2.yaml"))
        self.assertNotIn("run.samples=3000", self.read("run/command.yaml"))
        # The checkpoint has what its recipe's samples need, wherever it lies.
        shutil.copy(self.path("run/model.safetensors"), self.path("alone.safetensors"))
        for model in ("run/model", "alone"):
            self.expect(f"validate --samples 2 --model {model}.safetensors", 0)
        for asked in ("data.intrinsics=pool.yaml", "'data={intrinsics: pool.yaml}'"):
            self.expect_error(f"validate --samples 2 --model alone.safetensors --set {asked}", "pool.yaml")
        # So has another run of the same recipe.
        self.expect("train --config run/config.yaml --set run.samples=2 -o other", 0)

    def test_train_waits_passively_unless_told_otherwise(self):
        def spin_counts(**policy):
            """GOMP_SPINCOUNT of each start of `train`, as libgomp says it."""
            environment = {key: value for key, value in os.environ.items() if key not in ("OMP_WAIT_POLICY", "OPENBLAS_NUM_THREADS")}
            status, output = self.run_line("volalign train --config no_such_file.yaml -o no_such_run", env={**environment, "OMP_DISPLAY_ENV": "verbose", **policy})
            self.assertEqual(status, 1)
            self.assertIn("error: cannot read no_such_file.yaml", output)
            return re.findall(r"GOMP_SPINCOUNT = '(\d+)'", output)

        first, again = spin_counts()  # it starts itself again
        self.assertNotEqual(first, "0")
        self.assertEqual(again, "0")
        self.assertNotIn("0", spin_counts(OMP_WAIT_POLICY="ACTIVE"))
        self.assertEqual(len(spin_counts(OMP_WAIT_POLICY="ACTIVE", OPENBLAS_NUM_THREADS="2")), 1)


class Written(WithACapture):
    """Of commands that write a folder, after the first one what needs its result."""

    def commands(self):
        self.capture()
        return {"calibrated": "calibrate --capture capture/capture.json --structure capture/structure.yaml --no-report",
                "converted": "convert calibrated/extrinsics.json --to colmap",
                "rendered": "render --force --rig rig.yaml",
                "evaluated": f"evaluate {MODEL} --rig rig.yaml --seeds 5"}

    def start_writing(self, command):
        """The command at work, which has begun to write into `calibrated`."""
        process = self.start(command + " -o calibrated")
        while not (os.path.isdir(self.path("calibrated")) and any(name.startswith("unfinished.tmp-") for name in os.listdir(self.path("calibrated")))):
            time.sleep(0.001)
        return process

    def test_one_process_at_a_time(self):
        commands = self.commands()
        first = self.start_writing(commands["calibrated"])
        first.send_signal(signal.SIGSTOP)
        self.expect_error(commands["calibrated"] + " -o calibrated", "calibrated: another volalign is writing there")
        first.send_signal(signal.SIGCONT)
        self.assertEqual(first.wait(), 0)
        self.expect(commands["calibrated"] + " -o calibrated", 0)
        del commands["calibrated"]
        for name, command in commands.items():
            os.mkdir(self.path(name))
            other = os.open(self.path(name), os.O_RDONLY)
            fcntl.flock(other, fcntl.LOCK_EX)
            self.expect(f"{command} -o {name}", 1, f"{name}: another volalign is writing there")
            self.assertEqual(os.listdir(self.path(name)), [])
            os.close(other)

    def test_ends_on_signals_with_nothing_half_written(self):
        calibrate = self.commands()["calibrated"]
        for number in (signal.SIGINT, signal.SIGTERM):
            process = self.start_writing(calibrate)
            process.send_signal(number)
            self.assertIn("stopped by", process.communicate()[0])
            self.assertEqual(process.returncode, 128 + number)
            self.assertEqual(os.listdir(self.path("calibrated")), [])
        train = self.start("train --config configs/m05-lite.yaml --set run.samples=100000 -o run")
        while not os.path.exists(self.path("run/metrics.jsonl")):
            time.sleep(0.01)
        time.sleep(0.5)
        train.send_signal(signal.SIGTERM)
        self.assertIn("continue with --resume", train.communicate()[0])
        self.assertEqual(train.returncode, 128 + signal.SIGTERM)
        self.assertTrue(os.listdir(self.path("run/states")))

    def test_a_full_disk_leaves_the_earlier_result(self):
        """A limit on the size of files does what a full disk does: before the first, and between a picture and a cloud."""
        commands = self.commands()
        commands["m.onnx"] = f"export {MODEL} --format onnx"
        commands["p.csv"] = "convert calibrated/extrinsics.json --to csv"
        for name, command in commands.items():
            self.expect(f"{command} -o {name}", 0)
            before = self.files(name)
            self.assertTrue(before, command)
            for limit in (10, 100) + ((100000,) if name == "calibrated" else ()):
                status, output = self.run_line(f"volalign {command} -o {name}", preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
                self.assertEqual(status, 1, output)
                self.assertRegex(output, r"error: cannot write .*File too large\n")
                self.assertTrue(self.files(name) == before, f"{command}: {limit} bytes")


class Stopped(WithACapture):
    """Commands that are stopped at moments drawn at random. What a kill leaves of a result is tested by core/base/file_util."""

    def setUp(self):
        super().setUp()
        self.random = random.Random(1)
        self.capture()
        self.calibrate = "calibrate --capture capture/capture.json --structure capture/structure.yaml --no-report -o "
        self.seconds(self.calibrate + "calibration")

    def start_main(self, command):
        """The command, once main has begun, which takes SIGINT (proc(5)), or has ended."""
        process = self.start(command)
        while process.poll() is None:
            with open(f"/proc/{process.pid}/status", encoding="ascii") as file:
                caught = re.search(r"SigCgt:\t(\w+)", file.read())
            if caught and int(caught[1], 16) >> (signal.SIGINT - 1) & 1:
                break
            time.sleep(0.001)
        return process

    def seconds(self, command):
        """How long the command takes from the beginning of main."""
        process = self.start_main(command)
        begin = time.monotonic()
        output = process.communicate()[0]
        self.assertIn(process.returncode, (0, 2), f"{command}\n{output}")
        return time.monotonic() - begin

    def stop_within(self, seconds, command, number):
        """Status and output; stopped at a moment within so many seconds from the beginning of main."""
        process = self.start_main(command)
        time.sleep(self.random.uniform(0, seconds))
        process.send_signal(number)
        output = process.communicate()[0]
        return process.returncode, output

    def test_every_command_says_so_and_ends_with_the_signals_status(self):
        commands = ["render --rig rig.yaml -o result", "render --config configs/m05-lite.yaml --count 20 -o result",
                    "init capture --depth-scale 0.001 -o result.json", self.calibrate + "result",
                    "check --extrinsics calibration/extrinsics.json --capture capture/capture.json -o result",
                    "convert calibration/extrinsics.json --to colmap -o result", f"evaluate {MODEL} --rig rig.yaml --seeds 7 -o result",
                    "plan rig.yaml -o result.svg", "structure build configs/structure.yaml -o result.glb",
                    "structure check configs/structure.yaml", f"validate {MODEL} --samples 16 -o result.json",
                    f"export {MODEL} --format onnx -o result.onnx", "config reference", "doctor"]
        said = {signal.SIGINT: "stopped by Ctrl-C (SIGINT)\n", signal.SIGTERM: "stopped by SIGTERM\n"}
        both = os.environ.get("VOLALIGN_LONG") == "1"
        for k, command in enumerate(commands):
            whole = self.seconds(command)
            for number in said if both else [list(said)[k % 2]]:
                for _ in range(20):
                    for name in os.listdir(self.folder):
                        if name.split(".")[0] == "result":
                            self.remove(name)
                    status, output = self.stop_within(whole, command, number)
                    if status in (0, 2):
                        continue  # it had ended before
                    self.assertEqual(status, 128 + number, output)
                    self.assertEqual(self.files(".", unfinished=True), {})
                    if said[number] in output:
                        break
                else:
                    self.fail(f"{command} never said that it was stopped by {number}")


if __name__ == "__main__":
    main(__doc__)
