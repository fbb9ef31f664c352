#!/usr/bin/env python3
"""One depth frame and the intrinsics of every RealSense that is plugged in, for `volalign init FOLDER`.

    examples/capture_realsense.py FOLDER       (needs pyrealsense2 and NumPy)

Not run here for want of a device; written after the reference of pyrealsense2.
"""

import json
import pathlib
import sys

import numpy as np
import pyrealsense2 as rs

folder = pathlib.Path(sys.argv[1])
folder.mkdir(parents=True, exist_ok=True)
for device in rs.context().query_devices():
    name = device.get_info(rs.camera_info.serial_number)
    pipeline, config = rs.pipeline(), rs.config()
    config.enable_device(name)
    config.enable_stream(rs.stream.depth)
    profile = pipeline.start(config)
    for _ in range(60):  # the first frames are those of an exposure that is still being found
        depth = pipeline.wait_for_frames().get_depth_frame()
    np.save(folder / f"{name}_depth.npy", np.asanyarray(depth.get_data()))
    k = depth.profile.as_video_stream_profile().get_intrinsics()
    intrinsics = {"width": k.width, "height": k.height, "fx": k.fx, "fy": k.fy, "cx": k.ppx, "cy": k.ppy, "distortion": list(k.coeffs)}
    (folder / f"{name}_intrinsics.json").write_text(json.dumps(intrinsics))
    print(f"{name}: --depth-scale {profile.get_device().first_depth_sensor().get_depth_scale():g}")
    pipeline.stop()
