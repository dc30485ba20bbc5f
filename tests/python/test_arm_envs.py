"""Environments in which an arm carries the hand: what Python adds to the core's."""

import pickle
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

import graspbox
from graspbox import arms
from graspbox.configs import CameraConfig, CamerasConfig
from graspbox.envs import spaces
from graspbox.errors import ArmError, ConfigError
from graspbox.hands.description import describe

GRASP = "graspbox/Grasp-v0"
HAND = "panda_gripper"
#: A camera that sees the whole arm.
WIDE = CameraConfig(name="wide", eye=(-0.6, -0.9, 0.8), target=(0.1, 0.0, 0.3), fov=1.1)


def test_the_hand_is_where_the_joints_put_it() -> None:
    env: Any = gymnasium.make(GRASP, objects="procedural:box:1", hand=HAND, arm="fr3", obs="proprio").unwrapped
    arm, hand = arms.load_arm("fr3"), graspbox.load_hand(HAND)
    columns = spaces.tables(hand, arm)["observations"]["twist"]["synergy"]["proprio"]
    places = {row["name"]: slice(start, start + row["size"]) for row, start in _starts(columns)}
    seen, _ = env.reset(seed=3)
    env.action_space.seed(3)
    fastest = 0.0
    flange_from_hand = arm.flange_from_base_of(hand) @ describe(hand).base_from_hand
    for _ in range(6):
        q = seen[places["arm_q"]].astype(np.float64)
        assert ((arm.joint_limits[:, 0] <= q) & (q <= arm.joint_limits[:, 1])).all()
        expected = env.world_from_arm @ arm.flange_poses(q[None])[0] @ flange_from_hand
        np.testing.assert_allclose(seen[places["hand_position"]], expected[:3, 3], atol=1e-5)
        np.testing.assert_allclose(seen[places["hand_rotation"]], expected[:3, :2].T.ravel(), atol=1e-5)
        seen = env.step(env.action_space.sample())[0]
        fastest = max(fastest, float(np.abs(seen[places["arm_dq"]]).max()))
    assert fastest > 0.01


def _starts(columns: Any) -> Any:
    ends = np.cumsum([row["size"] for row in columns])
    return zip(columns, ends - [row["size"] for row in columns], strict=True)


def test_tables_have_the_joints_of_the_arm_alone() -> None:
    hand, arm = graspbox.load_hand(HAND), arms.load_arm("ur5e")
    free, carried = spaces.tables(hand), spaces.tables(hand, arm)
    assert "joint_velocity" not in free["actions"]
    assert "joint_velocity" in carried["actions"]
    joints = [row for row in carried["actions"]["joint_velocity"]["synergy"] if row["name"] == "joint"]
    assert [row["high"] for row in joints] == pytest.approx(arm.speeds)
    names = [row["name"] for row in carried["observations"]["twist"]["synergy"]["state"]]
    assert {"arm_q", "arm_dq"} <= set(names)
    assert {row["name"] for row in carried["info"]} - {row["name"] for row in free["info"]} == {"arm_blocked"}


@pytest.mark.parametrize("base", [None, [[1.0, 0, 0, -0.55], [0, 1.0, 0, 0.1], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]])
def test_vector_environments_equal_the_single_one(base: Any) -> None:
    keywords: dict[str, Any] = {"objects": "procedural:can:2", "hand": HAND, "arm": "xarm7", "base": base}
    single = gymnasium.make(GRASP, **keywords)
    vector = gymnasium.make_vec(GRASP, num_envs=3, **keywords)
    seen, _ = vector.reset(seed=5)
    for index in (0, 2):
        assert (single.reset(seed=5 + index)[0] == seen[index]).all()
    copy = pickle.loads(pickle.dumps(single.unwrapped))
    rng = np.random.default_rng(0)
    for _ in range(8):
        actions = rng.uniform(-1, 1, vector.action_space.shape).astype(np.float32)
        seen, rewards, *_ = vector.step(actions)
        alone, reward, *_ = single.step(actions[2])
        assert (alone == seen[2]).all()
        assert reward == rewards[2]
        assert (copy.step(actions[2])[0] == alone).all()
    if base is not None:
        assert (np.asarray(base) == single.unwrapped.world_from_arm).all()  # type: ignore[attr-defined]
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(single.spec.to_json()))  # type: ignore[union-attr]
    assert (again.reset(seed=5)[0] == vector.reset(seed=5)[0][0]).all()


