#!/usr/bin/env python3
"""The command line as a user meets it: examples, data from any folder, misspelled names, the generated page.

    tests/cli/command_line.py VOLALIGN [CLASS]      (the program; WithoutEgl needs mount namespaces)
"""

import csv
import json
import os
import pty
import re
import shlex
import shutil
import subprocess

from program import PROGRAM, ROOT, InAFolder, main


# How options are called everywhere: what a description says -> the names that the option may have. A name that stands here
# means nothing else anywhere.
NAMES = (
    (r"^(cpu, cuda)", "--device"),
    (r"^EGL device", "--egl-device"),
    (r"^egl, cpu or auto", "--renderer"),
    (r"^threads", "--threads"),
    (r"^(folder for|file to write|folder to write|picture|structure file to write|also write the scores)", "-o,--output"),
    (r"^KEY=VALUE: replaces a value of the (file|rig$|rig or|recipe|config|calibration)", "--set"),
    (r"^checkpoints?\b", "--model"),
    (r"^(YAML of calibration options|recipe|training recipe)", "--config"),
    (r"^capture\.json( of the| files|;)", "--capture"),
    (r"^extrinsics\.json of the last", "--extrinsics"),
    (r"^raw calibration|^SENSOR=FILE", "--colour-camera"),
)
# Sub-commands that write a result, run on threads, run a network, render.
WITH = {
    "-o,--output": "add, calibrate, check, convert, evaluate, export, init, plan, render, structure build, structure sheet, structure suggest, train, validate",
    "--threads": "add, calibrate, check, evaluate, plan, render, structure suggest, train, validate",
    "--device": "add, calibrate, check, evaluate, train, validate",
    "--egl-device": "evaluate, render",
    "--renderer": "evaluate, render",
    "--set": "add, calibrate, check, config show, evaluate, plan, render, train, validate",
    "--config": "add, calibrate, check, evaluate, render, train, validate",
    "--model": "add, calibrate, check, doctor, evaluate, export, validate",
    "--capture": "add, calibrate, check, evaluate",
    # Those that print a table.
    "--json": "add, calibrate, check, doctor, evaluate, plan, render, runs compare, runs list, structure build, structure check, structure show, structure suggest, validate",
}


def options_of(text):
    """Of a --help: names, meaning, and what stands behind the names, of its options."""
    found = []
    for line, below in re.findall(r"^  (-.*)(?:\n {30}(.*))?$", text, flags=re.MULTILINE):
        names, _, notes = (line if below else line[:28]).partition(" ")
        found.append((names, below or line[28:].strip(), notes.strip()))
    return found


def has_name(names, wanted):
    """Whether the names of an option begin with the wanted ones; others may follow."""
    return names == wanted or names.startswith(wanted + ",")


def deviating_names(options):
    """Sentences: options of one meaning that are called otherwise, and one name with two meanings."""
    found = []
    for command, rows in options.items():
        for names, meaning, _ in rows:
            for pattern, wanted in NAMES:
                means = re.search(pattern, meaning) is not None
                if means and not has_name(names, wanted):
                    found.append(f"volalign {command} {names} is {wanted} elsewhere: {meaning}")
                if not means and has_name(names, wanted):
                    found.append(f"volalign {command} {names} means something else elsewhere: {meaning}")
    for wanted, commands in WITH.items():
        having = sorted(command for command, rows in options.items() if any(has_name(names, wanted) for names, _, _ in rows))
        if having != commands.split(", "):
            found.append(f"{wanted} is an option of {', '.join(having)}; expected: {commands}")
    return found


