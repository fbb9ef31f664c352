#!/usr/bin/env python3
"""Converts checkpoints (.pt) and states (.state) of earlier versions of volalign, which are pickles of `torch.save`, to safetensors.

    packaging/convert_checkpoint.py model.pt model.safetensors
    packaging/convert_checkpoint.py runs/a/states/000000004000.state runs/a/states/000000004000.state

Needs nothing but Python. No instruction of the pickle is followed but those that make texts, dictionaries and tensors."""

import hashlib
import json
import os
import pickle
import struct
import sys
import zipfile

# torch's class of storage: the name in safetensors, LibTorch's name, size in bytes.
TYPES = {
    "FloatStorage": ("F32", "Float", 4),
    "HalfStorage": ("F16", "Half", 2),
    "DoubleStorage": ("F64", "Double", 8),
    "LongStorage": ("I64", "Long", 8),
    "IntStorage": ("I32", "Int", 4),
    "ByteStorage": ("U8", "Byte", 1),
    "BFloat16Storage": ("BF16", "BFloat16", 2),
}
FORMATS = {"volalign.checkpoint/1": "volalign.checkpoint/2", "volalign.training/2": "volalign.training/3"}


def tensor(storage, offset, shape, stride, *_):
    """Its type and shape, and the values' bytes."""
    kind, data = storage
    expected = [1] * len(shape)
    for i in reversed(range(len(shape) - 1)):
        expected[i] = expected[i + 1] * max(shape[i + 1], 1)
    if offset != 0 or any(n > 1 and s != e for n, s, e in zip(shape, stride, expected)):
        raise ValueError("a tensor is not contiguous")
    return kind, tuple(shape), data


class Reader(pickle.Unpickler):
    """Makes tensors of what stands in the archive `files`, in `folder`."""

    def __init__(self, files, folder):
        super().__init__(files.open(folder + "data.pkl"))
        self.files, self.folder = files, folder

    def find_class(self, module, name):
        known = {"_rebuild_tensor_v2": tensor, "OrderedDict": dict, "restore_type_tag": lambda value, _: value}
        if name in known:
            return known[name]
        if module == "torch" and name in TYPES:
            return name
        raise ValueError(f"the pickle asks for {module}.{name}, which no tensor needs")

    def persistent_load(self, pid):
        return TYPES[pid[1]], self.files.read(f"{self.folder}data/{pid[2]}")


def digest(meta, tensors):
    """As volalign's: over the metadata, and over names, types, shapes and values."""
    text = meta
    for name, ((_, kind, _), shape, data) in sorted(tensors.items(), key=lambda item: item[0].encode()):
        text += f"\n{name} {kind} {','.join(map(str, shape))} {hashlib.sha256(data).hexdigest()}"
    return hashlib.sha256(text.encode()).hexdigest()


def convert(source, target):
    with zipfile.ZipFile(source) as files:
        folder = next(name for name in files.namelist() if name.endswith("/data.pkl"))[: -len("data.pkl")]
        old = Reader(files, folder).load()
    meta, tensors = old["meta"], old["tensors"]
    if old["format"] not in FORMATS or digest(meta, tensors) != old["digest"]:
        raise ValueError("it is no file of volalign, or it was changed")
    if old["format"].startswith("volalign.training"):
        progress = json.loads(meta)
        progress["best"].pop("since", None)
        meta = json.dumps(progress)
    texts = {"format": FORMATS[old["format"]], "volalign.json": meta, "digest": digest(meta, tensors)}
    ordered = sorted(tensors.items(), key=lambda item: (-item[1][0][2], item[0].encode()))
    header, end = {"__metadata__": texts}, 0
    for name, ((kind, _, _), shape, data) in ordered:
        header[name] = {"dtype": kind, "shape": shape, "data_offsets": [end, end + len(data)]}
        end += len(data)
    # As volalign itself writes it, byte for byte.
    text = json.dumps(header, ensure_ascii=False, separators=(",", ":"), sort_keys=True).encode()
    text += b" " * (-len(text) % 8)
    with open(str(target) + ".new", "wb") as file:
        file.write(struct.pack("<Q", len(text)) + text + b"".join(data for _, (_, _, data) in ordered))
    os.replace(str(target) + ".new", target)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    try:
        convert(sys.argv[1], sys.argv[2])
    except (OSError, ValueError, KeyError, StopIteration, pickle.UnpicklingError, zipfile.BadZipFile) as error:
        sys.exit(f"{sys.argv[1]}: {error}")
