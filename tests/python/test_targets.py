"""A target among others in `GraspPose-v0` and `Grasp-v0`: its labels, infos, starts, copies, policies, and errors."""

import json
import multiprocessing
import os
import pickle
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

import graspbox
from acting import CAMERAS
from command_line import invoke
from graspbox.envs.coding import encode_action, object_pose
from graspbox.errors import ConfigError
from graspbox.evaluation import evaluate
from graspbox.policies import Task, load

POSE, LOOP, CLEAR = "graspbox/GraspPose-v0", "graspbox/Grasp-v0", "graspbox/Clear-v0"
OBJECTS = ("procedural:box:0-3", "procedural:can:0-3")
LAYOUTS = ("packed", "pile", "bin")
HAND = "panda_gripper"


def among(env_id: str = POSE, **settings: Any) -> Any:
    chosen = {"layout": "packed", "objects_per_scene": 4, "hand": HAND, **settings}
    return gymnasium.make(env_id, objects=OBJECTS, **chosen)


def many(env_id: str = POSE, num_envs: int = 3, **settings: Any) -> Any:
    chosen = {"layout": "pile", "objects_per_scene": (2, 4), "hand": HAND, **settings}
    return gymnasium.make_vec(env_id, num_envs, "vector_entry_point", objects=OBJECTS, **chosen)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("env_id", [POSE, LOOP])
def test_state_info_and_labels_are_about_the_target(env_id: str, layout: str) -> None:
    env = among(env_id, layout=layout, obs=("state", "segmentation", "points"), image_size=96)
    control, targets, shown = ("twist" if env_id == LOOP else "grasp_pose"), set(), 0
    for seed in range(6):
        seen, info = env.reset(seed=seed)
        scene = env.unwrapped.arrangement()
        targets.add(scene.target)
        pose = scene.world_from_objects[scene.target]
        np.testing.assert_allclose(object_pose(seen["state"], control=control, hand=HAND), pose, atol=1e-6)
        assert info["object"] == scene.meshes[scene.target].name
        assert (info["neighbours"], info["neighbours_moved"]) == (len(scene) - 1, 0)
        assert info["resting"] == -1
        # What has the label 2 lies on the target.
        camera = env.unwrapped.cameras()["front"][1]
        points = seen["points"].reshape(-1, 3) @ camera[:3, :3].T + camera[:3, 3]
        low, high = scene.meshes[scene.target].bounds
        here = (points - pose[:3, 3]) @ pose[:3, :3]
        inside = ((here > low - 2e-3) & (here < high + 2e-3)).all(axis=1)
        labels = seen["segmentation"].ravel()
        assert inside[labels == 2].all()
        shown += bool((labels == 2).any())
    assert len(targets) > 1
    assert shown >= 4


def test_a_single_object_is_the_default() -> None:
    for env_id in (POSE, LOOP):
        plain = gymnasium.make(env_id, objects=OBJECTS)
        single = gymnasium.make(env_id, objects=OBJECTS, layout="single")
        assert data_equivalence(plain.reset(seed=4), single.reset(seed=4), exact=True)
        assert "neighbours" not in plain.reset(seed=4)[1]


@pytest.mark.parametrize("env_id", [POSE, LOOP])
def test_states_continue_bit_for_bit_and_belong_to_their_layout(env_id: str) -> None:
    env = among(env_id, obs=("state", "proprio"), layout="pile")
    env.reset(seed=5)
    env.action_space.seed(3)
    actions = [env.action_space.sample() for _ in range(1 if env_id == POSE else 6)]
    state = env.unwrapped.get_state()
    expected = [env.step(action) for action in actions]
    other = pickle.loads(pickle.dumps(env)).unwrapped
    other.reset(seed=9)
    other.set_state(state)
    assert other.arrangement().target is not None
    assert data_equivalence([other.step(action) for action in actions], [(*x[:3], False, x[4]) for x in expected])
    for layout in ("single", "bin"):
        stranger = among(env_id, **({} if layout == "bin" else {"objects_per_scene": 5}), layout=layout)
        with pytest.raises(graspbox.GraspboxError):
            stranger.unwrapped.set_state(state)


@pytest.mark.parametrize("env_id", [POSE, LOOP])
def test_vector_environments_equal_single_ones(env_id: str) -> None:
    settings: dict[str, Any] = {"obs": ("state", "segmentation"), "randomization": "standard", "image_size": 32}
    threads = many(env_id, 12, num_threads=2, autoreset_mode=AutoresetMode.SAME_STEP, **settings)
    rows, infos = threads.reset(seed=11)
    threads.single_action_space.seed(1)
    action = threads.single_action_space.sample()
    batch = threads.step(np.tile(action, (12, 1)))
    for index in (0, 5, 11):
        single = among(env_id, layout="pile", objects_per_scene=(2, 4), **settings)
        seen, info = single.reset(seed=11 + index)
        assert all((seen[name] == rows[name][index]).all() for name in seen)
        assert (info["object"], info["neighbours"]) == (infos["object"][index], infos["neighbours"][index])
        _, reward, ended, _, last = single.step(action)
        final = batch[4].get("final_info", {}) if env_id == POSE else batch[4]
        assert (reward, ended) == (batch[1][index], batch[2][index])
        assert last["neighbours_moved"] == final["neighbours_moved"][index]


