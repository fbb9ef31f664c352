#!/usr/bin/env python3
"""The command line as a user meets it: examples, data from any folder, misspelled names, completion, the generated page.

    tests/cli/command_line.py VOLALIGN      (the program)
"""

import json
import os
import pty
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
PROGRAM = os.path.abspath(sys.argv.pop(1)) if len(sys.argv) > 1 else ""


def run(arguments, folder, **environment):
    """Status and output (both streams) of a command line of the program."""
    done = subprocess.run(
        ["bash", "-c", f'volalign() {{ "{PROGRAM}" "$@"; }}; {arguments}'],
        cwd=folder,
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    return done.returncode, done.stdout


# How options are called everywhere: what a description says -> the names that the option may have. A name that stands here
# means nothing else anywhere.
NAMES = (
    (r"^(cpu, cuda)", "--device"),
    (r"^EGL device", "--egl-device"),
    (r"^egl, cpu or auto", "--renderer"),
    (r"^threads", "--threads"),
    (r"^(folder for|file to write|folder to write|picture|structure file to write|also write the scores)", "-o,--output"),
    (r"^KEY=VALUE over (the|a) (file|rig$|rig or|recipe|config|calibration)", "--set"),
    (r"^checkpoints?\b", "--model"),
    (r"^(YAML of calibration options|recipe|training recipe)", "--config"),
    (r"^capture\.json( of the| files|;)", "--capture"),
    (r"^extrinsics\.json of the last", "--extrinsics"),
    (r"^raw calibration|^SENSOR=FILE", "--colour-camera"),
)
# Sub-commands that write a result, run on threads, run a network, render.
WITH = {
    "-o,--output": "calibrate, capture init, check, convert, evaluate, export, plan, render, runs plot, structure build, structure check, train, validate",
    "--threads": "calibrate, check, evaluate, plan, render, train, validate",
    "--device": "calibrate, check, evaluate, train, validate",
    "--egl-device": "evaluate, render",
    "--renderer": "evaluate, render",
    "--set": "calibrate, check, config show, evaluate, plan, render, train, validate",
    "--config": "calibrate, check, evaluate, render, train, validate",
    "--model": "calibrate, check, doctor, evaluate, export, validate",
    "--capture": "calibrate, check, evaluate",
}


def options_of(text):
    """Of `volalign config commands`: sub-command -> (names, meaning) of its options, not its positional arguments."""
    sections = re.split(r"^## volalign (.+)$", text, flags=re.MULTILINE)[1:]
    return {
        name: re.findall(r"^\| `(-[^`]*)` \| (.*) \|$", body, flags=re.MULTILINE)
        for name, body in zip(sections[::2], sections[1::2])
    }


def has_name(names, wanted):
    """Whether the names of an option begin with the wanted ones; others may follow."""
    return names == wanted or names.startswith(wanted + ",")


def deviating_names(options):
    """Sentences: options of one meaning that are called otherwise, and one name with two meanings."""
    found = []
    for command, rows in options.items():
        for names, meaning in rows:
            for pattern, wanted in NAMES:
                means = re.search(pattern, meaning) is not None
                if means and not has_name(names, wanted):
                    found.append(f"volalign {command} {names} is {wanted} elsewhere: {meaning}")
                if not means and has_name(names, wanted):
                    found.append(f"volalign {command} {names} means something else elsewhere: {meaning}")
    for wanted, commands in WITH.items():
        having = sorted(command for command, rows in options.items() if any(has_name(names, wanted) for names, _ in rows))
        if having != commands.split(", "):
            found.append(f"{wanted} is an option of {', '.join(having)}; expected: {commands}")
    return found


def examples_of(text):
    """Of `volalign config commands`: sub-command -> lines of its example."""
    sections = re.split(r"^## volalign (.+)$", text, flags=re.MULTILINE)[1:]
    found = {}
    for name, body in zip(sections[::2], sections[1::2]):
        found[name] = re.findall(r"^    (volalign .+)$", body, flags=re.MULTILINE)
    return found


class CommandLine(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp(prefix="volalign_cli_")
        self.addCleanup(shutil.rmtree, self.folder)

    def expect(self, arguments, status, *parts, **environment):
        got, output = run("volalign " + arguments, self.folder, **environment)
        self.assertEqual(got, status, output)
        for part in parts:
            self.assertIn(part, output)
        return output

    def test_every_example_works_in_an_empty_folder(self):
        text = self.expect("config commands", 0)
        examples = examples_of(text)
        self.assertGreater(len(examples), 12)
        done = set()
        for name, lines in examples.items():
            self.assertTrue(lines, f"volalign {name} has no example")
            self.assertTrue(f"{lines[-1]} ".startswith(f"volalign {name} "), lines[-1])
            self.assertTrue(self.expect(f"{name} --help", 0).rstrip().endswith(lines[-1]), name)
            for line in lines:
                if line in done:
                    continue
                done.add(line)
                status, output = run(line, self.folder)
                # The rendered sensors' intrinsics are in no file of their own: it has to say so.
                expected = 2 if name == "capture init" and line == lines[-1] else 0
                self.assertEqual(status, expected, f"{line}\n{output}")
                self.expect_record(line, options_of(text)[next(key for key in examples if f"{line} ".startswith(f"volalign {key} "))])
        with open(os.path.join(self.folder, "out/calibration/options.yaml"), encoding="utf-8") as file:
            self.assertIn("refine:", file.read())
        # What was used stands beside what came out, and serves again.
        self.assertIn("tripods:", self.expect("config show out/capture/rig.yaml", 0))
        self.assertIn("tripods:", self.expect("config show out/evaluation/rigs/ring4.yaml", 0))
        self.assertIn("refine:", self.expect("config show out/evaluation/options.yaml", 0))
        # Resolved configurations that have no file of their own.
        for file, key in (("plan.svg", '"rig":'), ("scores.json", '"recipe of models/m05-lite.pt":')):
            with open(os.path.join(self.folder, "out", file + ".command.yaml"), encoding="utf-8") as record:
                self.assertIn("\n" + key + "\n  ", record.read())
        # Where LiveScan3D's points are has to be known.
        convert = "convert out/calibration/extrinsics.json -o livescan --to livescan3d_"
        self.expect(convert + "azure", 1, "--colour-camera S1=FILE.json")
        self.expect(convert + "azure --colour-camera S1", 1, "expected SENSOR=FILE.json")
        self.expect(convert + "kinect_v2", 0, "4 sensors")
        self.assertEqual(len(os.listdir(os.path.join(self.folder, "livescan"))), 5)  # and command.yaml
        self.expect("convert livescan --from livescan3d_kinect_v2 --to csv -o back.csv", 0, "4 sensors")
        # What goes to the terminal leaves nothing.
        before = sorted(os.listdir(self.folder))
        self.expect("structure show configs/structure.yaml", 0)
        self.expect("plan configs/rig_ring4.yaml --trials 1", 0)
        self.assertEqual(sorted(os.listdir(self.folder)), before)

    def test_options_have_the_same_names_everywhere(self):
        options = options_of(self.expect("config commands", 0))
        self.assertGreater(sum(len(rows) for rows in options.values()), 60)
        self.assertEqual(deviating_names(options), [])
        # It sees what it looks for.
        for command, old, new in (("calibrate", "--threads", "--jobs"), ("validate", "-o,--output", "--json"), ("render", "--egl-device", "--device")):
            broken = {name: [(new if names == old else names, meaning) for names, meaning in rows] if name == command else rows for name, rows in options.items()}
            self.assertTrue(deviating_names(broken), (command, new))

    def expect_record(self, line, options):
        """What stands beside the result of an example says how it came about."""
        output = re.search(r" -o (\S+)", line)
        if not output:
            return
        result = os.path.join(self.folder, output.group(1))
        record = result + "/command.yaml" if os.path.isdir(result) else result + ".command.yaml"
        with open(record, encoding="utf-8") as file:
            text = file.read()
        self.assertIn(line.split("#")[0].strip()[len("volalign") :], text.split("\n")[1])
        for option in re.findall(r" (--[\w-]+)", line.split("#")[0]):
            self.assertIn(f"\n  {option[2:]}: ", text, line)
        for names, meaning in options:
            default = re.search(r"; default (\S+)", meaning)
            if default:
                name = re.search(r"--([\w-]+)", names).group(1)
                self.assertIn(f"\n  {name}: ", text, line)

    def test_groups_end_with_an_example_too(self):
        for group in ("capture", "completion", "config", "structure"):
            lines = self.expect(f"{group} --help", 0).rstrip().splitlines()
            self.assertTrue(lines[-1].startswith(f"  volalign {group} "), lines[-1])

    def test_the_page_is_what_the_program_says(self):
        with open(os.path.join(ROOT, "docs", "cli.md"), encoding="utf-8") as file:
            self.assertEqual(file.read(), self.expect("config commands", 0), "volalign config commands > docs/cli.md")

    def test_names_that_are_not_there(self):
        self.expect("calibrat --capture x", 1, "error: volalign has no sub-command calibrat; did you mean calibrate?")
        self.expect("structure biuld x", 1, "volalign structure has no sub-command biuld; did you mean build?")
        self.expect("--data-dir . rendr", 1, "did you mean render?")
        output = self.expect("frobnicate", 1, "error: volalign has no sub-command frobnicate")
        self.assertEqual(output.count("\n"), 1, output)
        output = self.expect("calibrate --capture x -o y --modle z", 1, "volalign calibrate has no option --modle; did you mean --model?")
        self.assertEqual(output.count("\n"), 1, output)

    def test_a_plot_is_svg(self):
        self.expect("runs plot . -o runs.png", 1, "--output = runs.png", ".svg")

    def test_data_from_any_folder(self):
        self.expect("structure show configs/structure.yaml", 0, "4 boxes")
        self.expect("structure show configs/none.yaml", 1, "none.yaml")
        mine = os.path.join(self.folder, "mine", "configs")
        os.makedirs(mine)
        text = "name: mine\nboxes:\n  - {name: only, x: [0, 400], y: [0, 300], z: [0, 200]}\n"
        with open(os.path.join(mine, "structure.yaml"), "w", encoding="utf-8") as file:
            file.write(text)
        self.expect("structure show configs/structure.yaml --data-dir mine", 0, "mine: 1 boxes")
        self.expect("structure show configs/structure.yaml", 0, "mine: 1 boxes", VOLALIGN_DATA_DIR="mine")
        self.expect("structure show configs/structure.yaml --data-dir nowhere", 1, "--data-dir nowhere")
        # The working directory comes first.
        os.rename(mine, os.path.join(self.folder, "configs"))
        self.expect("structure show configs/structure.yaml", 0, "mine: 1 boxes")

    def test_an_installed_program_finds_its_data(self):
        os.makedirs(os.path.join(self.folder, "bin"))
        share = os.path.join(self.folder, "share", "volalign")
        shutil.copytree(os.path.join(ROOT, "configs"), os.path.join(share, "configs"))
        shutil.copy(PROGRAM, os.path.join(self.folder, "bin"))
        done = subprocess.run(
            [os.path.join(self.folder, "bin", "volalign"), "doctor"], cwd="/", stdout=subprocess.PIPE, text=True, check=False
        )
        self.assertIn(share, done.stdout)
        self.assertEqual(done.returncode, 2, done.stdout)  # the model was not installed
        self.assertIn("MISSING", done.stdout)

    def test_config_show(self):
        self.expect("config show configs/rig_ring8.yaml --set seed=3", 0, "seed: 3", "device_errors:")
        self.expect("config show configs/m05-lite.yaml", 0, "loss:")
        with open(os.path.join(self.folder, "calibration.yaml"), "w", encoding="utf-8") as file:
            file.write("refine: {threads: 1}\n")
        self.expect("config show calibration.yaml", 0, "verdict:")
        with open(os.path.join(self.folder, "empty.yaml"), "w", encoding="utf-8") as file:
            file.write("{}\n")
        self.expect("config show empty.yaml", 1, "--as")
        self.expect("config show empty.yaml --as calibration", 0, "verdict:")

    def test_completion(self):
        self.expect("completion bash > completion.sh", 0)

        def complete(*words):
            line = " ".join(f"'{word}'" for word in words)
            script = f"source completion.sh; COMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _volalign; echo ${{COMPREPLY[@]}}"
            done = subprocess.run(["bash", "-c", script], cwd=self.folder, stdout=subprocess.PIPE, text=True, check=True)
            return done.stdout.split()

        self.assertEqual(complete("volalign", "cali"), ["calibrate"])
        self.assertEqual(sorted(complete("volalign", "structure", "")[:2]), ["build", "show"])
        self.assertIn("--capture", complete("volalign", "calibrate", "--cap"))
        self.assertEqual(complete("volalign", "calibrate", "--initial", "pap"), ["paper"])
        self.assertEqual(complete("volalign", "calibrate", "--output", "x"), [])

    def test_doctor(self):
        self.expect("doctor", 0, "LibTorch", "Ceres", "renderer", "classes", "everything is there")
        self.expect("doctor --model none.pt", 2, "MISSING", "none.pt")

    def test_progress_is_for_terminals(self):
        self.expect("render --rig configs/rig_ring4.yaml --set sensors[0].name=A -o capture", 0)
        arguments = "calibrate --capture capture/capture.json --model models/m05-lite.pt --threads 1 -o "
        self.expect(arguments + "plain --device tpu", 1, "error: device = 'tpu' is no device: use cpu, cuda or cuda:N")
        output = self.expect(arguments + "plain --device cpu", 0)
        self.assertNotIn("\r", output)
        with open(os.path.join(self.folder, "plain", "options.yaml"), encoding="utf-8") as file:
            self.assertIn("\nthreads: 1\n", file.read())
        master, slave = pty.openpty()
        with subprocess.Popen([PROGRAM] + (arguments + "seen").split(), cwd=self.folder, stdout=subprocess.DEVNULL, stderr=slave) as process:
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
        os.close(master)
        self.assertEqual(process.returncode, 0)
        for stage in (b"first poses", b"all sensors together"):
            self.assertIn(stage, seen)
        self.assertTrue(seen.endswith(b"\r\x1b[K"), seen[-80:])

    def test_capture_init(self):
        self.expect("render --rig configs/rig_ring4.yaml -o capture", 0)
        with open(os.path.join(self.folder, "capture", "capture.json"), encoding="utf-8") as file:
            capture = json.load(file)
        for sensor in capture["sensors"]:
            path = os.path.join(self.folder, "capture", sensor["name"] + "_intrinsics.json")
            with open(path, "w", encoding="utf-8") as file:
                json.dump(sensor["intrinsics"], file)
        self.expect("capture init capture", 1, "capture.json is there already", "--force")
        self.expect("capture init capture -o draft.json", 2, "S1: depth_scale", "m at 0.001")
        self.expect("capture init capture -o draft.json --force --depth-scale 0.001", 0, "S1: intrinsics of S1_intrinsics.json")
        with open(os.path.join(self.folder, "draft.json"), encoding="utf-8") as file:
            draft = json.load(file)
        self.assertEqual(len(draft["sensors"]), len(capture["sensors"]))
        for made, known in zip(draft["sensors"], capture["sensors"]):
            self.assertEqual(made["name"], known["name"])
            self.assertEqual(made["depth"], "capture/" + known["depth"])
            self.assertEqual(made["intrinsics"]["fx"], known["intrinsics"]["fx"])


if __name__ == "__main__":
    if not PROGRAM:
        sys.exit(__doc__)
    unittest.main()
