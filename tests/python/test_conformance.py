"""Requirements of every environment: each registered id and observation, in this process and on a server."""

import pickle
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence

import graspbox
from acting import OBJECTS, pressing
from graspbox.envs import GOAL_IDS, IDS, spaces
from graspbox.tools.remote import EnvironmentServer, ServerSettings

TABLES = spaces.tables(graspbox.load_hand())
GRASP = "graspbox/Grasp-v0"
CLEAR = "graspbox/Clear-v0"
STEPS = 20
#: A hand that the arms carry.
CARRIED = {"hand": "panda_gripper"}

#: The shipped hands besides the default.
OTHER_HANDS = [name for name in graspbox.Hand.names() if name != "reflex"]
#: Every id with every observation that it has, and with several at once; Grasp-v0 with its other control modes too, and
#: the decision and the motion with every hand.
CASES: list[tuple[str, dict[str, Any]]] = [
    *[("graspbox/GraspPose-v0", {"obs": name}) for name in TABLES["decision"]["observations"]],
    ("graspbox/GraspPose-v0", {"obs": ("depth_palm", "rgb", "state", "proprio", "voxels"), "image_size": 36}),
    *[("graspbox/GraspPose-v0", {"obs": name, "image_size": (40, 48)}) for name in spaces.IMAGES],
    # The hand touches nothing while it waits, so that Clear-v0 has nothing to see in `tactile`.
    *[(CLEAR, {"obs": name}) for name in TABLES["clear"]["observations"] if name != "tactile"],
    (CLEAR, {"obs": ("depth", "segmentation", "rgb", "state"), "image_size": 36, "layout": "packed"}),
    (CLEAR, {"obs": "segmentation", "image_size": (40, 48), "layout": "bin", "objects_per_scene": (2, 4)}),
    (CLEAR, {"obs": (*spaces.IMAGES, "rgb_palm"), "image_size": 36, "randomization": "standard", "layout": "bin"}),
    (CLEAR, {"obs": ("state", "proprio"), "hand": "panda_gripper", "reward": "dense", "randomization": "standard"}),
    (CLEAR, {"obs": ("state", "proprio"), "hand": "leap", "layout": "packed"}),
    ("graspbox/GraspPose-v0", {"obs": ("state", "segmentation"), "image_size": 36, "layout": "packed"}),
    *[(GRASP, {"obs": name}) for name in TABLES["observations"]["twist"]["synergy"]],
    (GRASP, {"obs": ("state", "segmentation"), "image_size": 36, "layout": "packed", "objects_per_scene": (2, 4)}),
    *[
        (env_id, {"obs": ("state", *spaces.IMAGES), "image_size": 36, "layout": "pile", "randomization": "standard"})
        for env_id in ("graspbox/GraspPose-v0", GRASP)
    ],
    *[(GRASP, {"obs": name, "image_size": 36}) for name in spaces.IMAGES],
    (GRASP, {"obs": ("depth_palm", "proprio"), "randomization": "standard", "image_size": (40, 48)}),
    (GRASP, {"obs": ("state", "proprio"), "control_freq": 5, "randomization": "standard"}),
    (GRASP, {"obs": ("proprio", "tactile"), "reward": "dense", "randomization": "standard"}),
    *[
        (GRASP, {"obs": "state", "control": control, "fingers": fingers})
        for control, by_fingers in TABLES["actions"].items()
        for fingers in by_fingers
    ],
    *[("graspbox/GraspPose-v0", {"obs": ("state", "proprio"), "hand": name}) for name in OTHER_HANDS],
    *[(GRASP, {"obs": ("state", "proprio"), "hand": name}) for name in OTHER_HANDS],
    *[(GRASP, {"obs": "state", "hand": name, "control": "top_down", "fingers": "each"}) for name in OTHER_HANDS[:2]],
    *[(env_id, {"obs": name, "image_size": 36}) for env_id in GOAL_IDS for name in ("state", "depth")],
    *[(env_id, {"obs": "proprio", "control": "twist", "fingers": "each"}) for env_id in GOAL_IDS],
    (GRASP, {"obs": ("state", "proprio", "segmentation", "voxels"), "image_size": 36, "arm": "fr3", **CARRIED}),
    (GRASP, {"obs": "state", "control": "joint_velocity", "arm": "xarm7", "randomization": "standard", **CARRIED}),
    (GRASP, {"obs": ("proprio", "depth"), "layout": "bin", "image_size": 36, "arm": "ur5e", **CARRIED}),
    (GOAL_IDS[0], {"obs": "proprio", "arm": "fr3", **CARRIED}),
]


def factory(case: tuple[str, dict[str, Any]], remote: str | None = None) -> Callable[[], Any]:
    env_id, settings = case
    limit: dict[str, Any] = {"max_episode_steps": STEPS, "control_freq": 20} if env_id in (GRASP, *GOAL_IDS) else {}
    return partial(gymnasium.make, env_id, objects=OBJECTS, remote=remote, **{**limit, **settings})


def label(case: tuple[str, dict[str, Any]]) -> str:
    return "-".join([case[0].split("/")[1], *map(str, case[1].values())])


#: Cases that run on a server too. The code of all others is that of these: a server steps the same environments, and
#: `test_remote` compares every control mode and layout bit by bit.
SERVED = [
    case for case in CASES if (isinstance(case[1]["obs"], tuple) and "hand" not in case[1]) or case[0] in GOAL_IDS
]


