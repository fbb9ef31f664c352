"""What runs the network: OpenCV, or ONNX Runtime where it is installed."""

import sys
import types

import numpy as np
import pytest

import volalign
from conftest import CAMERA, frame_of


@pytest.fixture(scope="module")
def paper():
    """A capture of the boxes that the installed network knows."""
    structure = volalign.Structure.load("configs/structure.yaml")
    floor = volalign.Box("floor", (-5, structure.floor_height - 0.1, -5), (5, structure.floor_height, 5))
    room = volalign.Structure("room", [*structure.boxes, floor])
    poses = [volalign.look_at((2 * np.cos(angle), 0.3, 2 * np.sin(angle)), (0, 0, 0), 90) for angle in (0.5, 2.4, 4.3)]
    return volalign.Capture([frame_of(f"S{i}", room.cast_view(CAMERA, pose)[0]) for i, pose in enumerate(poses)], structure=structure)


def runtime_of(result):
    return result.to_dict()["model"]["runtime"].rsplit(" ", 1)[0]


def test_both_runtimes_give_the_same_poses(paper):
    pytest.importorskip("onnxruntime")
    results = {runtime: volalign.calibrate(paper, runtime=runtime, threads=1) for runtime in ("auto", "onnxruntime", "opencv")}
    assert [runtime_of(result) for result in results.values()] == ["ONNX Runtime", "ONNX Runtime", "OpenCV"]
    assert results["opencv"].placed == 3
    for name, sensor in results["opencv"].sensors.items():
        other = results["auto"].sensors[name]
        assert np.mean(other.labels == sensor.labels) > 0.9999
        np.testing.assert_allclose(other.structure_from_sensor, sensor.structure_from_sensor, rtol=0, atol=1e-6)


def test_opencv_where_the_other_is_not_installed(paper, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)  # an import of it raises
    assert runtime_of(volalign.calibrate(paper)) == "OpenCV"
    with pytest.raises(volalign.ConfigError, match="pip install onnxruntime"):
        volalign.calibrate(paper, runtime="onnxruntime")
    with pytest.raises(volalign.ConfigError, match="runtime = tensorrt is none of"):
        volalign.check(volalign.calibrate(paper), paper, runtime="tensorrt")


def stand_in(run):
    """A package `onnxruntime` of which only `run` is of interest."""
    session = types.SimpleNamespace(run=run)
    return types.SimpleNamespace(__version__="0", SessionOptions=types.SimpleNamespace, InferenceSession=lambda *_, **__: session)


def test_what_the_runtime_raises_and_a_wrong_shape_are_errors(paper, monkeypatch):
    def refuse(names, inputs):
        assert inputs["depth"].shape == (1, 1, 144, 160) and inputs["depth"].dtype == np.float32
        raise RuntimeError("no memory for it")

    monkeypatch.setitem(sys.modules, "onnxruntime", stand_in(refuse))
    with pytest.raises(volalign.Error, match='m05-lite.onnx: ONNX Runtime 0 cannot run it: no memory for it; runtime="opencv"'):
        volalign.calibrate(paper)
    monkeypatch.setitem(sys.modules, "onnxruntime", stand_in(lambda names, inputs: [np.zeros((1, 3, 144, 160), np.float32)]))
    with pytest.raises(volalign.Error, match="ONNX Runtime 0 gives log-probabilities of another shape"):
        volalign.calibrate(paper)
