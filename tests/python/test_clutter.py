"""Policies, rounds, training scenes and the benchmark of scenes of several objects."""

import json
import pickle
import subprocess
import sys
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
from graspbox import object_sets, policies
from graspbox.configs import PhysicsConfig
from graspbox.envs.coding import codec, encode_action
from graspbox.errors import ConfigError, SimulationError
from graspbox.evaluation.rounds import Rounds, clear_rounds
from graspbox.hands import load_hand
from graspbox.learn.models.cluttered import is_scene, read_scene, write_scene
from graspbox.learn.models.scene_trials import render_scene, source_of
from graspbox.learn.models.scene_views import SceneViews
from graspbox.learn.models.scenes import COUNTS, PlacedObjects, SceneConfig, SceneSampler
from graspbox.perception.configs import CropConfig, DepthNoise
from graspbox.perception.finder import GraspFinder
from graspbox.policies.clutter import _down_at
from graspbox.simulation.layouts import bin_points, draw_objects, objects_that_fit, scaled

OBJECTS = ("procedural:box:0-3", "procedural:can:0-3")
HAND = "panda_gripper"
#: Everything on the table counts as one object.
WIDE = SceneConfig(crop=CropConfig(gap=0.5))


def command(*arguments: str) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, "-m", "graspbox", *arguments]
    return subprocess.run(program, capture_output=True, text=True, timeout=300)


def scene(count: int = 3, layout: Any = "packed", seed: int = 3) -> graspbox.Arrangement:
    specs = list(object_sets.load(OBJECTS))
    return graspbox.arrange(
        [spec.load() for spec in draw_objects(specs, count, layout, seed)], layout, seed=seed, hand=HAND
    )


def test_rounds_are_counted_and_repeat() -> None:
    settings: dict[str, Any] = {"objects": OBJECTS, "layout": "packed", "hand": HAND, "objects_per_scene": 3}
    seen: list[int] = []
    rounds = clear_rounds("scene_planner", rounds=4, progress=seen.append, **settings)
    assert seen == [1, 2, 3, 4]
    assert (rounds.cleared + rounds.lost <= rounds.begun).all()
    assert rounds.successes.sum() + sum(rounds.failures.values()) == rounds.attempts.sum()
    assert rounds.cleared_share > 0.7, "a planner that knows the meshes clears boxes and cans"
    again = clear_rounds("scene_planner", rounds=2, seed=2, **settings)
    assert (again.attempts == rounds.attempts[2:]).all()
    first = clear_rounds("scene_planner", rounds=2, **settings)
    joined = Rounds.joined([first, again])
    assert joined.to_json() == rounds.to_json()
    low, high = joined.to_json()["success_interval"]
    assert low < joined.success_rate <= high


def test_rounds_end_with_the_budget_and_refuse_nonsense() -> None:
    settings: dict[str, Any] = {"objects": OBJECTS, "hand": HAND, "rounds": 1}
    found = clear_rounds("scene_planner", layout="packed", max_attempts=2, **settings)
    assert found.attempts.tolist() == [2]
    assert clear_rounds("random", layout="packed", max_failures=5, **settings).attempts.tolist() == [5]
    with pytest.raises(ConfigError, match="no round was finished"):
        clear_rounds("random", stop=lambda: True, **settings)
    with pytest.raises(ConfigError, match="there are no rounds"):
        Rounds.joined([])
    with pytest.raises(ConfigError, match="graspbox/Clear-v0"):
        graspbox.evaluation.evaluate("scene_planner", trials=1, objects=OBJECTS)


class Scripted(policies.Policy):
    """Makes attempts that fail, and looks that find no grasp where its script has an x."""

    name = "scripted"

    def __init__(self, script: str) -> None:
        self.script, self.looks = script, 0

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        self.looks = 0

    def act(self, observation: Any) -> policies.Actions:
        """Give zeros."""
        self.looks += 1
        return self._zeros()

    def found_nothing(self, env: int) -> bool:
        """Read the script."""
        return self.script[self.looks - 1] == "x"


