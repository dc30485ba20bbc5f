"""Learning to correct another policy's grasps. Needs the extra ``train``."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict

from graspbox import evaluation, policies
from graspbox.errors import ConfigError
from graspbox.policies.residual import ResidualConfig

pytestmark = [pytest.mark.train, pytest.mark.usefixtures("one_thread")]

sb3 = pytest.importorskip("stable_baselines3")
torch = pytest.importorskip("torch")
pytest.importorskip("tyro", reason="graspbox train needs tyro, from the extra 'train'")

from stable_baselines3.common.save_util import load_from_pkl, save_to_pkl  # noqa: E402
from stable_baselines3.common.vec_env import VecEnvWrapper  # noqa: E402

from graspbox.cli.train import train  # noqa: E402
from graspbox.sb3 import Extractor  # noqa: E402
from graspbox.sb3.residual_training import (  # noqa: E402
    DecisionBuffer,
    load_residual,
    make_residual_env,
    train_seed,
)
from graspbox.sb3.settings import TEST_SEED, ResidualSettings  # noqa: E402

OBJECTS, MANY = ("procedural:can:0-9",), ("procedural:can:0-9", "procedural:box:0-9")
CONFIG = ResidualConfig(distance=0.03)


def settings(folder: Path, **given: Any) -> Any:
    """Make options of a small run."""
    small = {"objects": OBJECTS, "num_envs": 4, "watched": 2, "steps": 24, "evaluations": 1, "distance": 0.03}
    return ResidualSettings(base="seen_planner", out=folder, **{**small, **given})


def stop(found: Any) -> None:
    """End a run after its first step, in which nothing is learned yet."""
    found.interrupt()


def base() -> policies.Policy:
    return policies.load("partial_view_planner")


@pytest.mark.parametrize("algorithm", ["sac", "ppo"])
def test_a_run_begins_as_its_base_policy(algorithm: str, tmp_path: Path) -> None:
    found = train_seed(settings(tmp_path, algorithm=algorithm, objects=MANY, watched=8), 0, tmp_path, started=stop)
    assert found.last is not None
    policy, _ = load_residual(tmp_path / "checkpoint", base(), algorithm, CONFIG)
    given: dict[str, Any] = {"objects": list(MANY), "split": "validation", "seed": 10_000}
    results = [evaluation.evaluate(one, trials=8, num_envs=4, **given) for one in (base(), policy)]
    assert results[0].trials == results[1].trials
    assert found.last["success"] == results[0].rate


def test_the_buffer_keeps_what_was_seen_once(tmp_path: Path) -> None:
    boxes: dict[str, Any] = {"volume": Box(0, 255, (2, 3), np.uint8), "proposal": Box(-1.0, 1.0, (4,), np.float32)}
    space, rng = Dict(boxes), np.random.default_rng(0)
    buffer = DecisionBuffer(8, space, Box(-1.0, 1.0, (7,), np.float32), device="cpu", n_envs=2)
    rows = []
    for _ in range(3):
        seen, after = ({name: np.stack([box.sample(), box.sample()]) for name, box in boxes.items()} for _ in range(2))
        rows.append(seen)
        buffer.add(seen, after, rng.normal(size=(2, 7)), np.array([1.0, 2.0]), np.ones(2), [{}, {}])
    save_to_pkl(tmp_path / "buffer.pkl", buffer)
    again = load_from_pkl(tmp_path / "buffer.pkl")
    for one in (buffer, again):
        assert (one.size(), one.pos, one.full) == (3, 3, False)
        for name, box in boxes.items():
            assert one.observations[name].shape == (4, 2, *box.shape)
            assert (one.observations[name][:3] == np.stack([row[name] for row in rows])).all()
        sample = one.sample(16)
        assert all(torch.equal(sample.observations[name], sample.next_observations[name]) for name in boxes)
    again.add(rows[0], rows[0], np.zeros((2, 7)), np.zeros(2), np.ones(2), [{}, {}])
    again.add(rows[1], rows[1], np.zeros((2, 7)), np.zeros(2), np.ones(2), [{}, {}])
    assert again.full
    assert (again.observations["volume"][0] == rows[1]["volume"]).all()


def test_rewards_move_the_correction(tmp_path: Path) -> None:
    """PPO learns, from a reward of its own, the direction of the target; its observations reach the network."""
    env = make_residual_env(4, base(), CONFIG, objects="procedural:can:0")
    env.seed(0)

    class Upward(VecEnvWrapper):  # type: ignore[misc]
        """Pays for one entry of the correction, without physics."""

        def reset(self) -> Any:
            self.seen = self.venv.reset()
            return self.seen

        def step_async(self, actions: Any) -> None:
            self.paid = 1.0 - np.abs(actions[:, 2] - 0.5)

        def step_wait(self) -> Any:
            infos = [{"terminal_observation": {k: v[i] for k, v in self.seen.items()}} for i in range(4)]
            return self.seen, self.paid.astype(np.float32), np.ones(4, dtype=bool), infos

    settings = {"features_extractor_class": Extractor, "log_std_init": -1.0}
    model = sb3.PPO(
        "MultiInputPolicy", Upward(env), n_steps=32, batch_size=64, gamma=0.0, learning_rate=2e-3, seed=0,
        policy_kwargs=settings, device="cpu",
    )  # fmt: skip
    before = model.predict(env.reset(), deterministic=True)[0][:, 2]
    model.learn(1280)
    after = model.predict(env.reset(), deterministic=True)[0][:, 2]
    assert np.abs(after - 0.5).max() < np.abs(before - 0.5).min()
    env.close()


def test_the_command_resumes_and_writes_its_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    words = ["partial_view_planner", "--out", str(out), "--objects", "procedural:can:0-9", "procedural:box:0-9"]
    words += ["--unseen", "procedural:can:10-13", "--trials", "6", "--watched", "4", "--num-envs", "4"]
    assert train("residual", [*words, "--steps", "8", "--evaluations", "1"]) == 0
    rows = [json.loads(line) for line in (out / "results.jsonl").read_text().splitlines()]
    assert [(row["name"], row["steps"]) for row in rows] == [("base", 0), ("seed 0", 8)]
    alone = evaluation.evaluate(base(), objects="procedural:can:10-13", trials=6, seed=TEST_SEED)
    assert rows[0]["success"] == alone.rate
    first = (out / "results.jsonl").read_bytes()
    assert train("residual", [*words, "--steps", "8", "--evaluations", "1"]) == 0
    assert (out / "results.jsonl").read_bytes() == first
    capsys.readouterr()
    assert train("residual", [*words, "--steps", "16", "--evaluations", "1", "--json"]) == 0
    assert [row["steps"] for row in json.loads(capsys.readouterr().out)["results"]] == [0, 8, 16]
    page = (out / "README.md").read_text()
    assert "| seed 0 | 16 |" in page
    assert page.count("| base | 0 |") == 1
    with pytest.raises(ConfigError, match=r"distance was 0\.02, is now 0\.01"):
        train("residual", [*words, "--distance", "0.01"])


@pytest.mark.parametrize(
    ("name", "message"), [("planner", "the base policy is a Planner"), ("nowhere", "there is no policy 'nowhere'")]
)
def test_a_base_that_proposes_nothing_is_refused(name: str, message: str, tmp_path: Path) -> None:
    small = ("--trials", "1", "--watched", "1", "--num-envs", "1", "--objects", "procedural:can:0-9")
    with pytest.raises(ConfigError, match=message):
        train("residual", [name, "--out", str(tmp_path / "out"), *small])


def test_an_interrupted_run_goes_on_where_it_was(tmp_path: Path) -> None:
    stopped = train_seed(settings(tmp_path), 0, tmp_path, started=stop)
    assert stopped.interrupted
    assert stopped.model.num_timesteps == 4
    found = train_seed(settings(tmp_path), 0, tmp_path)
    assert found.model.num_timesteps == 24
    assert not found.interrupted
    # Stable-Baselines3 does not store the transitions of the step in which a callback ends the training.
    assert found.model.replay_buffer.size() == 5
    assert [row["timesteps"] for row in found.rows] == [0, 24]


def test_a_run_is_not_continued_with_other_bounds(tmp_path: Path) -> None:
    train_seed(settings(tmp_path, algorithm="ppo"), 0, tmp_path, started=stop)
    with pytest.raises(ConfigError, match=r"distance was 0\.03, is now 0\.02"):
        train_seed(settings(tmp_path, algorithm="ppo", distance=0.02), 0, tmp_path)
