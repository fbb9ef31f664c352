from itertools import islice

import numpy as np
import pytest

import volalign

SMALL = {"data.image_sizes": ["80x72", "80x45"], "run.batch_size": 2}


def draw(count, **more):
    return list(islice(volalign.samples(renderer="cpu", **{"seed": 5, "threads": 1, **SMALL, **more}), count))


def test_samples():
    samples = volalign.samples(renderer="cpu", threads=1, **SMALL)
    assert (samples.batch_size, samples.structure.num_classes) == (2, 21)
    assert 'renderer: "cpu"' in samples.recipe
    sample = next(samples)
    assert sample.index == 0
    for image, kind in ((sample.depth, np.float32), (sample.labels, np.uint8), (sample.depth_clean, np.float32), (sample.labels_clean, np.uint8)):
        assert image.dtype == kind
        assert image.shape == (sample.intrinsics.height, sample.intrinsics.width)
        assert image.flags.writeable and image.flags.c_contiguous
    assert sample.structure_from_sensor.shape == (4, 4)
    assert sample.box_offsets.shape == (4, 4, 4)
    assert sample.labels.max() < 21 and not sample.depth[sample.labels > 0].min() <= 0


def test_depend_on_seed_and_index_alone():
    first = draw(4)
    for other in (draw(4, threads=3), [*draw(2), *draw(2, start=2)]):
        for a, b in zip(first, other):
            assert a.index == b.index
            np.testing.assert_array_equal(a.depth, b.depth)
            np.testing.assert_array_equal(a.labels, b.labels)
    assert not np.array_equal(first[0].structure_from_sensor, draw(1, seed=6)[0].structure_from_sensor)


def test_images_outlive_sample_and_iterator():
    depth = draw(1)[0].depth
    expected = draw(1)[0].depth.copy()
    np.testing.assert_array_equal(depth, expected)
    depth[:] = 1
    assert depth.sum() == depth.size


def test_recipes():
    assert next(volalign.samples({"data": {"renderer": "cpu", "image_sizes": ["80x45"], "sensors": ["realsense_d415"]}})).depth.shape == (45, 80)
    with pytest.raises(volalign.ConfigError, match="data.image_size"):
        volalign.samples(**{"data.image_size": ["80x72"]})
    with pytest.raises(volalign.ConfigError, match="renderer"):
        volalign.samples(renderer="nonsense")
    with pytest.raises(volalign.Error, match="multiple of the batch size"):
        volalign.samples(renderer="cpu", start=3)


def test_torch_takes_them_without_a_copy():
    import torch

    sample = draw(1)[0]
    tensor = torch.from_numpy(sample.depth)
    assert tensor.data_ptr() == sample.depth.ctypes.data
    tensor += 1
    assert sample.depth.min() >= 1
