"""``graspbox/Grasp-v0``: its own behaviour; ``test_conformance`` has the requirements of all environments."""

import re
from pathlib import Path
from typing import Any, get_args

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import graspbox
from acting import EACH, OBJECTS, expert_actions, pressing
from graspbox import errors
from graspbox.configs import CamerasConfig, Randomization
from graspbox.envs import grasp, reward, spaces
from graspbox.envs.coding import Codec, object_pose
from graspbox.simulation import outcomes

ID = "graspbox/Grasp-v0"


def make(**settings: Any) -> Any:
    return gymnasium.make(ID, **{"objects": OBJECTS, **EACH, **settings})


def test_what_the_documentation_says_in_words_is_true() -> None:
    """Its tables are those of `test_generate_docs`."""
    found = spaces.tables(graspbox.load_hand())
    text = grasp.__doc__ or ""
    for control, by_fingers in found["actions"].items():
        assert f'control="{control}"' in text
        for fingers in by_fingers:
            assert f'fingers="{fingers}"' in text
    for name in found["observations"]["twist"]["each"]:
        assert (name in found["privileged"]) == (f"``{name}`` is **privileged**" in text)
    assert grasp.GraspEnv.metadata["render_fps"] == 5
    _, info = make().reset(seed=0)
    assert list(info) == [*(row["name"] for row in found["info"]), "reward_terms"]


def test_names_that_python_repeats_are_those_of_the_core() -> None:
    """Type checkers need the kinds of failures before there is a pool; an error lists the kinds of images."""
    found = spaces.tables(graspbox.load_hand())
    assert ["", *get_args(outcomes.FailureKind)] == found["failures"]
    with pytest.raises(errors.ConfigError, match="there is no image") as refused:
        spaces.images(graspbox.load_hand(), CamerasConfig(images=("nothing",)))
    listed = re.findall(r"give (.*?), alone", str(refused.value))[0]
    assert tuple(re.split(", | or ", listed)) == spaces.IMAGES


@pytest.mark.parametrize("fingers", ["synergy", "each"])
@pytest.mark.parametrize("control", ["twist", "delta_pose", "target_pose", "top_down"])
def test_spaces_follow_control_mode_and_fingers(control: str, fingers: str) -> None:
    env = make(control=control, fingers=fingers, obs=("proprio", "tactile", "state"))
    found = spaces.tables(graspbox.load_hand())
    assert env.action_space.shape == (sum(f["size"] for f in found["actions"][control][fingers]),)
    for name, rows in found["observations"][control][fingers].items():
        assert env.observation_space[name].shape == (sum(f["size"] for f in rows),)
    observation, _ = env.reset(seed=0)
    np.testing.assert_array_equal(observation["proprio"], observation["state"][: len(observation["proprio"])])
    action = env.action_space.sample()
    state = env.step(action)[0]["state"]
    np.testing.assert_array_equal(state[-len(action) :], action)


def test_bounds_of_the_state_cut_nothing_off() -> None:
    """Observations are clipped to their bounds, so those must be wide enough: a grasp comes near none of them.

    Loads, contacts and sizes do reach their lower bound of 0, a load its motor's limit, the preshape that of its joint;
    columns without a unit are shares and axes.
    """
    columns, physical = (
        spaces.tables(graspbox.load_hand())["observations"]["twist"]["each"]["state"],
        ("load", "preshape"),
    )
    for objects in ("procedural:can:0", "procedural:box:1"):
        env = make(objects=objects).unwrapped
        actions = expert_actions(env, 0)
        states = [env.reset(seed=0)[0], *(env.step(action)[0] for action in actions)]
        first = 0
        for column in columns:
            values = np.stack(states)[:, first : first + column["size"]]
            first += column["size"]
            if column["unit"] != "1":
                assert values.max() < column["high"] * (1 - 1e-6) or column["name"] in physical, column["name"]
                assert values.min() > column["low"] * (1 - 1e-6) or column["low"] == 0.0, column["name"]


def test_reward_is_the_weighted_sum_of_its_terms() -> None:
    """Dense, sparse and own weights on the same actions: one run, three rewards."""
    envs = {
        "dense": make(reward="dense"),
        "sparse": make(reward="sparse"),
        "own": make(reward="sparse", reward_weights={"reach": 2.0, "success": 0.0}),
    }
    weights = {"dense": reward.DENSE, "sparse": reward.SPARSE, "own": {"reach": 2.0}}
    for env in envs.values():
        env.reset(seed=3)
    seen = set()
    for action in pressing(30, 1)[:, 0]:
        for name, env in envs.items():
            _, value, _, _, info = env.step(action)
            expected = sum(weights[name].get(term, 0.0) * x for term, x in info["reward_terms"].items())
            assert value == pytest.approx(expected, abs=1e-12)
            seen.add((name, value != 0.0))
    assert ("dense", True) in seen
    assert ("own", True) in seen
    assert ("sparse", True) not in seen


