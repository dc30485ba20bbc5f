"""Keywords of the environments: known to type checkers and `inspect`, and suggested after a misspelling."""

import inspect
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, get_type_hints

import gymnasium
import numpy as np
import pytest
from mypy import api as mypy

from acting import EACH, OBJECTS, TASKS, best_grasp, expert_actions, pressing
from graspbox import errors
from graspbox.configs import PhysicsConfig, SuccessCriterion, TrialConfig
from graspbox.envs import settings
from graspbox.envs.clear import ClearEnv, ClearVectorEnv
from graspbox.envs.grasp import GraspEnv
from graspbox.envs.grasp_pose import GraspPoseEnv, GraspPoseVectorEnv
from graspbox.envs.vector import GraspVectorEnv

KINDS = {
    GraspEnv: settings.GraspConfig,
    GraspPoseEnv: settings.GraspPoseConfig,
    GraspVectorEnv: settings.GraspVectorConfig,
    GraspPoseVectorEnv: settings.GraspPoseVectorConfig,
    ClearEnv: settings.ClearConfig,
    ClearVectorEnv: settings.ClearVectorConfig,
}
GRASP, POSE, CLEAR = "graspbox/Grasp-v0", "graspbox/GraspPose-v0", "graspbox/Clear-v0"


@pytest.mark.parametrize("env", KINDS, ids=lambda env: env.__name__)
def test_signatures_name_every_keyword_with_its_default(env: Any) -> None:
    found = inspect.signature(env).parameters
    rows = {field.name: field for field in fields(KINDS[env])}
    named = ["num_envs", "objects"] if "Vector" in env.__name__ else ["objects"]
    assert list(found) == [*named, *rows]
    assert all(found[name].default == row.default for name, row in rows.items())
    hints = get_type_hints(KINDS[env])
    assert all(found[name].annotation == hints[name] for name in rows)
    assert found["objects"].default == "procedural"
    closed_loop, clears = env in (GraspEnv, GraspVectorEnv), env in (ClearEnv, ClearVectorEnv)
    assert ("control" in found, "trial" in found) == (not clears, not closed_loop)
    assert found["physics"].default == PhysicsConfig()


def test_defaults_are_those_that_environments_have() -> None:
    """Omitted keywords and explicit defaults give the same environment."""
    kinds = ((GRASP, settings.GraspConfig), (POSE, settings.GraspPoseConfig), (CLEAR, settings.ClearConfig))
    for env_id, kind in kinds:
        given: dict[str, Any] = {field.name: field.default for field in fields(kind)}
        plain: Any = gymnasium.make(env_id).unwrapped
        full: Any = gymnasium.make(env_id, **given).unwrapped
        assert plain._core.config == full._core.config
        assert plain.observation_space == full.observation_space
        np.testing.assert_array_equal(plain.reset(seed=0)[0], full.reset(seed=0)[0])


@pytest.mark.parametrize("kind", KINDS.values(), ids=lambda kind: kind.__name__)
def test_every_keyword_has_a_type_in_words_and_a_meaning(kind: type) -> None:
    docs = "\n".join(one.__doc__ or "" for one in kind.__mro__)
    for field in fields(kind):
        assert f"    {field.name} : {settings.documented_type(kind, field.name)}\n        " in docs, field.name


@pytest.mark.parametrize(
    ("env_id", "vector", "wrong", "near"),
    [
        (GRASP, False, "rewards", "'reward'"),
        (GRASP, True, "frame_skip", "pass control_freq=20 / frame_skip"),
        (GRASP, False, "trial", "choose from objects, split, scale, mass, obs"),
        (POSE, False, "fingers", "choose from objects, split, scale, mass, obs"),
        (POSE, True, "auto_reset_mode", "'autoreset_mode'"),
        (POSE, False, "copy", "choose from"),
        (CLEAR, True, "max_failure", "'max_failures'"),
    ],
)
def test_a_misspelt_keyword_names_the_nearest_one(env_id: str, vector: bool, wrong: str, near: str) -> None:
    make: Any = gymnasium.make_vec if vector else gymnasium.make
    with pytest.raises(errors.ConfigError, match=f"no keyword '{wrong}'; .*{near}"):
        make(env_id, **{wrong: 1})


@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_an_unknown_keyword_is_a_type_error_in_words_of_python(make: Any) -> None:
    """TorchRL's GymEnv passes ``frameskip``, and leaves it out after a TypeError with these words."""
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'") as caught:
        make(GRASP, frameskip=1)
    assert isinstance(caught.value, errors.ConfigError)
    with pytest.raises(errors.UnknownKeywordError, match="did you mean 'objects'"):
        make(GRASP, object="procedural:can")


