"""``graspbox train student``: rounds of recording and cloning. Needs the extra ``train``."""

import json
import shlex
import shutil
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from graspbox import policies
from graspbox._common.runs import Rows
from graspbox.data.episodes import Demonstrations, record
from graspbox.errors import ConfigError
from graspbox.learn.sb3.histories import history
from graspbox.learn.sb3.settings import PARAMETERS, Sb3Settings, StudentSettings

pytestmark = pytest.mark.train

pytest.importorskip("stable_baselines3")
training = pytest.importorskip("graspbox.learn.sb3.training")
student = pytest.importorskip("graspbox.learn.sb3.student")

ENV = ('env.objects=["procedural:can:0-9"]', "env.max_episode_steps=6", "env.image_size=16")
SMALL = ("num_envs=4", "model.n_steps=8", "model.batch_size=32", "model.n_epochs=1")


@pytest.fixture(scope="module")
def teacher(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Train for few steps."""
    out = tmp_path_factory.mktemp("student") / "teacher"
    settings: Any = Sb3Settings(
        algorithm="ppo", out=out, steps=32, evaluations=1, episodes=4, video=0, set=(*ENV, *SMALL)
    )
    assert training.train(settings, "", lambda _: None).status == 0
    return out


def taught(teacher: Path, out: Path, **given: Any) -> dict[str, Any]:
    """Teach in this process."""
    options = {"rounds": 2, "shown": 10, "epochs": 1, "batch": 32, "episodes": 4, **given}
    settings = StudentSettings(teacher=teacher, out=out, **options)
    return dict(student.train(settings, "", lambda _: None).results)


def test_a_student_is_taught_in_rounds(teacher: Path, tmp_path: Path) -> None:
    out = tmp_path / "student"
    first = taught(teacher, out)
    settings = [json.loads((out / f"rounds/{number}/manifest.json").read_text())["settings"] for number in (0, 1)]
    assert [one.get("acting") for one in settings] == [None, "0/checkpoint"]
    assert all(one["policy"] == "teacher/best" and one["keep"] == "all" for one in settings)
    # The last student learned from both rounds, and is a policy that sees and feels.
    policy = policies.load(str(out))
    assert (policy.env_id, set(policy.obs or ())) == ("graspbox/Grasp-v0", {"depth", "proprio", "tactile"})
    seen = sum(episode.steps for number in (0, 1) for episode in Demonstrations(out / f"rounds/{number}").episodes)
    assert first["updates"] == pytest.approx(0.9 * seen / 32, abs=2)
    rows = [*Rows(out / "evaluations.jsonl")]
    assert taught(teacher, out) == first
    assert [*Rows(out / "evaluations.jsonl")] == rows
    # Its history begins with that of the teacher, whose best checkpoint was chosen on the split validation.
    assert set(policies.load(str(out)).learned_from) == {"procedural:can:0-9/train", "procedural:can:0-9/validation"}
    before, last = history(out, PARAMETERS)
    assert (before.kind, last.kind) == ("training", "student")
    assert before.command.startswith("graspbox train sb3 ppo --out out/teacher")
    words = shlex.split(last.command)
    assert words[:6] == ["graspbox", "train", "student", "out/teacher", "--out", "out/student"]
    assert (words[words.index("--rounds") + 1], words[words.index("--shown") + 1]) == ("2", "10")
    assert "2 rounds of 10 episodes" in last.description


def test_a_student_whose_teacher_is_missing_is_a_policy(
    teacher: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    moved = tmp_path / "moved"
    shutil.copytree(teacher, moved)
    taught(moved, tmp_path / "student", rounds=1)
    shutil.rmtree(moved)
    policy = policies.load(str(tmp_path / "student"))
    assert "is missing; its own training is unknown" in caplog.text
    assert policy.learned_from == ("procedural:can:0-9/train",)
    (tmp_path / "student/student.json").write_text('{"run": ')
    with pytest.raises(ConfigError, match=r"student\.json' is damaged"):
        policies.load(str(tmp_path / "student"))


def test_the_teacher_says_what_to_do_where_another_policy_leads(teacher: Path, tmp_path: Path) -> None:
    """Recorded actions are the teacher's; the states are those of the policy that acts."""
    keywords: dict[str, Any] = {"objects": "procedural:can:0-9", "episodes": 2, "keep": "all", "max_episode_steps": 6}
    shown = record(str(teacher), tmp_path / "shown", obs="state", acting="zero", **keywords)
    run = policies.load(str(teacher))
    for episode in shown.read():
        states = episode.observations["state"]
        moved = np.abs(states[-1][:3] - states[0][:3]).max()
        assert moved < 1e-3
        envs = gymnasium.make_vec("graspbox/Grasp-v0", 1, objects="procedural:can:0-9", max_episode_steps=6)
        run.bind(policies.Task.of(envs))
        actions = np.concatenate([run.act(state[None]) for state in states[:-1]])
        envs.close()
        np.testing.assert_allclose(episode.actions, np.clip(actions, -1, 1), atol=1e-6)
        assert np.abs(episode.actions).max() > 0.0


def test_only_a_run_teaches(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="is no run of graspbox train sb3"):
        taught(Path("planner"), tmp_path / "x")
    with pytest.raises(ConfigError, match="--obs is empty"):
        StudentSettings(teacher=Path("x"), out=tmp_path / "x", obs=())
