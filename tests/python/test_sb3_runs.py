"""Runs of ``graspbox train sb3`` and ``clone`` as policies: loaded by their folders, and taken by every command."""

import json
import logging
import pickle
import shutil
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from command_line import invoke
from graspbox import evaluation, policies
from graspbox._common.runs import Rows, read_settings
from graspbox.envs import GOAL_OBSERVATIONS
from graspbox.errors import ConfigError
from graspbox.learn.sb3.runs import next_commands, policy_of_run
from graspbox.learn.sb3.settings import EVALUATION_SEED, CloneSettings, Sb3Settings
from graspbox.policies import Task
from graspbox.policies.network import ActingNetwork
from test_scripts import script

pytestmark = pytest.mark.train

pytest.importorskip("stable_baselines3")
torch = pytest.importorskip("torch")
export = pytest.importorskip("graspbox.learn.sb3.export")
running = pytest.importorskip("graspbox.learn.sb3.running")
training = pytest.importorskip("graspbox.learn.sb3.training")
Image = pytest.importorskip("PIL.Image")

CLOSED, ONCE = "graspbox/Grasp-v0", "graspbox/GraspPose-v0"
#: Entries of the file of parameters. Of ten cans, none of these belongs to the split `test`.
PARAMETERS = f"""
ppo:
  {CLOSED}:
    steps: 256
    num_envs: 4
    normalize: {{observations: true, reward: false}}
    env: {{objects: ["procedural:can:0-39"], reward: dense, max_episode_steps: 12, control: top_down, control_freq: 10}}
    model: {{n_steps: 16, batch_size: 32, n_epochs: 1, gamma: 0.97, policy_kwargs: {{net_arch: [16]}}}}
sac:
  {ONCE}:
    steps: 48
    num_envs: 4
    normalize: {{observations: true, reward: false}}
    env: {{objects: "procedural:can:0-39", reward: dense}}
    model: {{learning_starts: 16, buffer_size: 512, batch_size: 16, gamma: 0.0, policy_kwargs: {{net_arch: [16]}}}}
  graspbox/Reach-v0:
    steps: 48
    num_envs: 2
    normalize: {{observations: true, reward: false}}
    env: {{objects: ["procedural:box:0-39"], max_episode_steps: 8}}
    model:
      replay_buffer_class: HerReplayBuffer
      learning_starts: 20
      buffer_size: 512
      batch_size: 16
      gamma: 0.9
      policy_kwargs: {{net_arch: [16]}}
"""
REACH = "graspbox/Reach-v0"
FEELS = 'env.obs=["proprio", "tactile"]'


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder with the file of parameters."""
    folder = tmp_path_factory.mktemp("runs")
    (folder / "parameters.yaml").write_text(PARAMETERS)
    return folder


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """Leave the number of torch's threads as it was."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def train(folder: Path, algorithm: Any = "ppo", env: str = CLOSED, **settings: Any) -> str:
    """Train in this process; returns the last line."""
    parameters = folder.parent / "parameters.yaml"
    given: dict[str, Any] = {"episodes": 6, "evaluations": 2, "video": 0, "parameters": parameters}
    options = Sb3Settings(algorithm=algorithm, out=folder, env=env, **{**given, **settings})
    return str(training.train(options, "graspbox train sb3", lambda _: None).text.splitlines()[-1])


@pytest.fixture(scope="module")
def run(made: Path) -> Path:
    """Train PPO on what a hand feels."""
    assert train(made / "felt", set=(FEELS,), video=2) == next_commands(made / "felt")
    return made / "felt"


@pytest.fixture(scope="module")
def decisions(made: Path) -> Path:
    """Train SAC on decisions, from the state."""
    train(made / "decided", "sac", ONCE)
    return made / "decided"


@pytest.fixture(scope="module")
def reaching(made: Path) -> Path:
    """Train SAC with hindsight in a goal task."""
    train(made / "reaching", "sac", REACH)
    return made / "reaching"