@pytest.mark.parametrize(
    ("script", "most", "attempts", "looks", "no_grasp"),
    [
        ("x", None, 0, 1, 1),
        (".x", None, 1, 2, 1),
        ("..", None, 2, 2, 0),
        ("x", 1, 0, 1, 1),
        ("xxx", 3, 0, 3, 1),
        ("x.x.", 4, 2, 4, 0),
        ("..xx", 4, 2, 4, 1),
    ],
)
def test_a_look_without_a_grasp_is_no_attempt(
    script: str, most: int | None, attempts: int, looks: int, no_grasp: int
) -> None:
    """After VGN it ends the round; where more failures in a row are allowed, it is one of them."""
    seen: list[Any] = []
    settings: dict[str, Any] = {} if most is None else {"max_failures": most}
    policy = Scripted(script)
    found = clear_rounds(
        policy, objects=OBJECTS, layout="packed", hand=HAND, rounds=2, witness=lambda *all: seen.append(all), **settings
    )
    assert found.attempts.tolist() == [attempts, attempts]
    assert found.no_grasp.tolist() == [no_grasp, no_grasp]
    assert policy.looks == looks
    assert len(seen) == sum(found.failures.values()) == 2 * attempts
    assert Rounds.joined([found, found]).to_json()["no_grasp"] == 4 * no_grasp
    assert f"{2 * no_grasp} of 2 rounds end as no grasp is found" in str(found)


class Blinking(policies.ScenePlanner):
    """Finds no grasp at every second look."""

    looks = 0

    def _best(self, scene: graspbox.Arrangement, tried: Any) -> Any:
        self.looks += 1
        return None if self.looks % 2 else super()._best(scene, tried)


def test_failures_in_a_row_end_with_a_success() -> None:
    settings: dict[str, Any] = {"objects": OBJECTS[1], "layout": "packed", "hand": HAND, "rounds": 1}
    blinking = Blinking()
    found, all_seen = clear_rounds(blinking, max_failures=3, **settings), clear_rounds("scene_planner", **settings)
    assert found.successes.sum() > 3
    assert blinking.looks == 2 * found.attempts.sum()
    assert found.to_json() == all_seen.to_json()
    assert found.no_grasp.sum() == 0
    assert clear_rounds(Blinking(), **settings).attempts.tolist() == [0]


def test_straight_down_at_one_of_several_tops_of_equal_height() -> None:
    """Not between them, where nothing is."""
    square = np.stack(np.meshgrid(np.linspace(-0.01, 0.01, 9), np.linspace(-0.02, 0.02, 9)), axis=-1).reshape(-1, 2)
    middles = np.array([[-0.1, 0.0], [0.1, 0.02]])
    points = np.concatenate([np.append(square + middle, np.full((len(square), 1), 0.08), axis=1) for middle in middles])
    hand = load_hand(HAND)
    pose = _down_at(points, hand)
    closes = (pose @ np.append(hand.closing_center(hand.preshape_limits[0]), 1.0))[:2]
    assert np.linalg.norm(middles - closes, axis=1).min() < 1e-6


@pytest.mark.parametrize("name", ["top_down", "partial_view_planner", "best_proposal"])
def test_policies_tell_where_they_find_no_grasp(name: str) -> None:
    env: Any = gymnasium.make(
        "graspbox/Clear-v0", objects="procedural:can:0", hand=HAND, obs=("depth", "proprio"), image_size=128
    )
    policy = policies.load(name)
    with env:
        policy.bind(policies.Task.of(env))
        observation, info = env.reset(seed=2)
        policy.reset(2, info=info)
        assert not policy.found_nothing(0), "it has not looked"
        batch = {name: values[None] for name, values in observation.items()}
        unseen = {**batch, "depth": np.zeros_like(batch["depth"])}
        for images, found in ((unseen, False), (batch, True), (unseen, False)):
            assert policy.act(images).any() == found
            assert policy.found_nothing(0) != found


def test_baselines_act_on_images_alone() -> None:
    """Cans no wider than half the gripper stand alone: from above they can all be lifted."""
    settings: dict[str, Any] = {"objects": "procedural:can:0-9", "hand": HAND, "layout": "packed", "rounds": 3}
    thin = clear_rounds("top_down", objects_per_scene=1, object_scale=(0.5, 0.6), image_size=128, **settings)
    assert thin.success_rate == 1.0
    planned = clear_rounds("partial_view_planner", objects_per_scene=2, object_scale=(0.5, 0.6), **settings)
    assert planned.successes.sum() >= 1


