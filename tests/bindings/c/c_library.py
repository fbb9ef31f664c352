#!/usr/bin/env python3
"""libvolalign_c as its callers have it: Python's ctypes and the C99 example.

    tests/bindings/c/c_library.py LIBRARY C_COMPILER PROGRAM SOURCE_FOLDER

The quick start's capture is rendered and calibrated by the program, and every caller has to find the program's poses.
"""

import ctypes
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest

from example_frames import poses_of, write_list

LIBRARY, COMPILER, PROGRAM, SOURCE = sys.argv[1:5] if len(sys.argv) > 4 else ("", "", "", "")
del sys.argv[1:5]
STRUCTURE = os.path.join(SOURCE, "configs", "structure.yaml")
MODEL = os.path.join(SOURCE, "models", "m05-lite.onnx")
SAME_POSE = 1e-9  # m and rad: the same code on the same numbers; the file has them with 17 digits
INVALID_ARGUMENT, CONFIG_ERROR, DATA_ERROR, IO_ERROR, STOPPED = range(1, 6)


class Frame(ctypes.Structure):
    _fields_ = [
        ("struct_size", ctypes.c_size_t), ("name", ctypes.c_char_p), ("sensor", ctypes.c_char_p), ("width", ctypes.c_int), ("height", ctypes.c_int),
        ("fx", ctypes.c_double), ("fy", ctypes.c_double), ("cx", ctypes.c_double), ("cy", ctypes.c_double),
        ("distortion_count", ctypes.c_int), ("distortion", ctypes.c_double * 8), ("depth", ctypes.c_void_p), ("raw", ctypes.c_void_p),
        ("raw_scale", ctypes.c_double), ("orientation_known", ctypes.c_int), ("quarter_turns", ctypes.c_int)]  # fmt: skip


class Sensor(ctypes.Structure):
    _fields_ = [
        ("struct_size", ctypes.c_size_t), ("name", ctypes.c_char_p), ("status", ctypes.c_int), ("code", ctypes.c_char_p), ("reason", ctypes.c_char_p),
        ("hint", ctypes.c_char_p), ("has_pose", ctypes.c_int), ("structure_from_sensor", ctypes.c_double * 16), ("covariance", ctypes.c_double * 36),
        ("sigma_position", ctypes.c_double * 3), ("rms_to_structure", ctypes.c_double), ("fx", ctypes.c_double), ("fy", ctypes.c_double),
        ("cx", ctypes.c_double), ("cy", ctypes.c_double), ("distortion_count", ctypes.c_int), ("distortion", ctypes.c_double * 8)]  # fmt: skip


class Finding(ctypes.Structure):
    _fields_ = [("struct_size", ctypes.c_size_t)] + [(name, ctypes.c_char_p) for name in ("code", "about", "reason", "hint")]


PROGRESS = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_char_p, ctypes.c_void_p)


