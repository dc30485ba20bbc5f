"""`graspbox.evaluation`: a fixed set of seeded trials, counted correctly; and ``graspbox evaluate``."""

import doctest
import json
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from graspbox import evaluation, object_sets, policies
from graspbox.envs import SINGLE_OBJECT_IDS
from graspbox.errors import ConfigError, GraspboxError
from graspbox.evaluation import evaluate, run_trials, trial_seeds, wilson
from graspbox.hands import load_hand
from graspbox.policies import Policy, Task, Zero
from interrupting import interrupted

POSE, LOOP = SINGLE_OBJECT_IDS
SET = ["procedural:can:0-4", "procedural:box:0-4"]


@pytest.mark.parametrize(
    ("succeeded", "trials", "low", "high"),
    [
        # Closed forms: for no success the interval is [0, z^2 / (n + z^2)], for n successes its mirror image.
        (0, 10, 0.0, 3.841458820694124 / 13.841458820694124),
        (10, 10, 10 / 13.841458820694124, 1.0),
        # Half of them: 1/2 -+ z / (2 sqrt(n + z^2)).
        (50, 100, 0.5 - 1.959963984540054 / (2 * 103.841458820694124**0.5), 0.5 + 0.0961676),
        # Newcombe, "Two-sided confidence intervals for the single proportion", Stat. Med. 17, 1998, table I.
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_intervals_are_those_of_the_literature(succeeded: int, trials: int, low: float, high: float) -> None:
    assert wilson(succeeded, trials) == pytest.approx((low, high), abs=5e-5)
    mirrored = wilson(trials - succeeded, trials)
    assert (1 - mirrored[1], 1 - mirrored[0]) == pytest.approx((low, high), abs=5e-5)


@pytest.mark.parametrize(("succeeded", "trials"), [(0, 0), (3, 2), (-1, 5)])
def test_counts_that_cannot_be_have_no_interval(succeeded: int, trials: int) -> None:
    with pytest.raises(ConfigError, match="at least one trial"):
        wilson(succeeded, trials)


def test_trials_have_seeds_of_their_own() -> None:
    seeds = trial_seeds(0, 500)
    assert seeds[:20] == trial_seeds(0, 20)
    assert all(0 <= seed < 2**53 for seed in seeds)
    # Neighbouring seeds of an evaluation share no trial.
    assert len({*seeds, *trial_seeds(1, 500)}) == 1000


@pytest.mark.parametrize(
    ("env_id", "policy", "trials"), [(POSE, "planner", 12), (LOOP, "expert", 9), (LOOP, "random", 8)]
)
def test_the_trials_do_not_depend_on_the_number_of_environments(env_id: str, policy: str, trials: int) -> None:
    """With 7 environments some idle at the end; with 4 short episodes make room for more of them."""
    settings: dict[str, Any] = {"max_episode_steps": 120} if env_id == LOOP else {}
    found = [evaluate(policy, env_id, SET, trials, 3, num_envs=count, **settings) for count in (1, 4, 7)]
    assert found[0] == found[1] == found[2]
    assert len(found[0].trials) == trials
    assert [trial.seed for trial in found[0].trials] == trial_seeds(3, trials)
    # Another seed gives other trials.
    assert evaluate("zero", env_id, SET, trials, 4, max_episode_steps=1).trials != found[0].trials


def test_a_trial_is_the_episode_of_its_seed() -> None:
    """Reset a single environment with the seed of a trial, and the same happens."""
    result = evaluate("planner", LOOP, SET, 4, 7, reward="dense")
    for trial in result.trials:
        policy = policies.load("planner")
        env = gymnasium.make(LOOP, objects=SET, reward="dense", **policy.settings_in(LOOP))
        policy.bind(Task.of(env))
        observation, info = env.reset(seed=trial.seed)
        assert info["object"] == trial.object
        policy.reset(trial.seed, info=info)
        steps, total, done = 0, 0.0, False
        while not done:
            observation, reward, terminated, truncated, info = env.step(policy.act(observation[None])[0])
            steps, total, done = steps + 1, total + float(reward), terminated or truncated
        assert (trial.success, trial.secure, trial.steps) == (info["is_success"], info["is_secure"], steps)
        assert trial.failure == info["failure"]
        assert trial.reward == total


class Hasty(Policy):
    """Plays `planner`, but in every other trial does nothing, and so fails late where the others succeed early."""

    name = "hasty"
    obs = "state"

    def _bind(self, task: Task) -> None:
        self._inner = policies.load("planner")
        self._inner.bind(task)
        self._idle = np.zeros(task.num_envs, dtype=bool)

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        assert seed is not None
        self._idle[env] = seed % 2
        mask = np.arange(self.task.num_envs) == env
        self._inner.reset(mask=mask, info={"object": np.full(self.task.num_envs, info["object"], dtype=object)})

    def act(self, observation: Any) -> policies.Actions:
        """Do nothing in the idle environments."""
        actions = self._inner.act(observation)
        actions[self._idle] = 0.0
        return actions


def test_a_policy_says_where_it_acts() -> None:
    """Unless its caller does."""

    class Idle(policies.Policy):
        """Stands still, in the closed loop."""

        env_id = LOOP
        settings = {"max_episode_steps": 3}  # noqa: RUF012 (read only)

        def act(self, observation: Any) -> policies.Actions:
            """Do nothing."""
            return self._zeros()

    found = evaluate(Idle(), None, "procedural:can:0", 2)
    assert (found.env_id, [trial.steps for trial in found.trials]) == (LOOP, [3, 3])
    assert evaluate(Idle(), POSE, "procedural:can:0", 1).env_id == POSE
    assert evaluate("zero", objects="procedural:can:0", trials=1).env_id == POSE


def test_short_episodes_count_no_more_than_long_ones() -> None:
    """Half of the trials succeed after about 120 steps, half fail after 600: the first ones to finish would succeed."""
    result = evaluate(Hasty(), LOOP, "procedural:can:0-2", 12, 0, num_envs=4, max_episode_steps=600)
    odd = [trial.seed % 2 == 1 for trial in result.trials]
    assert 3 <= sum(odd) <= 9
    assert all(trial.steps == 600 and not trial.success for trial, idle in zip(result.trials, odd, strict=True) if idle)
    assert result.succeeded == sum(trial.success for trial in result.trials)
    assert 12 - sum(odd) - result.succeeded <= 1


def test_counts_add_up() -> None:
    result = evaluate("planner", POSE, ["procedural:can:5", "procedural:plate:0-1", "procedural:mug:0"], 24, 1)
    assert sum(count.trials for count in result.objects) == 24
    assert sum(count.succeeded for count in result.objects) == result.succeeded
    assert sum(count.secure for count in result.objects) == result.secure
    assert 0 < result.secure <= result.succeeded < 24
    assert sum(result.failures.values()) == 24 - result.succeeded
    assert result.rate == result.succeeded / 24
    assert result.ci95 == wilson(result.succeeded, 24)
    assert result.secure_ci95 == wilson(result.secure, 24)
    assert [count.name for count in result.objects] == sorted({trial.object for trial in result.trials})


def test_trials_tell_whether_the_object_fits_the_hand() -> None:
    """Boxes of these sizes lie on any of their faces: some of them are wider than the gripper's opening, some not."""
    found = evaluate("random", "graspbox/GraspPose-v0", "procedural:box:0-19", 24, hand="panda_gripper")
    widest = load_hand("panda_gripper").widest
    objects = {spec.name: spec.load() for spec in object_sets.load("procedural:box:0-19")}
    env = gymnasium.make("graspbox/GraspPose-v0", objects="procedural:box:0-19", hand="panda_gripper")
    for trial in found.trials[:12]:
        _, info = env.reset(seed=trial.seed)
        assert bool(info["fits"]) == trial.fits
        mesh = objects[trial.object]
        corners = mesh.vertices @ mesh.resting_poses()[0][info["resting"], :3, :3].T
        angles = np.linspace(0.0, np.pi, 720, endpoint=False)
        widths = np.ptp(corners[:, :2] @ np.stack([np.cos(angles), np.sin(angles)]), axis=0)
        if abs(widths.min() - widest) > 1e-3:
            assert (widths.min() < widest) == trial.fits
    fitting = found.fitting
    assert 0 < len(fitting.trials) < 24
    assert all(trial.fits for trial in fitting.trials)
    assert found.to_json()["fitting"] == {"trials": len(fitting.trials), "succeeded": 0, "secure": 0}
    assert len(evaluate("random", "graspbox/GraspPose-v0", "procedural:box:0-19", 4).fitting.trials) == 4


def test_the_policy_s_time_is_its_own() -> None:
    """20 ms of every call, shared by the environments that act; the simulation is not counted."""

    class Slow(Policy):
        def act(self, observation: Any) -> policies.Actions:
            time.sleep(0.02)
            return self._zeros()

    assert 10.0 < evaluate(Slow(), POSE, SET, 8, num_envs=2).ms_per_decision < 15.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"trials": 0}, "trials is 0; it must be between 1 and 1000000"),
        ({"trials": 2.5}, "trials is 2.5 (float); give an integer"),
        ({"trials": "7"}, "trials is '7' (str); give an integer"),
        ({"trials": 10**7}, "trials is 10000000"),
        ({"seed": -1}, "seed is -1 (int); give an integer that is not negative"),
        ({"seed": 1.5}, "seed is 1.5 (float); give an integer"),
        ({"num_envs": 0}, "num_envs is 0; it must be between 1 and 4096"),
        ({"env_id": "graspbox/Grab-v0"}, "no environment 'graspbox/Grab-v0'; choose from graspbox/GraspPose-v0"),
        ({"env_id": "CartPole-v1"}, "no environment 'CartPole-v1'"),
        ({"policy": "best"}, "no policy 'best'; choose from random"),
        ({"policy": "expert"}, "acts in graspbox/Grasp-v0"),
        ({"objects": "procedural:sponge"}, "no family 'sponge'"),
        ({"split": "training"}, "training"),
        ({"obs": "rgb", "policy": "planner"}, "needs obs='state'"),
    ],
)
def test_wrong_arguments_are_named(changes: dict[str, Any], message: str) -> None:
    given = {"policy": "zero", "env_id": POSE, "objects": SET, "trials": 2, "seed": 0, **changes}
    with pytest.raises(GraspboxError, match=re.escape(message)):
        evaluate(**given)


