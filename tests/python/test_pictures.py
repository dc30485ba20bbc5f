"""Elements of pictures: cameras, surfaces, hidden lines, hands and glyphs of grasp poses."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import graspbox
from graspbox import _core, errors
from graspbox.meshes import mesh_from_arrays
from graspbox.meshes.shapes import cylinder
from graspbox.planning import Box

pytest.importorskip("matplotlib")
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

from graspbox.pictures import Camera, PosedHand, Solid, View
from graspbox.pictures.hands import glyphs
from graspbox.pictures.solids import box_mesh
from graspbox.pictures.view import Lens


def check_picture(path: Path, *, most: int = 400_000) -> None:
    """Check that a picture is smaller than `most` bytes, and that something is on it."""
    with Image.open(path) as image:
        pixels = np.asarray(image.convert("L"))
    assert path.stat().st_size < most
    assert 0.02 < np.mean(pixels < 200) < 0.9


def cube(center: tuple[float, float, float], half: float, color: str) -> Solid:
    """Make a cube of half side `half` metres."""
    mesh = box_mesh(Box(np.zeros(3), np.eye(3), np.full(3, half)))
    pose = np.eye(4)
    pose[:3, 3] = center
    return Solid(mesh, color, pose)


CUBE = cube((0.0, 0.0, 0.0), 0.05, "#0000ff")
FRONT = Camera(azimuth=-90.0, elevation=0.0)
CORNERS = 0.05 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])


def test_camera_looks_where_it_says() -> None:
    np.testing.assert_allclose(FRONT.axes.T, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)
    top = Camera(azimuth=-90.0, elevation=90.0)
    np.testing.assert_allclose(top.axes.T, [[1, 0, 0], [0, -1, 0], [0, 0, -1]], atol=1e-12)
    for camera in (FRONT, top, Camera(37.0, 12.0)):
        np.testing.assert_allclose(np.cross(camera.axes[:, 0], camera.axes[:, 1]), camera.axes[:, 2], atol=1e-12)
    for way in ([1.0, 0.2, 0.0], [-0.5, 0.8, -0.3], [0.0, -1.0, 0.0]):
        along = Camera.across(way).axes[:, 2] @ way
        assert abs(along) < 0.5 * np.linalg.norm(way), "the way lies across the view, not along it"


def test_a_lens_shows_all_points_and_fills_the_picture() -> None:
    rng = np.random.default_rng(0)
    for size in ((200, 100), (90, 240)):
        points = rng.normal(size=(50, 3)) * [0.3, 0.1, 0.2] + [1.0, -2.0, 0.5]
        seen = Lens.showing(points, Camera(20.0, 30.0), size).project(points)
        low, high = seen[:, :2].min(axis=0) / size, seen[:, :2].max(axis=0) / size
        np.testing.assert_allclose(low + high, 1.0, atol=1e-9)
        assert np.max(high - low) == pytest.approx(0.94)
        assert np.all(seen[:, 2] > 0)


def test_the_picture_is_where_the_lens_projects() -> None:
    # Lines agree with the renderer: the columns and rows that the cube covers, and its least depth.
    view = View([CUBE], Camera(-70.0, 35.0), shown=CORNERS, size=(160, 120))
    projected = view.lens.project(CORNERS)
    rows, columns = np.nonzero(view.depth)
    for pixels, at in ((columns, projected[:, 0]), (rows, projected[:, 1])):
        assert abs(pixels.min() + 0.5 - at.min()) < 1.0
        assert abs(pixels.max() + 0.5 - at.max()) < 1.0
    assert abs(view.depth[view.depth > 0].min() - projected[:, 2].min()) < 2e-3
    covered = np.any(view.image < 250, axis=2)
    assert np.mean(covered != (view.depth > 0)) < 0.03, "pictures and depths differ only along smooth edges"


def test_the_nearer_surface_hides_the_farther() -> None:
    near = cube((0.0, -0.2, 0.0), 0.02, "#ff0000")
    views = [View(s, FRONT, shown=CORNERS, size=(101, 101)) for s in ([near, CUBE], [CUBE, near])]
    middle, edge = views[0].image[50, 50].astype(int), views[0].image[50, 12].astype(int)
    assert middle[0] > middle[2]
    assert edge[2] > edge[0]
    # The order of the solids does not matter.
    np.testing.assert_array_equal(views[0].image, views[1].image)


def test_lines_know_what_hides_them() -> None:
    view = View([CUBE], FRONT, shown=CORNERS, size=(200, 200))
    points = np.array([[0.0, -0.1, 0.0], [0.0, -0.05, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    np.testing.assert_array_equal(view.visible(points), [True, True, False, False, True])
    axes = Figure().subplots()
    view.lines(axes, [[[-0.1, 0.06, 0.01], [0.1, 0.06, 0.01]]], "black", hidden=0.2)
    added = [collection for collection in axes.collections if isinstance(collection, LineCollection)]
    hidden, seen = (collection.get_segments() for collection in added)
    assert [len(hidden), len(seen)] == [1, 2], "one stretch behind the cube, one on each side of it"


def test_the_table_takes_whole_shadows_and_hides_no_lines() -> None:
    box = cube((0.0, 0.0, 0.05), 0.05, "#c08040")
    corners = CORNERS + np.array([0.0, 0.0, 0.05])
    view = View([box], Camera(-60.0, 30.0), shown=corners, size=(200, 160), table=corners)
    bare = View([box], Camera(-60.0, 30.0), shown=corners, size=(200, 160))
    border = np.concatenate([view.image[[0, -1]].reshape(-1, 3), view.image[:, [0, -1]].reshape(-1, 3)])
    assert border.min() >= 250, "the table ends within the picture"
    # Smooth edges of the box are dark too, but few.
    dark, bare_dark = (np.mean((v.depth == 0) & (v.image.max(axis=2) < 200)) for v in (view, bare))
    assert dark > 0.02 > 3 * bare_dark, "a shadow lies on the table"
    assert view.visible(np.array([[-0.05, -0.05, -1e-3], [0.05, -0.05, -1e-3]])).all(), "an edge in its top is seen"


def bent(preshape: float, proximal: float, distal: float) -> Any:
    """Positions of the ReFlex's joints, all fingers alike."""
    return np.array([preshape, *(proximal, distal) * 3])


