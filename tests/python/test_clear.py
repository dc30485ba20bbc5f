"""`Clear-v0`: rounds, what an attempt changes, labels, scenes for privileged policies, and errors."""

from dataclasses import fields, replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import graspbox
from graspbox.configs import Randomization
from graspbox.envs.coding import codec, encode_action
from graspbox.envs.settings import ClearConfig
from graspbox.errors import ConfigError

ID = "graspbox/Clear-v0"
OBJECTS = ("procedural:box:0-3", "procedural:can:0-3")
#: A pose high above the table, where the hand closes on nothing.
AWAY = np.diag([1.0, -1.0, -1.0, 1.0])
AWAY[2, 3] = 0.4


def clear(**settings: Any) -> Any:
    return gymnasium.make(ID, objects=OBJECTS, hand="panda_gripper", **{"objects_per_scene": 3, **settings})


def planned(env: Any) -> Any:
    """Plan for every object, and choose the best grasp; zeros where there is none."""
    scene, best = env.unwrapped.arrangement(), (-np.inf, np.zeros(env.action_space.shape, np.float32))
    for index, (mesh, pose) in enumerate(zip(scene.meshes, scene.world_from_objects, strict=True)):
        plan = graspbox.plan(mesh, hand="panda_gripper", world_from_object=pose, neighbours=scene.without(index)).best(
            1
        )
        if len(plan) and plan.score[0] > best[0]:
            best = (plan.score[0], encode_action(pose @ plan.poses[0], plan.preshape[0], hand="panda_gripper"))
    return best[1]


def away() -> Any:
    return encode_action(AWAY, 0.0, hand="panda_gripper")


def test_a_round_ends_when_all_is_cleared() -> None:
    env = clear(layout="packed")
    _, info = env.reset(seed=3)
    begun, rewards, ended = info["remaining"], [], False
    assert begun >= 2
    assert (info["attempts"], info["cleared"], info["failure"]) == (0, 0, "")
    while not ended:
        before = info
        _, reward, ended, _, info = env.step(planned(env))
        rewards.append(reward)
        assert info["attempts"] == before["attempts"] + 1
        assert info["cleared"] + info["lost"] + info["remaining"] == begun
        assert (info["cleared"] > before["cleared"]) == info["is_success"] == (reward == 1.0)
        assert info["is_success"] == (info["failure"] == "")
        assert not info["is_success"] or info["lift"] > 0.14
    assert info["cleared"] == begun, "the planner clears three packed boxes and cans"
    assert sum(rewards) == begun


def test_a_round_ends_after_failures_in_a_row() -> None:
    for most in (1, 3):
        env = clear(max_failures=most, obs="state")
        before, _ = env.reset(seed=3)
        for attempt in range(1, most + 1):
            state, reward, ended, _, info = env.step(away())
            assert (reward, info["failure"], ended) == (0.0, "no_contact", attempt == most)
        # Nothing was touched; what settles further settles by hairs.
        np.testing.assert_allclose(state, before, atol=2e-3)


def test_an_infeasible_attempt_moves_nothing() -> None:
    env = clear()
    env.reset(seed=3)
    before = env.unwrapped.arrangement()
    info = env.step(np.zeros(env.action_space.shape, np.float32))[4]
    assert (info["failure"], info["infeasible"], info["disturbed"]) == ("infeasible", True, 0)
    assert (env.unwrapped.arrangement().world_from_objects == before.world_from_objects).all()


def test_the_scene_loses_what_is_taken_away() -> None:
    env = clear(layout="packed", obs="segmentation", image_size=128)
    image, _ = env.reset(seed=1)
    before, labels = env.unwrapped.arrangement(), set(np.unique(image)) - {0, 1}
    image, _, _, _, info = env.step(planned(env))
    after = env.unwrapped.arrangement()
    assert info["is_success"]
    assert len(after) == len(before) - 1
    assert set(after.objects) < set(before.objects)
    # Others keep their labels; the hand waits out of sight.
    assert set(np.unique(image)) - {0, 1} < labels
    names = [env.unwrapped.objects.names[index] for index in after.objects]
    assert [mesh.name for mesh in after.meshes] == names


