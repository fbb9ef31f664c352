import numpy as np
import pytest

import volalign
from conftest import ANGLES, depth_of, frame_of, true_pose


def test_of_files(result, tmp_path):
    assert {"csv", "opencv", "livescan3d_azure"} < set(volalign.pose_formats)
    result.save(tmp_path / "out", report=False)
    volalign.convert(tmp_path / "out" / "extrinsics.json", "csv", tmp_path / "a.csv")
    volalign.convert(tmp_path / "a.csv", "opencv", tmp_path / "a.yaml", from_format="csv")
    found = volalign.read_poses(tmp_path / "a.yaml", "opencv")["S1"]
    np.testing.assert_allclose(found.structure_from_sensor, result.sensors["S1"].structure_from_sensor, atol=1e-9)
    assert found.intrinsics == result.sensors["S1"].intrinsics


def test_a_result_is_converted_as_its_file(stack, tmp_path):
    frames = [frame_of(name, depth_of(true_pose(angle)), serial="0815" + name) for name, angle in ANGLES.items()]
    result = volalign.calibrate(volalign.Capture(frames, structure=stack), model=None)
    result.save(tmp_path / "out", report=False)
    notes = [volalign.convert(source, "cwipc", tmp_path / file) for source, file in ((result, "a"), (tmp_path / "out", "b"))]
    assert notes[0] == notes[1]
    assert (tmp_path / "a").read_text() == (tmp_path / "b").read_text()
    assert "0815S1" in (tmp_path / "a").read_text()


def test_raw_depths_need_the_structures_place(result, tmp_path):
    volalign.convert(result, "csv", tmp_path / "a.csv", poses_for="raw")
    with pytest.raises(volalign.ConfigError, match="extrinsics.json"):
        volalign.convert(tmp_path / "a.csv", "tum", tmp_path / "a.tum", from_format="csv", poses_for="raw")


def test_writes_poses_of_ones_own(tmp_path):
    pose = volalign.look_at((2, 1, 0), (0, 0, 0))
    camera = volalign.Intrinsics(320, 288, 252, 252, 160, 144)
    volalign.write_poses(tmp_path / "colmap", "colmap", {"A": volalign.SensorPose(pose, camera)})
    np.testing.assert_allclose(volalign.read_poses(tmp_path / "colmap", "colmap")["A"].structure_from_sensor, pose, atol=1e-9)
    volalign.write_poses(tmp_path / "a.tum", "tum", {"A": pose.tolist()})
    assert list(volalign.read_poses(tmp_path / "a.tum", "tum")) == ["A"]
    with pytest.raises(volalign.ConfigError, match="livescan3d_azure"):
        volalign.write_poses(tmp_path / "x", "livescan3d_azure", {"A": pose})
    with pytest.raises(volalign.DataError, match="B"):
        volalign.write_poses(tmp_path / "x.csv", "csv", {"B": np.ones((4, 4))})


def test_the_world_and_the_camera_that_poses_are_of(result, tmp_path):
    def positions(**choice):
        volalign.convert(result, "csv", tmp_path / "a.csv", **choice)
        found = volalign.read_poses(tmp_path / "a.csv", "csv")
        return {name: pose.structure_from_sensor[:3, 3] for name, pose in found.items()}

    plain, floor = positions(), positions(origin="floor")
    up = -result.structure.floor_height
    for name, position in plain.items():
        np.testing.assert_allclose(floor[name], position + [0, up, 0], atol=1e-6)
        np.testing.assert_allclose(positions(up="z")[name], position[[0, 2, 1]] * [1, -1, 1], atol=1e-6)
    np.testing.assert_allclose(positions(origin="S1")["S1"], 0, atol=1e-9)
    # Of a file it is the same.
    result.save(tmp_path / "out", report=False)
    volalign.convert(tmp_path / "out" / "extrinsics.json", "csv", tmp_path / "b.csv", origin="floor")
    found = volalign.read_poses(tmp_path / "b.csv", "csv")
    for name, position in floor.items():
        np.testing.assert_allclose(found[name].structure_from_sensor[:3, 3], position, atol=1e-6)
    for bad, words in (({"origin": "S9"}, "S9"), ({"up": "x"}, "up = 'x'"), ({"camera": "left"}, "camera = 'left'"), ({"camera": "colour"}, "colour")):
        with pytest.raises(volalign.ConfigError, match=words):
            positions(**bad)