def test_numbers_of_numpy_are_numbers() -> None:
    plain = evaluate("zero", POSE, SET, 3, 5, num_envs=2)
    assert evaluate("zero", POSE, SET, np.int64(3), np.uint8(5), num_envs=np.int32(2)) == plain
    json.dumps(plain.to_json())


def test_a_function_is_no_policy() -> None:
    policy: Any = lambda observation: observation  # noqa: E731
    with pytest.raises(ConfigError, match=r"policy is a function; pass a graspbox\.policies\.Policy"):
        evaluate(policy, SINGLE_OBJECT_IDS[0], "procedural:can:0", 1, 0)


def test_environments_that_reset_by_themselves_are_refused() -> None:
    policy = policies.load("zero")
    envs: Any = gymnasium.make_vec(POSE, num_envs=2, objects=SET)
    policy.bind(Task.of(envs))
    with pytest.raises(ConfigError, match="autoreset_mode='Disabled'"):
        run_trials(policy, envs, [1, 2])
    envs = gymnasium.make_vec(POSE, num_envs=3, objects=SET, autoreset_mode="Disabled")
    with pytest.raises(ConfigError, match="bound to 2 environments, these are 3"):
        run_trials(policy, envs, [1, 2])
    policy.bind(Task.of(envs))
    with pytest.raises(ConfigError, match="no seeds"):
        run_trials(policy, envs, [])


