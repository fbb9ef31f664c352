import json

import numpy as np
import pytest

import volalign

CAMERA = volalign.Intrinsics(320, 288, fx=252, fy=252, cx=159.5, cy=143.5)
ANGLES = {"S1": 0.5, "S2": 2.4, "S3": 4.3}


def low_stack():
    return volalign.Structure(
        "stack", [volalign.Box("low", (-0.3, 0, -0.2), (0.3, 0.4, 0.2)), volalign.Box("high", (-0.3, 0.4, -0.15), (0.1, 0.75, 0.2))]
    )


def true_pose(angle):
    return volalign.look_at((2 * np.cos(angle), 1.1, 2 * np.sin(angle)), (0, 0.4, 0))


def depth_of(pose, camera=CAMERA):
    """What a sensor sees of the stack on a floor: (H, W) float32, m."""
    room = volalign.Structure("room", [*low_stack().boxes, volalign.Box("floor", (-5, -0.1, -5), (5, 0, 5))])
    return room.cast_view(camera, pose)[0]


def frame_of(name, depth, camera=CAMERA, **more):
    return volalign.Frame(name, depth, fx=camera.fx, fy=camera.fy, cx=camera.cx, cy=camera.cy, **more)


def capture_of(camera=CAMERA, moved=None, **more):
    """Three sensors; `moved`: by its name, by how many metres one stands higher."""
    frames = []
    for name, angle in ANGLES.items():
        pose = true_pose(angle)
        pose[1, 3] += (moved or {}).get(name, 0)
        frames.append(frame_of(name, depth_of(pose, camera), camera))
    return volalign.Capture(frames, structure=low_stack(), **more)


@pytest.fixture(scope="session")
def stack():
    return low_stack()


@pytest.fixture(scope="session")
def capture():
    return capture_of()


@pytest.fixture(scope="session")
def result(capture):
    return volalign.calibrate(capture, model=None)


def write_capture(folder):
    """The same as files: capture.json, and boxes.yaml beside it."""
    sensors = []
    for name, angle in ANGLES.items():
        np.save(folder / f"{name}.npy", depth_of(true_pose(angle)))
        intrinsics = {key: getattr(CAMERA, key) for key in ("width", "height", "fx", "fy", "cx", "cy")}
        sensors.append({"name": name, "depth": f"{name}.npy", "depth_scale": 1.0, "intrinsics": intrinsics})
    boxes = [
        {"name": "low", "x": [-300, 300], "y": [0, 400], "z": [-200, 200]},
        {"name": "high", "x": [-300, 100], "y": [400, 750], "z": [-150, 200]},
    ]
    (folder / "boxes.yaml").write_text(json.dumps({"name": "stack", "boxes": boxes}))
    path = folder / "capture.json"
    path.write_text(json.dumps({"format": "volalign.capture/1", "structure": "boxes.yaml", "sensors": sensors}))
    return path


@pytest.fixture(scope="session")
def capture_file(tmp_path_factory):
    return write_capture(tmp_path_factory.mktemp("capture"))
