"""Loads what export_torchscript_test.cc wrote to a folder, without any of our code: exit 0 if Python agrees."""

import json
import sys

import torch
from read_safetensors import read

folder = sys.argv[1]
torch.set_num_threads(2)

texts, tensors = read(folder + "/model.safetensors")
assert texts["format"] == "volalign.checkpoint/2", texts["format"]
labels = json.loads(texts["volalign.json"])["structure"]["labels"]
assert len(labels) == 20 and tensors["classifier.weight"].shape[0] == 21

extra = {"volalign.json": ""}
script = torch.jit.load(folder + "/model.ts", map_location="cpu", _extra_files=extra)
assert json.loads(extra["volalign.json"])["structure"]["labels"] == labels

cases = {name: torch.from_numpy(values.copy()) for name, values in read(folder + "/cases.safetensors")[1].items()}
for i in range(2):
    expected = cases["expected%d" % i]
    with torch.no_grad():
        result = script(cases["depth%d" % i])
    assert result.shape == expected.shape, (result.shape, expected.shape)
    difference = (result - expected).abs().max().item()
    assert difference < 1e-4, difference