def test_a_hand_is_shown_whole_where_it_is() -> None:
    hand = graspbox.load_hand()
    frame = np.eye(4)
    frame[:3, 3] = [1.0, 2.0, 3.0]
    here, there = (PosedHand.open(hand, pose, 0.0) for pose in (np.eye(4), frame))
    assert len(here.corners()) == 8 * len(hand.shapes(hand.open(0.0))[0])
    np.testing.assert_allclose(here.corners() + frame[:3, 3], there.corners(), atol=1e-12)
    closed = PosedHand(hand, np.eye(4), bent(0.0, 0.7, 0.7))
    assert not np.allclose(closed.corners(), here.corners())
    small = cube((0.0, 0.0, 0.0), 1e-3, "#000000")
    for posed in (here, there, closed):
        view = View([small], Camera(), shown=posed.corners(), size=(160, 120), hand=posed)
        rows, columns = np.nonzero(view.depth)
        ends = [columns.min() / 160, rows.min() / 120, 1 - columns.max() / 160, 1 - rows.max() / 120]
        assert 0.0 < min(ends) < 0.05, "it fills the picture that was made for its corners"


def test_wrong_scenes_are_refused() -> None:
    lens = Lens.showing(CORNERS, FRONT, (32, 32))
    config: dict[str, Any] = {"image_size": (32, 32), "samples": 1, "near": 0.01, "far": 10.0, "light": {}}

    def render(poses: Any, colors: Any, config: dict[str, Any] = config) -> Any:
        return _core.render(
            [CUBE.mesh], poses, colors, [True], None, lens.intrinsics, lens.world_from_camera, config, None
        )

    color = np.full((1, 3), 0.5)
    image, depth = render(np.eye(4)[None], color)
    assert (image.shape, image.dtype, depth.shape, depth.dtype) == ((32, 32, 3), np.uint8, (32, 32), np.float32)
    for poses, colors, reason in (
        (np.zeros((0, 4, 4)), color, "world_from_mesh has length 0; give one for each of 1 meshes"),
        (np.eye(4)[None], np.full((2, 3), 0.5), "colors has length 2"),
        (np.eye(4)[None], 2 * np.ones((1, 3)), "color"),
        (2 * np.eye(4)[None], color, "not a rigid motion"),
    ):
        with pytest.raises(errors.ConfigError, match=reason):
            render(poses, colors)
    with pytest.raises(errors.ConfigError, match="samples"):
        render(np.eye(4)[None], color, {**config, "samples": 9})


