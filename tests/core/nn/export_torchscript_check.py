"""Loads what export_torchscript_test.cc wrote to a folder, without any of our code: exit 0 if Python agrees."""

import json
import sys

import torch

folder = sys.argv[1]
torch.set_num_threads(2)

checkpoint = torch.load(folder + "/model.pt", map_location="cpu", weights_only=False)
assert checkpoint["format"] == "volalign.checkpoint/1", checkpoint["format"]
labels = json.loads(checkpoint["meta"])["structure"]["labels"]
assert len(labels) == 20 and checkpoint["tensors"]["classifier.weight"].shape[0] == 21

extra = {"volalign.json": ""}
script = torch.jit.load(folder + "/model.ts", map_location="cpu", _extra_files=extra)
assert json.loads(extra["volalign.json"])["structure"]["labels"] == labels

cases = torch.load(folder + "/cases.pt", map_location="cpu", weights_only=False)["tensors"]
for i in range(2):
    expected = cases["expected%d" % i]
    with torch.no_grad():
        result = script(cases["depth%d" % i])
    assert result.shape == expected.shape, (result.shape, expected.shape)
    difference = (result - expected).abs().max().item()
    assert difference < 1e-4, difference
