#!/usr/bin/env python3
"""Do other programs' readers understand rig.glb?

    tests/report/rig_test.py FOLDER     (of make_report.py)

Needs `trimesh` and `pygltflib` of PyPI.
"""

import json
import math
import os
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))

import numpy as np
import pygltflib
import trimesh


def main(folder):
    rig, sensors = os.path.join(folder, "calibration", "rig.glb"), json.load(open(os.path.join(folder, "calibration", "extrinsics.json")))["sensors"]
    placed = {name: np.array(sensor["structure_from_sensor"]) for name, sensor in sensors.items() if "structure_from_sensor" in sensor}
    assert len(placed) == 3 and len(sensors) == 4

    scene = trimesh.load(rig, force="scene")
    flip = np.diag([1.0, -1, -1, 1])
    for name, pose in placed.items():
        found, _ = scene.graph[name]
        assert np.allclose(found, pose @ flip, atol=1e-6), name
        transform, geometry = scene.graph[f"{name} points"]
        points = trimesh.transform_points(scene.geometry[geometry].vertices, transform)
        # In front of the sensor, in its picture, and not all in one place.
        seen = trimesh.transform_points(points, np.linalg.inv(pose))
        k = sensors[name]["intrinsics"]
        assert (seen[:, 2] > 0.3).all(), name
        if not any(k.get("distortion", [])):
            u, v = k["fx"] * seen[:, 0] / seen[:, 2] + k["cx"], k["fy"] * seen[:, 1] / seen[:, 2] + k["cy"]
            assert (abs(u - (k["width"] - 1) / 2) <= k["width"] / 2 + 0.1).all() and (abs(v - (k["height"] - 1) / 2) <= k["height"] / 2 + 0.1).all(), name
        assert points.std(axis=0).min() > 0.1, name
        assert len(scene.geometry[geometry].colors) == len(points), name

    # The stack: four closed boxes of the paper's size, 555 x 330 x 405 mm each.
    boxes = [geometry for node in scene.graph.nodes_geometry for geometry in [scene.graph[node][1]] if isinstance(scene.geometry[geometry], trimesh.Trimesh)]
    area = sum(scene.geometry[geometry].area for geometry in boxes)
    assert abs(area - 4 * 2 * (0.555 * 0.330 + 0.555 * 0.405 + 0.330 * 0.405)) < 0.05 * area, area

    gltf = pygltflib.GLTF2().load(rig)
    for node in gltf.nodes:
        if node.camera is None:
            continue
        camera = gltf.cameras[node.camera]
        k = sensors[camera.name.removesuffix(" camera")]["intrinsics"]
        assert math.isclose(math.tan(camera.perspective.yfov / 2), k["height"] / 2 / k["fy"], rel_tol=1e-6)
    assert sorted(camera.name for camera in gltf.cameras) == sorted(f"{name} camera" for name in placed)
    print(f"{len(placed)} sensors, {len(boxes)} surfaces of boxes, {len(gltf.accessors)} accessors: read and compared")


if __name__ == "__main__":
    main(os.path.abspath(sys.argv[1]))
