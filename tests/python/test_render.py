"""Pictures and videos of environments, and image observations."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.wrappers import RecordVideo
from gymnasium.wrappers.vector import RecordVideo as RecordVideos
from moviepy import VideoFileClip

from acting import EACH, OBJECTS, TASKS, pressing
from graspbox import errors
from graspbox.configs import FRONT, PALM, CameraConfig, CamerasConfig, PictureConfig
from graspbox.envs.grasp import GraspEnv

ID = "graspbox/Grasp-v0"
SMALL = PictureConfig(image_size=(48, 64), samples=1)
# moviepy's readers of ffmpeg close their pipes when they are collected; its progress bars know an old numpy.
pytestmark = pytest.mark.filterwarnings(
    "default::pytest.PytestUnraisableExceptionWarning", "default::DeprecationWarning"
)


def defaults(env_id: str) -> dict[str, Any]:
    acting = EACH if env_id == ID else {}
    return {"objects": OBJECTS, "render_mode": "rgb_array", "picture": SMALL, **acting}


def make(env_id: str = ID, **settings: Any) -> Any:
    return gymnasium.make(env_id, **{**defaults(env_id), **settings})


def make_vec(num_envs: int, env_id: str = ID, **settings: Any) -> Any:
    return gymnasium.make_vec(env_id, num_envs=num_envs, **{**defaults(env_id), **settings})


def test_pictures_follow_the_world() -> None:
    env = make()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.unwrapped.render()
    env.reset(seed=0)
    frames = [env.render()]
    for action in pressing(5, 1)[:, 0]:
        env.step(action)
        frames.append(env.render())
        # Taking a picture changes nothing.
        np.testing.assert_array_equal(env.render(), frames[-1])
    assert all(frame.shape == (48, 64, 3) and frame.dtype == np.uint8 for frame in frames)
    assert len({frame.tobytes() for frame in frames}) == len(frames)
    assert env.metadata["render_modes"] == ["human", "rgb_array"]


@pytest.mark.parametrize("task", TASKS)
def test_vector_pictures_are_those_of_the_single_environments(task: str) -> None:
    env_id, keywords = TASKS[task]
    envs = make_vec(3, env_id, **keywords)
    envs.reset(seed=5)
    frames = envs.render()
    assert len(frames) == 3
    for i, frame in enumerate(frames):
        env = make(env_id, **keywords)
        env.reset(seed=5 + i)
        np.testing.assert_array_equal(env.render(), frame)


@pytest.mark.parametrize("hand", ["reflex", "leap"])
def test_pictures_show_what_happens(hand: str) -> None:
    """Hand and object are within the picture, and large in it: a mug was 30 pixels wide."""
    picture = PictureConfig()
    cameras = CamerasConfig(cameras=(picture.camera,), image_size=picture.image_size)
    env = make(objects="procedural:mug", hand=hand, obs="segmentation", cameras=cameras)
    for seed in range(5):
        labels = env.reset(seed=seed)[0][:, :, 0]
        rows, columns = np.nonzero(labels == 2)
        assert max(np.ptp(rows), np.ptp(columns)) > 60
        borders = np.concatenate([labels[[0, -1]].ravel(), labels[:, [0, -1]].ravel()])
        assert (borders < 2).all()
        assert (labels > 2).any()


def test_nothing_is_rendered_unless_asked() -> None:
    env, envs = make(render_mode=None).unwrapped, make_vec(2, render_mode=None)
    env.reset(seed=0)
    envs.reset(seed=0)
    assert env.render() is None
    assert envs.render() is None
    with pytest.raises(errors.ConfigError, match="'ansi' is not available; use None or one of 'human', 'rgb_array'"):
        GraspEnv(render_mode="ansi")


def test_a_palm_camera_can_take_the_pictures() -> None:
    env = make(picture=PictureConfig(image_size=(32, 32), samples=2, camera=PALM))
    env.reset(seed=0)
    before = env.render()
    for action in pressing(6, 1)[:, 0]:
        env.step(action)
    assert not np.array_equal(env.render(), before)


def test_images_come_in_the_size_and_from_the_cameras_that_were_asked() -> None:
    above = CameraConfig("above", eye=(0.0, 0.0, 0.8), up=(1.0, 0.0, 0.0), target=(0.0, 0.0, 0.0))
    cameras = CamerasConfig(cameras=(above, PALM), voxels=16)
    env = make(obs=("depth", "rgb_palm", "voxels", "proprio"), image_size=(24, 40), cameras=cameras)
    observation, _ = env.reset(seed=1)
    shapes = {name: array.shape for name, array in observation.items()}
    proprio = env.observation_space["proprio"].shape
    assert list(shapes) == list(env.observation_space)
    assert shapes == {"depth": (24, 40, 1), "rgb_palm": (24, 40, 3), "voxels": (16, 16, 16), "proprio": proprio}
    intrinsics, pose = env.unwrapped.cameras()["above"]
    np.testing.assert_allclose(pose[:3, 3], above.eye, atol=1e-12)
    np.testing.assert_allclose(intrinsics[:2, 2], (20, 12))
    # The middle of the image looks straight down: at the table or at an object above it.
    assert 0.2 < observation["depth"][12, 20, 0] <= 0.8
    with pytest.raises(errors.ConfigError, match="back"):
        make(obs="depth_back")
    with pytest.raises(errors.ConfigError, match="name images in obs"):
        make(cameras=CamerasConfig(images=("rgb",)))


def test_views_into_buffers_hold_images_too() -> None:
    envs = make_vec(2, obs=("depth", "segmentation"), copy=False, image_size=20)
    first, _ = envs.reset(seed=0)
    kept = {name: array.copy() for name, array in first.items()}
    second = envs.step(pressing(1, 2)[0])[0]
    assert all(np.shares_memory(first[name], second[name]) for name in kept)
    assert not np.array_equal(first["depth"], kept["depth"])


def test_videos_are_recorded_single_and_vector(tmp_path: Path) -> None:
    env: Any = RecordVideo(make(max_episode_steps=6), str(tmp_path / "one"), episode_trigger=lambda _: True)
    envs: Any = RecordVideos(
        make_vec(3, max_episode_steps=6),
        str(tmp_path / "many"),
        episode_trigger=lambda _: True,
        video_aspect_ratio=(1, 1),
    )
    env.reset(seed=0)
    envs.reset(seed=0)
    for action in pressing(6, 3):
        env.step(action[0])
        envs.step(action)
    env.close()
    envs.close()
    for folder in ("one", "many"):
        files = sorted((tmp_path / folder).glob("*.mp4"))
        assert files
        with VideoFileClip(str(files[0])) as clip:
            assert clip.fps == 20
            assert clip.n_frames >= 6
            assert np.asarray(clip.get_frame(0)).std() > 5


def test_a_grasp_pose_can_be_seen_and_pictured() -> None:
    # Wide enough to see the hand where an attempt ends, high over the table, but not where it waits.
    cameras = CamerasConfig(cameras=(replace(FRONT, fov=0.9),))
    settings: dict[str, Any] = {"objects": OBJECTS, "render_mode": "rgb_array", "picture": SMALL, "cameras": cameras}
    env = gymnasium.make("graspbox/GraspPose-v0", obs=("depth", "segmentation", "state"), **settings).unwrapped
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.render()
    observation, _ = env.reset(seed=0)
    labels = observation["segmentation"]
    assert set(np.unique(labels)) == {0, 1, 2}
    assert ((observation["depth"] > 0) == (labels > 0)).all()
    before: Any = env.render()
    # Just above the object.
    action = np.array([0, 0, 0, 1, 0, 0, 0, -1, 0, -1], dtype=np.float32)
    again = env.step(action)[0]
    # The final observation shows the object after the attempt, and the hand.
    assert (again["segmentation"] > 2).any()
    assert (again["depth"] != observation["depth"]).any()
    after: Any = env.render()
    assert (before != after).any(axis=-1).mean() > 0.02
    with pytest.raises(errors.ConfigError, match="deep"):
        gymnasium.make("graspbox/GraspPose-v0", obs="deep", **settings)
