import json

import numpy as np
import pytest

import volalign
from conftest import ANGLES, capture_of, depth_of, frame_of, true_pose


@pytest.fixture(scope="module")
def check(result):
    return volalign.check(result, capture_of(moved={"S3": 0.1}), model=None)


def test_finds_what_moved(check, result):
    assert check.moved == ["S3"]
    assert {name: sensor.movement for name, sensor in check.sensors.items()} == {"S1": "stayed", "S2": "stayed", "S3": "moved"}
    sensor = check.sensors["S3"]
    assert sensor.translation_m == pytest.approx(0.1, abs=0.005)
    assert sensor.probability < 1e-5
    assert sensor.structure_from_sensor[1, 3] - result.sensors["S3"].structure_from_sensor[1, 3] == pytest.approx(0.1, abs=0.005)
    np.testing.assert_allclose(check.last_from_now, np.eye(4), atol=0.005)
    assert check.moved_beyond(0.05, 90) and not check.moved_beyond(0.2, 90)
    assert (check.not_compared, check.same_structure) == ({}, True)
    assert "S3 moved" in str(check)


def test_exchanged(check, result):
    assert check.exchanged == {}
    turned = {"S1": "S2", "S2": "S1", "S3": "S3"}
    frames = [frame_of(name, depth_of(true_pose(ANGLES[other]))) for name, other in turned.items()]
    now = volalign.check(result, volalign.Capture(frames, structure=result.structure), model=None)
    assert now.exchanged == {"S1": "S2", "S2": "S1"}


def test_files(check, result, tmp_path):
    check.save(tmp_path / "check.json")
    assert check.to_dict() == json.loads((tmp_path / "check.json").read_text())
    check.update(tmp_path / "updated.json")
    updated = volalign.read_poses(tmp_path / "updated.json")
    np.testing.assert_array_equal(updated["S1"].structure_from_sensor, result.sensors["S1"].structure_from_sensor)
    assert updated["S3"].structure_from_sensor[1, 3] == pytest.approx(1.2, abs=0.005)


def test_known_to_have_moved(result):
    now = volalign.check(result, volalign.Capture([frame_of(name, depth_of(true_pose(ANGLES[name]))) for name in ("S1", "S2")], structure=result.structure), model=None, moved=["S2"])
    assert now.moved == ["S2"] and now.last_from_now is None
    now = volalign.check(result, now.result, moved=["S2"], one_may_stay=True)
    np.testing.assert_allclose(now.sensors["S2"].structure_from_sensor, result.sensors["S2"].structure_from_sensor, atol=0.01)


def test_of_files(result, capture_file, tmp_path):
    result.save(tmp_path / "out", report=False)
    stages = []
    check = volalign.check(last=tmp_path / "out" / "extrinsics.json", capture=capture_file, model=None, progress=stages.append, threads=1)
    assert check.moved == [] and stages
    assert check.to_dict()["last"] == str(tmp_path / "out" / "extrinsics.json")
    again = volalign.check(result, check.result)
    assert again.moved == []