def test_objects_that_were_learned_from_are_left_out() -> None:
    policy = policies.load("scene_planner")
    policy.learned_from = (OBJECTS[0],)
    settings: dict[str, Any] = {"layout": "packed", "hand": HAND, "rounds": 1}
    found = clear_rounds(policy, objects=OBJECTS, **settings)
    assert found.left_out == len(object_sets.load(OBJECTS[0])) > 0
    assert found.to_json()["objects_left_out"] == found.left_out
    with pytest.raises(ConfigError, match="learned from all objects"):
        clear_rounds(policy, objects=OBJECTS[0], **settings)


@pytest.mark.parametrize("seed", [10, 30])
def test_a_scene_planner_pushes_neighbours_that_give_way(seed: int) -> None:
    """Its first choice in these piles touches a neighbour: it is ranked by its press, and succeeds."""
    env = gymnasium.make("graspbox/Clear-v0", objects=OBJECTS, layout="pile", hand=HAND)
    policy = policies.load("scene_planner")
    policy.bind(policies.Task.of(env))
    env.reset(seed=seed)
    scene: graspbox.Arrangement = env.unwrapped.arrangement()  # type: ignore[attr-defined]
    action = policy.act(None)[0]

    def chosen(max_press: float) -> tuple[graspbox.Grasp, Any]:
        placed = enumerate(zip(scene.meshes, scene.world_from_objects, strict=True))
        settings: dict[str, Any] = {"hand": HAND, "max_press": max_press}
        plans = [
            (graspbox.plan(mesh, world_from_object=rest, neighbours=scene.without(index), **settings)[0], rest)
            for index, (mesh, rest) in placed
        ]
        return max(plans, key=lambda found: found[0].score if found[0].feasible else -np.inf)

    grasp, rest = chosen(0.005)
    assert grasp.touch > 0.01
    assert grasp.press < 1e-4
    np.testing.assert_array_equal(action, encode_action(rest @ grasp.pose, grasp.preshape, hand=HAND))
    refused, _ = chosen(0.0)
    assert (refused.touch, refused.press) == (0.0, 0.0)
    assert refused.score < grasp.score
    assert env.step(action)[-1]["is_success"]


def test_a_scene_planner_tries_another_grasp() -> None:
    """In a scene that did not change it does not repeat itself, until the next episode."""
    env = gymnasium.make("graspbox/Clear-v0", objects=OBJECTS, layout="packed", hand=HAND)
    policy = policies.load("scene_planner")
    policy.bind(policies.Task.of(env))
    _, info = env.reset(seed=3)
    policy.reset(3, info=info)
    decode = codec("grasp_pose", HAND).decode_grasp
    poses = [decode(policy.act(None)[0])[0] for _ in range(4)]
    for one, other in combinations(poses, 2):
        turn = (np.trace(one[:3, :3].T @ other[:3, :3]) - 1.0) / 2.0
        assert np.linalg.norm(one[:3, 3] - other[:3, 3]) > 0.0099 or turn < np.cos(0.199)
    policy.reset(3, info=info)
    np.testing.assert_array_equal(decode(policy.act(None)[0])[0], poses[0])


def test_a_scene_planner_needs_a_scene() -> None:
    policy = policies.load("scene_planner")
    assert isinstance(policy, policies.ScenePlanner)
    env = gymnasium.make("graspbox/Clear-v0", objects=OBJECTS, layout="packed")
    policy.bind(replace(policies.Task.of(env), scenes=None))
    with pytest.raises(ConfigError, match="sees no scene"):
        policy.act(None)
    with pytest.raises(ConfigError, match="use 'scene_planner'"):
        clear_rounds("planner", objects=OBJECTS, rounds=1, obs="state")


def test_scenes_are_written_and_read() -> None:
    found = scene()
    names = [mesh.name for mesh in found.meshes]
    sources = [f"procedural:{name.rpartition('-')[0]}:{int(name.rpartition('-')[2])}" for name in names]
    text = write_scene(found, sources, [0.75] * len(names))
    assert is_scene(text)
    assert not is_scene(sources[0])
    read = read_scene(text)
    np.testing.assert_allclose(read.world_from_objects, found.world_from_objects, atol=2e-7)
    for mesh, source in zip(read.meshes, sources, strict=True):
        whole = object_sets.load(source)[0].load()
        np.testing.assert_allclose(mesh.vertices, 0.75 * whole.vertices, atol=1e-12)
        assert mesh.mass == pytest.approx(0.75**3 * whole.mass)