def test_a_firm_hold_is_paid_for() -> None:
    """``slip`` adds up to how far the object has moved in the hand, ``secure`` comes with the info's flag."""
    env: Any = make(objects="procedural:can:0", reward="firm").unwrapped
    reads = Codec("twist", graspbox.load_hand(), fingers="each")
    actions = expert_actions(env, 0)
    env.reset(seed=0)
    slipped, greatest = 0.0, 0.0
    for action in actions:
        state, value, _, _, info = env.step(action)
        terms = info["reward_terms"]
        assert value == pytest.approx(sum(reward.FIRM.get(name, 0.0) * x for name, x in terms.items()), abs=1e-12)
        slipped += terms["slip"]
        shift, turn = (reads.column(state, name)[0] for name in ("shift", "turn"))
        assert -slipped == pytest.approx(min(max(shift / 0.05, turn / np.radians(15)), 1.0), abs=1e-5)
        greatest = max(greatest, -slipped)
        assert terms["secure"] == float(info["is_secure"])
    assert info["is_success"]
    assert greatest > 0.01
    decision: Any = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0", reward="firm").unwrapped
    decision.reset(seed=0)
    _, value, _, _, info = decision.step(decision.action_space.sample())
    terms = info["reward_terms"]
    assert value == pytest.approx(sum(reward.FIRM_DECISION.get(name, 0.0) * x for name, x in terms.items()))
    for weights, firm in ((reward.DENSE, reward.FIRM), (reward.DECISION, reward.FIRM_DECISION)):
        # A secure success is worth more than before, a loose one less.
        assert firm["success"] < weights["success"] < firm["success"] + firm["secure"]


def test_state_restores_the_future() -> None:
    """Contact, a state in the middle, and the same actions again: the same bits; also the draws of the next episode."""
    env = make(objects="procedural:can:0", reward="dense", randomization="standard").unwrapped
    actions = expert_actions(env, 1)[:-1]
    assert len(actions) > 80

    def run(rest: Any) -> list[Any]:
        found = [env.step(action) for action in rest]
        return [*found, env.reset()]

    env.reset(seed=1)
    before = [env.step(action) for action in actions[:-15]]
    state = env.get_state()
    first = run(actions[-15:])
    observation, info = env.set_state(state)
    assert data_equivalence((observation, info), (before[-1][0], before[-1][4]), exact=True)
    assert data_equivalence(run(actions[-15:]), first, exact=True)
    assert all(step[4]["touches"] for step in first[:-1])
    other = make(objects="procedural:can:0", reward="dense", randomization="standard").unwrapped
    other.set_state(state)
    again = [*(other.step(action) for action in actions[-15:]), other.reset()]
    assert data_equivalence(again, first, exact=True)


def test_options_change_what_they_name_alone() -> None:
    env = make().unwrapped
    env.reset(seed=2)
    state, info = env.reset(seed=2)
    moved, _ = env.reset(seed=2, options={"place": [0.02, -0.03, 1.0], "object": info["object"]})
    # The state begins with the columns of proprio.
    proprio = spaces.size(env._core.tables["observations"]["twist"]["each"]["proprio"])
    np.testing.assert_array_equal(state[:proprio], moved[:proprio])
    assert (state[proprio:] != moved[proprio:]).any()
    world_from_hand = np.diag([1.0, -1.0, -1.0, 1.0])
    world_from_hand[:3, 3] = [0.1, 0.05, 0.4]
    placed, info = env.reset(seed=2, options={"world_from_hand": world_from_hand, "object": np.int64(1)})
    np.testing.assert_allclose(placed[:3], [0.1, 0.05, 0.4], atol=1e-6)
    assert info["object"] == env.objects.names[1]


