import numpy as np
import pytest

import volalign


def test_every_format_there_and_back(result, tmp_path):
    expected = {name: sensor.structure_from_sensor for name, sensor in result.sensors.items()}
    for word in volalign.pose_formats:
        if word in ("volalign", "livescan3d_azure"):
            continue
        notes = volalign.convert(result, word, tmp_path / word)
        assert all(isinstance(note, str) for note in notes)
        found = volalign.read_poses(tmp_path / word, word)
        assert list(found) == list(expected), word
        for name, pose in expected.items():
            np.testing.assert_allclose(found[name].structure_from_sensor, pose, atol=1e-6)


def test_of_files(result, tmp_path):
    result.save(tmp_path / "out", report=False)
    volalign.convert(tmp_path / "out" / "extrinsics.json", "csv", tmp_path / "a.csv")
    volalign.convert(tmp_path / "a.csv", "opencv", tmp_path / "a.yaml", from_format="csv")
    found = volalign.read_poses(tmp_path / "a.yaml", "opencv")["S1"]
    np.testing.assert_allclose(found.structure_from_sensor, result.sensors["S1"].structure_from_sensor, atol=1e-9)
    assert found.intrinsics == result.sensors["S1"].intrinsics


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
