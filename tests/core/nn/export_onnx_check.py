"""Runs what export_onnx_test.cc wrote to a folder by ONNX Runtime and by torch.jit.load, without any of our code:
exit 0 if they agree with LibTorch.

A folder has NAME.fp32.onnx, NAME.fp16.onnx, NAME.fp32.ts, NAME.fp16.ts, and of each case the values depth*_BxCxHxW.f32 and
NAME.expected*_BxKxHxW.f32.
"""

import glob
import json
import os
import re
import sys

import numpy

THREADS = 2
LABELS = {"fp32": 0.9999, "fp16": 0.999}  # least share of equal labels among the pixels with depth
LOG_PROBABILITIES = 1e-3  # of fp32, largest difference


def values(path):
    shape = [int(size) for size in re.search(r"_([\dx]+)\.f32$", path).group(1).split("x")]
    return numpy.fromfile(path, "<f4").reshape(shape)


def onnx_runner(path):
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = THREADS
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])
    texts = session.get_modelmeta().custom_metadata_map
    meta = json.loads(texts["volalign.json"])
    assert texts["structure_sha256"] == meta["structure"]["sha256"], texts
    assert texts["orientation"] in ("portrait", "landscape", "any"), texts
    assert [i.name for i in session.get_inputs()] == ["depth"]
    assert [o.shape[1] for o in session.get_outputs()] == [1 + len(meta["structure"]["labels"])]
    return lambda depth: session.run(None, {"depth": depth})[0]


def script_runner(path):
    import torch

    torch.set_num_threads(THREADS)
    extra = {"volalign.json": ""}
    script = torch.jit.load(path, map_location="cpu", _extra_files=extra)
    assert "top/front" in str(extra["volalign.json"]), extra

    def run(depth):
        with torch.no_grad():
            return script(torch.from_numpy(depth)).numpy()

    return run


def main(folder):
    failed, cases = False, 0
    for path in sorted(glob.glob(folder + "/*.onnx") + glob.glob(folder + "/*.ts")):
        name, precision, ending = os.path.basename(path).rsplit(".", 2)
        run = onnx_runner(path) if ending == "onnx" else script_runner(path)
        pixels = same = 0
        largest = 0.0
        for depth_path in sorted(glob.glob(folder + "/depth*.f32")):
            depth = values(depth_path)
            case = os.path.basename(depth_path).split("_")[0][len("depth") :]
            (expected_path,) = glob.glob(f"{folder}/{name}.expected{case}_*.f32")
            expected = values(expected_path)
            found = run(depth)
            assert found.shape == expected.shape and found.dtype == numpy.float32, (path, found.shape, expected.shape)
            measured = depth[:, 0] > 0
            pixels += int(measured.sum())
            same += int(((found.argmax(1) == expected.argmax(1)) & measured).sum())
            largest = max(largest, float(numpy.abs(found - expected).max()))
            cases += 1
        share = same / pixels
        ok = share >= LABELS[precision] and (precision == "fp16" or largest <= LOG_PROBABILITIES)
        print(f"{os.path.basename(path)}: {pixels} pixels with depth, {share:.6%} labels equal, log-probabilities within {largest:.1e}{'' if ok else ': TOO FAR'}")
        failed = failed or not ok
    assert cases > 0, "no cases"
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