def test_type_checkers_know_the_keywords(tmp_path: Path) -> None:
    """Mypy finds a wrong value and a keyword of the other environment, and nothing else."""
    (tmp_path / "use.py").write_text(
        "from graspbox.configs import TrialConfig\n"
        "from graspbox.envs.settings import GraspConfig, GraspPoseVectorConfig\n"
        "\n"
        "GraspConfig(control='twist', control_freq=10)\n"
        "GraspPoseVectorConfig(trial=TrialConfig(), copy=False)\n"
        "GraspConfig(control='joint')\n"
        "GraspConfig(trial=TrialConfig())\n"
    )
    root = Path(__file__).parents[2]
    folders = ["--config-file", str(root / "pyproject.toml"), "--cache-dir", str(root / ".mypy_cache")]
    out, _, _ = mypy.run([*folders, str(tmp_path / "use.py")])
    lines = [line for line in out.splitlines() if "error:" in line]
    assert len(lines) == 2, out
    assert "use.py:6" in lines[0]
    assert "control" in lines[0]
    assert "use.py:7" in lines[1]
    assert "trial" in lines[1]


def test_a_trial_is_the_decisions_alone() -> None:
    short = TrialConfig(hold_time=0.6)
    env: Any = gymnasium.make(POSE, trial=short).unwrapped
    assert env._core.config.trial == short


def test_success_is_a_criterion_that_can_be_set() -> None:
    """A lower one ends the expert's episode sooner, a higher one never; a decision's must fit its lift."""
    low, high = SuccessCriterion(lift_height=0.03, hold_time=0.1), SuccessCriterion(lift_height=0.5)
    env: Any = gymnasium.make(GRASP, objects="procedural:can:0", **EACH).unwrapped
    actions = expert_actions(env, 0)
    eager: Any = gymnasium.make(GRASP, objects="procedural:can:0", success=low, **EACH).unwrapped
    eager.reset(seed=0)
    steps = next(step for step, action in enumerate(actions) if eager.step(action)[2])
    assert steps + 5 < len(actions)
    strict: Any = gymnasium.make(GRASP, objects="procedural:can:0", success=high, **EACH).unwrapped
    strict.reset(seed=0)
    assert not any(strict.step(action)[2] for action in actions)
    short = TrialConfig(lift_height=0.05)
    ways: list[dict[str, Any]] = [{"trial": short, "success": low}, {"trial": replace(short, success=low)}]
    for given in ways:
        decision: Any = gymnasium.make(POSE, objects="procedural:can:0", **given).unwrapped
        state, info = decision.reset(seed=0)
        _, reward, _, _, info = decision.step(best_grasp(decision.objects, info["object"], state))
        assert reward == 1.0
        assert info["lift"] < 0.06
    for wrong in ({"trial": short}, {"success": high}):
        with pytest.raises(errors.ConfigError, match="lift_height"):
            gymnasium.make(POSE, objects="procedural:can:0", **wrong)
    with pytest.raises(errors.ConfigError, match="lift_height"):
        gymnasium.make(GRASP, success=SuccessCriterion(lift_height=-1.0))


def flat_numbers(info: dict[str, Any]) -> bool:
    return all(isinstance(value, bool | int | float | np.bool_ | np.number) for value in info.values())


@pytest.mark.parametrize("task", TASKS)
def test_numeric_infos_say_the_same_in_numbers(task: str) -> None:
    """No string and no nested dictionary, so that wrappers can make tensors."""
    env_id, keywords = TASKS[task]
    full: Any = gymnasium.make(env_id, objects=OBJECTS, reward="dense", **keywords).unwrapped
    numeric: Any = gymnasium.make(env_id, objects=OBJECTS, reward="dense", info="numeric", **keywords).unwrapped
    failures, seen = full._core.tables["failures"], set()
    for seed in range(3):
        pairs = [(full.reset(seed=seed)[1], numeric.reset(seed=seed)[1])]
        for action in pressing(25, 1, seed=seed)[:, 0] if env_id == GRASP else [np.zeros(10, np.float32)]:
            pairs.append((full.step(action)[4], numeric.step(action)[4]))
        for one, other in pairs:
            assert flat_numbers(other)
            assert failures[other["failure"]] == one["failure"]
            assert full.objects.names[other["object"]] == one["object"]
            terms = {f"reward_{name}": value for name, value in one["reward_terms"].items()}
            assert {name: other[name] for name in terms} == terms
            rest = one.keys() - {"failure", "object", "reward_terms"}
            assert {name: other[name] for name in rest} == {name: one[name] for name in rest}
            assert set(other) == {*rest, *terms, "failure", "object"}
            seen |= {one["failure"]}
    assert len(seen) >= (2 if env_id == GRASP else 1)


