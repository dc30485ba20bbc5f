"""Corrections of another policy's grasps: bounds, the agent's observations, and no change by zero corrections."""

import doctest
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from graspbox import evaluation, load_hand, policies
from graspbox.envs.coding import rotation_from_columns
from graspbox.envs.motion import pose_matrix, rotation_matrix, rotation_vector
from graspbox.errors import ConfigError
from graspbox.evaluation.oracles import DepthOracle
from graspbox.perception import HandGrid
from graspbox.policies import residual
from graspbox.policies.residual import PROPOSAL, Proposals, ResidualConfig, ResidualGrasp, moved, residual_size
from graspbox.remote import EnvironmentServer, ServerSettings
from graspbox.sb3.residual_env import ResidualVectorEnv

OBJECTS = ("procedural:can:0-3", "procedural:box:0-3")
NARROW = ResidualConfig(distance=0.015, angle=0.3, preshape=0.2)
REFLEX = load_hand("reflex")


def make(num_envs: int = 2, mode: str = "SameStep", **more: Any) -> Any:
    keywords = {"objects": OBJECTS, "obs": ("depth", "proprio"), "image_size": 128, "reward": "firm", **more}
    return gymnasium.make_vec("graspbox/GraspPose-v0", num_envs=num_envs, autoreset_mode=mode, **keywords)


def corrected(num_envs: int = 2, mode: str = "SameStep", **more: Any) -> ResidualVectorEnv:
    return ResidualVectorEnv(make(num_envs, mode, **more), policies.load("partial_view_planner"), NARROW)


def closing_place(pose: NDArray[np.float64], preshape: float) -> NDArray[np.float64]:
    return np.asarray(pose[:3, :3] @ REFLEX.closing_center(preshape) + pose[:3, 3])


def test_examples_run() -> None:
    assert doctest.testmod(residual).failed == 0


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.floats(-2.0, 2.0), min_size=7, max_size=7),
    st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    st.lists(st.floats(-0.25, 0.25), min_size=3, max_size=3),
    st.floats(0.0, np.pi / 2),
)
def test_no_correction_leaves_its_bounds(
    correction: list[float], turn: list[float], place: list[float], preshape: float
) -> None:
    start = pose_matrix(place, rotation_matrix(np.array(turn)))
    pose, after = moved(start, preshape, correction, REFLEX, NARROW)
    shift = np.linalg.norm(closing_place(pose, preshape) - closing_place(start, preshape))
    angle = np.linalg.norm(rotation_vector(start[:3, :3].T @ pose[:3, :3]))
    assert shift <= NARROW.distance + 1e-12
    assert angle <= NARROW.angle + 1e-7
    low, high = REFLEX.preshape_limits
    assert low <= after <= high
    assert abs(after - preshape) <= NARROW.preshape * (high - low) + 1e-12
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-9)


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, -1, 0), (1, 1, 0), (-1, 1, 1)])
def test_the_largest_entry_is_the_share_of_the_bound(direction: tuple[int, int, int]) -> None:
    start = pose_matrix((0.1, 0.0, 0.2), rotation_matrix(np.array([0.3, 2.0, 0.1])))
    along = np.array(direction) / np.linalg.norm(direction)
    for share in (0.5, 1.0):
        part = share * np.array(direction)
        shifted, _ = moved(start, 0.5, [*part, 0, 0, 0, 0], REFLEX, NARROW)
        offset = start[:3, :3].T @ (closing_place(shifted, 0.5) - closing_place(start, 0.5))
        np.testing.assert_allclose(offset, share * NARROW.distance * along, atol=1e-12)
        turned, _ = moved(start, 0.5, [0, 0, 0, *part, 0], REFLEX, NARROW)
        found = rotation_vector(start[:3, :3].T @ turned[:3, :3])
        np.testing.assert_allclose(found, share * NARROW.angle * along, atol=1e-9)
        np.testing.assert_allclose(closing_place(turned, 0.5), closing_place(start, 0.5), atol=1e-12)
    assert moved(start, 0.5, [0, 0, 0, 0, 0, 0, 1], REFLEX, NARROW)[1] == pytest.approx(0.5 + 0.2 * np.pi / 2)


