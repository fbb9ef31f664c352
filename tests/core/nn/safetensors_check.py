"""Reads what safetensors_test.cc wrote to a folder by PyPI's `safetensors`, which refuses gaps. Exit 0 if it is what was meant."""

import json
import struct
import sys

import numpy
from safetensors import safe_open
from safetensors.numpy import load_file

path = sys.argv[1] + "/a.safetensors"
with safe_open(path, "numpy") as file:
    assert file.metadata() == {"format": "any", "text": '"quoted" \u00e9'}, file.metadata()
tensors = load_file(path)
# Readers that look into the file, as JavaScript's Float32Array, want values at multiples of their size.
with open(path, "rb") as file:
    header = json.loads(file.read(*struct.unpack("<Q", file.read(8))))
for name, values in tensors.items():
    assert header[name]["data_offsets"][0] % values.itemsize == 0, name
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
