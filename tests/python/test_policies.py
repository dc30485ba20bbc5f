"""`graspbox.policies`: every baseline acts in its environments, and the same in every row of any number of them."""

import doctest
import subprocess
import sys
from typing import Any

import gymnasium
import numpy as np
import pytest

import graspbox
from graspbox import policies
from graspbox.envs import SINGLE_OBJECT_IDS
from graspbox.envs.coding import encode_action, object_pose
from graspbox.envs.grasp_pose import GraspPoseVectorEnv
from graspbox.errors import ConfigError
from graspbox.policies import Policy, Task

POSE, LOOP = SINGLE_OBJECT_IDS
CANS = "procedural:can:0-3"


def make(env_id: str, num_envs: int, **settings: Any) -> Any:
    return gymnasium.make_vec(env_id, num_envs=num_envs, **{"objects": CANS, "autoreset_mode": "Disabled", **settings})


def bound(name: str, envs: Any) -> Policy:
    policy = policies.load(name)
    policy.bind(Task.of(envs))
    return policy


def test_the_names_are_those_that_load_takes() -> None:
    single = ("random", "zero", "planner", "expert", "partial_view_planner", "best_proposal")
    assert policies.names() == (*single, "top_down", "scene_planner", "robust_oracle")
    for name in policies.names():
        assert policies.load(name).name == name
    # Recorded demonstrations and runs hold the name of before.
    with pytest.raises(ConfigError, match="no policy 'plannr'; did you mean 'planner'\\? choose from random, zero, pl"):
        policies.load("plannr")


def test_the_example_of_the_module_runs() -> None:
    result = doctest.testmod(policies)
    assert result.attempted > 5
    assert result.failed == 0


def test_policies_need_no_torch() -> None:
    """Not even where it is installed; nor does the import of graspbox load them."""
    code = (
        "import sys, graspbox; assert 'graspbox.policies' not in sys.modules\n"
        "graspbox.policies.load('planner'), graspbox.evaluation\n"
        "sys.exit('torch' in sys.modules or 'matplotlib' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", ["random", "planner"])
def test_a_row_does_not_depend_on_its_neighbours(name: str) -> None:
    """The third of three environments, and one alone with its seed, get the same actions to the bit."""
    three, one = make(POSE, 3), make(POSE, 1)
    rows = []
    for envs, seed in ((three, [5, 6, 7]), (one, [7])):
        policy = bound(name, envs)
        observation, info = envs.reset(seed=seed)
        policy.reset(seed, info=info)
        rows.append(policy.act(observation)[-1])
    np.testing.assert_array_equal(rows[0], rows[1])
    assert np.abs(rows[0]).max() > 0


def test_random_actions_fill_the_space_and_follow_their_seed() -> None:
    envs = make(POSE, 4)
    policy = bound("random", envs)
    policy.reset(3)
    drawn = np.stack([policy.act(None) for _ in range(500)])
    assert drawn.dtype == np.float32
    assert drawn.min(axis=(0, 1)) == pytest.approx(-np.ones(10), abs=0.01)
    assert drawn.max(axis=(0, 1)) == pytest.approx(np.ones(10), abs=0.01)
    assert abs(drawn.mean()) < 0.02
    # Only the environments that begin an episode with a seed sample anew.
    policy.reset(3, mask=np.array([True, False, False, True]))
    again = policy.act(None)
    np.testing.assert_array_equal(again[[0, 3]], drawn[0, [0, 3]])
    assert (again[[1, 2]] != drawn[0, [1, 2]]).any(axis=1).all()


def test_the_planner_decides_once_an_episode_as_the_planner_itself() -> None:
    envs = make(POSE, 2)
    policy = bound("planner", envs)
    observation, info = envs.reset(seed=1)
    policy.reset(info=info)
    actions = policy.act(observation)
    for env in range(2):
        mesh = envs.objects[envs.objects.names.index(info["object"][env])].load()
        world_from_object = object_pose(observation[env])
        best = graspbox.plan(mesh, world_from_object=world_from_object)
        wanted = encode_action(world_from_object @ best.poses[0], best.preshape[0])
        np.testing.assert_array_equal(actions[env], wanted)
    # The next episode of one environment alone is planned for.
    mask = np.array([False, True])
    observation, info = envs.reset(seed=[None, 9], options={"reset_mask": mask})
    policy.reset(mask=mask, info=info)
    actions = policy.act(observation)
    assert not actions[0].any()
    assert actions[1].any()


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"control_freq": 20, "max_episode_steps": 200},
        {"control": "delta_pose", "control_freq": 10, "max_episode_steps": 100},
        {"control": "target_pose", "fingers": "each"},
    ],
)
@pytest.mark.parametrize("name", ["planner", "expert"])
def test_the_closed_loop_is_solved_in_every_control_mode(name: str, settings: dict[str, Any]) -> None:
    """Rows begin again where their episodes end: with autoreset in the same step."""
    envs = make(LOOP, 2, autoreset_mode="SameStep", obs=("state", "proprio"), **settings)
    policy = bound(name, envs)
    observation, info = envs.reset(seed=0)
    policy.reset(info=info)
    ended, succeeded = 0, 0
    while ended < 4:
        observation, _, terminated, truncated, info = envs.step(policy.act(observation))
        done = terminated | truncated
        if done.any():
            policy.reset(mask=done, info=info)
            ended += int(done.sum())
            succeeded += int(info["final_info"]["is_success"][done].sum())
    assert succeeded >= ended - 1