RUNS = [(case, False) for case in CASES] + [(case, True) for case in SERVED]


@pytest.fixture(scope="module")
def server() -> Iterator[str]:
    with EnvironmentServer(ServerSettings(port=0)) as running:
        yield running.url


@pytest.fixture(params=RUNS, ids=lambda run: ("on a server-" if run[1] else "here-") + label(run[0]))
def make(request: pytest.FixtureRequest, server: str) -> Callable[[], Any]:
    case, served = request.param
    return factory(case, server if served else None)


def actions(env: Any, count: int) -> Any:
    """Actions that lead to contact where that is easy, seeded ones elsewhere."""
    settings = env.spec.kwargs
    if env.spec.id == GRASP and settings.get("control", "twist") == "twist" and "hand" not in settings:
        return pressing(count, 1, motors=3 if settings.get("fingers") == "each" else 1)[:, 0]
    env.action_space.seed(7)
    if env.spec.id in (GRASP, *GOAL_IDS):
        return [env.action_space.sample() for _ in range(count)]
    # Decisions take longer than steps: in every other one the palm is over the middle, facing down.
    drawn = [env.action_space.sample() for _ in range(count // 10)]
    for action in drawn[::2]:
        action[:9] = [*(0.1 * action[:2]), 0.1 * action[2] - 0.3, 1, 0, 0, 0, -1, 0]
    return drawn


def rollout(env: Any, seed: int, steps: int = 3 * STEPS) -> list[Any]:
    """Everything that a few episodes return."""
    seen: list[Any] = [env.reset(seed=seed)]
    for action in actions(env, steps):
        seen.append(env.step(action))
        if seen[-1][2] or seen[-1][3]:
            seen.append(env.reset())
    return seen


def leaves(observation: Any) -> list[Any]:
    return list(observation.values()) if isinstance(observation, dict) else [observation]


def test_every_id_and_observation_is_here() -> None:
    assert {env_id for env_id, _ in CASES} == {*IDS, *GOAL_IDS}
    assert {*TABLES["observations"]["twist"]["synergy"], *spaces.IMAGES} <= {settings["obs"] for _, settings in CASES}


def test_gymnasium_finds_nothing_to_complain_about(make: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(make().unwrapped)


def test_spaces_are_finite_and_hold_what_comes(make: Any) -> None:
    env = make()
    boxes = list(getattr(env.observation_space, "spaces", {"": env.observation_space}).values())
    for space in [*boxes, env.action_space]:
        assert np.isfinite(space.low).all()
        assert np.isfinite(space.high).all()
        assert (space.low < space.high).all()
    for seen in rollout(env, 3):
        assert env.observation_space.contains(seen[0])
        for space, array in zip(boxes, leaves(seen[0]), strict=True):
            assert array.dtype == space.dtype


def test_same_seed_same_bits(make: Any) -> None:
    env = make()
    first = rollout(env, 7)
    assert data_equivalence(rollout(env, 7), first, exact=True)
    assert data_equivalence(rollout(gymnasium.make(env.spec), 7), first, exact=True)
    assert not data_equivalence(rollout(env, 8), first, exact=True)


def test_memory_is_not_shared_between_steps(make: Any) -> None:
    kept = [leaves(seen[0]) for seen in rollout(make(), 1, steps=10)]
    copies = [[array.copy() for array in arrays] for arrays in kept]
    rollout(make(), 2, steps=5)
    assert all((a == b).all() for x, y in zip(kept, copies, strict=True) for a, b in zip(x, y, strict=True))
    for i, arrays in enumerate(kept):
        assert not any(np.shares_memory(a, b) for a in arrays for other in kept[:i] for b in other)


def test_observations_and_initial_states_vary(make: Any) -> None:
    """Over a few episodes with contact no observation stays the same; episodes begin differently."""
    env = make()
    seen = [leaves(x[0]) for seed in range(3) for x in rollout(env, seed)]
    for index in range(len(seen[0])):
        assert np.ptp(np.stack([arrays[index] for arrays in seen]), axis=0).any()
    first = [leaves(env.reset(seed=seed)[0]) for seed in range(12)]
    # Nothing touches the hand yet where an episode begins.
    expected = env.spec.kwargs["obs"] != "tactile"
    assert np.ptp(np.stack([arrays[0] for arrays in first]), axis=0).any() == expected


def test_factories_can_be_pickled(make: Any) -> None:
    env = make()
    again = pickle.loads(pickle.dumps(make))()
    assert data_equivalence(again.reset(seed=1), env.reset(seed=1), exact=True)
    spec = pickle.loads(pickle.dumps(env.spec))
    assert spec == env.spec
    assert data_equivalence(gymnasium.make(spec).reset(seed=1), env.reset(seed=1), exact=True)


def test_a_pickled_spec_with_a_hand_is_the_same() -> None:
    env: Any = gymnasium.make(
        GRASP, objects="procedural:can:0", hand=graspbox.Hand(*graspbox.load_hand("reflex").files)
    )
    again = pickle.loads(pickle.dumps(env.spec))
    assert again.kwargs["hand"] is not env.spec.kwargs["hand"]
    assert again == env.spec