def test_zeros_are_the_proposal_to_the_bit() -> None:
    base = policies.load("partial_view_planner")
    size = residual_size(REFLEX)
    zero = ResidualGrasp(policies.load("partial_view_planner"), lambda seen: np.zeros((len(seen["proposal"]), size)))
    results = [evaluation.evaluate(one, objects=OBJECTS, trials=12, seed=3, num_envs=4) for one in (base, zero)]
    assert results[0].trials == results[1].trials
    assert results[0].succeeded > 0
    assert results[1].policy == "partial_view_planner + residual"
    away = ResidualGrasp(policies.load("partial_view_planner"), lambda seen: np.tile([0, 0, -1, 0, 0, 0, 0], (4, 1)))
    moved_back = evaluation.evaluate(away, objects=OBJECTS, trials=12, seed=3, num_envs=4)
    assert [t.reward for t in moved_back.trials] != [t.reward for t in results[0].trials]


def test_in_the_environment_a_zero_action_is_the_base_policy() -> None:
    envs, plain = corrected(3), make(3)
    base = policies.load("partial_view_planner")
    base.bind(policies.Task.of(plain))
    _, info = envs.reset(seed=[5, 6, 7])
    observation, other = plain.reset(seed=[5, 6, 7])
    base.reset([5, 6, 7], info=other)
    for _ in range(3):
        assert info["object"].tolist() == other["object"].tolist()
        _, reward, *_, info = envs.step(np.zeros((3, 7)))
        observation, wanted, terminated, _, other = plain.step(base.act(observation))
        assert terminated.all()
        assert reward.tolist() == wanted.tolist()
        base.reset(mask=terminated, info=other)


def test_the_agent_sees_the_voxels_around_the_proposed_hand() -> None:
    envs = corrected(2)
    seen, _ = envs.reset(seed=1)
    assert envs.single_observation_space.contains({name: rows[0] for name, rows in seen.items()})
    assert set(seen) == {"volume", "proposal"}
    base: Any = envs.proposals.base
    places = np.cumsum([0, *(row[1] for row in PROPOSAL)])
    columns = {row[0]: slice(a, b) for row, a, b in zip(PROPOSAL, places, places[1:], strict=False)}
    grid = HandGrid("reflex")
    for env in range(2):
        found, numbers = base.found[env], seen["proposal"][env]
        turn = found.world_from_hand[:3, :3]
        pose = np.linalg.inv(found.world_from_crop) @ found.world_from_hand
        assert (seen["volume"][env] == grid.crops(found.volume[None], [0], pose[None])[0]).all()
        assert (seen["volume"][env][:2] > 0).any()
        np.testing.assert_allclose(numbers[columns["down"]], turn.T @ [0, 0, -1], atol=1e-6)
        np.testing.assert_allclose(numbers[columns["away"]], turn.T @ found.world_from_crop[:3, 0], atol=1e-6)
        assert numbers[columns["height"]][0] == pytest.approx(10 * found.world_from_hand[2, 3], abs=1e-5)
        assert numbers[columns["preshape"]][0] == pytest.approx(found.preshape / (np.pi / 2), abs=1e-6)
        assert numbers[columns["score"]][0] == pytest.approx(np.clip(found.score, -10, 10), rel=1e-6)
        assert numbers[columns["proposed"]][0] == 1.0
    base.found[1] = None
    assert not envs.proposals.observe()["proposal"][1].any()
    assert not envs.proposals.actions(np.ones((2, 7)))[1].any()


def test_actions_stay_within_the_bounds_of_the_proposal() -> None:
    """Also where the workspace ends: an action names no pose beyond it."""
    envs = corrected(2)
    envs.reset(seed=1)
    base: Any = envs.proposals.base
    arm = np.linalg.norm(REFLEX.closing_center(0.0))
    first = base.found[0]
    edge = first.world_from_hand.copy()
    edge[:2, 3] = (0.249, -0.25)
    base.found[0] = replace(first, chosen=0, poses=(np.linalg.inv(first.world_from_crop) @ edge)[None])
    rng, outside = np.random.default_rng(0), 0
    for _ in range(50):
        actions = envs.proposals.actions(rng.uniform(-1.0, 1.0, (2, 7))).astype(np.float64)
        assert (np.abs(actions) <= 1.0).all()
        for action, found in zip(actions, base.found, strict=True):
            start = found.world_from_hand
            place = np.array([0.25 * action[0], 0.25 * action[1], 0.2 * (action[2] + 1.0)])
            rotation = rotation_from_columns(action[3:6], action[6:9])
            assert rotation is not None
            swing = 2.0 * arm * np.sin(NARROW.angle / 2.0)
            assert np.linalg.norm(place - start[:3, 3]) <= NARROW.distance + swing + 1e-6
            assert np.linalg.norm(rotation_vector(start[:3, :3].T @ rotation)) <= NARROW.angle + 1e-6
            outside += int((np.abs(action[:2]) == 1.0).any())
    assert outside > 10