class WithoutEgl(InAFolder):
    def test_without_egl(self):
        libraries = subprocess.run(["/sbin/ldconfig", "-p"], stdout=subprocess.PIPE, text=True, check=True).stdout
        library = re.search(r"^\s*libEGL\.so\.1 .* => (.*)$", libraries, re.MULTILINE)[1]
        hide = ["unshare", "--map-root-user", "--mount", "bash", "-c", 'mount --bind /dev/null "$0" && exec "$@"', os.path.realpath(library)]
        for command, status, part in (
            ("render --rig configs/rig_ring4.yaml --renderer auto -o capture", 0, "S4"),
            ("render --rig configs/rig_ring4.yaml --renderer egl -o x", 1, "install the Debian package libegl1"),
        ):
            found, output = self.run_line(f"{shlex.join(hide + [PROGRAM])} {command}")
            self.assertEqual(found, status, output)
            self.assertIn(part, output)


class CommandLine(InAFolder):
    def helps(self, name=""):
        """Sub-command, without groups -> its --help."""
        text = self.expect(f"{name} --help", 0)
        below = [f"{name} {word}".strip() for word in re.findall(r"^  ([a-z]+) {3,}\S", text, flags=re.MULTILINE)]
        return {key: help for sub in below for key, help in self.helps(sub).items()} if below else {name: text}

    def test_every_example_works_in_an_empty_folder(self):
        helps = self.helps()
        examples = {name: re.findall(r"^  (volalign .+)$", text, flags=re.MULTILINE) for name, text in helps.items()}
        self.assertGreater(len(examples), 12)
        done = set()
        for name, lines in examples.items():
            self.assertTrue(lines, f"volalign {name} has no example")
            self.assertTrue(f"{lines[-1]} ".startswith(f"volalign {name} "), lines[-1])
            self.assertTrue(helps[name].rstrip().endswith(lines[-1]), name)
            for line in lines:
                if line in done:
                    continue
                done.add(line)
                status, output = self.run_line(line)
                self.assertEqual(status, 0, f"{line}\n{output}")
                self.expect_record(line, options_of(helps[next(key for key in examples if f"{line} ".startswith(f"volalign {key} "))]))
        self.assertIn("refine:", self.read("out/calibration/options.yaml"))
        # What was used stands beside what came out, and serves again.
        self.assertIn("tripods:", self.expect("config show out/capture/rig.yaml", 0))
        self.assertIn("tripods:", self.expect("config show out/evaluation/rigs/ring4.yaml", 0))
        self.assertIn("refine:", self.expect("config show out/evaluation/options.yaml", 0))
        # Resolved configurations that have no file of their own.
        for file, key in (("plan.svg", '"rig":'), ("scores.json", '"recipe of models/m05-lite.safetensors":')):
            self.assertIn("\n" + key + "\n  ", self.read("out", file + ".command.yaml"))
        # Where LiveScan3D's points are has to be known.
        convert = "convert out/calibration/extrinsics.json -o livescan --to livescan3d_"
        self.expect(convert + "azure", 1, "--colour-camera S1=FILE.json")
        self.expect(convert + "azure --colour-camera S1", 1, "expected SENSOR=FILE.json")
        self.expect(convert + "kinect_v2", 0, "4 sensors")
        self.assertEqual(len(os.listdir(self.path("livescan"))), 5)  # and command.yaml
        self.expect("convert livescan --from livescan3d_kinect_v2 --to csv -o back.csv", 0, "4 sensors")
        # What goes to the terminal leaves nothing.
        before = sorted(os.listdir(self.folder))
        self.expect("structure show configs/structure.yaml", 0)
        self.expect("plan configs/rig_ring4.yaml --trials 1", 0)
        self.assertEqual(sorted(os.listdir(self.folder)), before)

    def test_options_have_the_same_names_everywhere(self):
        options = {name: options_of(text) for name, text in self.helps().items()}
        self.assertGreater(sum(len(rows) for rows in options.values()), 60)
        self.assertEqual(deviating_names(options), [])

    def expect_record(self, line, options):
        """What stands beside the result of an example says how it came about."""
        output = re.search(r" -o (\S+)", line)
        if not output:
            return
        result = os.path.join(self.folder, output.group(1))
        record = result + "/command.yaml" if os.path.isdir(result) else result + ".command.yaml"
        text = self.read(record)
        self.assertIn(line.split("#")[0].strip()[len("volalign") :], text.split("\n")[1])
        for option in re.findall(r" (--[\w-]+)", line.split("#")[0]):
            self.assertIn(f"\n  {option[2:]}: ", text, line)
        for names, _, notes in options:
            if "default " in notes:
                name = re.search(r"--([\w-]+)", names).group(1)
                self.assertIn(f"\n  {name}: ", text, line)

    def test_groups_end_with_an_example_too(self):
        for group in ("config", "structure"):
            lines = self.expect(f"{group} --help", 0).rstrip().splitlines()
            self.assertTrue(lines[-1].startswith(f"  volalign {group} "), lines[-1])

    def test_the_page_of_keys_is_what_the_program_says(self):
        self.assertEqual(self.read(ROOT, "docs", "config.md"), self.expect("config reference", 0), "volalign config reference > docs/config.md")

    def test_says_what_it_is(self):
        self.expect("--help", 0, "structure", "render", "train", "calibrate", "evaluate", "export", "config")
        version = self.expect("--version", 0)
        self.assertRegex(version, r"\Avolalign \d+\.\d+\.\d+( \([0-9a-f]{12}(-dirty)? of \d{4}-\d\d-\d\d\))?\n\Z")

    def test_errors_are_one_line(self):
        for arguments, part in (("", "subcommand"), ("fly", "sub-command fly"), ("calibrate --capture", "--capture"), ("train --nproc 100000", "--nproc")):
            self.expect_error(arguments, part, "--help")
        self.expect_error("structure show missing.yaml", "missing.yaml", "No such file")
        train = "train --config configs/m05-lite.yaml -o run --set optim."
        self.expect_error(train + "lrr=1", "optim.lrr", "--set", "did you mean 'optim.lr'")
        self.expect_error(train + "lr=0", "optim.lr = 0 violates optim.lr > 0")
        self.assertFalse(os.path.exists(self.path("run")))
        self.expect_error("export --model no.pt -o n.ts", "no.pt")
        self.assertFalse(os.path.exists(self.path("n.ts")))
        evaluate = "evaluate --model models/m05-lite.safetensors -o eval "
        rigs = evaluate + "--rigs configs/rig_ring8.yaml "
        self.expect_error(evaluate, "--rig ", "--capture ")
        self.expect_error(rigs + "--seeds 9:3", "--seeds 9:3")
        self.expect_error(rigs + "--compare initial.method", "--compare initial.method", "KEY=VALUE")
        self.expect_error(rigs + "configs/rig_ring8.yaml", "ring8")
        self.expect_error(rigs + "--set-rig room_=1", "room_")
        self.expect_error(evaluate + "--captures none.json", "none.json")
        self.expect("render --rig configs/rig_ring4.yaml -o capture", 0)
        os.makedirs(self.path("eval"), exist_ok=True)
        self.write("eval/evaluation.json", '{"cases": []}')
        self.expect_error(evaluate + "--captures capture/capture.json", "evaluation.json", "folder")

    def test_poses_from_and_for_others(self):
        self.write("poses.txt", "# sensor 0 left\n0 1 2 3 0 0 0 1\n")
        self.expect("convert poses.txt --from tum --to poses -o poses.json", 0)
        (sensor,) = self.json("poses.json")["sensors"]
        self.assertEqual((sensor["name"], sensor["structure_from_sensor"][1][3]), ("left", 2))
        self.expect("convert poses.json --from poses --to ros -o tf.yaml", 0, "written")
        self.expect_error("convert poses.txt --to tum -o x", "poses.txt")
        self.expect_error("convert poses.json --from poses --to colmap -o x", "colmap", "intrinsics", "left")
        self.expect_error("convert poses.json --from poses --to kinect -o x", "kinect", "open3d")

    def test_names_that_are_not_there(self):
        self.expect("calibrat --capture x", 1, "error: volalign has no sub-command calibrat; did you mean calibrate?")
        self.expect("structure biuld x", 1, "volalign structure has no sub-command biuld; did you mean build?")
        self.expect("--data-dir . rendr", 1, "did you mean render?")
        self.expect_error("frobnicate", "error: volalign has no sub-command frobnicate")
        self.expect_error("calibrate --capture x -o y --modle z", "volalign calibrate has no option --modle; did you mean --model?")

    def test_data_from_any_folder(self):
        self.expect("structure show configs/structure.yaml", 0, "4 boxes")
        self.expect("structure show configs/none.yaml", 1, "none.yaml")
        self.write("mine/configs/structure.yaml", "name: mine\nboxes:\n  - {name: only, x: [0, 400], y: [0, 300], z: [0, 200]}\n")
        self.expect("structure show configs/structure.yaml --data-dir mine", 0, "mine: 1 box,")
        self.expect("structure show configs/structure.yaml", 0, "mine: 1 box,", VOLALIGN_DATA_DIR="mine")
        self.expect("structure show configs/structure.yaml --data-dir nowhere", 1, "--data-dir nowhere")
        # The working directory comes first.
        os.rename(self.path("mine/configs"), self.path("configs"))
        self.expect("structure show configs/structure.yaml", 0, "mine: 1 box,")

    def test_config_show(self):
        self.expect("config show configs/rig_ring8.yaml --set seed=3", 0, "seed: 3", "device_errors:")
        self.expect("config show configs/m05-lite.yaml", 0, "loss:")
        self.write("calibration.yaml", "refine: {threads: 2, max_side_points: 3000, min_overlap: 0.05}\nverdict: {lens: {min_bend_m: 0.008}}\n")
        self.expect("config show calibration.yaml", 0, "verdict:")
        self.write("empty.yaml", "{}\n")
        self.expect("config show empty.yaml", 1, "--as")
        self.expect("config show empty.yaml --as calibration", 0, "verdict:")

    def test_doctor(self):
        self.expect("doctor", 0, "LibTorch", "Ceres", "renderer", "classes", "everything is there")
        self.expect("doctor --model none.pt", 2, "MISSING", "none.pt")

    def on_terminal(self, arguments):
        """Of a command of which stderr alone is a terminal: its standard output, and what the terminal showed."""
        master, slave = pty.openpty()
        with subprocess.Popen([PROGRAM] + arguments.split(), cwd=self.folder, stdout=subprocess.PIPE, stderr=slave, text=True) as process:
            os.close(slave)
            seen = b""
            while True:
                try:
                    piece = os.read(master, 4096)
                except OSError:  # the other end is closed
                    break
                if not piece:
                    break
                seen += piece
            output = process.stdout.read()
        os.close(master)
        self.assertEqual(process.returncode, 0, seen)
        return output, seen

    def test_progress_is_for_terminals(self):
        render = "render --rig configs/rig_ring4.yaml --set sensors[0].name=A -o capture"
        self.assertNotIn("\r", self.expect(render, 0))
        output, seen = self.on_terminal(render + " --force")
        self.assertRegex(seen, rb"frames, [1-4] of 4, about \d+ seconds? left")
        self.assertTrue(seen.endswith(b"\r\x1b[K"), seen[-80:])
        self.assertNotIn("\r", output)
        arguments = "calibrate --capture capture/capture.json --threads 1 -o "
        self.expect(arguments + "plain --device tpu", 1, "error: device = 'tpu' is no device: use cpu, cuda or cuda:N")
        output = self.expect(arguments + "plain --device cpu", 0)
        self.assertNotIn("\r", output)
        self.assertIn("\nthreads: 1\n", self.read("plain", "options.yaml"))
        output, seen = self.on_terminal(arguments + "seen")
        for stage in (b"first poses", b"all sensors together", b"writing poses"):
            self.assertIn(stage, seen)
        self.assertTrue(seen.endswith(b"\r\x1b[K"), seen[-80:])
        self.assertIn("4 of 4 sensors placed", output)
        for command, part in (
            ("plan configs/rig_ring4.yaml --trials 2 --json", rb"trials, 1 of 2, about"),
            ("validate --model models/m05-lite.safetensors --samples 16", rb"samples, \d+ of 16"),
            ("evaluate --rig configs/rig_ring4.yaml --seeds 1:3 -o evaluated", rb"captures, 1 of 2, about"),
            ("render --config configs/m05-lite.yaml --count 60 -o samples", rb"samples, \d+ of 60"),
        ):
            output, seen = self.on_terminal(command)
            self.assertRegex(seen, part, command)
            self.assertNotIn("\r", output)
        self.assertTrue(os.path.exists(self.path("samples/contact_sheet.png")))

    def test_tables_are_for_programs_too(self):
        self.expect("render --rig configs/rig_ring4.yaml -o capture", 0)
        self.expect("calibrate --capture capture/capture.json --no-report -o out", 0)
        check = "check --capture capture/capture.json --extrinsics out/extrinsics.json"
        for command, rows, key in (
            ("structure show configs/structure.yaml", 20, "exposed_centroid_x_m"),
            ("structure check configs/structure.yaml", 4, "weakest_worst_m"),
            ("plan configs/rig_ring4.yaml --trials 1 -o plan.svg", 4, "expected_m"),
            ("doctor", 9, "found"),
            ("calibrate --capture capture/capture.json -o out", 4, "error_m"),
            (check, 4, "translation_m"),
            ("evaluate --rig configs/rig_ring4.yaml --seeds 7 -o evaluated", None, "refined_mm_median"),
            ("validate --model models/m05-lite.safetensors --samples 16 -o scores.json", None, "miou"),
            ("structure build configs/structure.yaml -o out.glb", 20, "exposed_centroid_x_m"),
            ("structure suggest '2x 500x400x300' --candidates 20 -o boxes.yaml", 4, "weakest_worst_m"),
            ("render --rig configs/rig_ring4.yaml -o again --force", 4, "structure_px"),
        ):
            for flag in ("--json", "--csv") if command.startswith("structure") else ("--json",):
                output = self.expect(f"{command} {flag} 2> said", 0)
                table = json.loads(output) if flag == "--json" else list(csv.DictReader(output.splitlines()))
                self.assertIn(key, table[0], command)
                if rows is not None:
                    self.assertEqual(len(table), rows, command)
                if " -o " in command and not command.startswith("evaluate"):
                    self.assertIn("written: ", self.read("said"))
        # The numbers are those of the file.
        sensors = self.json("out", "extrinsics.json")["sensors"]
        for row in json.loads(self.expect("calibrate --capture capture/capture.json -o out --json 2>/dev/null", 0)):
            self.assertEqual(row["error_m"], sensors[row["sensor"]]["error"]["translation_m"])
        self.expect("plan configs/rig_ring4.yaml --json --csv", 1, "--json")
        self.expect("evaluate --suite all --json -o suite", 1, "--json", "--suite")

    def test_which_model_it_takes(self):
        self.expect("render --rig configs/rig_ring4.yaml -o capture", 0)
        calibrate = "calibrate --capture capture/capture.json --no-report -o out "
        output = self.expect(calibrate, 0)
        self.assertEqual(output.splitlines()[0], "model: models/m05-lite.safetensors, which knows paper_stack")
        self.assertIn("  network  ", output)
        output = self.expect(calibrate + "--model none", 0)
        self.assertEqual(output.splitlines()[0], "model: none, poses come from the structure's shape")
        self.assertNotIn("  network  ", output)
        # The same labels, but other boxes.
        other = re.sub(r"x: \[(-?[\d.]+), ", lambda m: f"x: [{float(m.group(1)) - 7}, ", self.read(ROOT, "configs", "structure.yaml"), count=1)
        self.write("other.yaml", other.replace("name: paper_stack", "name: other"))
        output = self.expect(calibrate + "--structure other.yaml", 0)
        self.assertEqual(
            output.splitlines()[0], "model: none, poses come from the structure's shape (the shipped model does not know other)"
        )
        # Asked for, it is taken.
        self.expect(calibrate + "--structure other.yaml --model models/m05-lite.safetensors", 0, "model: models/m05-lite.safetensors\n")
        # A capture that names no structure.
        self.expect("init capture --depth-scale 0.001 -o bare.json", 0)
        bare = calibrate.replace("capture/capture.json", "bare.json")
        self.expect(bare, 0, "with the structure that it knows, since neither the capture nor --structure names one")
        self.expect(bare + "--model none", 1, "--model none needs a structure", "--structure")
        os.makedirs(self.path("data", "configs"))
        shutil.copy(os.path.join(ROOT, "configs", "structure.yaml"), self.path("data", "configs"))
        self.expect(calibrate + "--data-dir data", 0, "model: none, poses come from the structure's shape (models/m05-lite.safetensors is not there)")

    def test_what_goes_wrong_is_said_in_a_line(self):
        self.expect("render --rig configs/rig_ring4.yaml -o capture", 0)
        self.expect("render --rig configs/rig_ring4.yaml -o capture", 1, "capture has a capture already", "--force")
        self.expect("render --rig configs/rig_ring4.yaml -o capture --force", 0)
        good = self.json("capture", "capture.json")
        self.write("capture/all.json", json.dumps({**good, "depth_scale": 1}))
        self.expect("calibrate --capture capture/all.json -o all", 2, "(wrong_units)", "(depth_scale)", "set depth_scale to 0.001; it is 1")
        good["sensors"][2]["depth_scale"] = 1
        self.write("capture/one.json", json.dumps(good))
        self.expect("calibrate --capture capture/one.json -o out", 2, "S3 failed (wrong_units)", "set depth_scale to 0.001; it is 1")
        for name in ("capture/S1_depth.png", "capture/capture.json"):
            self.expect(f"calibrate --capture capture/capture.json --model {name} -o x", 1, f"{name} is not a volalign checkpoint (.safetensors)")
        self.expect("init capture -o draft.json --sensor femto_bolt", 1, "femto_bolt is no kind of sensor", "orbbec_femto", "oak_d")
        self.expect("render --rig configs/rig_ring4.yaml -o x --set sensors[0].sensor=femto_bolt", 1, "femto_bolt", "orbbec_femto_bolt_nfov_binned")
        self.write("metres.yaml", "boxes:\n  - {name: b, x: [0, 0.5], y: [0, 0.5], z: [0, 0.5]}\n")
        self.expect("structure show metres.yaml", 1, "box 'b' is 0.5 x 0.5 x 0.5 mm", "sizes are written in millimetres")

    def test_what_no_stack_can_be(self):
        def write(*boxes):
            self.write("s.yaml", "boxes:\n  - {name: a, x: [0, 500], y: [0, 400], z: [0, 300]}\n" + "".join(f"  - {{name: {box}}}\n" for box in boxes))

        write("b, x: [0, 500], y: [420, 700], z: [0, 300]")
        self.expect("structure show s.yaml", 0, "warning: s: box 'b' stands on nothing: its lower side is 20 mm above box 'a'")
        self.expect("structure check s.yaml", 0, "doubtful: box 'b' stands on nothing")
        write("b, x: [0, 500], y: [480, 700], z: [0, 300]")
        for command in ("show s.yaml", "check s.yaml", "build s.yaml -o s.glb", "sheet s.yaml -o s.svg"):
            self.expect("structure " + command, 1, "error: s.yaml: box 'b' stands on nothing: its lower side is 80 mm above box 'a'")
        write("b, x: [520, 900], y: [0, 400], z: [0, 300]")
        self.expect("structure show s.yaml", 0, "warning: s: there is a gap of 20 mm between boxes 'a' and 'b'")
        self.expect("structure check s.yaml", 0, "doubtful: there is a gap of 20 mm")
        write("b, x: [0, 500], y: [400 700], z: [0, 300]")
        self.expect("structure show s.yaml", 1, "boxes[1].y = [400 700] has 1 values; 2 are expected, with commas between them (s.yaml:3)")

    def test_a_mesh_as_the_structure(self):
        # An L of 900 x 800 x 500 in millimetres, z up; its upper step is 350 wide.
        corners = [(0, 0), (900, 0), (900, 300), (350, 300), (350, 800), (0, 800)]
        lines = [f"v {x} {y} {z}" for y in (0, 500) for x, z in corners]
        caps = [(1, 2, 4), (2, 3, 4), (1, 4, 6), (4, 5, 6)]
        faces = [f"f {a} {b} {c}" for a, b, c in caps] + [f"f {a + 6} {c + 6} {b + 6}" for a, b, c in caps]
        for i in range(1, 7):
            j = i % 6 + 1
            faces += [f"f {j} {i} {i + 6}", f"f {j} {i + 6} {j + 6}"]
        self.write("ell.obj", "o ell\n" + "\n".join(lines + faces) + "\n")
        self.expect("structure show ell.obj", 1, "error: ell.obj: it is 900 m long", "structure build ell.obj --mesh-scale 0.001 -o NAME.yaml")
        said = "ell: 1 part, 7 labels and background, 800 mm high, sha256 "
        self.expect("structure build ell.obj --mesh-scale 0.001 --mesh-up z -o ell.yaml", 0, said, "1 side without label", "written: ell.yaml")
        os.remove(self.path("ell.obj"))
        for command in ("show ell.yaml", "build ell.yaml -o ell.glb", "show ell.glb"):
            self.expect("structure " + command, 0, said, "ell/7")
        self.expect("structure check ell.glb", 0, "ell: 1 part, 800 mm high")
        self.expect("plan configs/rig_ring4.yaml --set structure=ell.glb --trials 1 -o plan.svg", 0, "written: plan.svg")
        self.assertIn('<path class="rig-box"', self.read("plan.svg"))
        self.expect("structure sheet ell.yaml -o sheet.svg", 1, "error: ell: only a stack of boxes has a build sheet")
        self.expect("structure build ell.yaml --mesh-scale 0.001 -o x.yaml", 1, "a scale and an axis are for a mesh")
        self.expect("structure build ell.yaml -o x.png", 1, "x.png: the file to write ends in .glb or .yaml")
        self.expect("render --rig configs/rig_ring4.yaml --set structure=ell.glb -o capture", 0)
        self.expect("structure show capture/structure.yaml", 0, said)
        status, output = self.run_line("volalign calibrate --capture capture/capture.json -o out")
        self.assertIn(status, (0, 2), output)
        self.assertIn("model: none, poses come from the structure's shape", output)
        self.assertIn('"triangles"', self.read("out", "report.html"))
        # The paper's boxes, drawn for glTF, are a mesh of four parts.
        self.expect("structure build configs/structure.yaml -o stack.glb", 0)
        self.expect("structure show stack.glb", 0, "stack: 4 parts, 20 labels and background, 1620 mm high")

    def test_bytes_that_are_not_utf8(self):
        for command in (r"train -o $'n\xff'", r"calibrate --capture $'\xff.json' -o x", r"calibrate --capture c.json -o x --note $'\xff'"):
            self.expect_error(command, r"\xff", "is not UTF-8", "rename")
        os.mkdir(self.path("f"))
        with open(os.path.join(os.fsencode(self.folder), b"f", b"K\xfcche_depth.png"), "wb") as file:
            file.write(b"")
        self.expect("init f", 1, r'the file "f/K\xfcche_depth.png" is not UTF-8', "rename")

    def test_a_full_standard_output(self):
        for command in ("structure show configs/structure.yaml", "--help", "--version", "config show configs/m05-lite.yaml"):
            self.expect_error(command + " > /dev/full", "error: cannot write ")

    def test_where_an_argument_belongs(self):
        self.expect("calibrate --capture capture.json --twin S1=2", 1, "--twin: --choose SENSOR=NUMBER does this now")
        self.expect("calibrate real", 1, 'takes no argument "real" by itself: did you mean --capture real?')
        os.mkdir(self.path("real"))
        self.expect("calibrate real -o x", 1, "did you mean --capture real/capture.json? `volalign init real` writes that file")

    def test_a_long_list_of_boxes(self):
        self.write("blanks", 100000 * " ")
        self.expect('structure suggest -o x.yaml "$(cat blanks)"', 1, "error: cannot read the boxes")

    def test_egl_errors_name_their_cause(self):
        render = "render --rig configs/rig_ring4.yaml --renderer egl -o x"
        for variable, part in (
            ("__EGL_VENDOR_LIBRARY_FILENAMES=/no/such/file", "EGL finds no driver"),
            ("MESA_GL_VERSION_OVERRIDE=3.3", "gives OpenGL 3.3"),
            ("GALLIUM_DRIVER=softpipe", "softpipe, gives OpenGL "),
        ):
            name, value = variable.split("=")
            self.expect(render, 1, part, "--renderer cpu", **{name: value})

    def test_a_copied_program_says_where_its_data_may_be(self):
        shutil.copy(PROGRAM, self.path("copy"))
        for arguments in ("structure show configs/structure.yaml", "render --rig configs/rig_ring4.yaml -o x"):
            status, output = self.run_line("./copy " + arguments)
            self.assertEqual(status, 1, output)
            for part in ("--data-dir FOLDER", "VOLALIGN_DATA_DIR"):
                self.assertIn(part, output)
        self.assertNotIn("--data-dir", self.run_line("./copy structure show none.yaml")[1])

    def test_pages_are_named_where_they_are(self):
        page = os.path.join(ROOT, "docs", "formats.md")
        self.expect("calibrate --capture none.json -o x", 1, page)
        self.expect("calibrate --capture /none/docs/formats.md -o x", 1, "/none/docs/formats.md: ")
        self.expect("--help", 0, os.path.join(ROOT, "docs", "index.md"))
        installed = self.path("usr")
        for folder, name in (("share/volalign/configs", "configs/structure.yaml"), ("share/doc/volalign/docs", "docs/formats.md")):
            os.makedirs(os.path.join(installed, folder))
            shutil.copy(os.path.join(ROOT, name), os.path.join(installed, folder))
        self.expect(
            "calibrate --capture none.json -o x --data-dir usr/share/volalign", 1, os.path.join("usr", "share", "doc", "volalign", "docs", "formats.md")
        )

    def test_help_is_in_words(self):
        for output in self.helps().values():
            self.assertIsNone(re.search(r"\b(FLOAT|INT|UINT|TEXT|ENUM):", output), output)
        self.expect("check --help", 0, "--false-alarm FLOAT (1e-12 to 0.1; default 1e-05)", "--max-mm FLOAT (0 or above; default 0)")
        self.expect("calibrate --help", 0, "--initial {auto,network,geometry}", "--capture TEXT ... (required)")

    def test_init(self):
        self.expect("render --rig configs/rig_ring4.yaml -o capture", 0)
        capture = self.json("capture", "capture.json")
        self.expect("init capture", 1, "capture.json exists", "--force")
        self.expect("init capture -o draft.json", 2, "S1: depth_scale", "m at 0.001")
        self.expect("init capture -o draft.json --depth-scale 0.001", 0, "S1: intrinsics of S1_intrinsics.json", "(4 sensors)")
        self.write("draft.json", self.read("draft.json") + " ")
        self.expect("init capture -o draft.json --depth-scale 0.001", 1, "draft.json exists and was changed", "--force")
        self.expect("init capture -o draft.json --force --depth-scale 0.001", 0)
        draft = self.json("draft.json")
        self.assertEqual(len(draft["sensors"]), len(capture["sensors"]))
        for made, known in zip(draft["sensors"], capture["sensors"]):
            self.assertEqual(made["name"], known["name"])
            self.assertEqual(made["depth"], "capture/" + known["depth"])
            self.assertEqual(made["intrinsics"]["fx"], known["intrinsics"]["fx"])


if __name__ == "__main__":
    main(__doc__)
