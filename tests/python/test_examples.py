"""The programs in ``scripts/examples`` run as they stand."""

import importlib
import os
from pathlib import Path
from types import ModuleType

import pytest

from program_files import imported

EXAMPLES = Path(__file__).parents[2] / "scripts/examples"


def need(module: str, why_not: str) -> None:
    """Skip a test without a module, but where it must be there (`make test-examples`)."""
    if os.environ.get("GRASPBOX_REQUIRE_EXAMPLES"):
        importlib.import_module(module)
    else:
        pytest.importorskip(module, reason=why_not)


def example(name: str) -> ModuleType:
    """Import a program without running it."""
    return imported(EXAMPLES / f"{name}.py")


@pytest.mark.train
def test_cleanrl_style_ppo(capsys: pytest.CaptureFixture[str]) -> None:
    """A few updates, over ends of episodes."""
    pytest.importorskip("torch")
    example("cleanrl_ppo").main(
        "graspbox/Grasp-v0",
        "procedural:can:0-9",
        steps=3 * 4 * 150,
        num_envs=4,
        rollout=150,
        learning_rate=5e-4,
        seed=0,
    )
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    assert lines[-1].startswith("1800 steps, return ")
    assert "return nan" in lines[0]
    assert "nan" not in lines[-1]


@pytest.mark.train
def test_its_advantages_are_those_of_the_definition() -> None:
    """Sums of temporal differences, discounted, that stop where an episode does."""
    torch = pytest.importorskip("torch")
    program = example("cleanrl_ppo")
    rewards, values, after = torch.rand(3, 6, 1).unbind(0)
    dones = torch.tensor([0.0, 0, 1, 0, 0, 0])[:, None]
    found = program.advantages(rewards, values, after, dones)
    delta = rewards + program.GAMMA * after - values
    for t in range(6):
        end = 2 if t <= 2 else 5
        wanted = sum((program.GAMMA * program.LAMBDA) ** (k - t) * delta[k] for k in range(t, end + 1))
        torch.testing.assert_close(found[t], wanted)


@pytest.mark.filterwarnings("ignore")
def test_torchrl_rolls_out() -> None:
    need("torchrl", "TorchRL is in no extra; the example says how to install it")
    env = example("torchrl_env").make("procedural:can:0")
    env.set_seed(0)
    rollout = env.rollout(5)
    assert rollout["depth"].shape == (5, 64, 64, 1)
    assert rollout["next", "reward"].shape == (5, 1)


@pytest.mark.filterwarnings("ignore")
def test_rllib_trains() -> None:
    need("ray.rllib", "RLlib pins another Gymnasium; it has an extra of its own, rllib")
    example("rllib_ppo").main(iterations=1, runners=0)
