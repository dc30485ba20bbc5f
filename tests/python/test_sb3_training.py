"""``graspbox train sb3``: its files, interruption, resumption, evaluations, baselines. Needs the extra ``train``."""

import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox import evaluation
from graspbox._common.runs import Rows, Run
from graspbox.envs import GOAL_IDS
from graspbox.errors import ConfigError
from graspbox.learn.sb3.settings import EVALUATION_SEED, PARAMETERS, Sb3Settings, read_parameters
from test_scripts import script

pytestmark = pytest.mark.train

sb3 = pytest.importorskip("stable_baselines3")
torch = pytest.importorskip("torch")
typer = pytest.importorskip("typer")
running = pytest.importorskip("graspbox.learn.sb3.running")
training = pytest.importorskip("graspbox.learn.sb3.training")
summary = pytest.importorskip("graspbox.sb3.policy").summary

GRASP = "graspbox/Grasp-v0"
SMALL = ("num_envs=4", "env.max_episode_steps=12", 'env.objects=["procedural:can:0-9"]')
PPO = (*SMALL, "steps=256", "model.n_steps=16", "model.batch_size=32", "model.n_epochs=1")
SAC = (*SMALL, "steps=128", "model.learning_starts=32", "model.buffer_size=512", "model.batch_size=16")


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Leave the number of torch's threads as it was: runs set it."""
    threads = torch.get_num_threads()
    yield
    torch.set_num_threads(threads)


def run(algorithm: Any, folder: Path, changes: tuple[str, ...], **settings: Any) -> int:
    """Train in this process; the exit status."""
    given = {"episodes": 4, "evaluations": 2, "video": 0, **settings}
    options: Any = Sb3Settings(algorithm=algorithm, out=folder, set=changes, **given)
    return int(training.train(options, "graspbox train sb3", lambda _: None).status)


def rows_of(folder: Path) -> list[dict[str, Any]]:
    return Rows(folder / "evaluations.jsonl")


