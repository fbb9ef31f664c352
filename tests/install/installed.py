#!/usr/bin/env python3
"""Does what is installed work in any folder, and can a C++ program use it, without LibTorch?

    tests/install/installed.py CMAKE BUILD_FOLDER SOURCE_FOLDER CXX [Installed | Libraries | WithoutSource]

Installs what ./quickstart.sh builds to a new prefix, runs the program in an empty folder, and builds examples/calibrate_in_memory against the
libraries where CMake finds no LibTorch. The program with parts of its own, examples/own_program, is built against them, trains by its recipe, and
does with the result what volalign does. For WithoutSource an empty folder is mounted over the source tree meanwhile, of which only the LibTorch of
tests/compat/libtorch.sh stays: it needs mount namespaces for ordinary users.
"""

import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

CMAKE, BUILD, SOURCE, CXX = sys.argv[1:5] if len(sys.argv) > 4 else ("", "", "", "")
del sys.argv[1:5]

# Arguments: the source tree, the folder in it that stays if it is there, a folder to keep it in, and the command.
HIDE = """
source=$1 stays=$2 kept=$3
shift 3
if [ -d "$stays" ]; then mount --bind "$stays" "$kept"; fi
mount -t tmpfs none "$source" || exit
if mountpoint -q "$kept"; then mkdir -p "$stays" && mount --bind "$kept" "$stays"; fi
exec "$@"
"""
WITHOUT_TORCH = ["-DCMAKE_DISABLE_FIND_PACKAGE_Torch=ON", "-DCMAKE_FIND_USE_PACKAGE_REGISTRY=OFF"]


def files_below(folder, extensions):
    found = [os.path.join(where, name) for where, _, names in os.walk(folder) for name in names]
    return sorted(path for path in found if path.endswith(extensions))


def text_of(path):
    with open(path, encoding="utf-8") as file:
        return file.read()


def ninja(*arguments):
    return subprocess.run(["ninja", "-C", BUILD, "-t", *arguments], stdout=subprocess.PIPE, text=True, check=True).stdout


