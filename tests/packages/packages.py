#!/usr/bin/env python3
"""The Debian packages: made twice, unpacked into a root of their own, and used there.

    tests/packages/packages.py CMAKE BUILD_FOLDER SOURCE_FOLDER
"""

import filecmp
import glob
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
CMAKE, BUILD, SOURCE = sys.argv[1:4] if len(sys.argv) > 3 else ("", "", "")
del sys.argv[1:4]
sys.path.insert(0, os.path.join(SOURCE, "tests", "bindings", "c"))
from example_frames import poses_of, write_list  # noqa: E402


def run(*command, **options):
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False, **options)
    if done.returncode != 0:
        raise AssertionError(f"{' '.join(command)}: status {done.returncode}\n{done.stdout}")
    return done.stdout


class Packages(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="volalign_packages_")
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.made, cls.root = [os.path.join(cls.folder, name) for name in ("first", "second")], os.path.join(cls.folder, "root")
        for out in cls.made:
            run(os.path.join(SOURCE, "packaging", "deb.sh"), out, BUILD, env=dict(os.environ, SOURCE_DATE_EPOCH="1764000000"))
        cls.packages = {os.path.basename(path).split("_")[0]: path for path in glob.glob(os.path.join(cls.made[0], "*.deb"))}
        for path in cls.packages.values():
            run("dpkg-deb", "-x", path, cls.root)
        # As after their installation, with the root's libraries and nothing of the source tree.
        cls.usr = os.path.join(cls.root, "usr")
        cls.environment = {
            "PATH": os.path.join(cls.usr, "bin") + ":" + os.environ["PATH"],
            "HOME": cls.folder,
            "LD_LIBRARY_PATH": os.path.join(cls.usr, "lib"),
            "LP_NUM_THREADS": "0",
        }
        cls.work = os.path.join(cls.folder, "work")
        os.makedirs(cls.work)
        cls.use("volalign", "render", "--rig", "configs/rig_ring8.yaml", "-o", "capture")
        for model, out in (("safetensors", "calibration"), ("onnx", "by_onnx")):
            cls.use("volalign", "calibrate", "--capture", "capture/capture.json", "--model", f"models/m05-lite.{model}", "-o", out)
        cls.list, _ = write_list(os.path.join(cls.work, "capture", "capture.json"), cls.work)

    @classmethod
    def use(cls, *command, **environment):
        return run(*command, cwd=cls.work, env={**cls.environment, **environment})

    def field(self, package, name):
        return run("dpkg-deb", "-f", self.packages[package], name).strip()

    def test_names_and_dependencies(self):
        self.assertLessEqual({"volalign", "libvolalign-c0", "libvolalign-dev", "python3-volalign"}, set(self.packages))
        with open(os.path.join(SOURCE, "CMakeLists.txt"), encoding="utf-8") as file:
            version = file.read().split("project(volalign VERSION ")[1].split()[0]
        for package in self.packages:
            self.assertEqual(self.field(package, "Version"), version)
        self.assertIn("libtorch", self.field("volalign", "Depends"))
        for package in ("libvolalign-c0", "python3-volalign"):
            depends = self.field(package, "Depends")
            self.assertIn("libopencv", depends)
            self.assertNotIn("torch", depends)
        self.assertIn("python3-numpy", self.field("python3-volalign", "Depends"))
        for library in ("libceres-dev", "libeigen3-dev", "libvolalign-c0"):
            self.assertIn(library, self.field("libvolalign-dev", "Depends"))

    def test_they_are_equal_twice(self):
        for path in self.packages.values():
            again = os.path.join(self.made[1], os.path.basename(path))
            self.assertTrue(filecmp.cmp(path, again, shallow=False), os.path.basename(path))

    def test_nothing_names_the_source_tree(self):
        for package, path in self.packages.items():
            root = os.path.join(self.folder, "search", package)
            os.makedirs(root)
            run("dpkg-deb", "-x", path, root)
            found = subprocess.run(["grep", "-rlaF", SOURCE + "/", root], stdout=subprocess.PIPE, text=True, check=False).stdout
            self.assertEqual(found, "", package)

    def test_the_quick_start(self):
        with open(os.path.join(self.work, "calibration", "extrinsics.json"), encoding="utf-8") as file:
            sensors = json.load(file)["sensors"]
        self.assertEqual([sensor["status"] for sensor in sensors.values()], ["ok"] * 8)
        self.assertTrue(os.path.exists(os.path.join(self.work, "calibration", "report.html")))
        self.assertIn("everything is there", self.use("volalign", "doctor"))

    def test_the_c_example(self):
        # pkg-config's words are without the root, as in a package.
        words = self.use("pkg-config", "--cflags", "--libs", "volalign_c", PKG_CONFIG_LIBDIR=os.path.join(self.usr, "lib", "pkgconfig")).split()
        program = os.path.join(self.work, "calibrate_c")
        self.use("cc", "-std=c99", os.path.join(SOURCE, "examples", "calibrate_c", "main.c"), "-o", program, *words)
        self.expect_poses(program)

    def expect_poses(self, *example):
        """The example calibrates the quick start's capture by the installed network, and finds the program's poses."""
        data = os.path.join(self.usr, "share", "volalign")
        command = [*example, os.path.join(data, "configs", "structure.yaml"), os.path.join(data, "models", "m05-lite.onnx"), self.list]
        output = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, cwd=self.work, env=self.environment).stdout
        with open(os.path.join(self.work, "by_onnx", "extrinsics.json"), encoding="utf-8") as file:
            sensors = json.load(file)["sensors"]
        found = poses_of(output)
        self.assertEqual(set(found), set(sensors))
        for name, sensor in sensors.items():
            for a, b in zip(found[name], [x for row in sensor["structure_from_sensor"] for x in row]):
                # The capture says how the sensors are mounted, the example's list does not: the solver comes from elsewhere.
                self.assertAlmostEqual(a, b, delta=1e-6, msg=name)

    def test_the_cplusplus_example(self):
        build = os.path.join(self.work, "in_memory")
        self.use(CMAKE, "-S", os.path.join(SOURCE, "examples", "calibrate_in_memory"), "-B", build, "-DCMAKE_PREFIX_PATH=" + self.usr)
        self.use(CMAKE, "--build", build)
        self.assertIn("sensor0: ok", self.use(os.path.join(build, "calibrate_in_memory")))

    def test_the_python_package(self):
        code = (
            "import volalign; capture = volalign.Capture.load('capture/capture.json');"
            "result = volalign.calibrate(capture); print(volalign.__file__, sorted(s.status for s in result.sensors.values()))"
        )
        said = self.use("/usr/bin/python3", "-c", code, PYTHONPATH=os.path.join(self.usr, "lib", "python3", "dist-packages"))
        self.assertIn(self.usr, said)
        self.assertEqual(said.count("'ok'"), 8, said)


if __name__ == "__main__":
    unittest.main()
