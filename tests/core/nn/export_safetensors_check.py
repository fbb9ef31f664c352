"""Reads what export_safetensors_test.cc wrote to a folder by a reader of the format's description (8 bytes of length, a JSON header, the
values), and compares it with the checkpoint as torch reads it; with `--safetensors` also with what PyPI's safetensors reads. Exit 0 if they
agree."""

import json
import struct
import sys

import numpy
import torch

folder = sys.argv[-1]
TYPES = {"F32": "<f4", "F16": "<f2"}


def read(path):
    with open(path, "rb") as file:
        content = file.read()
    (length,) = struct.unpack("<Q", content[:8])
    header = json.loads(content[8 : 8 + length])
    values = content[8 + length :]
    texts = header.pop("__metadata__")
    tensors, end = {}, 0
    for name, entry in header.items():
        begin, stop = entry["data_offsets"]
        assert begin == end, f"{name} leaves a gap"
        # Readers that look into the file, as JavaScript's Float32Array, want it so.
        assert begin % numpy.dtype(TYPES[entry["dtype"]]).itemsize == 0, f"{name} begins at {begin}"
        end = stop
        tensors[name] = numpy.frombuffer(values[begin:stop], TYPES[entry["dtype"]]).reshape(entry["shape"])
    assert end == len(values)
    assert all(isinstance(text, str) for text in texts.values())
    return texts, tensors


checkpoint = torch.load(folder + "/model.pt", map_location="cpu", weights_only=False)
meta = json.loads(checkpoint["meta"])
for precision in ("fp32", "fp16"):
    path = f"{folder}/model.{precision}.safetensors"
    texts, tensors = read(path)
    assert json.loads(texts["volalign.json"]) == meta
    assert texts["structure_sha256"] == meta["structure"]["sha256"] and texts["orientation"] == "portrait"
    assert set(tensors) == set(checkpoint["tensors"])
    for name, expected in checkpoint["tensors"].items():
        found = tensors[name]
        assert found.dtype == ("float16" if precision == "fp16" and "running_" not in name else "float32"), (name, found.dtype)
        assert found.shape == tuple(expected.shape), name
        assert (found == expected.numpy().astype(found.dtype)).all(), name
    if "--safetensors" in sys.argv:
        from safetensors.numpy import load_file

        theirs = load_file(path)
        assert set(theirs) == set(tensors)
        assert all((theirs[name] == tensors[name]).all() for name in tensors)
