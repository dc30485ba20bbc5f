"""Behaviour cloning and fine-tuning from a clone: ``graspbox train clone``, ``train sb3 --clone``.

Needs the extra ``train``.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox import evaluation
from graspbox._common.runs import Rows, read_settings
from graspbox.data.episodes import Demonstrations, record
from graspbox.errors import ConfigError
from graspbox.learn.sb3.settings import CloneSettings

pytestmark = pytest.mark.train

sb3 = pytest.importorskip("stable_baselines3")
torch = pytest.importorskip("torch")
typer = pytest.importorskip("typer")
pytest.importorskip("pyarrow")
cloning = pytest.importorskip("graspbox.learn.sb3.cloning")
running = pytest.importorskip("graspbox.learn.sb3.running")
training = pytest.importorskip("graspbox.learn.sb3.training")
summary = pytest.importorskip("graspbox.sb3.policy").summary

OBJECTS = ("procedural:can:0-9",)
SEEING = ("depth", "proprio", "tactile")
NETWORKS = "model.policy_kwargs={net_arch: [32], log_std_init: -3.0}"
PPO = ("num_envs=2", "model.n_steps=32", "model.batch_size=32", "model.n_epochs=1", NETWORKS)
SAC = ("num_envs=2", "model.learning_starts=8", "model.buffer_size=256", "model.batch_size=16",
       "model.gradient_steps=1", "model.policy_kwargs={net_arch: [32]}")  # fmt: skip


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Leave the number of torch's threads as it was: runs set it."""
    threads = torch.get_num_threads()
    yield
    torch.set_num_threads(threads)


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten episodes of the expert."""
    out = tmp_path_factory.mktemp("cloning") / "shown"
    keywords: dict[str, Any] = {"objects": OBJECTS, "control_freq": 5, "max_episode_steps": 50, "image_size": 16}
    record("expert", out, episodes=10, obs=("state", *SEEING), num_envs=4, split="train", reward="firm", **keywords)
    return out


def measured(folder: Path) -> dict[str, Any]:
    """Evaluate a run on the trials of its evaluations."""
    options: dict[str, Any] = {"split": "validation", "include_learned": True}
    return dict(summary(evaluation.evaluate(str(folder), trials=2, seed=10_000, **options)))


def clone(algorithm: Any, source: Path, folder: Path, **settings: Any) -> dict[str, Any]:
    """Clone in this process."""
    changes = PPO if algorithm == "ppo" else SAC
    given = {"epochs": 2, "episodes": 2, "batch": 64, "set": changes, **settings}
    options: Any = CloneSettings(algorithm=algorithm, demonstrations=(source,), out=folder, **given)
    return dict(cloning.train(options, "graspbox train clone", lambda _: None).results)


def weights(folder: Path, part: str) -> Any:
    """Parameters of a part of the policy of a run, as one vector."""
    policy = running.load_policy(read_settings(folder)["algorithm"], folder / "checkpoint").model.policy
    return torch.cat([p.detach().flatten() for p in policy.get_submodule(part).parameters()])


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3"])
@pytest.mark.parametrize("obs", ["state", SEEING])
def test_a_batch_is_learned_by_heart(shown: Path, algorithm: str, obs: Any) -> None:
    """Every policy, from the vector and from depth with touch, can reproduce the actions of a batch."""
    from graspbox.learn.sb3.running import model_arguments

    steps = cloning.ClonedSteps([Demonstrations(shown)], obs)
    keywords = {**Demonstrations(shown).environment()[1], "obs": obs}
    env = running.normalized(running.make_env("graspbox/Grasp-v0", 1, **keywords), 0.9, observations=True, reward=False)
    given = {"policy_kwargs": {"net_arch": [128, 128]}, "gamma": 0.9}
    given |= {"n_steps": 8, "batch_size": 8} if algorithm == "ppo" else {"buffer_size": 1}
    kind = running.ALGORITHMS[algorithm]
    model = kind(env=env, device="cpu", seed=0, **model_arguments(kind, given, env, 0))
    cloning.observe(env, steps)
    observations, actions = steps[list(range(0, len(steps), 4))]
    optimizer = torch.optim.Adam(cloning.actor_parameters(model), lr=2e-3)
    errors = []
    for _ in range(300):
        loss, error = cloning.cloning_loss(model, observations, actions)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        errors.append(error.item())
    assert errors[-1] < 2e-3 < 0.05 < errors[0]
    # A deterministic policy reproduces the learned actions.
    policy = script_policy(model, env)
    arrays = (
        {name: rows.numpy() for name, rows in observations.items()} if isinstance(obs, tuple) else observations.numpy()
    )
    acted = policy.act(arrays)
    assert np.mean((acted - actions.numpy()) ** 2) < 2e-3
    if algorithm == "sac":
        spread = cloning.mean_actions(model, observations)[1]
        assert spread.mean().item() == pytest.approx(-2.4, abs=0.5)
    env.close()


def script_policy(model: Any, env: Any) -> Any:
    from graspbox.sb3.policy import ModelPolicy

    return ModelPolicy(model, env)


def test_statistics_are_those_of_the_demonstrations(shown: Path, tmp_path: Path) -> None:
    """Vectors are scaled by their mean and deviation in the demonstrations; images are left alone."""
    clone("ppo", shown, tmp_path / "c", obs=SEEING, epochs=1)
    policy = running.load_policy("ppo", tmp_path / "c/checkpoint")
    steps = cloning.ClonedSteps([Demonstrations(shown)], SEEING)
    assert set(policy.statistics.obs_rms) == {"proprio", "tactile"}
    scaled = policy.statistics.normalize_obs(steps.arrays())
    assert scaled["proprio"].mean(axis=0) == pytest.approx(0.0, abs=0.02)
    assert (scaled["depth"] == steps.arrays()["depth"]).all()
    assert not policy.statistics.training


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_an_interrupted_clone_is_continued(shown: Path, tmp_path: Path, algorithm: str, monkeypatch: Any) -> None:
    """Interrupted within the third of four epochs, it ends with the bits of one that was not."""
    whole = clone(algorithm, shown, tmp_path / "whole", epochs=4, evaluations=2)
    loss, calls = cloning.cloning_loss, []

    def stop(*given: Any) -> Any:
        calls.append(1)
        if len(calls) == stops:
            raise KeyboardInterrupt
        return loss(*given)

    epoch = whole["updates"] // 4
    # Each epoch ends with a validation of one batch.
    stops = 2 * (epoch + 1) + 2
    monkeypatch.setattr(cloning, "cloning_loss", stop)
    with pytest.raises(KeyboardInterrupt):
        clone(algorithm, shown, tmp_path / "parts", epochs=4, evaluations=2)
    monkeypatch.undo()
    with pytest.raises(ConfigError, match="holds a run; resume it"):
        clone(algorithm, shown, tmp_path / "parts", epochs=4, evaluations=2, resume=False)
    again = clone(algorithm, shown, tmp_path / "parts", epochs=4, evaluations=2)
    names = ("epoch", "updates", "trained", "held_out", "success")
    assert {name: again[name] for name in names} == {name: whole[name] for name in names}
    part = "mlp_extractor.policy_net" if algorithm == "ppo" else "actor"
    assert (weights(tmp_path / "whole", part) == weights(tmp_path / "parts", part)).all()
    rows = Rows(tmp_path / "parts/cloning/losses.jsonl")
    assert [row["step"] for row in rows] == [epoch, 2 * epoch, 3 * epoch, 4 * epoch]
    assert rows[-1]["train_error"] < rows[0]["train_error"]
    assert [row["timesteps"] for row in Rows(tmp_path / "parts/evaluations.jsonl")] == [2 * epoch, 4 * epoch]
    # A finished run has nothing left to do, and is evaluated as any run.
    assert clone(algorithm, shown, tmp_path / "parts", epochs=4, evaluations=2) == again
    with pytest.raises(ConfigError, match=r"clone\.epochs was 4, is now 5"):
        clone(algorithm, shown, tmp_path / "parts", epochs=5, evaluations=2)
    found = measured(tmp_path / "parts")
    assert (found["success"], found["secure"]) == (whole["success"], whole["secure"])


@pytest.mark.parametrize(("algorithm", "obs"), [("ppo", ("state",)), ("ppo", SEEING), ("sac", ("state",))])
def test_a_clone_begins_as_another(shown: Path, tmp_path: Path, algorithm: str, obs: tuple[str, ...]) -> None:
    """A clone that hardly learns stays what it began as, with the statistics of that one."""
    clone(algorithm, shown, tmp_path / "first", obs=obs, epochs=1)
    clone(algorithm, shown, tmp_path / "apart", obs=obs, epochs=1, rate=1e-9, seed=3)
    clone(algorithm, shown, tmp_path / "again", obs=obs, epochs=1, rate=1e-9, seed=3, clone=tmp_path / "first")
    actor = "action_net" if algorithm == "ppo" else "actor"
    first, apart, again = (weights(tmp_path / name, actor) for name in ("first", "apart", "again"))
    assert (again - first).abs().max() < 1e-6
    assert (apart - first).abs().max() > 1e-3
    before, after = (running.load_policy(algorithm, tmp_path / name / "checkpoint") for name in ("first", "again"))
    rms = before.statistics.obs_rms, after.statistics.obs_rms
    names = rms[0] if isinstance(rms[0], dict) else [None]
    for name in names:
        mine, its = (one if name is None else one[name] for one in rms)
        assert (mine.mean == its.mean).all()


def test_what_cannot_be_is_refused(shown: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--epochs is 0; pass 1 or more"):
        clone("ppo", shown, tmp_path / "x", epochs=0)
    with pytest.raises(ConfigError, match=r"--rate is 2\.0"):
        clone("ppo", shown, tmp_path / "x", rate=2.0)
    with pytest.raises(ConfigError, match="no observation 'voxels'"):
        clone("ppo", shown, tmp_path / "x", obs=("voxels",))
    with pytest.raises(ConfigError, match="5 episodes are too few"):
        clone("ppo", shown, tmp_path / "y", shown=5)
    with pytest.raises(ConfigError, match="keep is 'some'"):
        clone("ppo", shown, tmp_path / "x", keep="some")
    with pytest.raises(ConfigError, match="there is no run in"):
        clone("ppo", shown, tmp_path / "run", clone=tmp_path / "none")
    clone("ppo", shown, tmp_path / "clone", epochs=1)
    for given, message in (
        ({"algorithm": "sac"}, "is a policy of ppo; train it with that"),
        ({"obs": ("proprio", "tactile")}, "has the observation_space"),
        ({"set": (*PPO, "model.policy_kwargs={net_arch: [16]}")}, "has other networks"),
        ({"set": (*PPO, "normalize.observations=false")}, "normalize.observations differs"),
    ):
        settings: dict[str, Any] = {"algorithm": "ppo", "clone": tmp_path / "clone", **given}
        with pytest.raises(ConfigError, match=message):
            clone(source=shown, folder=tmp_path / f"run-{message[:9]}", **settings)
