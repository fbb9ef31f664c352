#!/usr/bin/env python3
"""One depth frame and the intrinsics of every Orbbec sensor that is plugged in, for `volalign init FOLDER`.

    examples/capture_orbbec.py FOLDER          (needs pyorbbecsdk 2 and NumPy)

Not run here for want of a device; written after the examples of pyorbbecsdk.
"""

import pathlib
import sys

import numpy as np
from pyorbbecsdk import Config, Context, OBFormat, OBSensorType, Pipeline

folder = pathlib.Path(sys.argv[1])
folder.mkdir(parents=True, exist_ok=True)
devices = Context().query_devices()
for i in range(devices.get_count()):
    device = devices.get_device_by_index(i)
    name = device.get_device_info().get_serial_number()
    pipeline, config = Pipeline(device), Config()
    profiles = pipeline.get_stream_profile_list(OBSensorType.DEPTH_SENSOR)
    config.enable_stream(profiles.get_default_video_stream_profile())
    pipeline.start(config)
    depth = None
    for _ in range(60):  # the first frames are those of an exposure that is still being found
        frames = pipeline.wait_for_frames(1000)
        depth = frames.get_depth_frame() if frames else depth
    if depth is None or depth.get_format() != OBFormat.Y16:
        sys.exit(f"{name}: no depth frame of 16 bits")
    image = np.frombuffer(depth.get_data(), np.uint16).reshape(depth.get_height(), depth.get_width())
    np.save(folder / f"{name}_depth.npy", image)
    (folder / f"{name}_intrinsics.txt").write_text(f"{pipeline.get_camera_param()}\n")
    print(f"{name}: --depth-scale {depth.get_depth_scale() / 1000:g}")
    pipeline.stop()