def install(prefix):
    """Installs to `prefix` from a copy of the build folder that lacks what ./quickstart.sh does not build."""
    wanted = re.search(r"^build_preset release (.+)$", text_of(os.path.join(SOURCE, "quickstart.sh")), re.MULTILINE)[1].split()
    outputs = {line.rpartition(": ")[0] for line in ninja("targets", "all").splitlines()}
    if not outputs.issuperset(wanted):  # without LibTorch or Python
        subprocess.run([CMAKE, "--install", BUILD, "--prefix", prefix], stdout=subprocess.DEVNULL, check=True)
        return
    made = set(ninja("inputs", *wanted).splitlines())
    for target in wanted:
        made.update(re.findall(r"^    (\S+)$", ninja("query", target).partition("outputs:")[0], re.MULTILINE))
    with tempfile.TemporaryDirectory(prefix="volalign_quickstart_") as copy:
        for folder, _, files in os.walk(BUILD):
            if "cmake_install.cmake" not in files:
                continue
            script = text_of(os.path.join(folder, "cmake_install.cmake"))
            for path in re.findall(rf'"({re.escape(BUILD)}/[^"]+)"', script):
                name = os.path.relpath(path, BUILD)
                # A link is made with the file that it leads to.
                if not os.path.isfile(path) or (name in outputs and made.isdisjoint({name, os.path.relpath(os.path.realpath(path), os.path.realpath(BUILD))})):
                    continue
                os.makedirs(os.path.dirname(os.path.join(copy, name)), exist_ok=True)
                if name != os.path.join(os.path.relpath(folder, BUILD), "cmake_install.cmake"):
                    shutil.copy2(path, os.path.join(copy, name), follow_symlinks=False)
            there = os.path.join(copy, os.path.relpath(folder, BUILD))
            os.makedirs(there, exist_ok=True)
            with open(os.path.join(there, "cmake_install.cmake"), "w", encoding="utf-8") as file:
                file.write(script.replace(BUILD + "/", copy + "/"))
        done = subprocess.run([CMAKE, "--install", copy, "--prefix", prefix], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if done.returncode:
        raise AssertionError(f"`cmake --install` after quickstart.sh:\n{done.stdout}")


class InAPrefix(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="volalign_install_")
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.prefix = os.path.join(cls.folder, "prefix")
        install(cls.prefix)
        cls.headers = os.path.join(cls.prefix, "include", "volalign")
        cls.work = os.path.join(cls.folder, "work")
        os.mkdir(cls.work)

    def run_in_work(self, *command, statuses=(0,)):
        environment = {key: value for key, value in os.environ.items() if key != "VOLALIGN_DATA_DIR"}
        done = subprocess.run(command, cwd=self.work, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
                              env={**environment, "LP_NUM_THREADS": "0"})
        self.assertIn(done.returncode, statuses, f"{command}: {done.stdout}")
        return done.stdout


class Installed(InAPrefix):
    hide = []

    def volalign(self, *arguments, **how):
        return self.run_in_work(*self.hide, os.path.join(self.prefix, "bin", "volalign"), *arguments, **how)

    def test_the_program(self):
        found = self.volalign("doctor")
        self.assertIn(os.path.join(self.prefix, "share", "volalign") + "\n", found)
        self.assertIn("everything is there", found)
        self.assertIn("loss:", self.volalign("config", "show", "configs/m05.yaml"))
        self.volalign("render", "--rig", "configs/rig_ring4.yaml", "-o", "capture")
        self.volalign("calibrate", "--capture", "capture/capture.json", "--model", "models/m05-lite.safetensors", "-o", "out")
        sensors = json.loads(text_of(os.path.join(self.work, "out", "extrinsics.json")))["sensors"]
        self.assertEqual([sensor["status"] for sensor in sensors.values()], ["ok"] * 4)


class WithoutSource(Installed):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        if cls.folder.startswith(os.path.join(SOURCE, "")):
            raise AssertionError("TMPDIR lies in the source tree")
        kept = os.path.join(cls.folder, "kept")
        os.mkdir(kept)
        cls.hide = ["unshare", "--map-root-user", "--mount", "bash", "-c", HIDE, "bash", SOURCE, os.path.join(SOURCE, "build", "libtorch"), kept]

    def test_the_source_is_hidden(self):
        self.volalign("structure", "show", os.path.join(SOURCE, "configs", "structure.yaml"), statuses=(1,))


class Libraries(InAPrefix):

    def configure(self, source, *options, status=0, without=WITHOUT_TORCH):
        """A build folder of the project in the folder `source`, and what CMake said."""
        build = tempfile.mkdtemp(dir=self.folder)
        command = [CMAKE, "-S", source, "-B", build, f"-DCMAKE_PREFIX_PATH={self.prefix}", f"-DCMAKE_CXX_COMPILER={CXX}", *without, *options]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        self.assertEqual(done.returncode, status, done.stdout)
        return build, done.stdout

    def project(self, name, lists, sources):
        folder = os.path.join(self.folder, name)
        os.makedirs(folder)
        for path, text in {"CMakeLists.txt": f"cmake_minimum_required(VERSION 3.25)\nproject({name} CXX)\n{lists}", **sources}.items():
            with open(os.path.join(folder, path), "w", encoding="utf-8") as file:
                file.write(text)
        return folder

    def build(self, folder):
        done = subprocess.run([CMAKE, "--build", folder, "-v"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        self.assertEqual(done.returncode, 0, done.stdout)
        return done.stdout

    def example(self, name, sensors, *arguments):
        """What the example, built without LibTorch, says of its sensors, which all are ok."""
        source = shutil.copytree(os.path.join(SOURCE, "examples", name), os.path.join(self.folder, name))
        folder, _ = self.configure(source, "-DCMAKE_BUILD_TYPE=Release")
        self.assertNotIn("torch", self.build(folder))
        program = os.path.join(folder, name)
        self.assertNotIn("torch", self.run_in_work("ldd", program))
        said = self.run_in_work(program, *arguments)
        self.assertEqual(re.findall(r"^\w+: (ok|weak|failed)", said, re.MULTILINE), ["ok"] * sensors, said)
        return said

    def test_the_example_in_memory(self):
        self.example("calibrate_in_memory", 3)

    def test_the_example_of_files(self):
        self.run_in_work(os.path.join(self.prefix, "bin", "volalign"), "render", "--rig", "configs/rig_ring4.yaml", "-o", "capture")
        said = self.example("calibrate_capture", 4, "capture/capture.json", os.path.join(SOURCE, "configs", "structure.yaml"))
        for name, truth in json.loads(text_of(os.path.join(self.work, "capture", "capture.json")))["ground_truth"].items():
            rows = re.search(rf"^{name}: ok.*\n((?:.*\n){{4}})", said, re.MULTILINE)[1].splitlines()
            self.assertLess(math.dist([float(row.split()[3]) for row in rows], [row[3] for row in truth]), 0.03, name)

    def test_a_program_with_parts_of_its_own_is_the_whole_program(self):
        source = shutil.copytree(os.path.join(SOURCE, "examples", "own_program"), os.path.join(self.folder, "own_program"))
        folder, _ = self.configure(source, without=[])
        self.build(folder)
        run = lambda command, *statuses: self.run_in_work(os.path.join(folder, "own_program"), *command.split(), statuses=statuses or (0,))
        of_work = lambda *names: text_of(os.path.join(self.work, *names))

        def has_its_parts(folder, optimizer="lion"):
            for word in ('kind: "dilated"', 'models: ["paper", "quadratic"]', 'terms: ["dice"]', f'optimizer: "{optimizer}"'):
                self.assertIn(word, of_work(folder, "config.yaml"))
            rows = [json.loads(row) for row in of_work(folder, "metrics.jsonl").splitlines()]
            self.assertTrue(all(row["loss_dice"] > 0 for row in rows))
            self.assertTrue(all(0 < row["accuracy"] < 1 for row in rows if row["type"] == "validation"))
            self.assertEqual({row["type"] for row in rows}, {"train", "validation"})

        run(f"train --config {source}/recipe.yaml -o run --set run.samples=32")
        run(f"train --config {source}/recipe.yaml -o run --resume")
        has_its_parts("run")
        with open(os.path.join(self.work, "sweep.yaml"), "w", encoding="utf-8") as file:
            file.write(f"recipes: [{source}/recipe.yaml]\nset: {{optim.optimizer: [lion, adamw]}}\n")
        run("train --sweep sweep.yaml --set run.samples=16 -o sweep")
        for optimizer in ("lion", "adamw"):
            has_its_parts(os.path.join("sweep", f"recipe_optim.optimizer={optimizer}"), optimizer)
        self.assertIn("64", run("validate --model run/model.safetensors --samples 8"))
        run("evaluate --rig configs/rig_ring4.yaml --set-rig noise=[paper,quadratic] --model run/model.safetensors -o evaluation")
        self.assertIn('noise: ["paper", "quadratic"]', of_work("evaluation", "rigs", "ring4.yaml"))
        self.assertIn("run/model.safetensors", of_work("evaluation", "evaluation.json"))
        run("render --rig configs/rig_ring4.yaml --set noise=quadratic -o own")
        # So short a training need not place every sensor.
        run("calibrate --capture own/capture.json --model run/model.safetensors --no-report -o result", 0, 2)
        self.assertIn("run/model.safetensors", of_work("result", "extrinsics.json"))
        self.assertIn("a network of kind 'dilated' cannot be exported", run("export --model run/model.safetensors --format onnx -o net.onnx", 1))

    def test_headers_need_no_flag_and_nothing_that_is_not_installed(self):
        # LibTorch's own headers are not to be had here.
        torch = re.compile(r"^(core/nn|infer/segment|train)/")
        names = [os.path.relpath(path, self.headers) for path in files_below(self.headers, (".h",))]
        names = [name for name in names if not torch.match(name)]
        self.assertIn("infer/calib/calibrate.h", names)
        source = self.project(
            "headers",
            "find_package(volalign REQUIRED COMPONENTS calibration files render)\nadd_library(headers OBJECT main.cc)\n"
            "target_link_libraries(headers PRIVATE volalign::calibration volalign::files volalign::render_egl)\n",
            {"main.cc": "".join(f'#include "{name}"\n' for name in names)},
        )
        folder, _ = self.configure(source)
        command = self.build(folder)
        self.assertIn("-DEIGEN_MAX_ALIGN_BYTES=16", command)
        self.assertNotRegex(command, r" -march| -ffp-contract| -W[a-z]| -fsanitize|" + re.escape(SOURCE + "/") + "| -I *" + re.escape(SOURCE))

    def test_nothing_names_this_machine(self):
        found = files_below(self.prefix, (".cmake", ".h"))
        self.assertGreater(len(found), 40)
        for path in found:
            for folder in (SOURCE, BUILD):
                self.assertNotIn(folder, text_of(path), path)
        packages = files_below(self.prefix, ("-targets.cmake",))
        self.assertGreater(len(packages), 2)
        for path in packages:
            for name, value in re.findall(r'(INTERFACE_\w+) "([^"]*)"', text_of(path)):
                self.assertNotRegex(value, "(^|;)[/-]", f"{name} in {path}")

    def test_headers_include_installed_headers_alone(self):
        for path in files_below(self.headers, (".h",)):
            for include in re.findall(r'^\s*#\s*include\s+"([^"]+)"', text_of(path), re.MULTILINE):
                self.assertTrue(os.path.exists(os.path.join(self.headers, include)), f"{path} includes {include}")

    def test_says_what_is_missing(self):
        source = self.project("missing", "find_package(volalign REQUIRED COMPONENTS nonsense)\n", {})
        self.assertIn("without the component nonsense", self.configure(source, status=1)[1])
        source = self.project("newer", "find_package(volalign 99 REQUIRED COMPONENTS calibration)\n", {})
        self.assertIn('requested version "99"', self.configure(source, status=1)[1])


if __name__ == "__main__":
    if not SOURCE:
        sys.exit(__doc__)
    unittest.main()