def test_a_run_with_goals_is_a_policy(reaching: Path, tmp_path: Path) -> None:
    """It is evaluated, recorded as a video and exported like others; success is that of the last step."""
    policy = policies.load(str(reaching))
    assert (policy.env_id, policy.obs) == (REACH, "proprio")
    found = evaluation.evaluate(policy, trials=4, **policy.settings)
    assert [trial.steps for trial in found.trials] == [8] * 4
    assert all(trial.failure == ("" if trial.success else "goal_missed") for trial in found.trials)
    assert not any(trial.secure for trial in found.trials)
    played = invoke(["play", reaching, "--video", tmp_path / "reach.webp", "--episodes", "1"])
    assert played.exit_code == 0, played.output
    assert "graspbox view" not in next_commands(reaching)
    for words in (["view", reaching], ["serve-policy", reaching]):
        with pytest.raises(ConfigError, match="acts in the goal task 'graspbox/Reach-v0'"):
            invoke(words, catch_exceptions=False)
    settings = read_settings(reaching)
    model = running.load_policy("sac", reaching / "best")
    keywords = {"algorithm": "sac", "env_id": REACH, "env": settings["env"], "learned_from": policy.learned_from}
    config = export.export_policy(
        tmp_path / "published", "reach", model, policy_kwargs=settings["model"]["policy_kwargs"], **keywords
    )
    assert {one.name for one in config.inputs} == set(GOAL_OBSERVATIONS)
    again = evaluation.evaluate(str(tmp_path / "published"), REACH, ["procedural:box:0-39"], trials=4, split="test")
    assert [trial.success for trial in again.trials] == [trial.success for trial in found.trials]


def test_the_card_of_a_run_with_goals_says_what_is_privileged(reaching: Path, tmp_path: Path) -> None:
    given = [str(reaching), "--out", str(tmp_path / "reach"), "--objects", "procedural:box:0-39/test", "--trials", "2"]
    assert script("publish_sb3").main(given) == 0
    card = " ".join((tmp_path / "reach/README.md").read_text().split())
    assert "It is **privileged**: no sensor measures `achieved_goal`; the simulation supplies it." in card


def test_threads_do_not_mix_their_actions(run: Path) -> None:
    """As those of a server with several clients: each answer is that of the observation asked about."""
    policy: Any = policies.load(run)
    network, random = policy._network(), np.random.default_rng(0)
    asked = [
        {one.name: random.normal(size=(1, *one.shape)).astype(np.float32) for one in policy._inputs} for _ in range(400)
    ]
    wanted = [network(rows)["action"] for rows in asked]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(8) as threads:
            found = list(threads.map(lambda rows: network(rows)["action"], asked))
    finally:
        sys.setswitchinterval(interval)
    assert all((one == other).all() for one, other in zip(found, wanted, strict=True))


def best_row(run: Path) -> dict[str, Any]:
    return max(Rows(run / "evaluations.jsonl"), key=lambda row: (row["success"], row["return"]))


def test_a_run_names_its_environment_and_its_objects(run: Path) -> None:
    policy = policies.load(run)
    assert (policy.name, policy.env_id, policy.obs) == ("felt/best", CLOSED, ("proprio", "tactile"))
    acting = {"control": "top_down", "fingers": "synergy", "control_freq": 10, "max_episode_steps": 12}
    assert policy.settings == {**acting, "hand": "reflex", "reward": "dense"}
    assert policy.learned_from == ("procedural:can:0-39/train", "procedural:can:0-39/validation")
    assert policy.default_objects() == (["procedural:can:0-39"], "test")
    last = policies.load(str(run / "checkpoint"))
    assert (last.name, last.learned_from) == ("felt/checkpoint", ("procedural:can:0-39/train",))


def test_its_video_shows_its_episodes(run: Path) -> None:
    """Each lasts at most 12 steps at 10 Hz, and a second more."""
    with Image.open(run / "video.webp") as video:
        assert 2 * (2 + 10) <= video.n_frames <= 2 * (12 + 10)


@pytest.mark.parametrize("name", ["run", "decisions"])
def test_it_acts_as_the_model_that_was_evaluated(name: str, request: pytest.FixtureRequest) -> None:
    """The trials of the best evaluation have the same results, with any number of environments."""
    folder: Path = request.getfixturevalue(name)
    row = best_row(folder)
    assert json.loads((folder / "best/progress.json").read_text())["timesteps"] == row["timesteps"]
    keywords: dict[str, Any] = {"split": "validation", "trials": 6, "seed": EVALUATION_SEED, "include_learned": True}
    one, four = (
        evaluation.evaluate(str(folder), objects="procedural:can:0-39", num_envs=n, **keywords) for n in (1, 4)
    )
    assert one.trials == four.trials
    assert one.rate == row["success"]
    assert np.mean([trial.reward for trial in one.trials]) == pytest.approx(row["return"], abs=1e-3)


def test_by_default_it_is_measured_on_objects_held_out(run: Path, decisions: Path) -> None:
    found = evaluation.evaluate(str(run), trials=4)
    assert found.objects_left_out == 0
    assert {trial.object for trial in found.trials} <= set(unseen_cans())
    assert evaluation.evaluate(str(decisions), trials=4).env_id == ONCE


def unseen_cans() -> list[str]:
    from graspbox import object_sets

    return list(object_sets.load("procedural:can:0-39", split="test").names)


