"""Images of environments: images by name, their cameras, and rendered pictures."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
from acting import EACH
from graspbox import _core, errors, object_sets
from graspbox._common.arguments import config_dict
from graspbox.configs import FRONT, PALM, CameraConfig, CamerasConfig, PhysicsConfig, PictureConfig

OBJECTS = ("procedural:can:1", "procedural:box:3")
IMAGES = ("rgb", "depth", "rgbd", "segmentation", "amodal", "points", "voxels", "depth_palm", "rgb_palm", "voxels_palm")
#: Looks along the table: above it there is nothing but the sky.
LEVEL = CameraConfig("level", eye=(-0.5, 0.0, 0.3), target=(0.0, 0.0, 0.3), fov=0.9)
HAND = _core.Hand.named("reflex")
TABLE, OBJECT, BASE = 1, 2, 3


@pytest.fixture(scope="module")
def objects() -> _core.Objects:
    sources = [spec.load() for spec in object_sets.load(list(OBJECTS))]
    return _core.Objects(sources, HAND, config_dict(PhysicsConfig()), None)


def pool(
    objects: _core.Objects,
    cameras: CamerasConfig,
    num_envs: int = 1,
    num_threads: int | None = None,
    **config: Any,
) -> _core.EnvPool:
    fields = {"observations": ["proprio"], "cameras": config_dict(cameras), **EACH, **config}
    return _core.EnvPool(objects, fields, num_envs, num_threads)


def tables(cameras: CamerasConfig) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = _core.image_tables(HAND, config_dict(cameras))
    return rows


def pose(x: float, y: float, z: float, rotation: Sequence[Sequence[float]] | None = None) -> list[list[float]]:
    matrix = np.eye(4)
    matrix[:3, :3] = np.eye(3) if rotation is None else rotation
    matrix[:3, 3] = x, y, z
    found: list[list[float]] = matrix.tolist()
    return found


#: The palm looks down.
DOWN = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]


def actions(rows: int, steps: int, seed: int = 0) -> NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, rows, 10)).astype(np.float32)


def pixel(intrinsics: NDArray[np.float64], camera: NDArray[np.float64], point: NDArray[np.float64]) -> tuple[int, int]:
    """Row and column of a world point."""
    local = np.linalg.inv(camera) @ np.append(point, 1.0)
    u, v, w = intrinsics @ local[:3]
    return int(v / w), int(u / w)


def test_images_are_as_their_table_says(objects: _core.Objects) -> None:
    cameras = CamerasConfig(images=IMAGES, image_size=(40, 56), cameras=(FRONT, PALM, LEVEL), voxels=20)
    envs = pool(objects, cameras, 2)
    shown = [envs.reset([0, 1])] + [envs.step(a)[0] for a in actions(2, 20)]
    for row in tables(cameras):
        assert row["privileged"] == (row["kind"] in ("segmentation", "amodal"))
        for arrays in shown:
            image = arrays[row["name"]]  # type: ignore[literal-required]
            assert image.shape == (2, *row["shape"])
            assert image.dtype == row["dtype"]
            assert (image >= np.float32(row["low"])).all()
            assert (image <= np.float32(row["high"])).all()
        first, last = (arrays[row["name"]] for arrays in (shown[0], shown[-1]))  # type: ignore[literal-required]
        assert not np.array_equal(first, last)


def test_images_of_one_frame_agree(objects: _core.Objects) -> None:
    cameras = CamerasConfig(
        images=("rgb", "depth", "rgbd", "segmentation", "points"), image_size=(48, 64), cameras=(LEVEL,)
    )
    envs = pool(objects, cameras)
    shown: Any = envs.reset([3])
    depth = shown["depth"][0, :, :, 0]
    k = _core.poses_of_cameras(envs)["level"][0]
    v, u = np.mgrid[:48, :64] + 0.5
    expected = np.stack([(u - k[0, 2]) / k[0, 0] * depth, (v - k[1, 2]) / k[1, 1] * depth, depth], axis=-1)
    np.testing.assert_allclose(shown["points"][0], expected, atol=1e-6)
    np.testing.assert_array_equal(shown["rgbd"][0, :, :, 3], depth)
    np.testing.assert_allclose(shown["rgbd"][0, :, :, :3] * 255, shown["rgb"][0], atol=1e-4)
    # Where nothing was seen, depth is 0, and only there.
    seen = shown["segmentation"][0, :, :, 0] > 0
    assert 0.2 < seen.mean() < 0.9
    np.testing.assert_array_equal(depth > 0, seen)
    assert (shown["points"][0][~seen] == 0).all()


def test_points_of_the_table_lie_on_the_table(objects: _core.Objects) -> None:
    envs = pool(objects, CamerasConfig(images=("points", "segmentation")))
    shown: Any = envs.reset([0])
    camera = _core.poses_of_cameras(envs)["front"][1][0]
    world = shown["points"][0] @ camera[:3, :3].T + camera[:3, 3]
    table = shown["segmentation"][0, :, :, 0] == TABLE
    near = table & (np.abs(world[..., :2]) < 0.59).all(axis=-1)
    assert near.mean() > 0.3
    np.testing.assert_allclose(world[near][:, 2], 0.0, atol=1e-5)


def test_labels_name_what_is_there(objects: _core.Objects) -> None:
    images = ("segmentation", "segmentation_palm", "segmentation_level")
    envs = pool(objects, CamerasConfig(images=images, image_size=(128, 128), cameras=(FRONT, PALM, LEVEL)))
    options = {"world_from_hand": pose(0.15, 0.0, 0.25, DOWN), "place": [0.0, 0.0, 0.3]}
    for index, name in enumerate(objects.names):
        shown: Any = envs.reset([index], None, [{**options, "object": name}])
        world_from_object, world_from_hand, _ = (poses[0] for poses in envs.poses())
        mesh = object_sets.load(OBJECTS[index])[0].load()
        middle = world_from_object[:3, :3] @ mesh.bounds.mean(axis=0) + world_from_object[:3, 3]
        for camera, key in (("front", "segmentation"), ("palm", "segmentation_palm")):
            k, poses = _core.poses_of_cameras(envs)[camera]
            at = pixel(k, poses[0], middle)
            if min(at) >= 0 and max(at) < 128:
                assert shown[key][0, *at, 0] == OBJECT, (name, camera)
            else:
                assert camera == "palm"
        # 5 cm behind the palm's surface is the middle of the base.
        k, poses = _core.poses_of_cameras(envs)["level"]
        base = world_from_hand[:3, :3] @ [0.0, 0.0, -0.05] + world_from_hand[:3, 3]
        assert shown["segmentation_level"][0, *pixel(k, poses[0], base), 0] == BASE
        labels = set(np.unique(shown["segmentation_level"][0]))
        assert {TABLE, OBJECT, BASE} < labels
        assert max(labels) < BASE + 10


def test_cameras_stand_still_or_follow_the_hand(objects: _core.Objects) -> None:
    envs = pool(objects, CamerasConfig(images=("depth",)))
    envs.reset([0])
    hands, fronts, palms = [], [], []
    for action in actions(1, 15):
        envs.step(action)
        cameras = _core.poses_of_cameras(envs)
        hands.append(envs.poses()[1][0])
        fronts.append(cameras["front"][1][0])
        palms.append(cameras["palm"][1][0])
    assert np.ptp(np.array(hands)[:, :3, 3], axis=0).max() > 0.01
    np.testing.assert_array_equal(fronts, [fronts[0]] * len(fronts))
    mounted = [np.linalg.inv(hand) @ palm for hand, palm in zip(hands, palms, strict=True)]
    np.testing.assert_allclose(mounted, [mounted[0]] * len(mounted), atol=1e-9)
    np.testing.assert_allclose(mounted[0][:3, 3], PALM.eye, atol=1e-9)
    forward = np.subtract(PALM.target, PALM.eye)
    np.testing.assert_allclose(mounted[0][:3, 2], forward / np.linalg.norm(forward), atol=1e-9)


def test_no_image_tells_where_a_hidden_object_is(objects: _core.Objects) -> None:
    """Behind both cameras, its place makes no difference to anything observed."""
    envs = pool(objects, CamerasConfig(images=IMAGES, shadows=False))
    hand = {"world_from_hand": pose(0.1, 0.0, 0.3, DOWN)}
    shown: list[Any] = [
        envs.reset([0], None, [{**hand, "object": 0, "world_from_object": pose(-0.46, y, 0.07)}]) for y in (-0.15, 0.17)
    ]
    for name in ("proprio", *IMAGES):
        np.testing.assert_array_equal(shown[0][name], shown[1][name])
    visible: Any = envs.reset([0], None, [{**hand, "object": 0, "world_from_object": pose(0.0, 0.0, 0.06)}])
    assert all(not np.array_equal(shown[0][name], visible[name]) for name in IMAGES)


def test_images_depend_on_seed_and_actions_alone(objects: _core.Objects) -> None:
    cameras = CamerasConfig(images=IMAGES, image_size=(32, 32), voxels=16)
    vary = {"camera_position": 0.02, "camera_rotation": 0.03, "light": 1.0}
    moves = actions(5, 12)

    def run(envs: Sequence[int], num_threads: int) -> list[Any]:
        some = pool(objects, cameras, len(envs), num_threads, randomization=vary, max_episode_steps=6)
        return [some.reset([10 + env for env in envs])] + [some.step(a[list(envs)])[0] for a in moves]

    together = run(range(5), 1)
    for envs, num_threads in ((range(5), 3), ([2], 1), ([4, 0], 2)):
        for some, all_ in zip(run(list(envs), num_threads), together, strict=True):
            for name in IMAGES:
                np.testing.assert_array_equal(some[name], all_[name][list(envs)])


def test_a_state_brings_its_images_back(objects: _core.Objects) -> None:
    cameras = CamerasConfig(images=("rgb", "depth_palm", "voxels"))
    vary = {"camera_position": 0.05, "camera_rotation": 0.05, "light": 1.0}
    envs, others = (pool(objects, cameras, randomization=vary) for _ in range(2))
    envs.reset([4])
    others.reset([5])
    for action in actions(1, 5):
        envs.step(action)
    others.set_state(0, envs.get_state(0))
    for ours, theirs in ((envs.now(), others.now()), *((p.step(a)[0] for p in (envs, others)) for a in actions(1, 3))):
        for name in cameras.images:
            np.testing.assert_array_equal(ours[name], theirs[name])  # type: ignore[literal-required]
    fewer = pool(objects, replace(cameras, cameras=(FRONT,), images=("rgb",)))
    with pytest.raises(errors.ConfigError, match="cameras"):
        fewer.set_state(0, envs.get_state(0))
    # The same number, but a wrist camera's pose is not a pose in the world.
    fixed = replace(cameras, cameras=(FRONT, replace(PALM, mount="world")))
    with pytest.raises(errors.ConfigError, match="front, palm"):
        pool(objects, fixed).set_state(0, envs.get_state(0))


def test_cameras_and_light_vary_only_where_asked(objects: _core.Objects) -> None:
    cameras = CamerasConfig(images=("rgb",))
    plain = pool(objects, cameras, 4)
    plain.reset([0, 1, 2, 3])
    fronts = _core.poses_of_cameras(plain)["front"][1]
    np.testing.assert_array_equal(fronts, [fronts[0]] * 4)
    moved = pool(objects, cameras, 4, randomization={"camera_position": 0.02, "camera_rotation": 0.0})
    moved.reset([0, 1, 2, 3])
    shifts = _core.poses_of_cameras(moved)["front"][1][:, :3, 3] - fronts[:, :3, 3]
    assert 0.005 < np.abs(shifts).max() <= 0.02 * np.sqrt(3)
    assert len(np.unique(shifts[:, 0])) == 4
    lit = pool(objects, cameras, 4, randomization={"light": 1.0})
    ours, theirs = (p.reset([0, 1, 2, 3])["rgb"] for p in (plain, lit))  # type: ignore[typeddict-item]
    np.testing.assert_array_equal(_core.poses_of_cameras(lit)["front"][1], fronts)
    assert all(not np.array_equal(a, b) for a, b in zip(ours, theirs, strict=True))
    # Only the images vary: the sampled initial states are the same.
    np.testing.assert_array_equal(plain.poses(), lit.poses())
    np.testing.assert_array_equal(plain.poses(), moved.poses())


def test_a_reset_can_place_a_camera(objects: _core.Objects) -> None:
    envs = pool(objects, CamerasConfig(images=("depth",)))
    above = pose(0.0, 0.0, 0.9, DOWN)
    shown: Any = envs.reset([0], None, [{"cameras": {"front": above}}])
    np.testing.assert_allclose(_core.poses_of_cameras(envs)["front"][1][0], above, atol=1e-12)
    # Straight above the table: no point is farther than the table.
    assert shown["depth"].max() == pytest.approx(0.9, abs=1e-5)
    for cameras, message in (({"back": above}, "back"), ({"front": (2 * np.array(above)).tolist()}, "cameras")):
        with pytest.raises(errors.ConfigError, match=message):
            envs.reset([0], None, [{"cameras": cameras}])


def test_voxels_are_those_of_the_depth_images(objects: _core.Objects) -> None:
    cameras = CamerasConfig(images=("voxels", "voxels_palm", "depth", "depth_palm"), voxels=24, voxel_side=0.36)
    envs = pool(objects, cameras)
    shown: Any = envs.reset([1])
    placed = _core.poses_of_cameras(envs)
    origin = [-0.18, -0.18, -0.0075]
    known = {}
    for camera, key in (("front", "depth"), ("palm", "depth_palm")):
        k, poses = placed[camera]
        known[camera] = graspbox.occupancy(shown[key][..., 0], k, poses, 24, origin, 0.36, far=2.0)
    agree = (shown["voxels_palm"][0] == known["palm"]).mean()
    # The camera's least depth is not an argument of `occupancy`.
    assert agree > 0.995
    assert (shown["voxels"][0] == np.maximum(known["front"], known["palm"])).mean() > 0.995
    assert {0, 1, 2} == set(np.unique(shown["voxels"]))
    # The lowest layer holds the table.
    assert (shown["voxels"][0, 6:18, 6:18, 0] != 1).all()


def test_images_go_into_arrays_that_are_given(objects: _core.Objects) -> None:
    cameras = CamerasConfig(images=("rgb", "depth"), image_size=(20, 24))
    envs = pool(objects, cameras, 2)
    out: Any = {"rgb": np.zeros((2, 20, 24, 3), np.uint8), "depth": np.zeros((2, 20, 24, 1), np.float32)}
    shown: Any = envs.reset([0, 1], None, None, out)
    fresh: Any = envs.now()
    for name, array in out.items():
        assert shown[name] is array
        np.testing.assert_array_equal(array, fresh[name])
        assert not np.shares_memory(array, fresh[name])
    with pytest.raises(errors.ConfigError, match="depth"):
        envs.reset([0, 1], None, None, {"depth": np.zeros((2, 5), np.float32)})


@pytest.mark.parametrize(
    ("cameras", "message"),
    [
        (CamerasConfig(images=("deep",)), "deep"),
        (CamerasConfig(images=("depth_back",)), "front, palm"),
        (CamerasConfig(images=("rgb", "rgb")), "twice"),
        (CamerasConfig(cameras=()), "number of cameras"),
        (CamerasConfig(cameras=(FRONT, FRONT)), "front"),
        (CamerasConfig(cameras=(replace(FRONT, name="a_b"),)), "a_b"),
        (CamerasConfig(cameras=(replace(FRONT, eye=FRONT.target),)), "front"),
        (CamerasConfig(cameras=(replace(FRONT, fov=4.0),)), "fov"),
        (CamerasConfig(image_size=(0, 64)), "height"),
        (CamerasConfig(voxels=0), "voxels"),
        (CamerasConfig(voxel_side=-1.0), "voxel_side"),
    ],
)
def test_what_cannot_be_seen_is_refused(objects: _core.Objects, cameras: CamerasConfig, message: str) -> None:
    with pytest.raises(errors.ConfigError, match=message):
        pool(objects, cameras)


def test_pictures_are_taken_of_chosen_environments(objects: _core.Objects) -> None:
    envs = pool(objects, CamerasConfig(), 3)
    with pytest.raises(errors.ConfigError, match="reset"):
        _core.pictures(envs, [0], {})
    envs.reset([0, 1, 2])
    config = config_dict(PictureConfig(image_size=(90, 120), samples=2))
    every = _core.pictures(envs, [0, 1, 2], config)
    assert every.shape == (3, 90, 120, 3)
    assert every.dtype == np.uint8
    np.testing.assert_array_equal(every[[2, 0]], _core.pictures(envs, [2, 0], config))
    assert len({p.tobytes() for p in every}) == 3
    for picture in every:
        # Neither dark nor washed out, and full of things.
        assert 60 < picture.mean() < 220
        assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 200
    with pytest.raises(errors.ConfigError, match="samples"):
        _core.pictures(envs, [0], config_dict(PictureConfig(samples=9)))