def test_an_attempt_is_about_the_target_alone() -> None:
    """The planner's grasp of a neighbour lifts it, and fails."""
    lifted = 0
    for seed in range(6):
        env = among(objects_per_scene=3)
        env.reset(seed=seed)
        scene = env.unwrapped.arrangement()
        for index in range(len(scene)):
            env.reset(seed=seed)
            pose, around = scene.world_from_objects[index], scene.without(index)
            plan = graspbox.plan(scene.meshes[index], hand=HAND, world_from_object=pose, neighbours=around).best(1)
            if not len(plan):
                continue
            info = env.step(encode_action(pose @ plan.poses[0], plan.preshape[0], hand=HAND))[4]
            after = env.unwrapped.arrangement().world_from_objects
            rose = after[index, 2, 3] - pose[2, 3] > 0.15
            if index != scene.target:
                assert not info["is_success"]
                assert not rose or info["neighbours_moved"] >= 1
                lifted += rose
            else:
                assert info["is_success"] <= rose
    assert lifted >= 3


def test_the_hand_pushes_neighbours_aside() -> None:
    """Of poses whose approach touches a neighbour some arrive, and move it."""
    env, tried = among(objects_per_scene=5), []
    for seed in range(8):
        env.reset(seed=seed)
        scene = env.unwrapped.arrangement()
        pose = scene.world_from_objects[scene.target]
        alone = graspbox.plan(scene.meshes[scene.target], hand=HAND, world_from_object=pose).best(30)
        filtered = graspbox.Scene.of(scene, hand=HAND)
        world_from_hands = pose @ alone.poses
        free = filtered.check(
            np.linalg.inv(filtered.world_from_object) @ world_from_hands, alone.preshape, clearance=0.0
        )
        for index in np.flatnonzero(~free)[:2]:
            env.reset(seed=seed)
            info = env.step(encode_action(world_from_hands[index], alone.preshape[index], hand=HAND))[4]
            tried.append((info["infeasible"], info["neighbours_moved"]))
    assert any(not infeasible and moved for infeasible, moved in tried), tried


def test_a_layout_without_a_target_is_cleared_and_a_single_object_too() -> None:
    env = gymnasium.make(CLEAR, objects=OBJECTS, hand=HAND, layout="single", obs="state")
    other = gymnasium.make(POSE, objects=OBJECTS, hand=HAND, obs="state")
    for options in (None, {"object": 2, "place": (0.02, 0.0, 0.5)}):
        state, info = env.reset(seed=3, options=options)
        again, single = other.reset(seed=3, options=options)
        assert (state == again).all()
        assert (info["object"], info["remaining"]) == (single["object"], 1)
    scene: Any = env.unwrapped
    mesh, pose = scene.arrangement().meshes[0], scene.arrangement().world_from_objects[0]
    assert scene.arrangement().target is None
    plan = graspbox.plan(mesh, hand=HAND, world_from_object=pose).best(1)
    _, reward, ended, _, info = env.step(encode_action(pose @ plan.poses[0], plan.preshape[0], hand=HAND))
    assert (info["attempts"], info["cleared"]) == (1, reward)
    assert ended == info["is_success"]


@pytest.mark.parametrize("env_id", [POSE, LOOP])
def test_the_planner_sees_the_neighbours(env_id: str) -> None:
    settings: dict[str, Any] = {"objects": OBJECTS, "layout": "packed", "hand": HAND, "objects_per_scene": 3}
    found = evaluate("planner", env_id, trials=8, seed=0, **settings)
    assert found.succeeded >= 5
    assert evaluate("planner", env_id, trials=8, seed=0, num_envs=3, **settings).trials == found.trials
    assert sum(count.trials for count in found.objects) == 8
    assert found.settings is not None
    assert found.settings["layout"] == "packed"


def test_evaluate_takes_a_layout_from_the_command_line(tmp_path: Path) -> None:
    out = tmp_path / "result.json"
    objects = [part for name in OBJECTS for part in ("--objects", name)]
    command = ["evaluate", "planner", *objects, "--hand", HAND, "--trials", "4", "--layout", "packed"]
    done = invoke([*command, "--objects-per-scene", "3", "--out", str(out)])
    assert done.exit_code == 0, done.output
    found = json.loads(out.read_text())
    kept = found["made"]["settings"]
    assert (kept["layout"], kept["objects_per_scene"]) == ("packed", 3)
    assert len(found["rows"]) == 4
    assert found["replays"] == [], "a replay holds a single object"
    wrong = invoke([*command, "--rerun", str(tmp_path / "a.rrd")])
    assert "--rerun records single objects" in str(wrong.exception)


