import json
import os
import subprocess
import threading

import numpy as np
import pytest

import volalign
from conftest import ANGLES, CAMERA, capture_of, depth_of, frame_of, true_pose

NAMES = list(ANGLES)


def poses_of(result):
    return {name: sensor.structure_from_sensor for name, sensor in result.sensors.items()}


def assert_same(a, b):
    assert poses_of(a).keys() == poses_of(b).keys()
    for name, pose in poses_of(a).items():
        np.testing.assert_array_equal(pose, poses_of(b)[name])


def test_a_world_of_ones_own(capture, tmp_path):
    own = volalign.calibrate(capture, model=None)
    assert own.world_from_structure is None
    base = np.array([[1, 0, 0, 2], [0, 0, -1, 3], [0, 1, 0, 4], [0, 0, 0, 1]], float)
    (tmp_path / "world.json").write_text(json.dumps({"format": "volalign.world/1", "name": "base", "sigma_m": 0.001, "sigma_deg": 0.1, "world_from_structure": base.tolist()}))
    own.set_world(tmp_path / "world.json")
    np.testing.assert_allclose(own.world_from_structure, base)
    volalign.convert(own, "poses", tmp_path / "world_poses.json")
    in_world = volalign.read_poses(tmp_path / "world_poses.json", "poses")
    volalign.convert(own, "poses", tmp_path / "poses.json", origin="structure")
    in_structure = volalign.read_poses(tmp_path / "poses.json", "poses")
    own.save(tmp_path / "out", report=False)
    saved = json.loads((tmp_path / "out" / "extrinsics.json").read_text())
    for name, pose in poses_of(own).items():
        np.testing.assert_allclose(in_world[name].structure_from_sensor, base @ pose, atol=1e-9)
        np.testing.assert_allclose(in_structure[name].structure_from_sensor, pose, atol=1e-9)
        np.testing.assert_allclose(saved["sensors"][name]["world_from_sensor"], base @ pose, atol=1e-9)
    assert "frame of base" in (tmp_path / "out" / "clouds" / "merged.ply").read_bytes()[:200].decode("ascii", "ignore")


def test_places_sensors(result):
    assert (result.verdict, result.placed, list(result.sensors)) == ("ok", 3, NAMES)
    for name, sensor in result.sensors.items():
        distance, angle = volalign.compare_poses(sensor.structure_from_sensor, true_pose(ANGLES[name]))
        assert distance < 0.005 and angle < 0.2
        assert (sensor.status, sensor.code, sensor.initial_source) == ("ok", "", "geometry")
        assert sensor.covariance.shape == (6, 6)
        np.testing.assert_allclose(sensor.covariance, sensor.covariance.T)
        assert np.all(np.linalg.eigvalsh(sensor.covariance) > 0)
        assert sensor.sigma_position_m.shape == sensor.sigma_rotation_deg.shape == (3,)
        assert (sensor.labels.shape, sensor.labels.dtype) == ((288, 320), np.uint8)
        assert (sensor.confidence.shape, sensor.confidence.dtype) == ((288, 320), np.float32)
        assert {"low/up", "high/up"} & set(sensor.sides)
        assert sensor.intrinsics_given == CAMERA
    assert result.model is None
    assert {pair.a for pair in result.pairs} | {pair.b for pair in result.pairs} <= set(NAMES)
    for pair in result.pairs:
        assert np.allclose(pair.covariance, pair.covariance.T) and np.linalg.eigvalsh(pair.covariance).min() > 0
        assert 0 < pair.sigma_m < 0.2 and 0 < pair.sigma_deg < 10
    assert list(result.boxes) == ["low", "high"]
    assert "S1" in str(result)


def test_findings(result):
    assert result.findings == []
    frames = [frame_of(name, 1.05 * depth_of(true_pose(angle))) for name, angle in ANGLES.items()]
    doubtful = volalign.calibrate(volalign.Capture(frames, structure=result.structure), model=None)
    found = [{"code": f.code, "about": f.about, "reason": f.reason, "hint": f.hint} for f in doubtful.findings]
    assert "size_off" in [finding["code"] for finding in found]
    assert doubtful.verdict != "ok"
    assert found == [{"about": [], **finding} for finding in doubtful.to_dict()["findings"]]
    assert found[0]["code"] in repr(doubtful.findings[0])


def test_images_outlive_the_result(capture):
    result = volalign.calibrate(capture, model=None)
    labels = result.sensors["S1"].labels
    expected = labels.copy()
    del result
    np.testing.assert_array_equal(labels, expected)


