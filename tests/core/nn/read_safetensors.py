"""A reader of safetensors by the format's description: 8 bytes of length, a JSON header, the values."""

import json
import struct

import numpy

TYPES = {"F64": "<f8", "F32": "<f4", "F16": "<f2", "I64": "<i8", "U8": "u1"}


def read(path):
    """The texts, and the tensors by name."""
    with open(path, "rb") as file:
        content = file.read()
    (length,) = struct.unpack("<Q", content[:8])
    header = json.loads(content[8 : 8 + length])
    values = content[8 + length :]
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
