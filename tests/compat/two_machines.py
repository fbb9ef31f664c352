#!/usr/bin/env python3
"""Two network namespaces, joined by a virtual cable, stand for two machines: each runs one process of a training run, started by
torchrun's variables, and the run has to give the weights of `train --nproc 2` on one machine, bit for bit.

    tests/compat/two_machines.py build/release/cli/volalign

Run from the repository's root, by root and with iproute2.
"""

import os
import subprocess
import sys
import tempfile

TINY = ("data.image_sizes=[64x36] data.sensors=[realsense_d415] model.base_channels=2 model.residual_blocks=1 model.normalization=group "
        "run.batch_size=4 run.validation_samples=8 run.validate_every=64 run.checkpoint_every=32 run.threads=1 run.loader_threads=1 "
        "run.samples=96 run.precision=fp32 optim.warmup_samples=10 loss.lambda_warmup_samples=0").split()
NAMES = [f"volalign-{os.getpid()}-{i}" for i in range(2)]
ADDRESSES = ["10.87.0.1", "10.87.0.2"]

os.environ["SOURCE_DATE_EPOCH"] = "1764000000"  # of all checkpoints, which are compared


def ip(*arguments):
    subprocess.run(["ip", *arguments], check=True, capture_output=True, text=True)


def make_machines():
    ends = [f"va{os.getpid() % 100000}", f"vb{os.getpid() % 100000}"]
    for name in NAMES:
        ip("netns", "add", name)
    ip("link", "add", ends[0], "type", "veth", "peer", "name", ends[1])
    for name, end, address in zip(NAMES, ends, ADDRESSES):
        ip("link", "set", end, "netns", name)
        ip("-n", name, "addr", "add", f"{address}/24", "dev", end)
        ip("-n", name, "link", "set", end, "up")
        ip("-n", name, "link", "set", "lo", "up")


def train(program, folder, *arguments):
    return [program, "train", "--config", "configs/m05-lite.yaml", "-o", folder, "--set", *TINY, *arguments]


def main():
    program = sys.argv[1]
    with tempfile.TemporaryDirectory() as folder:
        try:
            make_machines()
            processes = []
            for rank, name in enumerate(NAMES):
                variables = [f"RANK={rank}", "WORLD_SIZE=2", "LOCAL_RANK=0", f"MASTER_ADDR={ADDRESSES[0]}", "MASTER_PORT=29500"]
                command = ["ip", "netns", "exec", name, "env", *variables, *train(program, f"{folder}/two")]
                processes.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True))
            for process in processes:
                output = process.communicate(timeout=200)[0]
                assert process.returncode == 0, output
        finally:
            for name in NAMES:
                subprocess.run(["ip", "netns", "del", name], capture_output=True, check=False)
        subprocess.run([*train(program, f"{folder}/one"), "--nproc", "2"], check=True, capture_output=True)
        weights = [open(f"{folder}/{run}/model.safetensors", "rb").read() for run in ("one", "two")]
        assert weights[0] == weights[1], "two machines give other weights than two processes of one"
    print("two machines: the same weights")


if __name__ == "__main__":
    main()