@pytest.mark.parametrize(
    "options",
    [
        {"colour": 1},
        {"object": "moon"},
        {"object": 99},
        {"place": [0.0, np.nan, 0.0]},
        {"world_from_hand": np.ones((4, 4))},
        {"friction": -1.0},
        {"place": [0.7, 0.0, 0.0]},
        {"world_from_hand": [[1.0, 0, 0, 0.0], [0, -1.0, 0, 3.0], [0, 0, -1.0, 0.3], [0, 0, 0, 1.0]]},
        {"place": object()},
        [{"object": 0}],
    ],
)
def test_wrong_options_leave_the_episode_as_it_was(options: Any) -> None:
    env = make().unwrapped
    env.reset(seed=1)
    state = env.get_state()
    with pytest.raises(errors.ConfigError):
        env.reset(options=options)
    assert env.get_state() == state


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"obs": "deep"}, "no observation 'deep'"),
        ({"obs": ()}, "at least one"),
        ({"obs": ("state", "state")}, "each once"),
        ({"control": "joint"}, "control is .joint.; choose from"),
        ({"reward": "shaped"}, "no reward"),
        ({"reward_weights": {"joy": 1.0}}, "no reward term 'joy'"),
        ({"reward_weights": {"lift": float("nan")}}, "finite"),
        ({"image_size": 3}, "image_size"),
        ({"randomization": "wild"}, "randomization"),
        ({"randomization": Randomization(friction=(2.0, 1.0))}, "friction"),
        ({"num_threads": 0}, "num_threads"),
        ({"physics": graspbox.PhysicsConfig(dt=0.003)}, "0.05 s"),
        ({"objects": "cupboard"}, "no object set"),
    ],
)
def test_wrong_arguments_are_explained(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(errors.GraspboxError, match=message):
        make(**wrong)


def test_wrong_actions_and_seeds_are_explained() -> None:
    env = make().unwrapped
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(env.action_space.sample())
    for seed in (-1, 1.5, "1", 2**64):
        with pytest.raises(errors.ConfigError, match="seed is"):
            env.reset(seed=seed)
    env.reset(seed=0)
    with pytest.raises(errors.ConfigError, match="10 numbers"):
        env.step(np.zeros(3, dtype=np.float32))
    with pytest.raises(errors.ConfigError, match="index 4"):
        env.step(np.array([0, 0, 0, 0, np.inf, 0, 0, 0, 0, 0], dtype=np.float32))
    with pytest.raises(errors.ConfigError, match="state"):
        env.set_state(b"nothing")


def test_an_object_let_go_rises_from_where_it_comes_to_rest() -> None:
    """The lift counts from there, not from where it was let go; while it hangs in the air it touches no table."""
    env: Any = make(objects="procedural:can:0").unwrapped
    state, _ = env.reset(seed=0, options={"resting": 0})
    high, away = object_pose(state), np.diag([1.0, -1.0, -1.0, 1.0])
    high[2, 3] += 0.05
    away[:3, 3] = [0.3, 0.3, 0.5]
    options = {"world_from_object": high, "world_from_hand": away}
    state, info = env.reset(seed=0, options=options)
    on_table = 72
    assert info["lift"] == pytest.approx(0.05, abs=2e-3)
    assert state[on_table] == 0.0
    for _ in range(20):
        state, _, _, _, info = env.step(np.zeros(10, np.float32))
    assert info["lift"] == pytest.approx(0.0, abs=2e-3)
    assert state[on_table] == 1.0
    decision: Any = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0")
    _, info = decision.reset(seed=0, options={"world_from_object": high})
    assert info["lift"] == pytest.approx(0.0, abs=2e-3)


@pytest.mark.parametrize("env_id", ["graspbox/Grasp-v0", "graspbox/GraspPose-v0"])
def test_the_hand_is_kept_off_the_object_and_the_table_as_they_are(env_id: str) -> None:
    """Not as they would be with the object in the resting pose that was drawn."""
    env: Any = gymnasium.make(env_id, objects="procedural:can:0", obs=("state", "proprio")).unwrapped
    lies = []
    for resting in range(2):
        env.reset(seed=0, options={"resting": resting, "place": [0.0, 0.0, 0.0]})
        lies.append(env._core.pool.poses()[0][0])
    assert abs(lies[0][2, 2] - lies[1][2, 2]) > 0.5
    free = np.diag([1.0, -1.0, -1.0, 1.0])
    free[:3, 3] = 0.3, 0.3, 0.3
    tall = lies[0].copy()
    tall[2, 3] += 0.3
    for seed in range(20):
        # As it rests; let go from on high; the hand is where it would be anyway.
        for pose in lies:
            given, _ = env.reset(seed=seed, options={"world_from_object": pose})
            drawn, _ = env.reset(seed=seed, options={"place": [0.0, 0.0, 0.0]})
            np.testing.assert_allclose(given["proprio"][:3], drawn["proprio"][:3], atol=0.051)
        env.reset(seed=seed, options={"world_from_object": tall, "world_from_hand": free})
        for height in (-0.1, -0.02, 0.02):
            sunk = free.copy()
            sunk[2, 3] = height
            with pytest.raises(errors.ConfigError, match="world_from_hand"):
                env.reset(seed=seed, options={"world_from_object": lies[1], "world_from_hand": sunk})


def test_an_object_is_dropped_where_it_stays_in_the_workspace() -> None:
    env: Any = make(objects="procedural:can:0").unwrapped
    env.reset(seed=0)
    # Tipped, so that it tumbles away from the table's middle.
    pose, angle = np.eye(4), 0.8
    pose[0, [0, 2]], pose[2, [0, 2]] = [np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]
    for x, match in ((0.56, "within 0.5 m"), (0.46, "leaves the workspace")):
        pose[:3, 3] = x, 0.0, 0.3
        with pytest.raises(errors.ConfigError, match=match):
            env.reset(options={"world_from_object": pose})
    # In this engine it bounces.
    rapier: Any = make(objects="procedural:can:0", physics=graspbox.PhysicsConfig(engine="rapier")).unwrapped
    pose[2, 3] = 0.9
    with pytest.raises(errors.ConfigError, match="falls off"):
        rapier.reset(seed=0, options={"world_from_object": pose})
    pose[:3, 3] = 0.0, 0.0, 0.1
    with pytest.raises(errors.ConfigError, match="not both"):
        env.reset(options={"world_from_object": pose, "resting": 0})
    assert env.reset(options={"world_from_object": pose})[1]["resting"] == -1


def test_a_hand_does_not_wait_in_an_object_that_fell_there() -> None:
    env: Any = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:can:0").unwrapped
    env.reset(seed=0, options={"resting": 0, "place": [0.0, 0.0, 0.0]})
    high = env._core.pool.poses()[0][0].copy()
    high[2, 3] += 0.6
    near = np.diag([1.0, -1.0, -1.0, 1.0])
    near[2, 3] = 0.06
    with pytest.raises(errors.ConfigError, match="of object"):
        env.reset(seed=0, options={"world_from_object": high, "world_from_hand": near})


def test_a_seed_of_numpy_is_a_seed() -> None:
    env = make().unwrapped
    seed: Any = np.int64(3)
    assert data_equivalence(env.reset(seed=seed), env.reset(seed=3), exact=True)
    assert env.np_random_seed == 3


def test_the_seed_of_a_state_is_not_known() -> None:
    one, other = make().unwrapped, make().unwrapped
    one.reset(seed=1)
    other.set_state(one.get_state())
    assert other.np_random_seed == -1
    assert data_equivalence(other.reset(), one.reset(), exact=True)


def test_an_object_that_cannot_be_used_does_not_block_the_environment(tmp_path: Path) -> None:
    """A reset that draws it raises; the next one draws again."""
    corners = [f"{x} {y} {z}" for x in (-0.03, 0.03) for y in (-0.03, 0.03) for z in (-0.03, 0.03)]
    faces = ["0 1 3", "0 3 2", "4 6 7", "4 7 5", "0 4 5", "0 5 1", "2 3 7", "2 7 6", "0 2 6", "0 6 4", "1 5 7", "1 7 3"]
    (tmp_path / "cube.off").write_text("\n".join(["OFF", "8 12 0", *corners, *(f"3 {face}" for face in faces)]))
    (tmp_path / "broken.off").write_text("OFF\n8 12 0\n0 0 0\n")
    env: Any = make(objects=f"dir:{tmp_path}").unwrapped
    env.reset(seed=0, options={"object": "cube"})
    names, messages = set(), []
    for _ in range(20):
        try:
            names.add(env.reset()[1]["object"])
        except errors.GraspboxError as error:
            names.add(error.object)
            messages.append(str(error))
    assert names == {"cube", "broken"}
    assert all(str(tmp_path / "broken.off") in message for message in messages)


def test_an_unseeded_episode_can_be_had_again() -> None:
    env = make().unwrapped
    first = env.reset()
    assert data_equivalence(env.reset(seed=env.np_random_seed), first, exact=True)
    assert not data_equivalence(make().unwrapped.reset(), first, exact=True)


def test_time_limit_truncates() -> None:
    env = make(max_episode_steps=3)
    env.reset(seed=0)
    ends = [env.step(np.zeros(10, dtype=np.float32))[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]
