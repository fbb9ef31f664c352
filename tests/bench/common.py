"""What the scripts of this folder have in common."""

import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
KINECT, D415 = "azure_kinect_nfov_binned", "realsense_d415"


def run(*command):
    """What a command prints, which may end with 2: a sensor has failed, or 3: one has moved."""
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
    if done.returncode not in (0, 2, 3):
        sys.exit(f"{' '.join(map(str, command))}\n{done.stderr}")
    return done.stdout


def short_training(program, folder, steps, batch, settings):
    """The command of that many training steps on pictures of a D415, without validation or checkpoints on the way."""
    values = {"data.image_sizes": "[320x180]", "data.sensors": "[realsense_d415]", "run.batch_size": batch, "run.samples": steps * batch, "run.validation_samples": 0,
              "run.checkpoint_every": 10**9, "run.tensorboard": "false", "optim.warmup_samples": batch, **settings}
    assignments = [word for key, value in values.items() for word in ("--set", f"{key}={value}")]
    return [program, "train", "--config", "configs/m05-lite.yaml", "-o", folder, *assignments]


def table(heading, rows):
    """Markdown."""
    lines = ["| " + " | ".join(map(str, row)) + " |" for row in [heading, *rows]]
    return "\n".join([lines[0], "|" + "---|" * len(heading), *lines[1:]])
