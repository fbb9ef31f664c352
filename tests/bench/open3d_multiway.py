#!/usr/bin/env python3
"""volalign's joint refinement beside Open3D's multiway registration.

Renders captures with the volalign program, calibrates them, and gives Open3D's documented pipeline (voxel downsampling,
normals, pairwise point-to-plane ICP from coarse to fine, pose graph, global optimisation) the same depth maps and the same
initial poses. Open3D knows no structure, so its absolute frame is free: every method's poses, ours too, are aligned
with the true ones as a set before absolute errors are taken; relative errors between sensors need no alignment.

Needs Debian's python3-open3d and python3-opencv (run with /usr/bin/python3), numpy and a built volalign. One command prints the table:

    /usr/bin/python3 tests/bench/open3d_multiway.py --program build/release/cli/volalign --model models/m05-lite.safetensors \\
        --rig configs/rig_ring8.yaml --seeds 1000:1003 -o out/open3d
"""

import argparse
import itertools
import json
import pathlib
import re
import sys
import time

import cv2
import numpy as np
import open3d as o3d

from common import D415, KINECT, run
from accuracy import best_rigid, errors

SENSORS = [KINECT, D415]

# Correspondence distances in voxels. `documented`: as in Open3D's multiway tutorial, all pairs. `near`: for initial poses that
# are a few centimetres off, and only pairs of which a tenth overlaps, which helps where most sensors face one another.
SETTINGS = {
    "documented": {"coarse": 15.0, "fine": 1.5, "min_overlap": 0.0},
    "near": {"coarse": 4.0, "fine": 1.5, "min_overlap": 0.1},
}


def rays_of(k):
    """x/z and y/z of every pixel."""
    u, v = np.meshgrid(np.arange(k["width"], dtype=float), np.arange(k["height"]))
    matrix = np.array([[k["fx"], 0, k["cx"]], [0, k["fy"], k["cy"]], [0, 0, 1]])
    lens, until = np.array(k.get("distortion") or [0.0] * 4), (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-9)
    rays = cv2.undistortPointsIter(np.dstack([u, v]).reshape(-1, 1, 2), matrix, lens, np.eye(3), np.eye(3), until)
    return np.moveaxis(rays.reshape(*u.shape, 2), 2, 0)


def read_capture(folder):
    """Points (N x 3, sensor frame, m) and labels of every sensor, and the true poses."""
    capture = json.loads((folder / "capture.json").read_text())
    clouds, truth = {}, {}
    for sensor in capture["sensors"]:
        name, k = sensor["name"], sensor["intrinsics"]
        scale = sensor.get("depth_scale", capture.get("depth_scale"))
        z = np.asarray(o3d.io.read_image(str(folder / sensor["depth"]))).astype(np.float64) * scale
        x, y = rays_of(k)
        points = np.dstack([x * z, y * z, z])
        labels = np.asarray(o3d.io.read_image(str(folder / f"{name}_labels.png")))
        clouds[name] = (points, z > 0, labels)
        truth[name] = np.array(capture["ground_truth"][name])
    return clouds, truth


def make_cloud(points, voxel):
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud = cloud.voxel_down_sample(voxel)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(radius=2 * voxel, max_nn=30))
    cloud.orient_normals_towards_camera_location(np.zeros(3))
    return cloud


def multiway(clouds, initial, voxel, setting):
    """Open3D's tutorial pipeline; returns world_from_sensor for each cloud (the world is sensor 0's frame) and seconds."""
    registration = o3d.pipelines.registration
    point_to_plane = registration.TransformationEstimationPointToPlane()
    coarse, fine = setting["coarse"] * voxel, setting["fine"] * voxel
    start = time.perf_counter()
    down = [make_cloud(points, voxel) for points in clouds]
    graph = registration.PoseGraph()
    graph.nodes.append(registration.PoseGraphNode(np.eye(4)))
    odometry = np.eye(4)
    for source, target in itertools.combinations(range(len(down)), 2):
        guess = np.linalg.inv(initial[target]) @ initial[source]
        consecutive = target == source + 1
        if not consecutive:
            overlap = registration.evaluate_registration(down[source], down[target], coarse, guess)
            if overlap.fitness <= setting["min_overlap"]:
                continue
        icp = registration.registration_icp(down[source], down[target], coarse, guess, point_to_plane)
        icp = registration.registration_icp(down[source], down[target], fine, icp.transformation,
                                            point_to_plane)
        information = registration.get_information_matrix_from_point_clouds(
            down[source], down[target], fine, icp.transformation)
        if consecutive:
            odometry = icp.transformation @ odometry
            graph.nodes.append(registration.PoseGraphNode(np.linalg.inv(odometry)))
        graph.edges.append(registration.PoseGraphEdge(source, target, icp.transformation, information,
                                                      uncertain=not consecutive))
    registration.global_optimization(
        graph, registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(),
        registration.GlobalOptimizationOption(max_correspondence_distance=fine, edge_prune_threshold=0.25,
                                              reference_node=0))
    return [np.array(node.pose) for node in graph.nodes], time.perf_counter() - start


def moved(pose, points):
    return points @ pose[:3, :3].T + pose[:3, 3]