def test_progress_is_told_trial_by_trial() -> None:
    told: list[int] = []
    evaluate("zero", POSE, SET, 5, num_envs=2, progress=told.append)
    assert told == [1, 2, 3, 4, 5]


def test_the_example_of_the_module_runs() -> None:
    result = doctest.testmod(evaluation)
    assert result.attempted > 2
    assert result.failed == 0


# --- the command ------------------------------------------------------------------------------------------------------

pytest.importorskip("typer", reason="the command line needs the extra 'cli'")

COMMAND = [sys.executable, "-m", "graspbox", "evaluate"]
KEYS = [
    "policy",
    "condition",
    "trials",
    "succeeded",
    "secure",
    "rate",
    "ci95",
    "fitting",
    "objects",
    "failures",
    "objects_left_out",
    "refused",
]
KEYS += ["mean_confidence", "calibration_error", "ms_per_decision"]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, check=False)


def test_the_command_prints_json_and_writes_every_trial(tmp_path: Path) -> None:
    out = tmp_path / "new" / "result.json"
    few = ("--objects", "procedural:can:0-4", "--objects", "procedural:box:0-4", "--trials", "6", "--seed", "3")
    done = run("planner", *few, "--env", POSE, "--json", "--out", str(out))
    assert done.returncode == 0, done.stderr
    shown = json.loads(done.stdout)
    asked = {name: shown.pop(name) for name in ("env_id", "hand", "arm", "base")}
    assert asked == {"env_id": POSE, "hand": None, "arm": None, "base": None}
    assert list(shown) == KEYS
    assert sum(shown["failures"].values()) == 6 - shown["succeeded"]
    assert all(list(row) == ["name", "trials", "succeeded"] for row in shown["objects"])
    result = evaluate("planner", POSE, SET, 6, 3)
    # The time is the machine's.
    assert {**shown, "ms_per_decision": 0} == {**result.to_json(), "ms_per_decision": 0}
    written = json.loads(out.read_text())
    assert written["rows"] == [vars(trial) for trial in result.trials]
    assert {name: written[name] for name in KEYS} == shown
    done = run("zero", *few)
    assert done.returncode == 0
    assert "success 0.0% (95 % interval 0.0% to 39.0%)" in done.stdout
    assert "failures: 6 infeasible" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("best",), 2, "no policy 'best'"),
        (("zero", "--env", "Grasp-v0"), 2, "no environment 'Grasp-v0'; choose from"),
        (("zero", "--objects", "procedural:sponge"), 2, "no family 'sponge'"),
        (("zero", "--trials", "0"), 2, "--trials"),
        (("zero", "--split", "training"), 2, "training"),
        (
            ("zero", "--trials", "1", "--out", "/proc/none/result.json"),
            1,
            "No such file or directory: /proc/none/result.json\n",
        ),
    ],
)
def test_the_command_explains_wrong_calls(arguments: tuple[str, ...], status: int, message: str) -> None:
    done = run(*arguments)
    assert done.returncode == status
    assert done.stdout == ""
    assert message in done.stderr
    assert "Traceback" not in done.stderr


