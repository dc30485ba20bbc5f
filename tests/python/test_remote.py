"""Environments on servers are those of this process: the same bits, infos and spaces, on one server or several."""

import copy
import itertools
import pickle
from collections.abc import Callable, Iterator
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

import graspbox
from acting import ACTING, OBJECTS, lower
from graspbox.configs import (
    CameraConfig,
    CamerasConfig,
    PhysicsConfig,
    PictureConfig,
    Randomization,
    SuccessCriterion,
    TrialConfig,
)
from graspbox.envs import spaces
from graspbox.envs.remote_config import RemoteConfig
from graspbox.tools.remote import EnvironmentServer, ServerSettings

GRASP, POSE, CLEAR = "graspbox/Grasp-v0", "graspbox/GraspPose-v0", "graspbox/Clear-v0"
IDS, HANDS, MODES = (GRASP, POSE), tuple(graspbox.Hand.names()), tuple(AutoresetMode)
#: Every vector and image, and several at once; `tactile` is of the reflex hand alone.
OBSERVATIONS: tuple[Any, ...] = (
    "tactile",
    "state",
    "depth",
    *(name for name in ("proprio", *spaces.IMAGES) if name != "depth"),
    ("voxels", "state", "depth_palm", "rgb", "proprio"),
)
PICTURE = PictureConfig(image_size=(24, 32), samples=1)
Urls = tuple[str, str]


@pytest.fixture(scope="module")
def urls() -> Iterator[Urls]:
    """Two servers, with different numbers of threads."""
    settings = [ServerSettings(port=0, threads=threads) for threads in (1, 2)]
    with EnvironmentServer(settings[0]) as one, EnvironmentServer(settings[1]) as two:
        yield one.url, two.url


def same(ours: Any, theirs: Any) -> bool:
    """Whether two results are alike to the bit: types, order of entries, dtypes, and whether arrays can be written."""
    if type(ours) is not type(theirs):
        return False
    if isinstance(ours, dict):
        return list(ours) == list(theirs) and all(same(value, theirs[name]) for name, value in ours.items())
    if isinstance(ours, tuple | list):
        return len(ours) == len(theirs) and all(map(same, ours, theirs))
    if isinstance(ours, np.ndarray):
        if (ours.shape, ours.dtype, ours.flags.writeable) != (theirs.shape, theirs.dtype, theirs.flags.writeable):
            return False
        return same(ours.tolist(), theirs.tolist()) if ours.dtype == object else ours.tobytes() == theirs.tobytes()
    return bool(repr(ours) == repr(theirs) if isinstance(ours, float) else ours == theirs)


#: A target among others, and rounds of clearing.
AMONG: dict[str, dict[str, Any]] = {
    GRASP: {"layout": "pile", "objects_per_scene": (2, 3)},
    POSE: {"layout": "bin", "objects_per_scene": (2, 3)},
    CLEAR: {"layout": "packed", "objects_per_scene": (2, 3)},
}


def defaults(env_id: str) -> dict[str, Any]:
    own = {"control_freq": 10} if env_id == GRASP else {}
    return {"objects": OBJECTS, "reward": "dense", "image_size": 20, **own}


#: Entries of an action that move the hand.
SIZES = {"twist": 6, "delta_pose": 6, "target_pose": 9, "top_down": 4}


def make(num_envs: int = 3, env_id: str = GRASP, **settings: Any) -> Any:
    limit = {"max_episode_steps": 8} if env_id == GRASP else {}
    return gymnasium.make_vec(env_id, num_envs=num_envs, **{**defaults(env_id), **limit, **settings})


def make_single(env_id: str = GRASP, **settings: Any) -> Any:
    return gymnasium.make(env_id, **{**defaults(env_id), **settings})


def acting(env: Any, steps: int, seed: int = 0) -> NDArray[np.float32]:
    """Actions (steps, *shape) that press the hand on objects and close it; decisions near the middle of the table."""
    shape = env.action_space.shape
    actions = np.random.default_rng(seed).uniform(-0.2, 0.2, (steps, *shape))
    if env.spec.id != GRASP:
        # The fingers of the LEAP hand reach farther: lower, they would touch the table.
        height = -0.34 if env.spec.kwargs.get("hand") == "leap" else -0.42
        actions[..., :9] = [0.1, 0.1, 0.2, 0, 0, 0, 0, 0, 0] * actions[..., :9] + [0, 0, height, 1, 0, 0, 0, -1, 0]
    else:
        closing = np.where(np.arange(steps) % 8 > 3, 1.0, -1.0)
        control = env.spec.kwargs.get("control", "twist")
        actions[..., SIZES[control] :] = closing.reshape(steps, *[1] * len(shape))
        return lower(actions.astype(np.float32), control)
    return actions.astype(np.float32)