def turned(axis: int, angle: float) -> Any:
    """Make a pose that turns about one axis of the frame."""
    pose, (i, j) = np.eye(4), ((1, 2), (2, 0), (0, 1))[axis]
    pose[[i, i, j, j], [i, j, i, j]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
    return pose


def test_joints_are_where_the_urdf_has_them() -> None:
    # In the grasp frame, whose origin is (0.015, 0, 0.09) in the base: finger 3 at rest, finger 1 at three preshapes.
    hand = graspbox.load_hand()
    for preshape in (0.0, 0.7, np.pi / 2):
        one, two, three = PosedHand.open(hand, np.eye(4), preshape).skeleton()
        np.testing.assert_allclose(three.points[0], [-0.045, 0.0, -0.0084], atol=1e-6)
        np.testing.assert_allclose(three.points[1], [-0.045 - 0.066, 0.0, -0.0134], atol=1e-6)
        np.testing.assert_allclose(np.abs(three.axes[0]), [0, 1, 0], atol=1e-6)
        way = np.array([np.cos(preshape), -np.sin(preshape), 0.0])
        np.testing.assert_allclose(one.points[0], np.array([0.0354, -0.026, -0.0084]) + 0.010 * way, atol=1e-6)
        np.testing.assert_allclose(one.points[1], one.points[0] + 0.066 * way - [0, 0, 0.005], atol=1e-6)
        np.testing.assert_allclose(two.points[1], one.points[1] * [1, -1, 1], atol=1e-6)
        # The far end of the distal link.
        assert np.linalg.norm(one.tip - one.points[1]) == pytest.approx(0.0485, abs=0.003)
    up = PosedHand(hand, np.eye(4), bent(0.0, np.pi / 2, 0.0)).skeleton()[2]
    np.testing.assert_allclose(up.points[1] - up.points[0], [-0.005, 0.0, 0.066], atol=1e-6)


@pytest.mark.parametrize("angles", [(0.0, 0.0), (1.2, 0.8)])
def test_fingers_are_joined_to_the_palm(angles: tuple[float, float], monkeypatch: pytest.MonkeyPatch) -> None:
    """Collision shapes leave gaps at the joints, at which open fingers seemed to float."""
    hand, pose = graspbox.load_hand(), turned(2, 0.3)
    posed = PosedHand(hand, pose, bent(0.5, *angles))
    fingers, joints = posed.skeleton(), posed.hinges()
    assert len(joints) == 2 * len(fingers) == 6
    for finger, hinge, neck in zip(fingers, joints[::2], joints[1::2], strict=True):
        np.testing.assert_array_equal(hinge.world_from_mesh, pose)
        np.testing.assert_allclose(hinge.mesh.vertices.mean(axis=0), finger.points[0], atol=1e-9)
        # The neck reaches from amid the link to the knuckle.
        way = finger.points[1] - finger.links[0].center
        along = (neck.mesh.vertices - finger.links[0].center) @ way / np.linalg.norm(way)
        np.testing.assert_allclose([along.min(), along.max()], [0.0, float(np.linalg.norm(way))], atol=1e-9)
    # Seen from above the palm the hinges are in the picture.
    view = View([], Camera(30.0, 89.0), shown=posed.corners(), size=(300, 300), hand=posed)
    monkeypatch.setattr(PosedHand, "hinges", lambda _: [])
    bare = View([], Camera(30.0, 89.0), shown=posed.corners(), size=(300, 300), hand=posed)
    assert np.mean(np.any(view.image != bare.image, axis=2)) > 0.001


def test_glyphs_show_approach_roll_and_preshape() -> None:
    hand = graspbox.load_hand()
    poses = np.array([np.eye(4), turned(2, 0.9), turned(0, 0.4)])
    poses[:, :3, 3] = [[0.0, 0.0, 0.0], [0.1, 0.2, 0.3], [0.0, 0.0, 0.5]]
    shapes = glyphs(hand, poses, np.array([0.0, np.pi / 2, 0.0]))
    assert shapes.shape == (3, 1 + 3 * len(hand.chains), 2, 3), "a stem, and three lines for each finger"
    for pose, shape in zip(poses, shapes, strict=True):
        stem = shape[0, 1] - shape[0, 0]
        np.testing.assert_allclose(shape[0, 1], pose[:3, 3], atol=1e-12)
        np.testing.assert_allclose(stem / np.linalg.norm(stem), pose[:3, 2], atol=1e-9)
        ends = (shape[:, 1] - pose[:3, 3]) @ pose[:3, :3]
        assert np.all(ends[3::3, 2] > 0.005), "fingers point ahead of the palm"
    # The same preshape is the same shape elsewhere; fingers 1 and 2 are side by side or opposite each other.
    moved = shapes[0] @ poses[2, :3, :3].T + poses[2, :3, 3]
    np.testing.assert_allclose(shapes[2], moved, atol=1e-9)
    tips = (shapes[:, [3, 6], 1] - poses[:, None, :3, 3]) @ poses[:, :3, :3]
    side_by_side, opposite = tips[0], tips[1]
    assert side_by_side[0, 0] == pytest.approx(side_by_side[1, 0])
    assert abs(side_by_side[0, 1] - side_by_side[1, 1]) < 0.6 * abs(opposite[0, 1] - opposite[1, 1])
    assert glyphs(hand, np.zeros((0, 4, 4)), np.zeros(0)).shape == (0, 1 + 3 * len(hand.chains), 2, 3)


def test_cylinders_are_closed_and_face_outward() -> None:
    mesh = mesh_from_arrays(*cylinder((0.1, 0.0, 0.0), (0.0, 2.0, 0.0), 0.03, 0.05))
    assert mesh.volume == pytest.approx(np.pi * 0.03**2 * 0.1, rel=0.01)
    np.testing.assert_allclose(mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0), [0.06, 0.1, 0.06], atol=1e-3)