def test_an_object_that_cannot_be_used_fails_the_command(tmp_path: Path) -> None:
    (tmp_path / "broken.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n")
    done = run("zero", "--objects", str(tmp_path / "broken.off"), "--trials", "1", "--json")
    assert done.returncode == 1
    assert list(json.loads(done.stdout)["refused"]) == ["broken"]
    assert "object `broken`: the OFF file is truncated" in done.stderr
    assert "Traceback" not in done.stderr


def test_ctrl_c_ends_the_command() -> None:
    """During trials that would take hours; partial counts are not printed."""
    ended = interrupted(
        "from graspbox import policies\n"
        "class Watched(policies.Planner):\n"
        "    def act(self, observation):\n"
        "        ready()\n"
        "        return super().act(observation)\n"
        "policies.load = lambda name, **options: Watched()\n"
        f"words = 'evaluate planner --env {LOOP} --objects procedural:can:0-4 --trials 1000000 --json'\n"
        "sys.argv = ['graspbox', *words.split()]\n"
        "from graspbox.__main__ import main; main()\n"
    )
    assert (ended.status, ended.stdout) == (130, "")
    assert set(ended.stderr.split()) <= {"ready"}


class _Stopped(Zero):
    """Acts a number of times, then Ctrl-C arrives."""

    def __init__(self, left: int) -> None:
        super().__init__()
        self.left = left

    def act(self, observation: Any) -> Any:
        self.left -= 1
        if self.left < 0:
            raise KeyboardInterrupt
        return super().act(observation)


def test_an_interrupted_evaluation_counts_whole_trials() -> None:
    """Two environments, three steps each: the third pair of trials is cut off, and the next evaluation is whole."""
    settings: dict[str, Any] = {"env_id": LOOP, "objects": "procedural:can:0-4", "max_episode_steps": 3}
    told: list[int] = []
    with pytest.raises(KeyboardInterrupt):
        evaluate(_Stopped(7), trials=6, num_envs=2, progress=told.append, **settings)
    assert told == [1, 2, 3, 4]
    again = evaluate(_Stopped(9), trials=6, num_envs=2, **settings)
    assert [trial.steps for trial in again.trials] == 6 * [3]
    assert again.trials == evaluate("zero", trials=6, **settings).trials
