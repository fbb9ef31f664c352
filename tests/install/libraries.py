#!/usr/bin/env python3
"""Can a C++ program use what is installed, without LibTorch?

    tests/install/libraries.py CMAKE BUILD_FOLDER SOURCE_FOLDER CXX

Installs what ./quickstart.sh builds to a new prefix, and builds examples/calibrate_in_memory against it where CMake finds no LibTorch. The
program with parts of its own, examples/own_program, is built against it, trains by its recipe, and does with the result what volalign does.
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

import quickstart_build

CMAKE, BUILD, SOURCE, CXX = sys.argv[1:5] if len(sys.argv) > 4 else ("", "", "", "")
del sys.argv[1:5]

WITHOUT_TORCH = ["-DCMAKE_DISABLE_FIND_PACKAGE_Torch=ON", "-DCMAKE_FIND_USE_PACKAGE_REGISTRY=OFF"]


def files_below(folder, extensions):
    found = [os.path.join(where, name) for where, _, names in os.walk(folder) for name in names]
    return sorted(path for path in found if path.endswith(extensions))


def text_of(path):
    with open(path, encoding="utf-8") as file:
        return file.read()


class Libraries(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="volalign_libraries_")
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.prefix = os.path.join(cls.folder, "prefix")
        quickstart_build.install(CMAKE, BUILD, SOURCE, cls.prefix)
        cls.headers = os.path.join(cls.prefix, "include", "volalign")

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

    def test_the_examples_calibrate_without_libtorch(self):
        run = lambda *command: subprocess.run(command, cwd=self.folder, stdout=subprocess.PIPE, text=True, check=False, env={**os.environ, "LP_NUM_THREADS": "0"})
        volalign = os.path.join(self.prefix, "bin", "volalign")
        self.assertEqual(run(volalign, "render", "--rig", "configs/rig_ring4.yaml", "-o", "capture").returncode, 0)
        boxes = os.path.join(SOURCE, "configs", "structure.yaml")
        for name, sensors, arguments in (("calibrate_in_memory", 3, []), ("calibrate_capture", 4, ["capture/capture.json", boxes])):
            source = shutil.copytree(os.path.join(SOURCE, "examples", name), os.path.join(self.folder, name))
            folder, _ = self.configure(source, "-DCMAKE_BUILD_TYPE=Release")
            self.assertNotIn("torch", self.build(folder))
            program = os.path.join(folder, name)
            said = run(program, *arguments).stdout
            self.assertEqual(re.findall(r"^\w+: (ok|weak|failed)", said, re.MULTILINE), ["ok"] * sensors, said)
            self.assertNotIn("torch", run("ldd", program).stdout)
        # The last one has printed its poses, too.
        for name, truth in json.loads(text_of(os.path.join(self.folder, "capture", "capture.json")))["ground_truth"].items():
            rows = re.search(rf"^{name}: ok.*\n((?:.*\n){{4}})", said, re.MULTILINE)[1].splitlines()
            self.assertLess(math.dist([float(row.split()[3]) for row in rows], [row[3] for row in truth]), 0.03, name)

    def test_a_program_with_parts_of_its_own_is_the_whole_program(self):
        source = shutil.copytree(os.path.join(SOURCE, "examples", "own_program"), os.path.join(self.folder, "own_program"))
        folder, _ = self.configure(source, without=[])
        self.build(folder)
        empty = os.path.join(self.folder, "empty")
        os.mkdir(empty)
        environment = {key: value for key, value in os.environ.items() if key != "VOLALIGN_DATA_DIR"}

        def run(command, *statuses):
            done = subprocess.run([os.path.join(folder, "own_program"), *command.split()], cwd=empty, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                                  text=True, check=False, env={**environment, "LP_NUM_THREADS": "0"})
            self.assertIn(done.returncode, statuses or (0,), f"{command}: {done.stdout}")
            return done.stdout

        run(f"train --config {source}/recipe.yaml -o run --set run.samples=32")
        recipe = text_of(os.path.join(empty, "run", "config.yaml"))
        for word in ('kind: "dilated"', 'models: ["paper", "quadratic"]', 'terms: ["dice"]'):
            self.assertIn(word, recipe)
        run(f"train --config {source}/recipe.yaml -o run --resume")
        for row in text_of(os.path.join(empty, "run", "metrics.jsonl")).splitlines():
            self.assertGreater(json.loads(row)["loss_dice"], 0)
        self.assertIn("64", run("validate --model run/model.safetensors --samples 8"))
        run("render --rig configs/rig_ring4.yaml -o capture")
        # So short a training need not place every sensor.
        run("calibrate --capture capture/capture.json --model run/model.safetensors --no-report -o result", 0, 2)
        self.assertIn("run/model.safetensors", text_of(os.path.join(empty, "result", "extrinsics.json")))
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