def test_images_are_observed_as_the_environment_has_them(made: Path) -> None:
    """Colours, and depth as bytes."""
    observed = ('env.obs=["depth", "proprio", "rgb"]', "env.image_size=16", "env.depth_limits=[0.1, 1.0]")
    seen: dict[str, Any] = {"set": observed, "evaluations": 1}
    for steps in (64, 128):
        train(made / "seen", steps=steps, **seen)
    assert [row["timesteps"] for row in Rows(made / "seen/evaluations.jsonl")] == [0, 64, 128]
    policy = policies.load(made / "seen")
    assert policy.settings["image_size"] == 16
    assert policy.settings["depth_limits"] == [0.1, 1.0]
    assert len(evaluation.evaluate(policy, trials=2).trials) == 2
    keywords: dict[str, Any] = {**policy.settings, "obs": policy.obs, "image_size": 32}
    envs = gymnasium.make_vec(CLOSED, 1, objects="procedural:can:0", **keywords)
    with pytest.raises(ConfigError, match=r"'depth' has shape \(32, 32, 1\) .* needs \(16, 16, 1\) and uint8"):
        policy.bind(Task.of(envs))
    envs.close()


def test_the_last_checkpoint_of_equal_success_has_the_greatest_return(run: Path) -> None:
    """Success decides, and no random grasp of this run succeeds: the untrained policy is not the best for ever."""
    rows = Rows(run / "evaluations.jsonl")
    assert len({row["return"] for row in rows}) == len(rows) == 3
    kept = json.loads((run / "best/progress.json").read_text())["timesteps"]
    assert kept == max(rows, key=lambda row: (row["success"], row["return"]))["timesteps"]


def test_losses_go_on_from_the_checkpoint(made: Path) -> None:
    folder = made / "resumed"
    train(folder)
    rows = Rows(folder / "losses.jsonl")
    assert {"train/value_loss", "rollout/ep_rew_mean", "rollout/ep_len_mean"} <= set().union(*rows)
    assert not any(name.startswith(("eval/", "time/")) for row in rows for name in row)
    # A row after the checkpoint, which an interruption left.
    rows.append({"step": 300, "seconds": 1.0, "train/loss": -1.0})
    train(folder, steps=384, evaluations=3)
    steps = [row["step"] for row in Rows(folder / "losses.jsonl")]
    assert steps == sorted(steps)
    assert 300 not in steps
    assert max(steps) == 384


def copied(run: Path, folder: Path, **changes: Any) -> Path:
    """Copy a run, with other settings."""
    shutil.copytree(run, folder)
    (folder / "settings.json").write_text(json.dumps(read_settings(folder) | changes))
    return folder


def test_what_is_no_policy_yet_is_refused(run: Path, tmp_path: Path) -> None:
    begun = copied(run, tmp_path / "begun")
    shutil.rmtree(begun / "best")
    with pytest.raises(ConfigError, match="has no checkpoint 'best' yet; its first evaluation writes it"):
        policies.load(begun)
    recurrent = copied(run, tmp_path / "recurrent", algorithm="recurrent_ppo")
    with pytest.raises(ConfigError, match=r"algorithm is 'recurrent_ppo'; only policies of ppo, sac.*no memory"):
        policies.load(recurrent)
    damaged = copied(run, tmp_path / "damaged")
    (damaged / "best/model.zip").write_bytes((damaged / "best/model.zip").read_bytes()[:1000])
    with pytest.raises(ConfigError, match=r"damaged/best cannot be read, it is damaged or of another version"):
        policies.load(damaged)
    with pytest.raises(ConfigError, match="'felt/best' does not take 'rehearsed'"):
        policies.load(run, rehearsed=4)
    for other in (run / "tensorboard", tmp_path):
        assert policy_of_run(other) is None
        with pytest.raises(
            ConfigError, match=r"there is no config.json in .*; name the folder of a policy or of a run"
        ):
            policies.load(other)


def test_a_run_whose_trials_were_of_the_test_split_is_shown_on_another(run: Path, tmp_path: Path) -> None:
    policy = policies.load(copied(run, tmp_path / "tested", evaluate="test"))
    assert policy.default_objects() == (["procedural:can:0-39"], "validation")
    assert policy.default_objects("train") == (["procedural:can:0-39"], "train")