def test_states_continue_bit_for_bit() -> None:
    for layout in ("packed", "pile", "bin"):
        env = clear(layout=layout, obs=("state", "proprio"))
        env.reset(seed=5)
        env.step(planned(env))
        state, action = env.unwrapped.get_state(), planned(env)
        expected = env.step(action)
        other = clear(layout=layout, obs=("state", "proprio"))
        other.unwrapped.set_state(state)
        other.reset(seed=9)
        other.unwrapped.set_state(state)
        found = other.unwrapped.step(action)
        assert data_equivalence(found[0], expected[0], exact=True)
        assert found[1:3] == expected[1:3]
        assert found[4] == expected[4]


def test_vector_environments_equal_single_ones() -> None:
    settings: dict[str, Any] = {"objects": OBJECTS, "hand": "panda_gripper", "objects_per_scene": (2, 4)}
    many: Any = gymnasium.make_vec(ID, num_envs=3, vectorization_mode="vector_entry_point", num_threads=2, **settings)
    seen = many.reset(seed=11)[0]
    for index in range(3):
        single: Any = gymnasium.make(ID, **settings)
        assert (single.reset(seed=11 + index)[0] == seen[index]).all()
        scene, other = single.unwrapped.arrangement(), many.unwrapped.arrangement(index)
        assert (scene.world_from_objects == other.world_from_objects).all()


def test_randomization_gives_every_object_the_same_factor_on_its_mass() -> None:
    """The state tells the mass of the object that reaches highest, which changes as the round goes on."""
    env = clear(layout="packed", obs="state", randomization=Randomization(mass=(0.5, 2.0)))
    lists: list[list[float]] = []
    for seed in (3, 4, 5, 3):
        state, _ = env.reset(seed=seed)
        factors, objects, ended = [], set(), False
        while not ended:
            scene = env.unwrapped.arrangement()
            distances = np.linalg.norm(scene.world_from_objects[:, :3, 3] - state[:3], axis=1)
            top = int(distances.argmin())
            assert distances[top] < 1e-5
            factors.append(float(state[-1]) / scene.meshes[top].mass)
            objects.add(scene.objects[top])
            state, _, ended, _, _ = env.step(planned(env))
        assert len(objects) > 1
        np.testing.assert_allclose(factors, factors[0], rtol=1e-5)
        assert 0.5 <= factors[0] <= 2.0
        lists.append(factors)
    assert lists[0] == lists[3]
    assert len({round(factors[0], 3) for factors in lists}) == 3


def test_friction_and_mass_of_an_attempt_are_those_of_every_object() -> None:
    """Attempts on each object end as those of a scene whose objects all have these factors, and not as without them."""
    for friction, mass in ((0.1, 10.0), (1.0, 1.0)):
        fixed = clear(layout="packed", randomization=Randomization(friction=(friction,) * 2, mass=(mass,) * 2))
        asked = clear(layout="packed")
        asked.reset(seed=3, options={"friction": friction, "mass": mass})
        found = asked.unwrapped.arrangement()
        scene = graspbox.Scene.of(found, hand="panda_gripper")
        for index in range(len(found)):
            around, rest = found.without(index), found.world_from_objects[index]
            (best,) = graspbox.plan(
                found.meshes[index], hand="panda_gripper", world_from_object=rest, neighbours=around
            ).best(1)
            action = encode_action(rest @ best.pose, best.preshape, hand="panda_gripper")
            pose, preshape = codec("grasp_pose", "panda_gripper").decode_grasp(action)
            pose = np.linalg.inv(scene.world_from_object) @ pose
            asked.reset(seed=3, options={"friction": friction, "mass": mass})
            fixed.reset(seed=3)
            ours, theirs = asked.step(action), fixed.step(action)
            assert data_equivalence(ours, theirs, exact=True)
            expected = scene.simulate(pose[None], preshape, friction=friction, mass=mass)
            assert ours[4]["lift"] == pytest.approx(float(expected.lift[0]), abs=1e-6)
            assert ours[4]["is_success"] == bool(expected.success[0])
            plain = scene.simulate(pose[None], preshape)
            assert (abs(float(plain.lift[0]) - ours[4]["lift"]) > 1e-5) == (friction != 1.0)