def rollout(env: Any, steps: int = 16, place: Any = None) -> list[Any]:
    """Everything that a few episodes of a vector environment return; those that ended are begun by hand if need be."""
    seen = [env.reset(seed=3, options=None if place is None else {"place": place})]
    for action in acting(env, steps):
        seen.append(env.step(action))
        done = seen[-1][2] | seen[-1][3]
        if env.metadata["autoreset_mode"] == AutoresetMode.DISABLED and done.any():
            seen.append(env.reset(options={"reset_mask": done}))
    return seen


def begun(num_envs: int = 5, **settings: Any) -> Any:
    env = make(num_envs, **settings)
    env.reset(seed=3)
    return env


def rollout_single(env: Any, steps: int) -> list[Any]:
    seen = [env.reset(seed=3)]
    for action in acting(env, steps):
        seen.append(env.step(action))
        if seen[-1][2] or seen[-1][3]:
            seen.append(env.reset())
    return seen


def pools_of(env: Any) -> list[Any]:
    pool = env.unwrapped._core.pool
    return list(getattr(pool, "_shards", [pool]))


def breaking(env: Any, before: bool) -> Any:
    """Break every connection off before each command is sent, or between it and its answer."""
    for pool in pools_of(env):

        def begin(command: str, fields: dict[str, Any], pool: Any = pool, send: Any = pool.begin) -> int:
            if before:
                pool._client._break_off()
            number: int = send(command, fields)
            if not before:
                pool._client._break_off()
            return number

        pool.begin = begin
    return env


def contact(seen: list[Any]) -> float:
    """Add up the contact observations of hand and object, including ends of episodes."""
    infos = [info for *_, step in seen for info in (step, step.get("final_info", step))]
    return float(sum(np.sum(info["touches"]) + np.sum(info["reward_terms"]["contact"]) for info in infos))


