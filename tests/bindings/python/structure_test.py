import numpy as np
import pytest

import volalign


def test_reads_writes_and_describes(tmp_path):
    structure = volalign.Structure.load("configs/structure.yaml")
    assert (len(structure.boxes), structure.num_classes) == (4, 21)
    assert len(structure.side_names) == 20
    assert structure.side_centres.shape == (20, 3)
    structure.save(tmp_path / "structure.yaml")
    assert volalign.Structure.load(tmp_path / "structure.yaml") == structure
    structure.save(tmp_path / "structure.glb")
    # A picture of boxes is a mesh: its sides have other names.
    mesh = volalign.Structure.load(tmp_path / "structure.glb")
    assert repr(mesh) == "<Structure structure: 4 parts, 20 labels>"
    assert mesh != structure


def test_a_mesh(tmp_path):
    # A wedge of 80 x 60 x 50 cm.
    corners = [(x, y, z) for z in (0, 0.5) for x, y in ((0, 0), (0.8, 0), (0, 0.6))]
    faces = [(1, 3, 2), (4, 5, 6), (1, 2, 5), (1, 5, 4), (2, 3, 6), (2, 6, 5), (3, 1, 4), (3, 4, 6)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in faces]
    (tmp_path / "wedge.obj").write_text("o wedge\n" + "\n".join(lines) + "\n")
    wedge = volalign.Structure.load(tmp_path / "wedge.obj")
    (part,) = wedge.boxes
    assert part.is_mesh and repr(part) == "<Mesh part wedge: 0.800 x 0.600 x 0.500 m>"
    np.testing.assert_allclose(part.structure_from_box[:3, 3], [0.4, 0.3, 0.25])
    assert len(wedge.side_names) == 4 and wedge.side_names[0] == "wedge/1"
    assert repr(wedge) == "<Structure wedge: 1 part, 4 labels>"
    camera = volalign.Intrinsics(64, 48, fx=60, fy=60, cx=31.5, cy=23.5)
    depth, labels = wedge.cast_view(camera, volalign.look_at((2.3, 1.4, 0.25), (0.5, 0.2, 0.25)))
    assert depth[24, 32] > 1 and wedge.side_names[labels[24, 32] - 1] == "wedge/1"
    wedge.save(tmp_path / "wedge.yaml")
    (tmp_path / "wedge.obj").unlink()
    assert volalign.Structure.load(tmp_path / "wedge.yaml") == wedge
    (tmp_path / "sheet.obj").write_text("\n".join(lines[:7]) + "\n")
    with pytest.raises(volalign.ConfigError, match="the surface is open"):
        volalign.Structure.load(tmp_path / "sheet.obj")


def test_boxes(stack):
    low, high = stack.boxes
    np.testing.assert_allclose(low.size, [0.6, 0.4, 0.4])
    np.testing.assert_allclose(high.structure_from_box[:3, 3], [-0.1, 0.575, 0.025])
    assert stack.floor_height == 0
    assert stack.height == pytest.approx(0.75)
    # From +z towards +x.
    turned = volalign.Box("a", (-1, 0, -1), (1, 1, 1), yaw_deg=90)
    np.testing.assert_allclose(turned.structure_from_box[:3, :3] @ [0, 0, 1], [1, 0, 0], atol=1e-12)


def test_cast_view(stack):
    camera = volalign.Intrinsics(64, 48, fx=60, fy=60, cx=31.5, cy=23.5)
    depth, labels = stack.cast_view(camera, volalign.look_at((2, 0.2, 0), (0, 0.2, 0)))
    assert (depth.shape, depth.dtype, labels.dtype) == ((48, 64), np.float32, np.uint8)
    assert depth[24, 32] == pytest.approx(1.7)
    assert stack.side_names[labels[24, 32] - 1] == "low/front"


def test_target(stack):
    target = stack.check(heights_m=[1.0])
    assert len(target.views) == 36
    assert {view.height_m for view in target.views} == {1.0}
    assert "stack" in str(target)


def test_intrinsics():
    camera = volalign.Intrinsics(320, 288, 252, 252, 160, 144, [0.1, 0.2, 0, 0])
    np.testing.assert_array_equal(camera.matrix, [[252, 0, 160], [0, 252, 144], [0, 0, 1]])
    assert camera.resized(160, 144).cx == pytest.approx(79.75)
    assert "azure_kinect_nfov_binned" in volalign.intrinsics_pool()
    with pytest.raises(volalign.DataError, match="fx"):
        volalign.Intrinsics(320, 288, 0, 252, 160, 144)


def test_poses():
    a = volalign.look_at((2, 1, 0), (0, 1, 0))
    np.testing.assert_allclose(a[:3, 2], [-1, 0, 0], atol=1e-12)
    b = volalign.look_at((2, 1, 0.03), (0, 1, 0.03), roll_deg=3)
    assert volalign.compare_poses(a, b) == pytest.approx((0.03, 3))
    with pytest.raises(volalign.DataError, match=r"shape \(3, 4\)"):
        volalign.compare_poses(a[:3], b)
    with pytest.raises(volalign.DataError):
        volalign.compare_poses(2 * a, b)
