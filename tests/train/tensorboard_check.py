"""Reads the event files of event_file_test.cc with TensorBoard's own reader, and checks what it finds.

    tensorboard_check.py FOLDER
"""

import struct
import sys

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator


def main(folder):
    # The size of nothing is limited.
    events = EventAccumulator(folder, size_guidance={"scalars": 0, "images": 0, "tensors": 0})
    events.Reload()
    loss = [(event.step, event.value) for event in events.Scalars("train/loss")]
    assert loss == [(10, 110.0), (20, 120.0), (30, 130.0), (40, 7.0)], loss
    miou = [(event.step, event.value) for event in events.Scalars("validation/miou")]
    assert miou == [(10, 0.25), (20, 0.25), (30, 0.25)], miou
    pictures = events.Images("validation/depth, labels, predicted")
    assert [picture.step for picture in pictures] == [10, 20, 30]
    for picture in pictures:
        png = picture.encoded_image_string
        assert png.startswith(b"\x89PNG\r\n"), png[:8]
        # Two samples, three pictures of 4x3 each, 2 pixels apart.
        assert (picture.width, picture.height) == struct.unpack(">II", png[16:24]) == (16, 8)
    assert "config" in events.Tags()["tensors"], events.Tags()
    text = events.Tensors("config")[-1].tensor_proto.string_val[0].decode()
    assert text == "    run:\n      seed: 1\n", text
    plugin = events.SummaryMetadata("config").plugin_data.plugin_name
    assert plugin == "text", plugin
    print("TensorBoard reads scalars, pictures and text")


if __name__ == "__main__":
    main(sys.argv[1])
