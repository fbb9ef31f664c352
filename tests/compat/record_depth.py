#!/usr/bin/env python3
"""Writes recordings as other programs do: a .bag by librealsense's own recorder, from a software device, and a .mkv by ffmpeg and mkvmerge.

    tests/compat/record_depth.py FOLDER      the small recordings of tests/infer/formats/recordings

Needs mkvmerge (Debian's mkvtoolnix), and of PyPI pyrealsense2 (2.56; 2.59 records no .bag any more), imageio-ffmpeg and numpy.
"""

import json
import os
import subprocess
import sys
import tempfile
import time

import imageio_ffmpeg
import numpy as np
import pyrealsense2 as rs


def record_bag(path, frames, k, unit=0.001, name="Intel RealSense D415", serial="918512071234"):
    """frames: uint16 arrays of one size; k: fx, fy, ppx, ppy."""
    height, width = frames[0].shape
    device = rs.software_device()
    device.register_info(rs.camera_info.name, name)
    device.register_info(rs.camera_info.serial_number, serial)
    sensor = device.add_sensor("Stereo Module")
    intrinsics = rs.intrinsics()
    intrinsics.width, intrinsics.height = width, height
    intrinsics.fx, intrinsics.fy, intrinsics.ppx, intrinsics.ppy = k
    intrinsics.model = rs.distortion.brown_conrady
    intrinsics.coeffs = [0, 0, 0, 0, 0]
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid = rs.stream.depth, 0, 0
    stream.width, stream.height, stream.fps, stream.bpp = width, height, 30, 2
    stream.fmt, stream.intrinsics = rs.format.z16, intrinsics
    profile = sensor.add_video_stream(stream)
    sensor.add_read_only_option(rs.option.depth_units, unit)
    recorder = rs.recorder(path, device)
    recording = recorder.query_sensors()[0]
    queue = rs.frame_queue(100)
    recording.open(profile)
    recording.start(queue)
    for i, pixels in enumerate(frames):
        frame = rs.software_video_frame()
        frame.pixels = np.ascontiguousarray(pixels)
        frame.stride, frame.bpp = 2 * width, 2
        frame.timestamp, frame.frame_number = i * 33.3, i
        frame.domain = rs.timestamp_domain.hardware_clock
        frame.profile = profile.as_video_stream_profile()
        frame.depth_units = unit
        sensor.on_video_frame(frame)
        time.sleep(0.1)
    recording.stop()
    recording.close()
    del recorder, recording


def kinect_calibration(parameters):
    """The device's raw calibration, with the keys that its memory has."""

    def camera(purpose, location, numbers):
        intrinsics = {"ModelParameterCount": 14, "ModelParameters": numbers, "ModelType": "CALIBRATION_LensDistortionModelBrownConrady"}
        return {"Intrinsics": intrinsics, "Location": location, "Purpose": purpose, "MetricRadius": 1.74, "SensorWidth": 1024, "SensorHeight": 1024}

    cameras = [camera("CALIBRATION_CameraPurposePhotoVideo", "CALIBRATION_CameraLocationPV0", [0.5] * 10 + [0] * 4),
               camera("CALIBRATION_CameraPurposeDepth", "CALIBRATION_CameraLocationD0", parameters)]
    return json.dumps({"CalibrationInformation": {"Cameras": cameras}})


def record_mkv(path, frames, parameters, serial="000123492812"):
    """As the Azure Kinect's recorder: track DEPTH of b16g, calibration.json attached, its tags."""
    height, width = frames[0].shape
    with tempfile.TemporaryDirectory() as folder:
        calibration, raw, tags = (os.path.join(folder, name) for name in ("calibration.json", "raw.mkv", "tags.xml"))
        with open(calibration, "w", encoding="utf-8") as file:
            file.write(kinect_calibration(parameters) + "\0")
        simple = "<Simple><Name>%s</Name><String>%s</String></Simple>"
        with open(tags, "w", encoding="utf-8") as file:
            file.write("<Tags><Tag>" + simple % ("K4A_DEPTH_MODE", "NFOV_2X2BINNED"))
            file.write(simple % ("K4A_DEVICE_SERIAL_NUMBER", serial) + "</Tag></Tags>")
        command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-loglevel", "error", "-f", "rawvideo", "-pixel_format", "gray16be"]
        command += ["-video_size", f"{width}x{height}", "-framerate", "30", "-i", "-"]
        command += ["-c:v", "copy", "-allow_raw_vfw", "1", raw]
        subprocess.run(command, input=b"".join(frame.astype(">u2").tobytes() for frame in frames), check=True)
        # ffmpeg has no FourCC for this format; mkvmerge sets it.
        command = ["mkvmerge", "-q", "-o", path, "--global-tags", tags, "--fourcc", "0:b16g", "--track-name", "0:DEPTH"]
        command += ["--compression", "0:none", "--attachment-mime-type", "application/octet-stream"]
        subprocess.run(command + ["--attach-file", calibration, raw], check=True)


def main():
    folder = sys.argv[1]
    os.makedirs(folder, exist_ok=True)
    v, u = np.mgrid[0:48, 0:64]
    frames = [(10000 + 100 * i + 64 * v + u).astype(np.uint16) for i in range(3)]
    record_bag(os.path.join(folder, "realsense.bag"), frames, (47.5, 47.25, 31.5, 23.75), unit=0.0001)
    v, u = np.mgrid[0:288, 0:320]
    parameters = [0.5078, 0.5117, 0.4927, 0.4928, 0.92185, 0.5004, 0.02836, 1.25842, 0.75181, 0.14419, 0, 0, -0.0001, 0.0002]
    record_mkv(os.path.join(folder, "kinect.mkv"), [(1000 + 4 * v + u).astype(np.uint16)], parameters)


if __name__ == "__main__":
    main()