def test_a_run_and_its_resumption(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    assert run("ppo", folder, PPO) == 0
    assert [row["timesteps"] for row in rows_of(folder)] == [0, 128, 256]
    for row in rows_of(folder):
        assert row["episodes"] == 4
        assert sum(row["failures"].values()) == round(4 * (1 - row["success"]))
        assert 0 < row["length"] <= 12
    assert list(folder.glob("tensorboard/*/events*"))
    assert (folder / "best/model.zip").is_file()
    first = sb3.PPO.load(folder / "checkpoint/model.zip")
    with pytest.raises(ConfigError, match="holds a run; resume it, or name another folder"):
        run("ppo", folder, PPO, resume=False)
    with pytest.raises(ConfigError, match=r"other settings: model\.gamma was 0\.97, is now 0\.5"):
        run("ppo", folder, (*PPO, "model.gamma=0.5"))
    # A finished run is extended.
    assert run("ppo", folder, PPO, steps=512, evaluations=4) == 0
    assert [row["timesteps"] for row in rows_of(folder)] == [0, 128, 256, 384, 512]
    second = sb3.PPO.load(folder / "checkpoint/model.zip")
    assert (first.num_timesteps, second.num_timesteps) == (256, 512)
    # The statistics continue: they hold each of the 512 steps, and one reset per environment.
    import pickle

    statistics = pickle.loads((folder / "checkpoint/normalize.pkl").read_bytes())
    assert statistics.obs_rms.count == pytest.approx(512 + 4, abs=0.01)
    # Its end is reached: nothing is left to do.
    assert run("ppo", folder, PPO, steps=512) == 0
    assert len(rows_of(folder)) == 5


#: A goal task with hindsight: the episodes in the replay buffer go on.
HINDSIGHT = (*SAC, "env.max_episode_steps=8", "model.learning_starts=40")


@pytest.mark.parametrize(
    ("algorithm", "changes", "env"),
    [
        ("ppo", PPO, GRASP),
        ("sac", SAC, GRASP),
        ("tqc", SAC, GRASP),
        ("sac", HINDSIGHT, "graspbox/Place-v0"),
    ],
)
def test_an_interrupted_run_ends_with_the_bits_of_one_that_was_not(
    tmp_path: Path, algorithm: str, changes: tuple[str, ...], env: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(algorithm, tmp_path / "whole", changes, env=env) == 0
    step = running.RunCallback._on_step

    def interrupted(self: Any) -> bool:
        if self.num_timesteps == 88:
            self.interrupt()
        return bool(step(self))

    with monkeypatch.context() as patch:
        patch.setattr(running.RunCallback, "_on_step", interrupted)
        assert run(algorithm, tmp_path / "parts", changes, env=env) == 130
    assert run(algorithm, tmp_path / "parts", changes, env=env) == 0
    whole, parts = (running.load_policy(algorithm, tmp_path / name / "checkpoint").model for name in ("whole", "parts"))
    states = whole.policy.state_dict(), parts.policy.state_dict()
    assert all((states[0][name] == states[1][name]).all() for name in states[0])
    assert [row["return"] for row in rows_of(tmp_path / "whole")] == [
        row["return"] for row in rows_of(tmp_path / "parts")
    ]


def test_the_same_seed_trains_the_same_policy(tmp_path: Path) -> None:
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        assert run("ppo", tmp_path / name, PPO, seed=seed) == 0
    a, b, c = (
        torch.cat([p.flatten() for p in sb3.PPO.load(tmp_path / name / "checkpoint/model.zip").policy.parameters()])
        for name in "abc"
    )
    assert (a == b).all()
    assert (a != c).any()


def test_an_off_policy_run_keeps_its_replay_buffer(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    assert run("sac", folder, SAC) == 0
    assert run("sac", folder, SAC, steps=192) == 0
    model = sb3.SAC.load(folder / "checkpoint/model.zip")
    model.load_replay_buffer(folder / "checkpoint/replay_buffer.pkl")
    assert model.replay_buffer.size() * 4 == 192
    assert not (folder / "best/replay_buffer.pkl").exists()


def test_decisions_are_trained_too(tmp_path: Path) -> None:
    """TD3, one decision per episode; a target that is not reached fails the run."""
    changes = (
        "num_envs=2",
        'env.objects=["procedural:can:0-9"]',
        "steps=16",
        "model.learning_starts=8",
    )
    settings = {"env": "graspbox/GraspPose-v0", "target": 1.0, "baselines": True, "episodes": 6}
    folder = tmp_path / "run"
    assert run("td3", folder, changes, **settings) == 1
    found = json.loads((folder / "baselines.json").read_text())
    assert found["planner"]["success"] > max(0.5, found["random"]["success"])
    plot = script("plot_sb3")
    plot.main([folder], out=tmp_path / "picture.png")
    assert (tmp_path / "picture.png").stat().st_size > 10_000


SHOWN = ("env.control_freq=5", "env.max_episode_steps=50", "normalize.reward=false", "demonstrations=12", "num_envs=4")


def test_demonstrations_are_half_of_what_sac_sees(tmp_path: Path) -> None:
    from graspbox.learn.sb3.running import DemonstratedBuffer

    folder = tmp_path / "run"
    changes = (*SHOWN, 'env.objects=["procedural:can:0-9"]', "demonstrations=2", "steps=64")
    assert run("sac", folder, (*changes, "model.learning_starts=16", "model.buffer_size=512")) == 0
    model = sb3.SAC.load(folder / "checkpoint/model.zip", custom_objects={"replay_buffer_class": DemonstratedBuffer})
    model.load_replay_buffer(folder / "checkpoint/replay_buffer.pkl")
    buffer = model.replay_buffer
    assert isinstance(buffer, DemonstratedBuffer)
    assert buffer.demonstrations is not None
    # Two successes, each at the end of its episode.
    assert buffer.demonstrations.dones.sum() == 2
    shown = {row.tobytes() for row in buffer.demonstrations.observations[:, 0]}
    drawn = [row.tobytes() for row in buffer.sample(32).observations.numpy()]
    assert sum(row in shown for row in drawn) == 16


def test_demonstrations_to_replay_are_of_one_vector(tmp_path: Path) -> None:
    changes = (*SHOWN, 'env.objects=["procedural:can:0-9"]', "env.obs=[proprio, tactile]")
    with pytest.raises(ConfigError, match="sac replays demonstrations of one vector only"):
        run("sac", tmp_path / "run", changes)


def test_a_checkpoint_of_a_former_version_is_refused(tmp_path: Path) -> None:
    assert run("ppo", tmp_path / "run", PPO) == 0
    (tmp_path / "run/checkpoint/state.pkl").unlink()
    with pytest.raises(ConfigError, match="is of a former version; train in another folder"):
        run("ppo", tmp_path / "run", PPO, steps=512)


def test_baselines_share_the_trials_of_a_policy() -> None:
    from graspbox import evaluation
    from graspbox.sb3.policy import evaluate_baselines, summary

    env_id = "graspbox/Grasp-v0"
    trials: dict[str, Any] = {"objects": "procedural:can:0-9", "max_episode_steps": 200}
    found = evaluate_baselines(env_id, 3, 6, 0, **trials)
    assert list(found) == ["random", "zero", "planner"]
    assert found["zero"]["success"] == found["random"]["success"] == 0.0
    assert found["planner"]["success"] > 0.5
    assert found["planner"] == summary(evaluation.evaluate("planner", env_id, trials=6, seed=0, **trials))


def test_a_result_without_trials_has_no_summary() -> None:
    from graspbox.evaluation import Evaluation
    from graspbox.sb3.policy import summary

    with pytest.raises(ConfigError, match=r"no trial of zero.*\(flat: it has no volume\); name other objects"):
        summary(Evaluation("zero", "graspbox/Grasp-v0", (), 0.0, refused={"flat": "it has no volume"}))


def test_images_are_trained_on(tmp_path: Path) -> None:
    changes = (*PPO, "env.obs=[proprio, depth]", "env.image_size=16", "steps=128")
    assert run("ppo", tmp_path / "run", changes) == 0
    model = sb3.PPO.load(tmp_path / "run/checkpoint/model.zip")
    assert type(model.policy.features_extractor).__name__ == "Extractor"


def test_ctrl_c_saves_and_the_run_goes_on(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    changes = [part for change in PPO for part in ("--set", change)]
    command = [sys.executable, "-m", "graspbox", "train", "sb3", "ppo", "--out", str(folder), "--json", *changes]
    # An evaluation every 128 steps.
    command += ["--steps", "1000064", "--evaluations", "7813", "--episodes", "4", "--video", "0"]
    log = folder / "evaluations.jsonl"
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        while child.poll() is None and not (log.is_file() and len(log.read_text().splitlines()) > 2):
            time.sleep(0.05)
        child.send_signal(signal.SIGINT)
        output, _ = child.communicate()
        assert child.returncode == 130
    result = json.loads(output)
    assert result["interrupted"]
    steps = json.loads((folder / "checkpoint/progress.json").read_text())["timesteps"]
    assert steps == result["timesteps"] >= 256
    assert not list(folder.glob("checkpoint.*"))
    end = steps + 128
    assert run("ppo", folder, PPO, steps=end) == 0
    assert rows_of(folder)[-1]["timesteps"] >= end
    assert np.all(np.diff([row["seconds"] for row in rows_of(folder)]) > 0)


@pytest.mark.parametrize(
    ("algorithm", "changes", "message"),
    [
        ("ppo", ("gamma",), "names no parameter"),
        ("ppo", ("model.gamma.x=1",), "names no parameter"),
        ("ppo", ("colour=1",), "there is no parameter 'colour'; choose from steps"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, algorithm: str, changes: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        run(algorithm, tmp_path / "run", changes)
    assert not (tmp_path / "run").exists()


def test_every_entry_names_what_exists() -> None:
    """Each of the parameters makes its model, on environments and a buffer of small size."""
    import yaml

    found = yaml.safe_load(PARAMETERS.read_text())
    from graspbox.learn.sb3.running import ALGORITHMS, make_env, model_arguments

    for algorithm, entries in found.items():
        for env_id, shown in [(name, shown) for name in entries for shown in (False, name not in GOAL_IDS)]:
            parameters = read_parameters(PARAMETERS, algorithm, env_id, demonstrated=shown)
            env = make_env(env_id, 1, **{**parameters.env, "objects": "procedural:ball:0"})
            settings = model_arguments(ALGORITHMS[algorithm], parameters.model, env, parameters.demonstrations)
            if "buffer_size" in settings:
                settings["buffer_size"] = 16
            else:
                settings["n_steps"] = settings["batch_size"]
            model = ALGORITHMS[algorithm](env=env, device="cpu", **settings)
            assert model.gamma == parameters.model["gamma"]
            env.close()


def program_env() -> Any:
    """Make a few small environments."""
    from graspbox.learn.sb3.running import make_env

    return make_env("graspbox/Grasp-v0", 4, objects="procedural:ball:0", max_episode_steps=8)


def test_a_run_interrupted_before_its_first_checkpoint_begins_anew(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with Run(folder, {"algorithm": "none"}):
        pass
    assert run("ppo", folder, PPO) == 0
    log = folder / "evaluations.jsonl"
    kept = log.read_text()
    # Evaluations are not thrown away.
    shutil.rmtree(folder / "checkpoint")
    with pytest.raises(ConfigError, match="no checkpoint"):
        run("ppo", folder, PPO)
    assert log.read_text() == kept


def test_minutes_cap_a_run_and_space_its_evaluations(tmp_path: Path) -> None:
    """A run that would take hours ends, with ten evaluations, or fewer if one takes longer than a tenth of the time."""
    folder = tmp_path / "run"
    assert run("ppo", folder, PPO, steps=10**7, minutes=0.2, evaluations=10) == 0
    assert rows_of(folder)[-1]["timesteps"] < 10**6
    assert 2 <= len(rows_of(folder)) <= 12
    # The cap is that of a call: resumed, the run continues for as long.
    before = rows_of(folder)[-1]["timesteps"]
    assert run("ppo", folder, PPO, steps=10**7, minutes=0.05) == 0
    assert rows_of(folder)[-1]["timesteps"] > before


def test_a_run_has_ten_evaluations_by_default(tmp_path: Path) -> None:
    assert Sb3Settings(algorithm="ppo", out=tmp_path).evaluations == 10
    assert run("ppo", tmp_path / "run", PPO, steps=1280, episodes=2, evaluations=10) == 0
    assert [row["timesteps"] for row in rows_of(tmp_path / "run")] == [128 * i for i in range(11)]


def test_a_trained_policy_is_evaluated_as_the_run_did(tmp_path: Path) -> None:
    """The same episodes give the last row of the run."""
    folder = tmp_path / "run"
    assert run("ppo", folder, PPO) == 0
    last = rows_of(folder)[-1]
    options: dict[str, Any] = {"split": "validation", "include_learned": True, "trials": last["episodes"]}
    found = summary(evaluation.evaluate(str(folder / "checkpoint"), seed=EVALUATION_SEED, **options))
    assert found == {name: pytest.approx(last[name]) if name == "return" else last[name] for name in found}


def test_an_off_policy_run_is_evaluated_without_its_buffer(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    assert run("sac", folder, SAC) == 0
    (folder / "checkpoint/replay_buffer.pkl").unlink()
    for checkpoint in ("checkpoint", "best"):
        options: dict[str, Any] = {"split": "train", "include_learned": True, "trials": 4}
        assert len(evaluation.evaluate(str(folder / checkpoint), **options).trials) == 4