def test_scales_and_numbers_vary_within_their_ranges() -> None:
    env = clear(objects_per_scene=(1, 4), object_scale=(0.5, 0.6), layout="packed")
    counts, scales = set(), []
    known = {name: env.unwrapped.objects[i].load() for i, name in enumerate(env.unwrapped.objects.names)}
    for seed in range(12):
        counts.add(env.reset(seed=seed)[1]["remaining"])
        for mesh in env.unwrapped.arrangement().meshes:
            whole = known[mesh.name]
            scales.append(np.ptp(mesh.bounds, axis=0)[2] / np.ptp(whole.bounds, axis=0)[2])
            assert mesh.mass == pytest.approx(whole.mass * scales[-1] ** 3, rel=1e-6)
    assert len(counts) >= 3
    assert min(scales) >= 0.5 - 1e-6
    assert max(scales) <= 0.6 + 1e-6
    assert np.ptp(scales) > 0.05


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"layout": "heap"}, "layout is 'heap'; choose from"),
        ({"objects_per_scene": 0}, "objects_per_scene"),
        ({"objects_per_scene": (4, 2)}, "objects_per_scene"),
        ({"objects_per_scene": 41}, "objects_per_scene"),
        ({"object_scale": (0.0, 1.0)}, "scale"),
        ({"max_failures": 0}, "max_failures"),
        ({"spread": 3.0}, "spread"),
        ({"spread": "dense"}, "spread"),
        ({"layout": "bin", "bin_size": (0.3, 5.0, 0.1)}, "inside"),
        ({"control": "twist"}, "control"),
    ],
)
def test_wrong_settings_are_refused(settings: dict[str, Any], why: str) -> None:
    with pytest.raises(graspbox.GraspboxError, match=why):
        clear(**settings)


def test_options_of_a_single_object_are_refused() -> None:
    env = clear()
    for options in ({"object": 0}, {"resting": 0}, {"place": [0, 0, 0]}, {"world_from_object": np.eye(4).tolist()}):
        with pytest.raises(graspbox.GraspboxError, match="sampled as a whole"):
            env.reset(seed=0, options=options)
    env.reset(seed=0)


def test_arrangements_lose_objects_by_index() -> None:
    env = clear(layout="packed")
    env.reset(seed=1)
    scene = env.unwrapped.arrangement()
    for index in range(len(scene)):
        rest = scene.without(index)
        assert rest.objects == scene.objects[:index] + scene.objects[index + 1 :]
        assert len(rest.world_from_objects) == len(rest.meshes) == len(scene) - 1
    with pytest.raises(ConfigError, match="there is no object 3"):
        scene.without(3)


def test_neighbours_make_poses_infeasible() -> None:
    """A planner that knows a copy beside the object finds fewer feasible poses than one that does not."""
    env = clear(layout="packed", objects_per_scene=1)
    env.reset(seed=2)
    scene = env.unwrapped.arrangement()
    mesh, pose = scene.meshes[0], scene.world_from_objects[0]
    alone = graspbox.plan(mesh, hand="panda_gripper", world_from_object=pose)
    same = graspbox.plan(mesh, hand="panda_gripper", world_from_object=pose, neighbours=scene.without(0))
    assert (alone.feasible == same.feasible).all()
    beside = pose.copy()
    beside[0, 3] += 1.1 * np.ptp(mesh.bounds, axis=0).max()
    near = replace(scene, world_from_objects=beside[None])
    around = graspbox.plan(mesh, hand="panda_gripper", world_from_object=pose, neighbours=near)
    # The candidates are the same; their order is that of the ranking.
    assert 0 < around.feasible.sum() < alone.feasible.sum()
    assert len(around) == len(alone)


def test_the_keywords_of_scenes_are_listed() -> None:
    listed = {"layout", "objects_per_scene", "object_scale", "bin_size", "spread", "max_failures"}
    assert listed <= {field.name for field in fields(ClearConfig)}
