#!/usr/bin/env python3
"""Do Open3D and COLMAP's own readers understand what `volalign convert` writes?

    tests/compat/read_poses.py VOLALIGN      (the program)

Needs `open3d` and `pycolmap` of PyPI.
"""

import json
import os
import runpy
import sys
import types
import xml.etree.ElementTree

import numpy as np
import open3d
import pycolmap

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "cli"))
from program import InAFolder, main  # noqa: E402


def some_poses():
    """Three sensors round a stack, one without a lens, as a file of --to poses has them."""
    sensors = []
    for i, distortion in enumerate([None, [0.1, -0.05, 1e-3, 2e-3], [5.4, 3.6, 1e-4, -2e-4, 0.18, 5.7, 5.5, 0.95]]):
        phi = 0.4 + 2.0 * i
        forward = -np.array([np.cos(phi), 0.2, np.sin(phi)])
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 1, 0])
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
        pose[:3, 3] = -2 * forward
        intrinsics = {"width": 320, "height": 288, "fx": 252.5, "fy": 251.25, "cx": 163.1, "cy": 170.2}
        if distortion:
            intrinsics["distortion"] = distortion
        sensors.append({"name": f"S{i}", "structure_from_sensor": pose.tolist(), "intrinsics": intrinsics})
    return sensors


def project(sensor, world):
    """The pixel of a point, centres at integer coordinates, by OpenCV's documented model."""
    p = np.linalg.inv(sensor["structure_from_sensor"]) @ np.append(world, 1)
    k = sensor["intrinsics"]
    d = np.zeros(8)
    d[: len(k.get("distortion", []))] = k.get("distortion", [])
    x, y = p[:2] / p[2]
    r2 = x * x + y * y
    radial = (1 + d[0] * r2 + d[1] * r2**2 + d[4] * r2**3) / (1 + d[5] * r2 + d[6] * r2**2 + d[7] * r2**3)
    u = x * radial + 2 * d[2] * x * y + d[3] * (r2 + 2 * x * x)
    v = y * radial + d[2] * (r2 + 2 * y * y) + 2 * d[3] * x * y
    return np.array([k["fx"] * u + k["cx"], k["fy"] * v + k["cy"]])


class Poses(InAFolder):
    def convert(self, word, name):
        self.expect(f"convert poses.json --from poses --to {word} -o {name}", 0)
        return self.path(name)

    def test_they_are_read_as_they_are_meant(self):
        sensors = some_poses()
        self.write("poses.json", json.dumps({"format": "volalign.poses/1", "convention": "", "sensors": sensors}))
        for word, name in (("open3d", "trajectory.json"), ("open3d_log", "trajectory.log")):
            cameras = open3d.io.read_pinhole_camera_trajectory(self.convert(word, name)).parameters
            assert len(cameras) == len(sensors), (word, len(cameras))
            for camera, sensor in zip(cameras, sensors):
                expected = np.linalg.inv(sensor["structure_from_sensor"])
                assert np.allclose(camera.extrinsic, expected, atol=1e-9), (word, sensor["name"])
                if word == "open3d":
                    k = sensor["intrinsics"]
                    assert np.allclose(camera.intrinsic.intrinsic_matrix,
                                       [[k["fx"], 0, k["cx"]], [0, k["fy"], k["cy"]], [0, 0, 1]]), sensor["name"]

        model = pycolmap.Reconstruction(self.convert("colmap", "colmap"))
        assert model.num_images() == len(sensors)
        for image in model.images.values():
            sensor = next(s for s in sensors if s["name"] == image.name)
            world = np.array([0.15, -0.1, 0.2])
            # The upper left pixel's centre is at (.5, .5) in COLMAP.
            theirs = image.project_point(world)
            assert np.allclose(theirs, project(sensor, world) + 0.5, atol=1e-6), (image.name, theirs)

    def test_numpy_and_ros_read_theirs(self):
        sensors = some_poses()
        for i, sensor in enumerate(sensors):
            sensor.update(depth_gain=1 + 0.01 * i, depth_offset_m=-0.004 * i)
        self.write("poses.json", json.dumps({"format": "volalign.poses/1", "convention": "", "sensors": sensors}))
        folder = self.convert("depth_correction", "corrections")
        for sensor in sensors:
            x, y, gain, offset = np.moveaxis(np.load(os.path.join(folder, sensor["name"] + ".npy")), 2, 0)
            assert x.shape == (288, 320) and x.dtype == np.float32
            for u, v, measured in ((160, 144, 1.9), (40, 200, 2.5)):
                z = gain[v, u] * measured + offset[v, u]
                assert abs(z - (sensor["depth_gain"] * measured + sensor["depth_offset_m"])) < 1e-6
                world = sensor["structure_from_sensor"] @ np.array([x[v, u] * z, y[v, u] * z, z, 1])
                assert np.allclose(project(sensor, world[:3]), [u, v], atol=1e-3), sensor["name"]

        started = []
        launch, actions = types.ModuleType("launch"), types.ModuleType("launch_ros.actions")
        launch.LaunchDescription, actions.Node = list, lambda **node: started.append(node)
        sys.modules.update({"launch": launch, "launch_ros": types.ModuleType("launch_ros"), "launch_ros.actions": actions})
        runpy.run_path(self.convert("ros_launch", "rig.launch.py"))["generate_launch_description"]()
        frames = [dict(zip(node["arguments"][::2], node["arguments"][1::2]))["--child-frame-id"] for node in started]
        assert frames == [sensor["name"] + "_depth_optical_frame" for sensor in sensors]
        joints = xml.etree.ElementTree.parse(self.convert("urdf", "rig.urdf")).getroot().findall("joint")
        assert [joint.find("child").get("link") for joint in joints] == frames


if __name__ == "__main__":
    main(__doc__)