def test_episodes_begin_as_the_mode_says() -> None:
    same, later, by_hand = corrected(2), corrected(2, "NextStep"), corrected(2, "Disabled")
    firsts = [envs.reset(seed=[4, 9])[0]["volume"] for envs in (same, later, by_hand)]
    assert (firsts[0] == firsts[1]).all()
    assert (firsts[0] == firsts[2]).all()
    action = np.full((2, 7), 0.1)
    found = [envs.step(action) for envs in (same, later, by_hand)]
    assert [one[1].tolist() for one in found] == [found[0][1].tolist()] * 3
    final = found[0][4]["final_obs"]
    assert all((final[i]["volume"] == firsts[0][i]).all() for i in range(2))
    assert (found[1][0]["volume"] == firsts[0]).all()
    next_of_later, reward, terminated, *_ = later.step(action)
    assert not reward.any()
    assert not terminated.any()
    assert (next_of_later["volume"] == found[0][0]["volume"]).all()
    assert (next_of_later["volume"] != firsts[0]).any(axis=(1, 2, 3, 4)).all()
    begun, _ = by_hand.reset(seed=[None, 9], options={"reset_mask": np.array([False, True])})
    assert (begun["volume"] == firsts[0]).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"distance": 0.0}, "distance is 0.0; give metres above 0, at most 0.2"),
        ({"distance": float("nan")}, "distance is nan"),
        ({"angle": 2.0}, "angle is 2.0; give radians above 0, at most 1.57"),
        ({"preshape": -0.1}, "preshape is -0.1; give a share"),
    ],
)
def test_bounds_are_checked(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        ResidualConfig(**changes)


def test_what_cannot_be_corrected_is_refused() -> None:
    with pytest.raises(ConfigError, match="the base policy is a Planner; give one that finds its grasp"):
        Proposals(policies.load("planner"))
    with pytest.raises(ConfigError, match="has oracles, which use the true object"):
        Proposals(DepthOracle(None, ("scorer",)))
    with pytest.raises(ConfigError, match=r"corrections act in graspbox/GraspPose-v0, not in 'graspbox/Grasp-v0'"):
        evaluation.evaluate(
            ResidualGrasp(policies.load("partial_view_planner"), lambda seen: np.zeros((1, 7))),
            "graspbox/Grasp-v0",
            trials=1,
        )
    envs = corrected(2)
    with pytest.raises(ConfigError, match="call reset before step"):
        envs.step(np.zeros((2, 7)))
    envs.reset(seed=0)
    with pytest.raises(ConfigError, match=r"corrections have shape \(7,\); give \(2, 7\)"):
        envs.step(np.zeros(7))
    with pytest.raises(ConfigError, match="give 7 finite numbers"):
        envs.step(np.full((2, 7), np.nan))
    assert envs.step(np.zeros((2, 7)))[2].all()


def test_a_hand_without_preshapes_has_a_shorter_correction() -> None:
    gripper = load_hand("panda_gripper")
    assert residual_size(gripper) == 6
    envs = corrected(1, hand="panda_gripper")
    assert envs.single_action_space.shape == (6,)
    seen, _ = envs.reset(seed=0)
    assert envs.single_observation_space.contains({name: rows[0] for name, rows in seen.items()})
    assert envs.step(np.zeros((1, 6)))[2].all()


def test_corrections_are_the_same_in_environments_on_a_server() -> None:
    with EnvironmentServer(ServerSettings(port=0)) as server:
        places = [corrected(2, remote=remote) for remote in (None, server.url)]
        seen = [envs.reset(seed=4)[0] for envs in places]
        for _ in range(3):
            for name, values in seen[0].items():
                np.testing.assert_array_equal(values, seen[1][name])
            results = [envs.step(np.full((2, 7), 0.1)) for envs in places]
            assert results[0][1].tolist() == results[1][1].tolist()
            seen = [result[0] for result in results]