def test_options(capture, result, tmp_path):
    assert "method: \"auto\"" in result.options
    ways = [
        volalign.calibrate(capture, model=None, initial={"method": "geometry"}, threads=np.int64(1)),
        volalign.calibrate(capture, model=None, options={"initial.method": "geometry", "threads": 1}),
        volalign.calibrate(capture, model=None, options={"threads": 3, "initial": {"method": "network"}}, threads=1, **{"initial.method": "geometry"}),
    ]
    (tmp_path / "options.yaml").write_text(ways[0].options)
    ways.append(volalign.calibrate(capture, model=None, options=tmp_path / "options.yaml"))
    assert len({way.options for way in ways}) == 1
    for way in ways:
        assert_same(way, result)


def test_progress(capture):
    stages = []
    here = threading.get_ident()
    volalign.calibrate(capture, model=None, progress=lambda stage: stages.append((stage, threading.get_ident())))
    assert "first poses" in [stage for stage, _ in stages]
    assert {thread for _, thread in stages} == {here}

    def fail(stage):
        raise KeyError(stage)

    with pytest.raises(KeyError, match="lenses"):
        volalign.calibrate(capture, model=None, progress=fail)


def test_other_threads_run_meanwhile(capture):
    counts = {"now": 0}
    stop = threading.Event()

    def count():
        while not stop.wait(0.001):
            counts["now"] += 1

    thread = threading.Thread(target=count)
    thread.start()
    volalign.calibrate(capture, model=None)
    stop.set()
    thread.join()
    assert counts["now"] > 20


