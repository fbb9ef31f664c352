import numpy as np
import pytest

import volalign
from conftest import CAMERA, depth_of, frame_of, true_pose


@pytest.fixture(scope="module")
def depth():
    return depth_of(true_pose(0.5))


def test_metres_and_millimetres(depth):
    millimetres = np.round(depth * 1000).astype(np.uint16)
    np.testing.assert_array_equal(frame_of("A", depth).depth, depth)
    np.testing.assert_array_equal(frame_of("A", depth.astype(np.float64)).depth, depth)
    np.testing.assert_allclose(frame_of("A", millimetres).depth, depth, atol=6e-4)
    quarters = np.round(depth * 4000).astype(np.uint16)
    np.testing.assert_allclose(frame_of("A", quarters, depth_scale=0.00025).depth, depth, atol=2e-4)
    # Any memory layout, any byte order.
    np.testing.assert_array_equal(frame_of("A", np.asfortranarray(depth)).depth, depth)
    np.testing.assert_array_equal(frame_of("A", depth.astype(">f4")).depth, depth)


def test_what_is_no_measurement(depth):
    spoilt = depth.copy()
    spoilt[0, :4] = [np.nan, np.inf, -1, 0]
    np.testing.assert_array_equal(frame_of("A", spoilt).depth[0, :4], 0)


def test_several_frames_of_a_still_scene(depth):
    frame = frame_of("A", depth * np.reshape([0.999, 1, 1.001], (3, 1, 1)))
    np.testing.assert_allclose(frame.depth, depth, atol=1e-5)
    assert frame.depth_sigma.shape == depth.shape
    assert frame_of("A", depth).depth_sigma is None


def test_arrays_are_copied_in_and_safe_to_keep(depth):
    own = depth.copy()
    frame = frame_of("A", own)
    own[:] = 9
    seen = frame.depth
    del frame
    np.testing.assert_array_equal(seen, depth)
    assert not seen.flags.writeable


def test_refuses(depth):
    for bad, words in (
        (depth.astype(np.int32), "int32"),
        (depth > 0, "bool"),
        (depth[0], "1 axes"),
        (depth[:0], "0 values"),
        (-depth - 1, "every value is negative"),
    ):
        with pytest.raises(volalign.DataError, match=words):
            frame_of("A", bad)
    for more, words in (({"quarter_turns": 4}, "quarter_turns"), ({"depth_scale": 0}, "depth_scale"), ({"distortion": [1]}, "distortion"),
                        ({"serial": "a" * 1000}, "plain text"), ({"sensor": "\x1b[31m"}, "plain text")):
        with pytest.raises(volalign.DataError, match=words):
            frame_of("A", depth, **more)
    with pytest.raises(volalign.DataError, match="file name"):
        frame_of("a/b", depth)
    with pytest.raises(volalign.DataError, match='two sensors are named "A"'):
        volalign.Capture([frame_of("A", depth), frame_of("A", depth)])


def test_properties(depth, stack):
    pose = true_pose(0.5)
    frame = frame_of("A", depth, sensor="azure_kinect_nfov_binned", quarter_turns=1, serial="7", ground_truth=pose)
    assert (frame.name, frame.sensor, frame.quarter_turns, frame.serial) == ("A", "azure_kinect_nfov_binned", 1, "7")
    np.testing.assert_array_equal(frame.ground_truth, pose)
    assert frame.intrinsics == CAMERA
    capture = volalign.Capture([frame], structure=stack, name="first")
    assert (capture.name, capture.structure, len(capture.frames)) == ("first", stack, 1)
    assert volalign.Capture([frame]).structure is None


def test_from_files(capture_file, depth, stack):
    capture = volalign.Capture.load(capture_file)
    assert [frame.name for frame in capture.frames] == ["S1", "S2", "S3"]
    np.testing.assert_array_equal(capture.frames[0].depth, depth)
    assert capture.structure == stack
    assert capture.name == str(capture_file)


def test_masks_and_channels(depth):
    mask = np.zeros(depth.shape, bool)
    mask[3, 5:9] = True
    for values in (depth, np.round(depth * 1000).astype(np.uint16)):
        masked = frame_of("A", np.ma.array(values, mask=mask)).depth
        np.testing.assert_array_equal(masked[3, 5:9], 0)
        np.testing.assert_array_equal(masked[~mask], frame_of("A", values).depth[~mask])
    np.testing.assert_array_equal(frame_of("A", depth[..., None]).depth, depth)
    assert frame_of("A", np.stack([depth, depth])[..., None]).depth_sigma.shape == depth.shape
    with pytest.raises(volalign.DataError, match="last axis of depth has 3 values"):
        frame_of("A", np.dstack([depth] * 3))


def test_a_transposed_image_is_named():
    camera = volalign.Intrinsics(640, 480, 600, 600, 320, 240)
    depth = depth_of(true_pose(0.5), camera)
    assert frame_of("A", depth, camera).depth.shape == (480, 640)
    with pytest.raises(volalign.DataError, match=r"rows and columns exchanged. Transpose the array"):
        frame_of("A", depth.T, camera)
    # A principal point that is off, as sensors' own and cropped images have it.
    frame_of("A", depth, volalign.Intrinsics(640, 480, 600, 600, 300, 262))
    frame_of("A", depth, volalign.Intrinsics(640, 480, 600, 600, 200, 240))


def test_a_stack_that_cannot_be(capture):
    floats = volalign.Structure("s", [volalign.Box("low", (0, 0, 0), (0.5, 0.4, 0.3)), volalign.Box("high", (0, 1, 0), (0.5, 1.4, 0.3))])
    with pytest.raises(volalign.DataError, match="'high' stands on nothing"):
        volalign.calibrate(volalign.Capture(capture.frames, structure=floats))
    assert "impossible: box 'high' stands on nothing" in str(floats.check())
    small = volalign.Structure("s", [volalign.Box("cm", (0, 0, 0), (0.04, 0.03, 0.05))])
    with pytest.warns(UserWarning, match="check the unit"):
        volalign.calibrate(volalign.Capture(capture.frames, structure=small), model=None)
