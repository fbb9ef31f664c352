#!/usr/bin/env python3
"""Does TensorBoard's own reader find in a run's event files what metrics.jsonl says, also after a resumption?

    tests/compat/read_events.py VOLALIGN      (the program)

Needs `tensorboard` of PyPI.
"""

import json
import os
import struct
import sys

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "cli"))
from program import InAFolder, main  # noqa: E402

TINY = ["data.sensors=[azure_kinect_nfov_binned]", "model.base_channels=2", "model.residual_blocks=1", "data.image_sizes=[40x36]", "run.batch_size=2", "run.samples=8",
        "run.log_every=2", "run.checkpoint_every=4", "run.validate_every=4", "run.validation_samples=2", "run.threads=1",
        "loss.min_side_pixels=3", "optim.warmup_samples=2"]


def same(events, rows, key, what):
    """Events have the steps and values (float32) of the rows."""
    found = [(event.step, event.value) for event in events]
    expected = [(row["samples"], struct.unpack("f", struct.pack("f", row[key]))[0]) for row in rows]
    assert found == expected, f"{what}: TensorBoard reads {found}, metrics.jsonl has {expected}"


class Events(InAFolder):
    def test_scalars_pictures_and_the_configuration(self):
        train = "train --config configs/m05-lite.yaml -o run --set " + " ".join(TINY)
        self.expect(train, 0)
        # Continue from the state before the last: the events after it come again, and the first ones are void.
        self.remove("run/states/000000000008.state")
        self.expect(train + " --resume", 0)
        rows = [json.loads(line) for line in self.read("run/metrics.jsonl").splitlines()]
        training = [row for row in rows if row["type"] == "train"]
        validation = [row for row in rows if row["type"] == "validation"]
        assert [row["samples"] for row in training] == [2, 4, 6, 8]
        # No limit to what is kept in memory.
        events = EventAccumulator(self.path("run/tensorboard"), size_guidance={"scalars": 0, "images": 0, "tensors": 0})
        events.Reload()
        for key in ("loss", "loss_seg", "loss_3d", "degenerate", "gradient_norm", "skipped", "lr", "samples_per_s"):
            same(events.Scalars("train/" + key), training, key, "train/" + key)
        for part in ("data", "forward", "loss", "backward", "optim"):
            same(events.Scalars(f"train/step_s/{part}"), [{**row, part: row["step_s"][part]} for row in training], part, part)
        for key in ("loss_seg", "miou", "miou_authors", "posed"):
            same(events.Scalars("validation/" + key), validation, key, "validation/" + key)
        pictures = events.Images("validation/depth, labels, predicted")
        assert [picture.step for picture in pictures] == [4, 8]
        for picture in pictures:
            png = picture.encoded_image_string
            assert png.startswith(b"\x89PNG\r\n"), png[:8]
            # Two samples, three pictures of 40x36 each, 2 pixels apart.
            assert (picture.width, picture.height) == struct.unpack(">II", png[16:24]) == (124, 74), (picture.width, picture.height)
        assert events.SummaryMetadata("config").plugin_data.plugin_name == "text"
        text = events.Tensors("config")[-1].tensor_proto.string_val[0].decode()
        assert text.split("\n") == ["    " + line if line else "" for line in self.read("run/config.yaml").split("\n")], text[:200]


if __name__ == "__main__":
    main(__doc__)