def images(arm: str | None) -> tuple[dict[str, NDArray[Any]], Any]:
    env = gymnasium.make(
        GRASP, objects="procedural:box:1", hand=HAND, arm=arm, obs=("rgb", "depth", "segmentation", "points"),
        layout="packed", objects_per_scene=3, image_size=96, cameras=CamerasConfig(cameras=(WIDE,)),
    )  # fmt: skip
    return env.reset(seed=1)[0], env


def test_images_show_the_arm() -> None:
    (seen, env), (free, other) = images("fr3"), images(None)
    label = int(env.observation_space["segmentation"].high.max())
    assert label == int(other.observation_space["segmentation"].high.max()) + 1
    arm = seen["segmentation"][..., 0] == label
    assert arm.mean() > 0.02
    assert not (free["segmentation"] == label).any()
    # Where the arm is seen, something near and of its colour is.
    assert (seen["depth"][..., 0][arm] > 0.1).all()
    assert (seen["points"][arm][:, 2] > 0.1).all()
    assert np.abs(seen["rgb"][arm].astype(int) - free["rgb"][arm]).mean() > 5


def test_a_gripper_reaches_down_by_its_joints() -> None:
    env: Any = gymnasium.make(
        GRASP, objects="procedural:box:1", hand=HAND, arm="fr3", control="joint_velocity"
    ).unwrapped
    env.reset(seed=0)
    action = env.idle_action
    still, *_ = env.step(action)
    moved, *_ = env.step(action)
    joints = slice(15, 22)
    assert np.abs(moved[joints] - still[joints]).max() < 1e-3
    action[0] = 1.0
    turned, *_ = env.step(action)
    assert turned[15] - moved[15] > 0.05
    assert np.abs(turned[16:22] - moved[16:22]).max() < 1e-3
    keys = env.get_keys_to_action()
    assert all(action.shape == env.action_space.shape for action in keys.values())


@pytest.mark.parametrize(
    ("keywords", "error", "words"),
    [
        ({"base": np.eye(4).tolist(), "arm": None}, ConfigError, "base"),
        ({"base": [[1.0, 0.0]]}, ConfigError, "homogeneous"),
        ({"base": (np.eye(4) + np.diag([0, 0, 1], -1)).tolist()}, ConfigError, "base"),
        ({"arm": "fr4"}, ConfigError, "there is no arm 'fr4'"),
        ({"arm": None, "control": "joint_velocity"}, ConfigError, "name an arm"),
        ({"arm": "so101"}, ArmError, "carries"),
        ({"physics": graspbox.PhysicsConfig(engine="rapier")}, graspbox.errors.SimulationError, "arm"),
        ({"remote": "ws://127.0.0.1:1", "arm": ("a.urdf", "arm.toml")}, ConfigError, "by its name"),
    ],
)
def test_wrong_arms_are_refused(keywords: dict[str, Any], error: type[Exception], words: str) -> None:
    with pytest.raises(error, match=words):
        gymnasium.make(GRASP, **{"hand": HAND, "arm": "fr3", "objects": "procedural:box:1", **keywords}).reset(seed=0)


def test_decisions_take_no_arm() -> None:
    with pytest.raises(ConfigError, match="closed-loop"):
        gymnasium.make("graspbox/GraspPose-v0", hand=HAND, arm="fr3")