def test_a_clone_and_what_begins_as_one(made: Path, caplog: pytest.LogCaptureFixture) -> None:
    from graspbox.data.episodes import record
    from graspbox.learn.sb3 import cloning

    shown, clone = made / "shown", made / "clone"
    record("expert", shown, CLOSED, "procedural:box:0-39", 10, ("proprio",), num_envs=4, split="train")
    parameters: dict[str, Any] = {"parameters": made / "parameters.yaml"}
    options = CloneSettings(
        algorithm="ppo", demonstrations=(shown,), out=clone, epochs=1, episodes=2, obs=("proprio",), **parameters
    )
    outcome = cloning.train(options, "graspbox train clone", lambda _: None)
    assert outcome.text.splitlines()[-1] == next_commands(clone)
    policy = policies.load(clone)
    assert (policy.name, policy.obs) == ("clone/checkpoint", "proprio")
    assert policy.settings["fingers"] == "each"
    assert policy.learned_from == ("procedural:box:0-39/train",)
    more, second = made / "more", made / "second"
    record("expert", more, CLOSED, "procedural:can:0-39", 10, ("proprio",), num_envs=4, split="train")
    cloning.train(replace(options, demonstrations=(more,), out=second, clone=clone), "", lambda _: None)
    learned = ("procedural:box:0-39/train", "procedural:can:0-39/train")
    assert policies.load(second).learned_from == learned
    shutil.rmtree(clone)
    with caplog.at_level(logging.WARNING):
        assert policies.load(second).learned_from == learned[1:]
    assert "second learned are unknown: it is missing" in caplog.text


def answer(*words: Any) -> Any:
    """Run a command that prints JSON."""
    result = invoke([*words, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def test_every_command_takes_a_run(run: Path, tmp_path: Path) -> None:
    found = answer("evaluate", run, "--trials", 3, "--out", tmp_path / "found.json")
    assert (found["policy"], found["trials"]) == ("felt/best", 3)
    played = answer("play", run, "--episodes", 3, "--video", tmp_path / "film.gif")
    trials = json.loads((tmp_path / "found.json").read_text())["rows"]
    wanted = [[row[name] for name in ("seed", "object", "success", "steps")] for row in trials]
    assert [[row[name] for name in ("seed", "object", "success", "steps")] for row in played["episodes"]] == wanted
    assert answer("report", run, "--out", tmp_path / "page.html")["bytes"] > 100_000
    assert answer("record", run, "--out", tmp_path / "shown", "--obs", "proprio", "--objects", "procedural:can:0-39",
                  "--keep", "all", "--episodes", 2)["episodes"] == 2  # fmt: skip


def test_a_run_is_served(run: Path) -> None:
    from graspbox.policies.remote_policy import RemotePolicy
    from graspbox.tools.remote.policy_serving import PolicyServer, PolicyServerSettings

    keywords: dict[str, Any] = {"trials": 3, "objects": "procedural:can:0-39", "split": "test"}
    with PolicyServer(run, PolicyServerSettings(port=0)) as server:
        served = evaluation.evaluate(RemotePolicy(server.url), CLOSED, **keywords)
    assert served.trials == evaluation.evaluate(str(run), **keywords).trials


def test_a_run_is_viewed(run: Path) -> None:
    pytest.importorskip("viser")
    from graspbox.tools.viewer import show

    with show(run, port=0) as viewer:
        page: Any = viewer.page
        assert page.policy.name == "felt/best"
        assert page.info["object"] in unseen_cans()
        page.step()
        assert page.steps == 1
        assert page.native._core.control == "top_down"


def test_a_report_has_the_curves_of_its_algorithm(run: Path) -> None:
    """Also of a run without losses, and of one that began by cloning."""
    pytest.importorskip("altair")
    from graspbox.tools.reports import charts, read_run

    (read,) = read_run(run)
    curves = {curve.measure: curve for curve in read.curves}
    assert list(curves)[:3] == [
        "success on held-out objects",
        "secure grasps on held-out objects",
        "return on held-out objects",
    ]
    rows = Rows(run / "evaluations.jsonl")
    assert list(curves["return on held-out objects"].values) == [row["return"] for row in rows]
    assert list(curves["return on held-out objects"].steps) == [0, 128, 256]
    assert {"train/value_loss", "train/approx_kl", "rollout/ep_rew_mean", "rollout/ep_len_mean"} <= set(curves)
    assert json.loads(read.facts["best evaluation"]) == best_row(run)
    drawn = dict(charts.curve_charts([read], [read.name]))
    scale = drawn["success on held-out objects"]["encoding"]["y"]["scale"]
    assert scale["domain"] == [0, 1]


def test_copies_share_the_network_and_pickle(run: Path) -> None:
    """A policy server copies its policy for each client."""
    from copy import deepcopy

    policy = policies.load(run)
    assert isinstance(policy, ActingNetwork)
    assert deepcopy(policy)._network is policy._network
    found = evaluation.evaluate(pickle.loads(pickle.dumps(policy)), trials=2)
    assert found.trials == evaluation.evaluate(policy, trials=2).trials