def test_walls_of_a_bin_are_written_and_read_and_are_no_objects() -> None:
    specs = object_sets.load(OBJECTS)[:3]
    found = graspbox.arrange([spec.load() for spec in specs], "bin", seed=3, hand=HAND)
    sources = [source_of(specs[i]) for i in found.objects]
    read = read_scene(write_scene(found, sources, [1.0] * len(sources)))
    assert len(read.wall_half_extents) == len(found.wall_half_extents) == 4
    np.testing.assert_allclose(read.wall_half_extents, found.wall_half_extents, atol=2e-6)
    np.testing.assert_allclose(read.world_from_walls, found.world_from_walls, atol=2e-7)
    crops = read.render(WIDE, [1], 1)
    bare = replace(read, world_from_walls=np.zeros((0, 4, 4)), wall_half_extents=np.zeros((0, 3)))
    assert crops.object.sum() > 1.2 * bare.render(WIDE, [1], 1).object.sum(), "walls are seen"
    np.testing.assert_array_equal(read.occupancy(crops, WIDE.crop), bare.occupancy(crops, WIDE.crop))


def test_objects_that_fit_are_those_that_the_hand_spans() -> None:
    """Boxes stand on their base in packed scenes, and lie on any face in piles."""
    boxes, widest = object_sets.load("procedural:box:0-19"), graspbox.load_hand(HAND).widest
    packed = objects_that_fit(boxes, "packed", HAND)
    for spec in boxes:
        width = 0.9 * np.ptp(spec.load().vertices[:, :2], axis=0).min()
        assert (spec.name in packed.names) == (width <= widest)
    piled = objects_that_fit(boxes, "pile", HAND)
    assert 0 < len(packed) < len(boxes)
    assert 0 < len(piled) < len(boxes)
    for spec in piled:
        assert np.ptp(spec.load().vertices, axis=0).min() <= widest, "some side is spanned"
    assert len(objects_that_fit(boxes, "pile", "reflex")) == len(boxes), "nothing is too wide for this hand"
    found = clear_rounds("random", objects="procedural:box:0-19", layout="packed", rounds=1, hand=HAND)
    assert found.too_wide == found.to_json()["objects_too_wide"] == len(boxes) - len(packed)
    huge = object_sets.load("procedural:box:0-3", scale=4.0)
    with pytest.raises(ConfigError, match=r"none of 4 objects .* fits the hand; name smaller ones"):
        clear_rounds("random", objects=huge, layout="packed", rounds=1, hand=HAND)


def test_scaled_objects_equal_those_of_a_scaled_set() -> None:
    spec = object_sets.load("procedural:mug:3")[0]
    one, other = spec.load().scaled(0.8, None), scaled(spec, 0.8).load()
    np.testing.assert_allclose(np.sort(one.bounds), np.sort(other.bounds), atol=1e-9)
    assert one.mass == pytest.approx(other.mass, rel=1e-6)
    with pytest.raises(ConfigError, match="`scale` is 0"):
        spec.load().scaled(0.0, None)


def test_a_view_of_several_objects_sees_them_all() -> None:
    found = scene()
    placed = PlacedObjects.of(found)
    target = placed.middle
    seen = graspbox.views(
        found.meshes[0],
        world_from_object=found.world_from_objects[0],
        neighbours=placed.others(),
        target=target,
        count=4,
        images="segmentation",
    )
    assert seen.segmentation is not None
    assert set(range(2, 2 + len(found))) <= set(np.unique(seen.segmentation).tolist())
    alone = graspbox.views(found.meshes[0], world_from_object=found.world_from_objects[0], target=target, count=4)
    assert (alone.depth >= seen.depth - 1e-6).all(), "neighbours only hide"


