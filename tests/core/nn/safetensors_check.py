"""Reads what safetensors_test.cc wrote to a folder by a reader of the format's description; with `--safetensors` by PyPI's. Exit 0 if it is what was meant."""

import json
import struct
import sys

import numpy

TYPES = {"F64": "<f8", "F32": "<f4", "F16": "<f2", "I64": "<i8", "U8": "u1"}


def read(path):
    """The texts, and the tensors by name: 8 bytes of length, a JSON header, the values."""
    with open(path, "rb") as file:
        content = file.read()
    (length,) = struct.unpack("<Q", content[:8])
    header, values = json.loads(content[8 : 8 + length]), content[8 + length :]
    texts = header.pop("__metadata__")
    tensors, end = {}, 0
    for name, entry in sorted(header.items(), key=lambda item: item[1]["data_offsets"]):
        begin, stop = entry["data_offsets"]
        assert begin == end, f"{name} leaves a gap"
        # Readers that look into the file, as JavaScript's Float32Array, want it so.
        assert begin % numpy.dtype(TYPES[entry["dtype"]]).itemsize == 0, f"{name} begins at {begin}"
        end = stop
        tensors[name] = numpy.frombuffer(values[begin:stop], TYPES[entry["dtype"]]).reshape(entry["shape"])
    assert end == len(values)
    return texts, tensors


path = sys.argv[-1] + "/a.safetensors"
texts, tensors = read(path)
assert texts == {"format": "any", "text": '"quoted" \u00e9'}, texts
if "--safetensors" in sys.argv:
    from safetensors import safe_open
    from safetensors.numpy import load_file

    tensors = load_file(path)
    with safe_open(path, "numpy") as file:
        assert file.metadata() == texts
expected = {"a_half": ("<f2", (3, 5)), "b_float": ("<f4", (2, 3, 4)), "c_long": ("<i8", (2,)), "d_byte": ("u1", (7,)), "e_none": ("<f4", (0, 4)), "f_one": ("<f8", ())}
assert set(tensors) == set(expected)
for name, (kind, shape) in expected.items():
    values = numpy.arange(numpy.prod(shape, dtype=int)) - 1.5
    if name == "f_one":
        values = numpy.zeros(1)
    assert tensors[name].dtype == numpy.dtype(kind) and tensors[name].shape == shape, name
    if name != "d_byte":  # whose first values wrap around
        assert (tensors[name] == values.astype(kind).reshape(shape)).all(), name
    else:
        assert (tensors[name][2:] == [0, 1, 2, 3, 4]).all(), tensors[name]