Case = tuple[Any, str, AutoresetMode, str]
#: Every value of every axis, and every hand with every mode.
CASES: list[Case] = [
    (obs, HANDS[i // 3 % len(HANDS)], MODES[i % 3], IDS[i % 2])
    for i, obs in enumerate((*OBSERVATIONS, *OBSERVATIONS[1:]))
]
PRODUCT: list[Case] = [
    case for case in itertools.product(OBSERVATIONS, HANDS, MODES, IDS) if case[0] != "tactile" or case[1] == "reflex"
]


def check_equality(urls: Urls, case: Case, **keywords: Any) -> None:
    obs, hand, mode, env_id = case
    settings: dict[str, Any] = {"env_id": env_id, "obs": obs, "hand": hand, **keywords}
    limit: dict[str, Any] = {"max_episode_steps": 7} if env_id == GRASP else {}
    steps, place = (16, None) if env_id == GRASP else (6, None if keywords else [0.0, 0.0, 0.3])
    local = make(autoreset_mode=mode, **settings)
    expected = rollout(local, steps, place=place)
    assert contact(expected) > 0
    for remote in (urls[0], urls):
        env = make(autoreset_mode=mode, remote=remote, **settings)
        for name in ("observation_space", "action_space", "single_observation_space", "single_action_space"):
            assert getattr(env, name) == getattr(local, name)
        assert env.metadata == local.metadata
        assert same(rollout(env, steps, place=place), expected)
        env.close()
    # Over two servers, whose connections break between each command and its answer.
    env = breaking(make(autoreset_mode=mode, remote=urls, **settings), before=False)
    assert same(rollout(env, steps, place=place), expected)
    env.close()
    alone, there = make_single(**settings, **limit), make_single(remote=urls[1], **settings, **limit)
    assert there.observation_space == alone.observation_space
    assert there.unwrapped.metadata == alone.unwrapped.metadata
    assert same(rollout_single(there, steps), rollout_single(alone, steps))
    there.close()


@pytest.mark.parametrize("case", CASES, ids=lambda case: "-".join(map(str, case)))
def test_equals_environments_of_this_process(urls: Urls, case: Case) -> None:
    """Over one server, over two, with lost connections, and alone; with contact, and ends of episodes everywhere."""
    check_equality(urls, case)


@pytest.mark.parametrize(("control", "fingers"), ACTING)
def test_every_meaning_of_an_action_is_that_of_this_process(urls: Urls, control: str, fingers: str) -> None:
    index = ACTING.index((control, fingers))
    case = (("state", "proprio"), HANDS[index % len(HANDS)], MODES[index % 3], GRASP)
    check_equality(urls, case, control=control, fingers=fingers, control_freq=(5, 10)[index // 2 % 2])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("env_id", AMONG)
def test_scenes_of_several_objects_equal_those_of_this_process(urls: Urls, env_id: str, mode: AutoresetMode) -> None:
    hand = HANDS[MODES.index(mode)]
    obs = ("state", "proprio", "depth", "segmentation", "amodal")
    check_equality(urls, (obs, hand, mode, env_id), randomization="standard", **AMONG[env_id])


@pytest.mark.slow
@pytest.mark.parametrize("case", sorted(set(PRODUCT) - set(CASES), key=str), ids=lambda case: "-".join(map(str, case)))
def test_equals_environments_of_this_process_in_all_combinations(urls: Urls, case: Case) -> None:
    check_equality(urls, case)


def test_equality_is_to_the_bit() -> None:
    """`same` of these tests detects differences."""
    array = np.zeros(2, dtype=np.float32)
    assert same({"a": (array, [np.nan])}, {"a": (array.copy(), [np.nan])})
    kept = array.copy()
    kept.flags.writeable = False
    for other in (-array, array.astype(np.float64), array[:1], kept, [0.0, 0.0]):
        assert not same(array, other)
    assert not same(1.0, 1)
    assert not same({"a": 1, "b": 2}, {"b": 2, "a": 1})
    assert not same(np.array([{"a": array}, None], dtype=object), np.array([{"a": -array}, None], dtype=object))


SIDE = CameraConfig("side", eye=(0.4, 0.4, 0.4), target=(0.0, 0.0, 0.1), fov=0.8)
#: Settings that change a rollout.
SETTINGS: list[tuple[str, dict[str, Any]]] = [
    (GRASP, {"control": "target_pose"}),
    (GRASP, {"control": "delta_pose"}),
    (GRASP, {"control_freq": 50, "fingers": "each"}),
    (GRASP, {"max_episode_steps": 3}),
    (GRASP, {"autoreset_mode": "SameStep"}),
    (GRASP, {"randomization": "standard"}),
    (GRASP, {"randomization": Randomization(mass=(0.5, 0.5))}),
    (GRASP, {"physics": PhysicsConfig(engine="rapier")}),
    (GRASP, {"physics": {"gravity": 3.0}}),
    (GRASP, {"reward": "sparse"}),
    (GRASP, {"reward_weights": {"reach": 0.5}}),
    (GRASP, {"info": "numeric"}),
    (GRASP, {"objects": ["procedural:box:3", "procedural:can:5-6"]}),
    (GRASP, {"objects": "procedural:box", "split": "test"}),
    (GRASP, {"objects": graspbox.object_sets.load("procedural:mug:0-1")}),
    (GRASP, {"obs": "depth_side", "cameras": CamerasConfig(cameras=(SIDE,))}),
    (GRASP, {"obs": ("voxels", "rgb"), "cameras": CamerasConfig(voxels=12), "image_size": (16, 24)}),
    (POSE, {"trial": TrialConfig(lift_height=0.3)}),
    (POSE, {"success": SuccessCriterion(lift_height=0.02), "trial": {"lift_height": 0.1}}),
]


@pytest.mark.parametrize(("env_id", "settings"), SETTINGS, ids=lambda value: str(value)[:60])
def test_every_setting_arrives(urls: Urls, env_id: str, settings: dict[str, Any]) -> None:
    """It changes the observations locally, and equally on the server."""
    steps = 8 if env_id == GRASP else 3
    expected = rollout(make(env_id=env_id, **settings), steps)
    assert not same(rollout(make(env_id=env_id), steps), expected)
    env = make(env_id=env_id, remote=urls, **settings)
    assert same(rollout(env, steps), expected)
    env.close()


def test_servers_are_named_in_several_ways(urls: Urls) -> None:
    """More servers than environments are too many, but no error."""
    expected = rollout(make(2), 3)
    ways: list[Any] = [
        urls[0],
        list(urls),
        [*urls, urls[0], urls[1]],
        RemoteConfig(urls),
        {"urls": [urls[1]], "grace": 5.0},
        RemoteConfig(urls[:1], grace=0.0),
    ]
    for remote in ways:
        env = make(2, remote=remote)
        assert same(rollout(env, 3), expected)
        env.close()
    one = make(1, remote=urls)
    assert same(rollout(one, 3), rollout(make(1), 3))
    one.close()


@pytest.mark.parametrize("mode", MODES)
def test_partial_resets_with_seeds_and_options(urls: Urls, mode: AutoresetMode) -> None:
    """Five environments on two servers: masks within one server, across both, and where an autoreset is due."""
    pair = [make(5, autoreset_mode=mode, remote=remote) for remote in (None, urls)]
    seeds = [3, 2**64 - 1, 0, 7, 9]
    assert same(*(env.reset(seed=seeds) for env in pair))
    each = [{"object": 1}, None, {"friction": 0.3}, {"object": "can-000001"}, {"place": [0.0, 0.01, 0.4]}]
    kinds: list[dict[str, Any]] = [{}, {"seed": 8}, {"seed": [7, None, 9, None, 1]}]
    options: list[dict[str, Any]] = [{}, {"each": each}, {"friction": 0.8, "each": each}, {"place": [0.0, 0.0, 0.5]}]
    masks = itertools.cycle(np.array(bits, dtype=bool) for bits in itertools.product((0, 1), repeat=5) if any(bits))
    asked = itertools.cycle(itertools.product(kinds, options))
    for action in acting(pair[0], 31):
        ours, theirs = (env.step(action) for env in pair)
        assert same(theirs, ours)
        given, own = next(asked)
        mask = next(masks)
        if mode == AutoresetMode.DISABLED:
            mask = mask | ours[2] | ours[3]
        ours, theirs = (env.reset(**given, options={**own, "reset_mask": mask.copy()}) for env in pair)
        assert same(theirs, ours)
        assert pair[0].np_random_seed == pair[1].np_random_seed
    pair[1].close()


def test_seeds_that_nobody_gives_are_those_of_the_client(urls: Urls) -> None:
    env, local = make(3, remote=urls), make(3)
    first = env.reset()
    assert len(set(env.np_random_seed)) == 3
    assert same(local.reset(seed=list(env.np_random_seed)), first)
    assert same(local.reset(), env.reset())
    env.close()


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("env_id", "keywords"), [(GRASP, {}), (CLEAR, AMONG[CLEAR])], ids=["Grasp", "Clear"])
def test_states_pass_between_here_and_there(
    urls: Urls, mode: AutoresetMode, env_id: str, keywords: dict[str, Any]
) -> None:
    """Into another environment, of another server or none, in every step of an episode and at its end."""
    local, there = (make(5, env_id, autoreset_mode=mode, remote=remote, **keywords) for remote in (None, urls))
    single, remote = (make_single(env_id, remote=url, **keywords) for url in (None, urls[1]))
    rollout(local, 7), rollout(there, 7)
    for step, action in enumerate(acting(local, 10, seed=1)):
        source, target = step % 5, (3 * step + 1) % 5
        states = [env.get_state(source) for env in (local, there)]
        assert states[0] == states[1]
        shown = local.set_state(target, states[1])
        for found in (there.set_state(target, states[0]), single.unwrapped.set_state(states[1])):
            assert same(found, shown)
        assert same(remote.unwrapped.set_state(states[0]), shown)
        if mode != AutoresetMode.DISABLED or step < 1:
            assert same(there.step(action), local.step(action))
    for env in (there, remote):
        env.close()


WAYS = pytest.mark.parametrize(
    "way", [lambda env: pickle.loads(pickle.dumps(env)), copy.deepcopy], ids=["pickle", "deepcopy"]
)


@WAYS
@pytest.mark.parametrize("mode", MODES)
def test_a_copy_continues_with_the_same_bits(urls: Urls, way: Callable[[Any], Any], mode: AutoresetMode) -> None:
    """It has sessions of its own, and is at the same step; when the original continues, it stays."""
    env = make(3, autoreset_mode=mode, remote=urls, max_episode_steps=5, randomization="standard")
    local = make(3, autoreset_mode=mode, max_episode_steps=5, randomization="standard")
    assert same(env.reset(seed=[3, 9, 4]), local.reset(seed=[3, 9, 4]))
    for action in acting(env, 7):
        other = way(env)
        assert other.np_random_seed == (3, 9, 4)
        assert other.spec == env.spec
        expected = local.step(action)
        assert same(env.step(action), expected)
        assert same(other.step(action), expected)
        other.close()
        if mode == AutoresetMode.DISABLED and (done := expected[2] | expected[3]).any():
            assert same(*(one.reset(options={"reset_mask": done.copy()}) for one in (env, local)))
    env.close()


@WAYS
def test_a_copy_of_a_single_environment_continues_with_the_same_bits(urls: Urls, way: Callable[[Any], Any]) -> None:
    env, local = (make_single(POSE, remote=remote, obs=("state", "depth")) for remote in (urls[0], None))
    fresh = way(env)
    assert same(fresh.reset(seed=2), local.reset(seed=2))
    env.reset(seed=1)
    other = way(env)
    action = acting(env, 1)[0]
    local.reset(seed=1)
    expected = local.step(action)
    assert same(other.step(action), expected)
    ended = way(other)
    assert same(env.step(action), expected)
    assert same(ended.reset(), local.reset())
    for one in (env, fresh, other, ended):
        one.close()


def test_pictures_and_cameras(urls: Urls) -> None:
    """Also of one environment alone, and after it has moved."""
    settings: dict[str, Any] = {"render_mode": "rgb_array", "picture": PICTURE, "obs": "depth_palm"}
    pair = [make(3, remote=remote, **settings) for remote in (None, urls)]
    for env in pair:
        env.reset(seed=1)
    before = pair[0].render()
    for action in acting(pair[0], 4):
        assert same(*(env.step(action) for env in pair))
        assert same(*(env.render() for env in pair))
        assert same(*(env.cameras() for env in pair))
    assert not same(pair[0].render(), before)
    assert same(*(env.picture(2) for env in pair))
    assert same(*(env.call("cameras") for env in pair))
    singles = [make_single(POSE, remote=remote, **settings) for remote in (None, urls[1])]
    for env in singles:
        env.reset(seed=2)
    assert same(*(env.render() for env in singles))
    assert same(*(env.unwrapped.cameras() for env in singles))
    for env in (pair[1], singles[1]):
        env.close()


def rows(step: Any) -> dict[int, Any]:
    """Split the results of a step by environment number."""

    def row(value: Any, i: int) -> Any:
        return {name: row(one, i) for name, one in value.items()} if isinstance(value, dict) else value[i : i + 1]

    *arrays, infos = step
    found = {}
    for i, env in enumerate(infos["env_id"]):
        own = row(infos, i)
        if not own.get("_final_obs", [False])[0]:
            own = {name: value for name, value in own.items() if "final" not in name}
        found[int(env)] = ([row(array, i) for array in arrays], own)
    return found


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
def test_what_is_sent_in_any_order_is_received(urls: Urls, mode: AutoresetMode) -> None:
    """Some are received while others of the same server are sent; ends of episodes come with them."""
    settings: dict[str, Any] = {"max_episode_steps": 3, "autoreset_mode": mode, "obs": ("proprio", "depth")}
    local, env = begun(**settings), begun(remote=urls, **settings)
    rng = np.random.default_rng(0)
    for _ in range(12):
        order = rng.permutation(5).tolist()
        first, second = order[: (cut := int(rng.integers(1, 5)))], order[cut:]
        actions = acting(local, 1)[0]
        env.send(actions[first], first)
        received = rows(env.recv(cut - 1)) if cut > 1 else {}
        env.send(actions[second], second)
        received |= rows(env.recv(len(order) - len(received)))
        local.send(actions)
        expected = rows(local.recv())
        assert sorted(received) == list(range(5))
        assert all(same(received[i], expected[i]) for i in range(5))
    assert same(env.step(actions), local.step(actions))
    env.close()