def test_two_threads_calibrate(capture, result):
    results = {}
    threads = [threading.Thread(target=lambda i=i: results.update({i: volalign.calibrate(capture, model=None)})) for i in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for other in results.values():
        assert_same(other, result)


def test_a_sensor_that_fails_is_a_result(capture):
    nothing = frame_of("S4", np.zeros((288, 320), np.float32))
    result = volalign.calibrate(volalign.Capture([*capture.frames, nothing], structure=capture.structure), model=None)
    sensor = result.sensors["S4"]
    assert (result.verdict, result.placed) == ("failed", 3)
    assert (sensor.status, sensor.code) == ("failed", "no_depth")
    assert sensor.reason and sensor.hint
    assert sensor.structure_from_sensor is None and sensor.covariance is None and sensor.initial is None
    assert np.isnan(sensor.sigma_position_m).all()


def test_ground_truth_gives_errors():
    frames = [frame_of(name, depth_of(true_pose(angle)), ground_truth=true_pose(angle)) for name, angle in ANGLES.items()]
    sensor = volalign.calibrate(volalign.Capture(frames), structure=capture_of().structure, model=None).sensors["S2"]
    expected = volalign.compare_poses(sensor.structure_from_sensor, true_pose(ANGLES["S2"]))
    assert sensor.error == pytest.approx(expected)


def test_known_poses():
    def known(**options):
        frames = [frame_of(name, depth_of(true_pose(angle)), prior=true_pose(angle), **options) for name, angle in ANGLES.items()]
        return volalign.calibrate(volalign.Capture(frames), structure=capture_of().structure, model=None)

    for sensor in known(prior_sigma=(0.01, 0.5)).sensors.values():
        assert sensor.prior_used
        np.testing.assert_allclose(sensor.prior, sensor.structure_from_sensor, atol=0.01)
    with pytest.raises(volalign.DataError, match="prior_world"):
        known(prior_world="mine", prior_sigma=(0.01, 0.5))
    with pytest.raises(volalign.DataError, match="standard deviation"):
        known()


def test_files(result, tmp_path):
    result.save(tmp_path / "out")
    assert result.to_dict() == json.loads((tmp_path / "out" / "extrinsics.json").read_text())
    assert result.to_dict()["sensors"]["S1"]["structure_from_sensor"] == result.sensors["S1"].structure_from_sensor.tolist()
    assert (tmp_path / "out" / "options.yaml").read_text() == result.options
    for name in ("report.html", "rig.glb", "labels/S1.png", "clouds/merged.ply", "pictures/overview.png"):
        assert (tmp_path / "out" / name).exists(), name
    result.save(str(tmp_path / "out"), report=False)
    assert not (tmp_path / "out" / "report.html").exists()
    result.report(tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "S1" in page and "pytest" in page
    with pytest.raises(volalign.IoError):
        result.report(tmp_path / "out" / "labels")


def test_several_captures(stack):
    def still(dx):
        moved = np.eye(4)
        moved[0, 3] = dx
        frames = [frame_of(name, depth_of(np.linalg.inv(moved) @ true_pose(angle))) for name, angle in ANGLES.items()]
        return volalign.Capture(frames, structure=stack, name=f"at{dx}")

    result = volalign.calibrate([still(0), still(0.3)], model=None)
    assert [still.name for still in result.stills] == ["at0", "at0.3"]
    first, second = result.stills
    np.testing.assert_allclose(first.first_from_placement, np.eye(4))
    np.testing.assert_allclose(second.first_from_placement[:3, 3], [0.3, 0, 0], atol=0.005)
    assert result.sensors["S1"].labels is None
    assert second.sensors["S1"].labels.shape == (288, 320)
    assert second.covariance.shape == (6, 6)
    other = volalign.Structure("other", stack.boxes[:1])
    with pytest.raises(volalign.ConfigError, match="another structure"):
        volalign.calibrate([still(0), volalign.Capture(still(0.3).frames, structure=other)], model=None)


def test_needs_a_structure_or_a_model(capture):
    with pytest.raises(volalign.ConfigError, match="neither a model nor a structure"):
        volalign.calibrate(volalign.Capture(capture.frames), model=None)


@pytest.mark.program
def test_the_same_poses_as_the_program(tmp_path):
    program = os.environ["VOLALIGN_PROGRAM"]
    capture = tmp_path / "capture" / "capture.json"
    for command in (
        ["render", "--rig", "configs/rig_ring8.yaml", "-o", capture.parent],
        ["calibrate", "--capture", capture, "--structure", "configs/structure.yaml", "--model", "none", "--no-report", "-o", tmp_path / "out"],
    ):
        subprocess.run([program, *command], stdout=subprocess.DEVNULL, check=True, env={**os.environ, "LP_NUM_THREADS": "0"})
    expected = json.loads((tmp_path / "out" / "extrinsics.json").read_text())
    found = volalign.calibrate(capture, structure="configs/structure.yaml", model=None).to_dict()
    for name, sensor in expected["sensors"].items():
        np.testing.assert_allclose(found["sensors"][name]["structure_from_sensor"], sensor["structure_from_sensor"], rtol=0, atol=1e-9)
        np.testing.assert_allclose(found["sensors"][name]["covariance"], sensor["covariance"], rtol=1e-6, atol=1e-15)
        assert found["sensors"][name]["status"] == sensor["status"]


def test_the_installed_model():
    paper = volalign.Structure.load("configs/structure.yaml")
    floor = volalign.Box("floor", (-5, paper.floor_height - 0.1, -5), (5, paper.floor_height, 5))
    room = volalign.Structure("room", [*paper.boxes, floor])
    frames = [frame_of(f"S{angle}", room.cast_view(CAMERA, volalign.look_at((2 * np.cos(angle), 0.3, 2 * np.sin(angle)), (0, 0, 0), 90))[0]) for angle in (0.5, 2.4, 4.3)]
    given = volalign.Capture(frames, structure=paper)
    result = volalign.calibrate(given)
    assert result.model.endswith("models/m05-lite.onnx")
    assert result.to_dict()["model"]["file"] == result.model
    result.note = "on the new tripod"
    assert result.to_dict()["note"] == "on the new tripod"
    assert result.placed == 3
    # It knows these boxes, not others with their names.
    middles = [box.structure_from_box[:3, 3] for box in paper.boxes]
    boxes = [volalign.Box(box.name, at - box.size / 2, at + box.size / 2 + (0.007, 0, 0)) for box, at in zip(paper.boxes, middles)]
    wider = volalign.Structure("wider", boxes, paper.side_names)
    assert wider.side_names == paper.side_names
    assert volalign.calibrate(volalign.Capture(frames, structure=wider)).model is None
    # Without a structure, the model's own.
    bare = volalign.Capture(frames)
    assert volalign.calibrate(bare).structure == paper
    assert_same(volalign.calibrate(bare, model="models/m05-lite.onnx"), result)
    assert volalign.calibrate(given, model=None).model is None
    with pytest.raises(volalign.IoError, match="none.onnx"):
        volalign.calibrate(given, model="none.onnx")


def test_the_installed_model_is_left_out_where_its_stack_is_another(capture):
    assert volalign.calibrate(capture).model is None
    with pytest.raises(volalign.DataError, match="train a model for it"):
        volalign.calibrate(capture, model="models/m05-lite.onnx")
