"""Policies whose critic observes the state: ``critic`` in the parameters of ``graspbox train sb3``. Needs ``train``."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox import evaluation, policies
from graspbox.errors import ConfigError
from graspbox.learn.sb3.settings import PARAMETERS, Sb3Settings, read_parameters

pytestmark = pytest.mark.train

torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
export = pytest.importorskip("graspbox.learn.sb3.export")
training = pytest.importorskip("graspbox.learn.sb3.training")
running = pytest.importorskip("graspbox.learn.sb3.running")

SMALL = ("num_envs=2", "env.max_episode_steps=8", 'env.objects=["procedural:can:0-9"]', "env.image_size=32")
APART = (*SMALL, "env.obs=[depth, proprio]", "critic=[state]", "model.policy_kwargs.net_arch=[16]")
ON = (*APART, "steps=32", "model.n_steps=8", "model.batch_size=16", "model.n_epochs=1")
OFF = (*APART, "steps=32", "model.learning_starts=8", "model.buffer_size=64", "model.batch_size=8")
CHANGES = {"ppo": ON, "sac": OFF, "tqc": OFF, "td3": OFF}


def run(algorithm: Any, folder: Path, changes: tuple[str, ...], **settings: Any) -> int:
    options: Any = Sb3Settings(
        algorithm=algorithm, out=folder, set=changes, episodes=2, evaluations=1, video=0, **settings
    )
    return int(training.train(options, "graspbox train sb3", lambda _: None).status)


@pytest.mark.parametrize("algorithm", CHANGES)
def test_the_actor_never_reads_what_the_critic_has(tmp_path: Path, algorithm: str) -> None:
    """Actions depend on the policy's observations alone, values on the critic's alone, and a run is a policy."""
    assert run(algorithm, tmp_path / "run", CHANGES[algorithm]) == 0
    model = running.load_policy(algorithm, tmp_path / "run/checkpoint").model
    envs = running.make_env(
        "graspbox/Grasp-v0", 2, objects="procedural:can:0-9", obs=("depth", "proprio", "state"), image_size=32
    )
    seen = envs.reset()
    own: dict[str, Any] = {name: torch.as_tensor(np.asarray(rows)) for name, rows in seen.items()}
    changed = {"actor": {**own, "state": own["state"] + 1.0}, "critic": {**own, "depth": own["depth"] * 0.5}}
    act = model.policy._predict
    assert torch.equal(act(own, deterministic=True), act(changed["actor"], deterministic=True))
    assert not torch.equal(act(own, deterministic=True), act(changed["critic"], deterministic=True))

    def value(rows: dict[str, Any]) -> Any:
        if algorithm == "ppo":
            return model.policy.predict_values(rows)
        found = model.critic(rows, torch.zeros(2, model.action_space.shape[0]))
        return found[0] if isinstance(found, tuple) else found

    assert torch.equal(value(own), value(changed["critic"]))
    assert not torch.equal(value(own), value(changed["actor"]))

    # As a policy, and as a network without torch, it has no state.
    policy = policies.load(str(tmp_path / "run"))
    assert policy.obs == ("depth", "proprio")
    acting: dict[str, Any] = {**policy.settings, "obs": policy.obs}
    found = evaluation.evaluate(policy, policy.env_id, objects="procedural:can:0-9", trials=2, **acting)
    assert len(found.trials) == 2
    env = {"obs": ["depth", "proprio"], "objects": ["procedural:can:0-3"], "image_size": 32, "max_episode_steps": 8}
    export.export_policy(
        tmp_path / "published",
        "tiny",
        running.load_policy(algorithm, tmp_path / "run/checkpoint"),
        algorithm=algorithm,
        env_id="graspbox/Grasp-v0",
        env=env,
        policy_kwargs={"net_arch": [16]},
        learned_from=("procedural:can:0-9",),
    )
    assert export.load_graph(tmp_path / "published").inputs == ("depth", "proprio")


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_an_extended_run_has_the_same_networks(tmp_path: Path, algorithm: str) -> None:
    assert run(algorithm, tmp_path / "run", CHANGES[algorithm]) == 0
    assert run(algorithm, tmp_path / "run", CHANGES[algorithm], steps=64) == 0
    assert running.load_policy(algorithm, tmp_path / "run/checkpoint").model.num_timesteps == 64


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (("critic=state",), r"critic is 'state' \(str\); give a list of observations, such as \[state\], or null"),
        (("critic=[]",), r"critic is \[\] \(list\); give a list"),
        (("critic=[state]", "demonstrations=5"), r"critic is \['state'\]; with --demonstrations it observes"),
    ],
)
def test_wrong_values_are_refused(changes: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_parameters(PARAMETERS, "sac", "graspbox/GraspPose-v0", changes)


def test_an_unknown_observation_of_the_critic_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="statf"):
        run("ppo", tmp_path / "run", (*ON, "critic=[statf]"))