def test_numeric_infos_of_vectors_are_arrays_of_numbers() -> None:
    env: Any = gymnasium.make_vec(
        GRASP, num_envs=2, objects=OBJECTS, info="numeric", max_episode_steps=3, autoreset_mode="SameStep", **EACH
    )
    _, info = env.reset(seed=0)
    infos = [info]
    for action in pressing(3, 2):
        infos.append(env.step(action)[4])
    infos.append(infos[-1]["final_info"])
    for info in infos:
        for name, value in info.items():
            if name not in ("final_obs", "final_info"):
                assert value.dtype.kind in "bif", name
    assert infos[-1]["reward_reach"].dtype == np.float64
    with pytest.raises(errors.ConfigError, match="'full', 'numeric'"):
        gymnasium.make(GRASP, info="flat")


def test_specs_tell_limits_and_thresholds() -> None:
    specs = {env_id: gymnasium.spec(env_id) for env_id in (GRASP, POSE)}
    assert {env_id: spec.max_episode_steps for env_id, spec in specs.items()} == {GRASP: 40, POSE: 1}
    # That of a sparse reward, which Grasp-v0 has no more by default.
    assert {env_id: spec.reward_threshold for env_id, spec in specs.items()} == {GRASP: None, POSE: 0.9}


def test_frames_per_second_are_an_integer() -> None:
    """`gymnasium.utils.play` refuses anything else."""
    rates = {}
    for freq in (5, 12.5, 20.0):
        for env in (gymnasium.make(GRASP, control_freq=freq), gymnasium.make_vec(GRASP, num_envs=1, control_freq=freq)):
            assert type(env.metadata["render_fps"]) is int
            rates[freq] = env.metadata["render_fps"]
    assert rates == {5: 5, 12.5: 12, 20.0: 20}
    assert gymnasium.make(POSE).metadata["render_fps"] == 1


@pytest.mark.parametrize("fingers", ["synergy", "each"])
@pytest.mark.parametrize("control", ["twist", "delta_pose"])
def test_keys_of_play_move_the_hand_as_they_say(control: str, fingers: str) -> None:
    settings: dict[str, Any] = {"control": control, "fingers": fingers, "control_freq": 20}
    env: Any = gymnasium.make(GRASP, objects="procedural:can:0", **settings).unwrapped
    keys = env.get_keys_to_action()
    assert len(keys) == 12 + 2 + 24
    # Requirements of `gymnasium.utils.play.play`.
    assert all(isinstance(key, str) and action in env.action_space for key, action in keys.items())
    assert env.idle_action in env.action_space
    place, spool, speed = slice(0, 3), slice(18, 21), slice(9, 15)
    state, _ = env.reset(seed=0)
    for _ in range(3):
        still = env.step(env.idle_action)[0]
    np.testing.assert_allclose(still[place], state[place], atol=1e-6)
    for index, (more, less) in enumerate([("d", "a"), ("w", "s"), ("e", "q"), ("i", "k"), ("u", "o"), ("j", "l")]):
        for key, sign in ((more, 1.0), (less, -1.0)):
            env.reset(seed=0)
            for _ in range(2):
                state = env.step(keys[key])[0]
            # As shares of the limits: no other motion is as fast.
            shares = state[speed] / [0.5, 0.5, 0.5, 2.0, 2.0, 2.0]
            assert np.argmax(shares * sign) == index
            assert shares[index] * sign > 0.2
    env.reset(seed=0)
    for _ in range(5):
        state = env.step(keys["q "])[0]
    assert (state[spool] > 0.3).all()


def test_keys_of_play_move_along_the_axes_of_the_world() -> None:
    env: Any = gymnasium.make(GRASP, objects="procedural:can:0", control="top_down").unwrapped
    keys = env.get_keys_to_action()
    assert len(keys) == 8 + 2 + 16
    for key, axis, sign in (("d", 0, 1), ("a", 0, -1), ("w", 1, 1), ("s", 1, -1), ("e", 2, 1)):
        before = env.reset(seed=0)[0][:3]
        moved = env.step(keys[key])[0][:3] - before
        assert sign * moved[axis] > 0.03, key
        assert np.abs(np.delete(moved, axis)).max() < 1e-5, key
    turns = []
    for key in "ik":
        before = env.reset(seed=0)[0]
        after = env.step(keys[key])[0]
        np.testing.assert_allclose(after[:3], before[:3], atol=1e-5)
        # The first two columns of the rotation, seen from above.
        turns.append(before[3] * after[4] - before[4] * after[3])
    assert turns[0] > 0.1
    assert turns[1] < -0.1


def test_poses_have_no_keys() -> None:
    env: Any = gymnasium.make(GRASP, control="target_pose").unwrapped
    with pytest.raises(errors.ConfigError, match="names a pose"):
        env.get_keys_to_action()
    assert not hasattr(gymnasium.make(POSE).unwrapped, "get_keys_to_action")