def test_the_expert_moves_less_than_the_planner() -> None:
    """Of the best poses it takes the nearest one, so its episodes are shorter."""
    steps = {}
    for name in ("planner", "expert"):
        result = graspbox.evaluation.evaluate(name, LOOP, CANS, trials=6, seed=2)
        steps[name] = np.mean([trial.steps for trial in result.trials if trial.success])
    assert steps["expert"] < steps["planner"] - 5


def test_one_environment_is_one_row() -> None:
    env = gymnasium.make(POSE, objects="procedural:can:0")
    policy = policies.load("planner")
    policy.bind(Task.of(env))
    observation, info = env.reset(seed=0)
    policy.reset(0, info=info)
    assert env.step(policy.act(observation[None])[0])[4]["is_success"]


def test_numeric_infos_name_objects_too() -> None:
    actions = []
    for kind in ("full", "numeric"):
        envs = make(POSE, 2, info=kind)
        policy = bound("planner", envs)
        observation, info = envs.reset(seed=4)
        policy.reset(info=info)
        actions.append(policy.act(observation))
    np.testing.assert_array_equal(actions[0], actions[1])


def test_objects_without_a_feasible_pose_get_zeros(monkeypatch: pytest.MonkeyPatch) -> None:
    from graspbox import planning

    plan = planning.plan

    def nothing(*args: Any, **kwargs: Any) -> Any:
        found = plan(*args, **kwargs)
        found.feasible[:] = False
        return found

    monkeypatch.setattr(planning, "plan", nothing)
    for env_id in SINGLE_OBJECT_IDS:
        envs = make(env_id, 1)
        policy = bound("planner", envs)
        observation, info = envs.reset(seed=0)
        policy.reset(info=info)
        assert not policy.act(observation).any()


def test_a_policy_of_ones_own_takes_rows_and_seeds() -> None:
    seen: list[tuple[int, int | None, str]] = []

    class Mine(Policy):
        name = "mine"

        def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
            seen.append((env, seed, info["object"]))

        def act(self, observation: Any) -> policies.Actions:
            return -np.ones((self.task.num_envs, 10), dtype=np.float32)

    envs = make(POSE, 3, objects="procedural:can:2")
    policy = Mine()
    policy.bind(Task.of(envs))
    _, info = envs.reset(seed=0)
    policy.reset(10, info=info)
    policy.reset(mask=np.array([False, False, True]), info=info)
    assert seen == [(0, 10, "can-000002"), (1, 11, "can-000002"), (2, 12, "can-000002"), (2, None, "can-000002")]


def test_a_task_says_what_the_environments_are() -> None:
    envs = make(LOOP, 2, control="delta_pose", fingers="each", control_freq=10, obs=("state", "tactile"), split="train")
    task = Task.of(envs)
    assert (task.env_id, task.num_envs, task.control, task.fingers) == (LOOP, 2, "delta_pose", "each")
    assert task.control_freq == 10
    assert task.obs == ("state", "tactile")
    assert task.objects.names == envs.objects.names
    assert task.action_space == envs.single_action_space


@pytest.mark.parametrize(
    ("name", "env_id", "settings", "message"),
    [
        ("expert", POSE, {}, "acts in graspbox/Grasp-v0"),
        ("planner", LOOP, {"obs": "proprio"}, "needs obs='state'; the environments have obs='proprio'"),
        ("planner", POSE, {"obs": ("proprio", "tactile")}, "needs obs='state'"),
    ],
)
def test_where_a_policy_cannot_act_it_says_so(name: str, env_id: str, settings: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        bound(name, make(env_id, 1, **settings))


def test_wrong_calls_are_explained() -> None:
    with pytest.raises(ConfigError, match="'zero' is not bound to environments"):
        policies.load("zero").reset(0)
    with pytest.raises(ConfigError, match="id 'CartPole-v1'"):
        Task.of(gymnasium.make("CartPole-v1"))
    with pytest.raises(ConfigError, match="no registered id"):
        Task.of(GraspPoseVectorEnv(2, CANS))
    policy = bound("planner", make(POSE, 2))
    with pytest.raises(ConfigError, match="3 seeds; pass one for each of the 2"):
        policy.reset([1, 2, 3])
    with pytest.raises(ConfigError, match=r"mask is .*pass an array of 2 bool"):
        policy.reset(mask=np.array([1, 0]))
    with pytest.raises(ConfigError, match=r"info\['object'\] has 1 rows"):
        policy.reset(info={"object": np.array(["can-000000"])})
    with pytest.raises(ConfigError, match=r"needs info\['object'\]"):
        policy.reset(0)
    with pytest.raises(ConfigError, match="info='numeric'"):
        graspbox.evaluation.evaluate("zero", POSE, CANS, 1, info="numeric")
    policy.reset(info={"object": np.array(["spoon", "can-000000"], dtype=object)})
    with pytest.raises(ConfigError, match="no object 'spoon' in the set"):
        policy.act(np.zeros((2, 19), dtype=np.float32) + 0.5)