def test_a_crop_of_a_scene_holds_every_object() -> None:
    found = scene()
    placed = PlacedObjects.of(found)
    quiet = replace(WIDE, noise=DepthNoise(0.0, 0.0, 0.0, 0.0))
    wide, one = placed.render(quiet, [1], 1), placed.render(replace(quiet, crop=CropConfig(gap=0.0)), [1], 1)
    assert wide.object.sum() > one.object.sum(), "without a gap only the largest group is an object"
    solid, alone = (
        placed.occupancy(wide, WIDE.crop),
        replace(placed, meshes=found.meshes[:1], world_from_objects=found.world_from_objects[:1]),
    )
    filled = (solid >= 128).sum()
    assert filled > (alone.occupancy(wide, WIDE.crop) >= 128).sum()
    volume = sum(mesh.volume for mesh in found.meshes)
    assert filled * WIDE.crop.voxel_size**3 == pytest.approx(volume, rel=0.25)


@pytest.mark.parametrize("layout", ["packed", "pile", "bin"])
def test_training_scenes_are_simulated_and_rendered_again(layout: Any) -> None:
    sampler = SceneSampler(object_sets.load(OBJECTS), WIDE, 0, (layout, "single"))
    hand, counts = graspbox.load_hand(HAND), set()
    for number in range(0, 8, 2):
        found = render_scene(sampler, number, np.random.default_rng(number), hand)
        again = render_scene(sampler, number, np.random.default_rng(number), hand)
        assert found.source == again.source
        assert is_scene(found.source)
        counts.add(len(found.objects.meshes))
        assert found.scene is not None
        assert found.crops is not None
        views = SceneViews(WIDE)
        seen = views.get(found.source, found.world_from_object, 0)
        assert seen is not None
        # Crops differ in what they cut off, most of all where they hold a bin.
        share = {"packed": 0.1, "pile": 0.15, "bin": 0.3}[layout]
        assert (seen[0][0] >= 128).sum() == pytest.approx((found.true_occupancy(seen[0]) >= 128).sum(), rel=share)
    assert len(counts) > 1
    assert max(counts) <= COUNTS[layout][1]
    single = render_scene(sampler, 1, np.random.default_rng(1), hand)
    assert not is_scene(single.source)
    fine = SceneSampler(sampler.objects, WIDE, 0, (layout, "single"), PhysicsConfig(dt=0.001))
    for number in (0, 1):
        found = render_scene(fine, number, np.random.default_rng(number), hand)
        assert found.scene is not None
        assert found.scene.physics.dt == 0.001


def test_a_trial_succeeds_with_any_object() -> None:
    """Poses are in the frame of the highest object; a trial on another one counts as well."""
    found = scene()
    simulated = graspbox.Scene.of(found, hand=HAND)
    highest = simulated.world_from_object
    succeeded = []
    for index, (mesh, pose) in enumerate(zip(found.meshes, found.world_from_objects, strict=True)):
        plan = graspbox.plan(mesh, hand=HAND, world_from_object=pose, neighbours=found.without(index)).best(2)
        outcomes = simulated.simulate(np.linalg.inv(highest) @ pose @ plan.poses, plan.preshape)
        succeeded.append(bool(outcomes.success.any()))
    assert sum(succeeded) >= 2
    copy = pickle.loads(pickle.dumps(simulated))
    assert (copy.world_from_object == highest).all()
    with pytest.raises(graspbox.errors.SimulationError):
        graspbox.Scene.of(PlacedObjects((), np.zeros((0, 4, 4))), hand=HAND)


def test_a_list_of_meshes_is_a_scene_of_several() -> None:
    """It is the scene of their arrangement, bit for bit, also after pickling."""
    meshes = [object_sets.load("procedural:box:0-1")[index].load() for index in (0, 1)]
    scene = graspbox.Scene(meshes, layout="bin", seed=3, hand=HAND)
    same = graspbox.Scene.of(graspbox.arrange(meshes, "bin", seed=3, hand=HAND), hand=HAND)
    for other in (same, pickle.loads(pickle.dumps(scene))):
        assert [mesh.name for mesh in other.others] == [mesh.name for mesh in scene.others]
        np.testing.assert_array_equal(other.world_from_object, scene.world_from_object)
        np.testing.assert_array_equal(other.world_from_others, scene.world_from_others)
        np.testing.assert_array_equal(other.world_from_walls, scene.world_from_walls)
    assert len(scene.others) == 1
    packed = graspbox.Scene(meshes, hand=HAND)
    assert len(packed.world_from_walls) == 0
    with pytest.raises(ConfigError, match=r"world_from_object is the pose of one mesh; give Scene\.of several"):
        graspbox.Scene(meshes, world_from_object=np.eye(4))
    with pytest.raises(ConfigError, match="layout is 'pile' for a single mesh; give a list of meshes"):
        graspbox.Scene(meshes[0], layout="pile")
    with pytest.raises(ConfigError, match="heap"):
        graspbox.Scene(meshes, layout="heap")  # type: ignore[arg-type]
    with pytest.raises(SimulationError):
        graspbox.Scene([])


