#!/usr/bin/env python3
"""Depth maps of the paper's stack in a room of boxes by pyrender on Mesa's EGL: serves samples_per_second.py.

    pyrender_depth.py SECONDS

One 320x180 depth map after another for so many seconds, each from another pose: the boxes, six sides of a room and 20 boxes of furniture, as one mesh each, in
pyrender's own depth-only pass. No labels, no noise, no new scene: less than a sample of volalign. Prints {"samples_per_s", "cpu_ms"} as JSON. Needs pyrender,
trimesh and numpy < 2 (pyrender 0.1.45).
"""

import json
import math
import os
import sys
import time

os.environ["PYOPENGL_PLATFORM"] = "egl"
import numpy as np
import pyrender
import trimesh

WARM = 20  # frames before the clock runs


def box(low, high):
    return trimesh.creation.box(bounds=np.array([low, high]) / 1000)


def scene():
    boxes = [([-280, -810, -165], [275, -405, 165]), ([-280, -405, -390], [50, 0, 165]), ([-505, 0, -165], [50, 405, 165]), ([-280, 405, -165], [50, 810, 390])]
    wall = 3500  # mm
    boxes += [([-wall, -910, -wall], [wall, -810, wall]), ([-wall, 1800, -wall], [wall, 1900, wall])]
    boxes += [([s * wall - 50, -810, -wall], [s * wall + 50, 1800, wall]) for s in (-1, 1)] + [([-wall, -810, s * wall - 50], [wall, 1800, s * wall + 50]) for s in (-1, 1)]
    random = np.random.default_rng(1)
    for angle in random.uniform(0, 2 * math.pi, 20):
        at = np.array([2900 * math.cos(angle), -810, 2900 * math.sin(angle)])
        size = random.uniform(200, 1200, 3)
        boxes.append((at - [size[0] / 2, 0, size[2] / 2], at + [size[0] / 2, size[1], size[2] / 2]))
    result = pyrender.Scene()
    for low, high in boxes:
        result.add(pyrender.Mesh.from_trimesh(box(low, high), smooth=False))
    return result


def look_at(eye):
    z = eye / np.linalg.norm(eye)
    x = np.cross([0, 1, 0], z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3] = np.column_stack([x, np.cross(z, x), z, eye])
    return pose


def main():
    seconds = float(sys.argv[1])
    world = scene()
    camera = world.add(pyrender.IntrinsicsCamera(fx=230, fy=230, cx=160, cy=90, znear=0.05, zfar=20))
    renderer = pyrender.OffscreenRenderer(320, 180)
    random = np.random.default_rng(2)
    frames, seen = 0, 0.0
    start = used = 0.0
    while frames <= WARM or time.perf_counter() < start + seconds:
        if frames == WARM:
            start, used = time.perf_counter(), time.process_time()
        rho, phi, height = random.uniform(1.5, 2.25), random.uniform(0, 2 * math.pi), random.uniform(-0.3, 0.6)
        world.set_pose(camera, look_at(np.array([rho * math.cos(phi), height, rho * math.sin(phi)])))
        seen = float(np.count_nonzero(renderer.render(world, flags=pyrender.RenderFlags.DEPTH_ONLY))) / (320 * 180)
        frames += 1
    if seen < 0.9:
        sys.exit(f"only {100 * seen:.0f} % of the last frame have depth: nothing was measured")
    count = frames - WARM
    print(json.dumps({"samples_per_s": count / (time.perf_counter() - start), "cpu_ms": 1000 * (time.process_time() - used) / count}))


if __name__ == "__main__":
    main()