def errors_of(poses, truth, seen):
    """Errors of a set of poses. `seen`: points of the structure in each sensor's frame."""
    align = best_rigid(np.vstack([moved(p, s) for p, s in zip(poses, seen)]),
                       np.vstack([moved(t, s) for t, s in zip(truth, seen)]))
    aligned = [align @ p for p in poses]
    own = [errors(pose, true) for pose, true in zip(aligned, truth)]
    points = [np.linalg.norm(moved(pose, some) - moved(true, some), axis=1) for pose, true, some in zip(aligned, truth, seen)]
    pairs = [errors(np.linalg.inv(poses[i]) @ poses[j], np.linalg.inv(truth[i]) @ truth[j]) for i, j in itertools.combinations(range(len(poses)), 2)]
    return {"position_mm": [1000 * m for m, _ in own], "rotation_deg": [deg for _, deg in own], "points_mm": [1000 * np.sqrt(np.mean(off**2)) for off in points],
            "pair_mm": [1000 * m for m, _ in pairs], "pair_deg": [deg for _, deg in pairs]}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--program", required=True, help="the volalign program")
    parser.add_argument("--model", required=True)
    parser.add_argument("--rig", default="configs/rig_ring8.yaml")
    parser.add_argument("--sensors", nargs="+", default=SENSORS, help="model of all sensors of the rig, one run each")
    parser.add_argument("--seeds", default="1000:1003", help="FIRST:END")
    parser.add_argument("--set-rig", nargs="*", default=["assembly.position_mm=3", "assembly.yaw_deg=0",
                                                         "assembly.size_scale_percent=0"], help="KEY=VALUE over the rig")
    parser.add_argument("--voxel", type=float, default=0.02, help="Open3D's voxel size, m")
    parser.add_argument("-o", "--output", required=True, help="folder for captures, calibrations and open3d.json")
    options = parser.parse_args()
    output = pathlib.Path(options.output)
    count = len(re.findall(r"^\s*-\s*\{?\s*name:", pathlib.Path(options.rig).read_text(), re.M))

    rows = []
    for sensor, seed in itertools.product(options.sensors, range(*map(int, options.seeds.split(":")))):
        capture, calibration = output / f"{sensor}_{seed}", output / f"{sensor}_{seed}_poses"
        assignments = [f"seed={seed}"] + options.set_rig
        assignments += [f"sensors[{i}].sensor={sensor}" for i in range(count)]
        run(options.program, "render", "--rig", options.rig, "-o", capture, "--set", *assignments)
        run(options.program, "calibrate", "--capture", capture / "capture.json", "--model", options.model, "-o", calibration)
        extrinsics = json.loads((calibration / "extrinsics.json").read_text())
        clouds, truth = read_capture(capture)
        names = [name for name, found in extrinsics["sensors"].items() if found["status"] != "failed"]
        if len(names) < 2:
            print(f"{sensor} seed {seed}: fewer than two sensors placed, left out", file=sys.stderr)
            continue
        initial = [np.array(extrinsics["sensors"][name]["initial"]) for name in names]
        refined = [np.array(extrinsics["sensors"][name]["structure_from_sensor"]) for name in names]
        true = [truth[name] for name in names]
        seen = [clouds[name][0][clouds[name][1] & (clouds[name][2] > 0)][::7] for name in names]
        timings = extrinsics["timings_s"]

        def add(method, poses, seconds):
            rows.append({"sensor": sensor, "seed": seed, "method": method, "sensors": len(names),
                         "seconds": seconds, **errors_of(poses, true, seen)})

        add("initial", initial, 0.0)
        add("volalign", refined, timings["placement"] + timings["refinement"])
        rows[-1]["refinement_s"] = timings["refinement"]
        for name, setting in SETTINGS.items():
            for points in ("whole frames", "structure only"):
                used = [clouds[n][0][clouds[n][1] & ((clouds[n][2] > 0) | (points == "whole frames"))] for n in names]
                poses, seconds = multiway(used, initial, options.voxel, setting)
                add(f"Open3D, {name}, {points}", poses, seconds)
        print(f"{sensor} seed {seed}: " + "; ".join(
            f"{row['method']} {np.median(row['pair_mm']):.1f} mm {row['seconds']:.2f} s"
            for row in rows if row["seed"] == seed and row["sensor"] == sensor), file=sys.stderr, flush=True)

    output.mkdir(parents=True, exist_ok=True)
    (output / "open3d.json").write_text(json.dumps({"open3d": o3d.__version__, "rows": rows}, indent=1) + "\n")
    print("Errors: median / 95 %. Time: mean of a capture.\n")
    print("| sensors | method | between sensors, mm | deg | position after alignment, mm | deg | points, mm | time, s |")
    print("|---|---|---|---|---|---|---|---|")
    for sensor in options.sensors:
        for method in dict.fromkeys(row["method"] for row in rows):
            chosen = [row for row in rows if row["sensor"] == sensor and row["method"] == method]
            if not chosen:
                continue
            cells = []
            for key, digits in (("pair_mm", 1), ("pair_deg", 2), ("position_mm", 1), ("rotation_deg", 2),
                                ("points_mm", 1)):
                values = np.concatenate([row[key] for row in chosen])
                cells.append(f"{np.median(values):.{digits}f} / {np.percentile(values, 95):.{digits}f}")
            seconds = np.mean([row["seconds"] for row in chosen])
            if method == "initial":
                cells.append("-")
            elif method == "volalign":
                alone = np.mean([row["refinement_s"] for row in chosen])
                cells.append(f"{seconds:.2f} (joint solution alone {alone:.2f})")
            else:
                cells.append(f"{seconds:.2f}")
            print(f"| {sensor} | {method} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