def test_the_command_writes_what_it_prints(tmp_path: Path) -> None:
    out = tmp_path / "clutter.json"
    arguments = ["benchmark", "clutter", "random", "--hand", HAND, "--rounds", "1", "--seed", "0", "--layout", "pile"]
    done = command(*arguments, "--objects", OBJECTS[1], "--out", str(out), "--json")
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(done.stdout)
    assert json.loads(out.read_text()) == [row]
    assert (row["policy"], row["hand"], row["layout"], row["rounds"]) == ("random", HAND, "pile", 1)
    above = command(*arguments, "--camera", "overhead", "--max-failures", "3", "--json")
    assert json.loads(above.stdout)[0]["attempts"] == 3, above.stderr
    wrong = command("benchmark", "clutter", "random", "--camera", "palm")
    assert wrong.returncode == 2
    assert "'palm' is not one of 'front', 'overhead'" in " ".join(wrong.stderr.replace("│", " ").split())
    wrong = command("benchmark", "clutter", "random", "--layout", "heap")
    assert wrong.returncode in (1, 2)
    assert "layout is 'heap'" in wrong.stderr


def test_a_policy_knows_where_the_bin_stands() -> None:
    """Of the decisions in the same narrow bins, more touch the walls where the policy is not told of them."""
    size = (0.2, 0.16, 0.14)
    wide: dict[str, Any] = {"layout": "bin", "bin_size": size, "objects_per_scene": 3, "image_size": 128}
    env: Any = gymnasium.make("graspbox/Clear-v0", objects=OBJECTS, hand=HAND, obs=("depth", "proprio"), **wide)
    policy = policies.load("policies/panda_clutter")
    assert isinstance(policy, policies.DepthPolicy)
    with env:
        task = policies.Task.of(env)
        assert task.bin_size == size
        touching = []
        for known in (task, replace(task, bin_size=None)):
            policy.bind(known)
            assert isinstance(policy.finder, GraspFinder)
            met = 0
            for seed in range(40):
                observation, info = env.reset(seed=seed)
                policy.reset(seed, info=info)
                policy.act({name: values[None] for name, values in observation.items()})
                (found,) = policy.found
                assert found is not None
                frame = found.world_from_crop
                walls = (bin_points(size) - frame[:3, 3]) @ frame[:3, :3]
                nothing, pose = np.zeros_like(found.occupancy), found.poses[[found.chosen]]
                free, _ = policy.finder.grid.meets(nothing, pose, [found.preshape], obstacles=walls)
                met += int(not free[0])
            touching.append(met)
    assert touching[0] < touching[1], touching


def test_touches_are_measured() -> None:
    """The grasps of the table by press are all that touch; without any object there is an error."""
    script = Path(__file__).parents[2] / "scripts" / "measure_touches.py"
    arguments = [sys.executable, str(script), "--layout", "packed", "--seed", "4"]
    run = partial(subprocess.run, capture_output=True, text=True, timeout=300)
    found = run([*arguments, "--scenes", "2", "--objects", *OBJECTS])
    assert found.returncode == 0, found.stderr
    head, *lines = found.stdout.splitlines()
    assert 0 < int(head.split()[0]) <= 20
    assert lines[0] == "press, of all that touch"
    end = lines.index("touch, of those that push sideways")
    assert 0 < sum(int(line.split(": ")[1].split()[0]) for line in lines[1:end]) <= 60
    none = run([*arguments, "--scenes", "0"])
    assert (none.returncode, none.stdout) == (2, "")
    assert "no grasp has a score above 6" in none.stderr