def volalign(*arguments):
    subprocess.run([PROGRAM, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=SOURCE, check=True)


class CLibrary(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp(prefix="volalign_c_")
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        capture = os.path.join(cls.folder, "capture", "capture.json")
        volalign("render", "--rig", "configs/rig_ring8.yaml", "-o", os.path.dirname(capture))
        cls.capture = capture
        # What the capture knows of mountings, the frames do not.
        cls.list, cls.frames = write_list(capture, cls.folder)
        cls.library = ctypes.CDLL(LIBRARY)
        for function in ("tool", "last_error", "result_json"):
            getattr(cls.library, "volalign_" + function).restype = ctypes.c_char_p
        for function in ("capture", "options", "model", "result"):
            getattr(cls.library, f"volalign_{function}_free").argtypes = [ctypes.c_void_p]

        header = os.path.join(SOURCE, "bindings", "c")
        source = os.path.join(SOURCE, "examples", "calibrate_c", "main.c")
        cls.example = os.path.join(cls.folder, "calibrate_c")
        flags = ["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-I", header]
        subprocess.run([COMPILER, "-x", "c", *flags, source, "-x", "none", LIBRARY, "-o", cls.example], check=True)

        cls.expected = {}
        for name, model in (("geometry", ["--model", "none"]), ("model", ["--model", MODEL])):
            out = os.path.join(cls.folder, name)
            volalign("calibrate", "--capture", cls.capture, "-o", out, "--structure", STRUCTURE, "--no-report", *model)
            with open(os.path.join(out, "extrinsics.json"), encoding="utf-8") as file:
                cls.expected[name] = json.load(file)["sensors"]

    def assert_poses(self, found, which):
        """`found`: name -> 16 numbers or None."""
        sensors = self.expected[which]
        self.assertTrue(any(sensor["status"] == "ok" for sensor in sensors.values()))
        self.assertEqual(set(found), set(sensors))
        for name, sensor in sensors.items():
            pose = [x for row in sensor.get("structure_from_sensor", []) for x in row]
            self.assertEqual(found[name] is None, not pose, name)
            for a, b in zip(found[name] or [], pose):
                self.assertAlmostEqual(a, b, delta=SAME_POSE, msg=name)

    def call(self, function, *arguments, code=0):
        found = getattr(self.library, "volalign_" + function)(*arguments)
        self.assertEqual(found, code, self.error())
        return found

    def error(self):
        return self.library.volalign_last_error().decode()

    def handle(self, kind, create, *arguments):
        handle = ctypes.c_void_p()
        self.call(create, *arguments, ctypes.byref(handle))
        self.addCleanup(getattr(self.library, f"volalign_{kind}_free"), handle)
        return handle

    def frame(self, number=0, metres=False):
        """A frame, and what has to live as long."""
        sensor, width, height, depth = self.frames[number]
        k = sensor["intrinsics"]
        frame = Frame(struct_size=ctypes.sizeof(Frame), name=sensor["name"].encode(), sensor=sensor.get("sensor", "").encode(), width=width, height=height,
                      fx=k["fx"], fy=k["fy"], cx=k["cx"], cy=k["cy"])  # fmt: skip
        for i, value in enumerate(k.get("distortion", [])):
            frame.distortion[i] = value
            frame.distortion_count = i + 1
        pixels = (ctypes.c_float * len(depth))(*(z / 1000 for z in depth)) if metres else (ctypes.c_uint16 * len(depth))(*depth)
        setattr(frame, "depth" if metres else "raw", ctypes.addressof(pixels))
        frame.raw_scale = 0.001
        return frame, pixels

    def memory(self, metres=False, raw_scale=0.001):
        capture = self.handle("capture", "capture_create", STRUCTURE.encode())
        for number in range(len(self.frames)):
            frame, pixels = self.frame(number, metres)
            frame.raw_scale = raw_scale
            self.call("capture_add", capture, ctypes.byref(frame))
            del pixels  # copied
        return capture

    def calibrate(self, capture, model=None, options=None, progress=None, code=0):
        result = ctypes.c_void_p()
        self.call("calibrate", capture, model, options, PROGRESS(progress) if progress else None, None, ctypes.byref(result), code=code)
        self.addCleanup(self.library.volalign_result_free, result)
        return result

    def sensors(self, result):
        found = []
        for index in range(self.library.volalign_result_count(result)):
            sensor = Sensor(struct_size=ctypes.sizeof(Sensor))
            self.call("result_sensor", result, index, ctypes.byref(sensor))
            found.append(sensor)
        return found

    def poses(self, result):
        return {s.name.decode(): list(s.structure_from_sensor) if s.has_pose else None for s in self.sensors(result)}

    def test_frames_in_memory_with_a_model(self):
        model = self.handle("model", "model_load", MODEL.encode())
        stages = []
        result = self.calibrate(self.memory(), model, progress=lambda stage, _: stages.append(stage) or 0)
        self.assert_poses(self.poses(result), "model")
        self.assertIn(b"first poses", stages)
        written = json.loads(self.library.volalign_result_json(result))
        self.assertEqual(written["tool"], self.library.volalign_tool().decode())
        self.assertEqual(written["capture"], "memory")
        self.assertIn("OpenCV", written["model"]["runtime"])
        for index, sensor in enumerate(self.sensors(result)):
            expected = self.expected["model"][sensor.name.decode()]
            self.assertEqual(["ok", "weak", "failed"][sensor.status], expected["status"])
            for a, b in zip(sensor.covariance, [x for row in expected["covariance"] for x in row]):
                self.assertAlmostEqual(a, b, delta=1e-12)
            _, width, height, _ = self.frames[index]
            labels = (ctypes.c_uint8 * (width * height))()
            self.call("result_labels", result, index, 0, labels, ctypes.c_size_t(width * height))
            self.assertGreater(len(set(labels)), 3)
            self.call("result_labels", result, index, 0, labels, ctypes.c_size_t(width), code=INVALID_ARGUMENT)
            self.call("result_labels", result, index, 1, labels, ctypes.c_size_t(width * height), code=INVALID_ARGUMENT)
        out = os.path.join(self.folder, "saved")
        self.call("result_save", result, out.encode(), 1)
        for file in ("extrinsics.json", "report.html", "options.yaml", "clouds/merged.ply"):
            self.assertTrue(os.path.exists(os.path.join(out, file)), file)

    def test_a_capture_file_and_metres_without_a_model(self):
        read = self.handle("capture", "capture_read", self.capture.encode(), STRUCTURE.encode())
        self.assert_poses(self.poses(self.calibrate(read)), "geometry")
        found = self.poses(self.calibrate(self.memory(metres=True)))
        self.assertEqual(set(found), set(self.expected["geometry"]))

    def test_findings(self):
        result = self.calibrate(self.memory(raw_scale=0.00105))
        written = json.loads(self.library.volalign_result_json(result))["findings"]
        self.assertIn("size_off", [finding["code"] for finding in written])
        self.assertEqual(self.library.volalign_result_finding_count(result), len(written))
        for index, expected in enumerate(written):
            finding = Finding(struct_size=ctypes.sizeof(Finding))
            self.call("result_finding", result, index, ctypes.byref(finding))
            for name in ("code", "reason", "hint"):
                self.assertEqual(getattr(finding, name).decode(), expected[name])
            self.assertEqual(finding.about.decode(), "\n".join(expected.get("about", [])))
        self.call("result_finding", result, len(written), ctypes.byref(finding), code=INVALID_ARGUMENT)
        self.assertEqual(self.library.volalign_result_finding_count(None), 0)

    def test_stopping(self):
        calls = []
        self.calibrate(self.memory(), progress=lambda stage, _: calls.append(stage) or len(calls) == 2, code=STOPPED)
        self.assertEqual(len(calls), 2)
        self.assertIn(calls[1].decode(), self.error())

    def test_options(self):
        options = self.handle("options", "options_create", None)
        self.call("options_set", options, b"refine.size_sigma_percent", b"0.7")
        self.call("options_set", options, b"refine.size_sigma_procent", b"0.7", code=CONFIG_ERROR)
        self.assertIn("size_sigma_procent", self.error())
        self.call("options_set", options, b"threads", b"0", code=CONFIG_ERROR)
        # What was refused leaves the options as they were.
        self.call("options_set", options, b"threads", b"1")
        network = self.handle("options", "options_create", None)
        self.call("options_set", network, b"initial.method", b"network")
        self.calibrate(self.memory(), options=network, code=CONFIG_ERROR)

    def test_errors_say_what_is_wrong(self):
        nothing = ctypes.c_void_p()
        self.call("capture_create", b"no_such.yaml", ctypes.byref(nothing), code=IO_ERROR)
        self.assertIn("no_such.yaml", self.error())
        self.assertIsNone(nothing.value)
        self.call("capture_create", None, ctypes.byref(nothing), code=INVALID_ARGUMENT)
        self.call("capture_create", STRUCTURE.encode(), None, code=INVALID_ARGUMENT)
        self.call("model_load", STRUCTURE.encode(), ctypes.byref(nothing), code=DATA_ERROR)
        self.call("capture_add", None, None, code=INVALID_ARGUMENT)
        self.call("capture_create", b"\xff.yaml", ctypes.byref(nothing), code=DATA_ERROR)
        self.assertIn('"\\xff.yaml" is not UTF-8', self.error())
        self.calibrate(None, code=INVALID_ARGUMENT)
        self.assertEqual(self.library.volalign_result_count(None), 0)
        capture = self.handle("capture", "capture_create", STRUCTURE.encode())
        self.calibrate(capture, code=DATA_ERROR)
        for change, code in (({"struct_size": 8}, INVALID_ARGUMENT), ({"name": None}, INVALID_ARGUMENT), ({"name": b"a/b"}, DATA_ERROR), ({"name": b"\xff\xfe"}, DATA_ERROR),
                             ({"width": 2**31 - 1, "height": 2**31 - 1}, DATA_ERROR), ({"sensor": b"\x1b[31m"}, DATA_ERROR),
                             ({"raw": None}, INVALID_ARGUMENT), ({"raw_scale": 0}, INVALID_ARGUMENT), ({"fx": -1}, DATA_ERROR), ({"width": 0}, DATA_ERROR),
                             ({"distortion_count": 9}, INVALID_ARGUMENT), ({"orientation_known": 1, "quarter_turns": 4}, INVALID_ARGUMENT)):  # fmt: skip
            frame, pixels = self.frame()
            for key, value in change.items():
                setattr(frame, key, value)
            self.call("capture_add", capture, ctypes.byref(frame), code=code)
            self.assertNotEqual(self.error(), "")
            del pixels

    def test_a_second_still(self):
        capture = self.memory()
        self.call("capture_next_still", capture)
        frame, pixels = self.frame()
        self.call("capture_add", capture, ctypes.byref(frame))
        del pixels
        self.calibrate(capture, code=DATA_ERROR)
        self.assertIn("same depth map", self.error())

    def test_nothing_else_is_exported_and_no_torch_is_loaded(self):
        names = subprocess.run(["nm", "-D", "--defined-only", LIBRARY], stdout=subprocess.PIPE, text=True, check=True).stdout
        exported = {line.split()[-1].split("@")[0] for line in names.splitlines()}
        self.assertEqual({name for name in exported if not name.startswith("volalign_")}, set())
        with open(os.path.join(SOURCE, "bindings", "c", "volalign.h"), encoding="utf-8") as file:
            header = file.read()
        for name in exported:
            self.assertIn(name + "(", header)
        self.assertEqual(header.count("VOLALIGN_API ") - header.count("define VOLALIGN_API "), len(exported))
        libraries = subprocess.run(["ldd", LIBRARY], stdout=subprocess.PIPE, text=True, check=True).stdout
        self.assertNotIn("torch", libraries)
        self.assertNotIn("not found", libraries)

    def test_the_c99_example(self):
        out = os.path.join(self.folder, "example")
        for which, model in (("model", MODEL), ("geometry", "-")):
            done = subprocess.run([self.example, STRUCTURE, model, self.list, out], stdout=subprocess.PIPE, text=True,
                                  env=dict(os.environ, LD_LIBRARY_PATH=os.path.dirname(LIBRARY)), check=False)  # fmt: skip
            self.assertIn(done.returncode, (0, 3))
            self.assert_poses(poses_of(done.stdout), which)
            with open(os.path.join(out, "extrinsics.json"), encoding="utf-8") as file:
                self.assertEqual("OpenCV" in json.load(file).get("model", {}).get("runtime", ""), which == "model")


if __name__ == "__main__":
    unittest.main()
