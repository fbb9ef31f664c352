#!/usr/bin/python3
"""Memory (kB) and handles of a training run of 50,000 steps by each renderer, after the first tenth and at the end: neither grows. From the
root of the repository."""

import os
import subprocess
import sys
import tempfile
import time


def use(pid):
    status = open(f"/proc/{pid}/status").read()
    return int(status.split("VmRSS:")[1].split()[0]), len(os.listdir(f"/proc/{pid}/fd"))


subprocess.run(["bash", "-c", "source cmake/packages.sh && build_preset release -DVOLALIGN_TESTS=ON volalign"], check=True)
for renderer in ("cpu", "egl"):
    with tempfile.TemporaryDirectory() as folder:
        run = subprocess.Popen(
            ["build/release/cli/volalign", "train", "--config", "configs/m05-lite.yaml", "-o", folder + "/run", "--set", "run.samples=100000",
             "run.batch_size=2", "model.base_channels=2", "model.residual_blocks=1", "data.image_sizes=[40x36]",
             "data.sensors=[azure_kinect_nfov_binned]", "run.threads=1", "run.validation_samples=2", "loss.min_side_pixels=3",
             "run.checkpoint_every=20000", "data.renderer=" + renderer], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        seen = []
        while run.poll() is None:
            time.sleep(2)
            try:
                seen.append(use(run.pid))
            except (OSError, IndexError):
                break
        if run.wait() != 0 or len(seen) < 20:
            sys.exit(f"training: status {run.returncode}, {len(seen)} looks")
        early, late = seen[len(seen) // 10], seen[-2]
        print(f"50,000 training steps by {renderer}: {early} -> {late} kB, handles")
        if late[0] > 1.1 * early[0] or late[1] > early[1] + 2:
            sys.exit("training grows")
