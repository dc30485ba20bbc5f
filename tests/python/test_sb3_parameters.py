"""Wrong values of ``graspbox train sb3 --set``: a sentence before a run begins. Needs the extra ``train``."""

import re
from pathlib import Path
from typing import Any

import pytest

from graspbox.errors import ConfigError
from graspbox.learn.sb3.settings import Sb3Settings

pytestmark = pytest.mark.train

pytest.importorskip("stable_baselines3")
training = pytest.importorskip("graspbox.learn.sb3.training")


def refusal(algorithm: Any, folder: Path, *changes: str) -> str:
    """Try to train with changes of the parameters; the error."""
    with pytest.raises(ConfigError) as caught:
        training.train(Sb3Settings(algorithm=algorithm, out=folder, set=changes), "graspbox train sb3", print)
    return str(caught.value)


@pytest.mark.parametrize(
    ("algorithm", "change", "message"),
    [
        ("ppo", "model.gama=0.9", "no argument of PPO 'gama'; did you mean 'gamma'?"),
        ("sac", "model.n_epochs=3", "no argument of SAC 'n_epochs';"),
        ("sac", "model.learning_start=3", "did you mean 'learning_starts'?"),
        ("ppo", "model.policy_kwargs.net_arc=[3]", "'net_arc'; did you mean 'net_arch'?"),
        ("ppo", "model.policy_kwargs.activation_fn=Tan", "no activation 'Tan'; did you mean 'Tanh'?"),
        ("ppo", "demonstration=3", "no parameter 'demonstration'; did you mean 'demonstrations'?"),
        ("ppo", "demonstrations=5", "ppo learns from its own episodes alone; sac, tqc and td3 replay demonstrations"),
        ("ppo", "demonstrations=-1", "demonstrations is -1 (int); give an integer of at least 0"),
        ("ppo", "steps=0", "steps is 0 (int); give an integer of at least 1"),
        ("ppo", "num_envs=-1", "num_envs is -1 (int); give an integer of at least 1"),
        ("ppo", "num_envs=2.5", "num_envs is 2.5 (float); give an integer of at least 1"),
        ("ppo", "normalize=3", "normalize is 3 (int); give observations and reward, true or false each"),
        ("ppo", "normalize.rewards=true", "give observations and reward, true or false each"),
        ("ppo", "model=3", "model is 3 (int); give names with their values"),
        ("ppo", "model.batch_size=0", "model.batch_size is 0 (int); give an integer of at least 2"),
        ("ppo", "model.gamma=2", "model.gamma is 2 (int); give a number from 0 to 1"),
        ("ppo", "model.learning_rate=linear_x", "model.learning_rate is 'linear_x' (str); give a positive number, or"),
        ("ppo", "model.target_kl=x", "model.target_kl is 'x' (str); give a number of at least 0, or null"),
        ("sac", "model.gradient_steps=0", "model.gradient_steps is 0 (int); give an integer of at least 1, or -1"),
        ("sac", "model.ent_coef=x", "model.ent_coef is 'x' (str); give a number of at least 0"),
        ("ppo", "env.num_envs=3", "env.num_envs is given by the training; set num_envs"),
        ("ppo", "env.split=test", "env.split is given by the training; training uses train"),
    ],
)
def test_a_wrong_value_is_explained_before_a_run_begins(
    tmp_path: Path, algorithm: str, change: str, message: str
) -> None:
    assert message in refusal(algorithm, tmp_path / "run", change)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("change", ["model.policy_kwargs.net_arch=64", "model.policy_kwargs.net_arch=[-3]"])
def test_what_an_algorithm_refuses_is_no_traceback(tmp_path: Path, change: str) -> None:
    changes = (
        change,
        "num_envs=2",
        "model.n_steps=64",
        "model.batch_size=128",
        "demonstrations=0",
        "env={objects: procedural:can:0-9}",
    )
    assert re.match("PPO refuses the values of model: ", refusal("ppo", tmp_path, *changes))
