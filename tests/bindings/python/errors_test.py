import pytest

import volalign


def test_hierarchy():
    for kind in (volalign.ConfigError, volalign.DataError, volalign.IoError):
        assert issubclass(kind, volalign.Error)
        assert kind.__module__ == "volalign"


def test_messages_are_the_programs(capture, tmp_path):
    with pytest.raises(volalign.ConfigError, match="'initial.table_hight_m'.*'initial.table_height_m'"):
        volalign.calibrate(capture, **{"initial.table_hight_m": 0.7})
    with pytest.raises(volalign.ConfigError, match="threads = 0 violates threads >= 1"):
        volalign.calibrate(capture, threads=0)
    with pytest.raises(volalign.IoError, match="none.json"):
        volalign.Capture.load(tmp_path / "none.json")
    with pytest.raises(volalign.IoError, match="none.yaml"):
        volalign.calibrate(capture, options=tmp_path / "none.yaml")
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(volalign.DataError, match="bad.json"):
        volalign.Capture.load(tmp_path / "bad.json")
    with pytest.raises(volalign.ConfigError, match="volalign export --model models/m05-lite.pt --format onnx"):
        volalign.calibrate(capture, model="models/m05-lite.pt")
    with pytest.raises(volalign.ConfigError, match="nonsense"):
        volalign.convert("out/extrinsics.json", "nonsense", tmp_path / "x")


def test_wrong_types_are_type_errors(capture):
    with pytest.raises(TypeError):
        volalign.calibrate(capture, options=3)
    with pytest.raises(TypeError):
        volalign.calibrate(3)
    with pytest.raises(TypeError):
        volalign.calibrate(capture, threads=object())
