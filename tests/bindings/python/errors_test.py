import os

import pytest

import volalign


def test_hierarchy():
    for kind in (volalign.ConfigError, volalign.DataError, volalign.IoError):
        assert issubclass(kind, volalign.Error)
        assert kind.__module__ == "volalign"


def test_messages_are_the_programs(capture, tmp_path):
    with pytest.raises(volalign.ConfigError, match="'refine.size_sigma_procent'.*'refine.size_sigma_percent'"):
        volalign.calibrate(capture, **{"refine.size_sigma_procent": 0.7})
    with pytest.raises(volalign.ConfigError, match="threads = 0 violates threads >= 1"):
        volalign.calibrate(capture, threads=0)
    with pytest.raises(volalign.IoError, match="none.json"):
        volalign.Capture.load(tmp_path / "none.json")
    with pytest.raises(volalign.IoError, match="none.yaml"):
        volalign.calibrate(capture, options=tmp_path / "none.yaml")
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(volalign.DataError, match="bad.json"):
        volalign.Capture.load(tmp_path / "bad.json")
    with pytest.raises(volalign.ConfigError, match="volalign export --model models/m05-lite.safetensors --format onnx"):
        volalign.calibrate(capture, model="models/m05-lite.safetensors")
    with pytest.raises(volalign.ConfigError, match="nonsense"):
        volalign.convert("out/extrinsics.json", "nonsense", tmp_path / "x")


def test_what_contains_itself_is_an_error(capture):
    loop = {}
    loop["a"] = loop
    deep = {}
    for _ in range(100_000):
        deep = {"a": deep}
    for options in (loop, deep):
        with pytest.raises(volalign.ConfigError, match="nested deeper than"):
            volalign.calibrate(capture, options=options)
    captures = [capture]
    captures.append(captures)
    with pytest.raises(TypeError, match="a capture is"):
        volalign.calibrate(captures)


def test_messages_are_text_whatever_they_quote(tmp_path):
    (tmp_path / "x.bag").write_bytes(b"#ROSBAG V2.0\n" + b"\x1b\x00\x00\x00\x17\x00\x00\x00compression=\xafone\n")
    (tmp_path / "c.json").write_text('{"format": "volalign.capture/1", "sensors": [{"name": "A", "depth": "x.bag"}]}')
    with pytest.raises(volalign.Error):
        volalign.Capture.load(tmp_path / "c.json")
    with pytest.raises(volalign.DataError, match="not UTF-8"):
        volalign.Capture.load(os.fsencode(tmp_path) + b"/\xff.json")


def test_wrong_types_are_type_errors(capture):
    with pytest.raises(TypeError):
        volalign.calibrate(capture, options=3)
    with pytest.raises(TypeError):
        volalign.calibrate(3)
    with pytest.raises(TypeError):
        volalign.calibrate(capture, threads=object())