def test_policies_that_cannot_see_a_scene_say_so() -> None:
    settings: dict[str, Any] = {"objects": OBJECTS, "layout": "packed", "trials": 1}
    with pytest.raises(ConfigError, match="layout is 'packed'"):
        evaluate("robust_oracle", POSE, **settings)
    env = among(obs="state")
    observation, info = env.reset(seed=0)
    policy = load("planner")
    policy.bind(replace(Task.of(env), scenes=None))
    policy.reset(0, info=info)
    with pytest.raises(ConfigError, match="sees no scene"):
        policy.act(observation[None])


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"layout": "heap"}, "layout is 'heap'; choose from single, packed"),
        ({"layout": "single", "objects_per_scene": 3}, "objects_per_scene is 3, but layout='single'"),
        ({"layout": "single", "object_scale": (0.5, 1.0), "objects_per_scene": 5}, "object_scale is"),
        ({"layout": "single", "spread": 0.5, "objects_per_scene": 5}, "spread is 0.5, but layout='single'"),
        ({"objects_per_scene": 41}, "objects_per_scene"),
        ({"max_failures": 3}, "no keyword 'max_failures'"),
    ],
)
@pytest.mark.parametrize("env_id", [POSE, LOOP])
def test_wrong_settings_are_refused(env_id: str, settings: dict[str, Any], why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        among(env_id, **settings)


def test_options_of_a_single_object_are_refused() -> None:
    env = among()
    for options in ({"object": 0}, {"resting": 0}, {"place": [0, 0, 0]}, {"world_from_object": np.eye(4).tolist()}):
        with pytest.raises(ConfigError, match="sampled as a whole"):
            env.reset(seed=0, options=options)
    seen, _ = env.reset(seed=0, options={"mass": 1.5, "friction": 0.5})
    assert seen[18] == pytest.approx(1.5 * env.reset(seed=0)[0][18])


def test_a_scene_without_an_object_keeps_its_target() -> None:
    env = among(objects_per_scene=4)
    env.reset(seed=0)
    scene = env.unwrapped.arrangement()
    assert scene.without(scene.target).target is None
    for index in set(range(len(scene))) - {scene.target}:
        rest = scene.without(index)
        assert rest.meshes[rest.target].name == scene.meshes[scene.target].name
        assert (rest.world_from_objects[rest.target] == scene.world_from_objects[scene.target]).all()


def test_pictures_show_the_neighbours() -> None:
    pictures = []
    for count in (1, 4):
        env = among(objects_per_scene=count, render_mode="rgb_array", cameras=CAMERAS)
        env.reset(seed=2)
        pictures.append(env.render())
    assert (pictures[0] != pictures[1]).any()


def rollout(monkeypatch: pytest.MonkeyPatch, cache: str, threads: int, pause: float) -> tuple[list[Any], Any]:
    """Observations and environments after four episodes of one decision each, and the resets between them."""
    monkeypatch.setenv("GRASPBOX_CACHE", cache)
    env = many(num_threads=threads)
    seen = [env.reset(seed=2)[0]]
    for action in np.random.default_rng(0).uniform(-1, 1, (8, *env.action_space.shape)).astype(np.float32):
        time.sleep(pause)
        seen.append(env.step(action)[0])
    return seen, env


def test_scenes_have_equal_bits_however_they_are_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Made when they are needed, in the background, or read from the cache, on any number of threads."""
    now, env = rollout(monkeypatch, "", 1, 0.0)
    env.close()
    cache = str(tmp_path / "cache")
    for threads, pause in ((2, 0.3), (1, 0.0)):
        again, env = rollout(monkeypatch, cache, threads, pause)
        env.close()
        assert data_equivalence(again, now, exact=True)
    assert list((tmp_path / "cache" / "scenes").glob("*.scene"))


def test_a_forked_child_makes_its_own_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is forked while the background thread makes the scene that its own environment of the same objects needs."""
    monkeypatch.setenv("GRASPBOX_CACHE", "")

    def third(between: Any) -> Any:
        env = gymnasium.make(CLEAR, objects=OBJECTS, layout="pile", objects_per_scene=8, hand=HAND)
        env.reset(seed=1)
        env.reset()
        between()
        return env.reset()[0]

    context = multiprocessing.get_context("fork")
    answers = context.SimpleQueue()
    child = context.Process(target=lambda: answers.put(third(lambda: None)))
    own = third(child.start)
    child.join(60)
    child.kill()
    assert child.exitcode == 0, "the child failed, or waits for a thread that it does not have"
    assert data_equivalence(answers.get(), own, exact=True)


def test_a_process_ends_while_a_scene_is_made() -> None:
    program = (
        "import gymnasium, graspbox.envs\n"
        f"env = gymnasium.make_vec({CLEAR!r}, 4, 'vector_entry_point', objects={OBJECTS!r}, layout='pile',"
        f" objects_per_scene=12, hand={HAND!r})\n"
        "env.reset(seed=0)\n"
        "print('reset')\n"
    )
    environment = {**os.environ, "GRASPBOX_CACHE": ""}
    ended = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "reset\n", "")
