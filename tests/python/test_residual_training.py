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
from test_scripts import script

pytestmark = [pytest.mark.train, pytest.mark.usefixtures("one_thread")]

sb3 = pytest.importorskip("stable_baselines3")
torch = pytest.importorskip("torch")
pytest.importorskip("tyro", reason="scripts/train_residual.py needs tyro, from the extra 'train'")

from stable_baselines3.common.save_util import load_from_pkl, save_to_pkl  # noqa: E402
from stable_baselines3.common.vec_env import VecEnvWrapper  # noqa: E402

from graspbox.sb3 import Extractor  # noqa: E402
from graspbox.sb3.decision_buffer import DecisionBuffer  # noqa: E402
from graspbox.sb3.residual_training import (  # noqa: E402
    ResidualRun,
    load_residual,
    make_residual_env,
    train_residual,
)

OBJECTS = ("procedural:can:0-3", "procedural:box:0-3")
CONFIG = ResidualConfig(distance=0.03)


def base() -> policies.Policy:
    return policies.load("seen_planner")


@pytest.mark.parametrize("algorithm", ["sac", "ppo"])
def test_a_run_begins_as_its_base_policy(algorithm: str, tmp_path: Path) -> None:
    run = ResidualRun(algorithm, 4, config=CONFIG, env={"objects": list(OBJECTS), "reward": "firm"}, episodes=8)
    found = train_residual(tmp_path, base, run, 0)
    assert found.last is not None
    policy, steps = load_residual(tmp_path / "checkpoint", base(), algorithm, CONFIG)
    assert steps == 0
    results = [evaluation.evaluate(one, objects=OBJECTS, trials=8, seed=10_000, num_envs=4) for one in (base(), policy)]
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
    """PPO learns, from a reward of its own, the direction in which that lies; what it sees reaches the network."""
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


def test_the_script_resumes_and_writes_its_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program = script("train_residual")
    out = tmp_path / "out"
    words = ["seen_planner", str(out), "--objects", "procedural:can:0-9", "procedural:box:0-9"]
    words += ["--unseen", "procedural:can:10-13", "--trials", "6", "--watched", "4", "--num-envs", "4"]
    assert program.main([*words, "--steps", "8", "--evaluations", "1"]) == 0
    rows = [json.loads(line) for line in (out / "results.jsonl").read_text().splitlines()[1:]]
    assert [(row["name"], row["steps"]) for row in rows] == [("base", 0), ("seed 0", 8)]
    alone = evaluation.evaluate(base(), objects="procedural:can:10-13", trials=6, seed=program.TEST_SEED)
    assert rows[0]["success"] == alone.rate
    first = (out / "results.jsonl").read_bytes()
    assert program.main([*words, "--steps", "8", "--evaluations", "1"]) == 0
    assert (out / "results.jsonl").read_bytes() == first
    assert program.main([*words, "--steps", "16", "--evaluations", "1", "--json"]) == 0
    assert [row["steps"] for row in json.loads(capsys.readouterr().out)["results"]] == [0, 8, 16]
    page = (out / "README.md").read_text()
    assert "| seed 0 | 16 |" in page
    assert page.count("| base | 0 |") == 1
    assert program.main([*words, "--distance", "0.01"]) == 2
    assert "distance was 0.02, is now 0.01" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("planner",), "the base policy is a Planner"),
        (("seen_planner", "--algorithm", "td3"), "no algorithm 'td3'; choose from sac, ppo"),
        (("seen_planner", "--distance", "1"), "distance is 1.0; give metres"),
        (("seen_planner", "--steps", "0"), "--steps is 0; give 1 or more"),
        (("seen_planner", "--seeds", "-1"), "--seeds is (-1,)"),
        (("seen_planner", "--minutes", "0"), "--minutes is 0.0"),
        (("nowhere",), "there is no policy 'nowhere'"),
    ],
)
def test_wrong_arguments_are_named(
    arguments: tuple[str, ...], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = script("train_residual")
    name, *rest = arguments
    small = ("--trials", "1", "--watched", "1", "--num-envs", "1", "--objects", "procedural:can:0-9")
    assert program.main([name, str(tmp_path / "out"), *small, *rest]) == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_an_interrupted_run_goes_on_where_it_was(tmp_path: Path) -> None:
    run = ResidualRun("sac", 4, config=CONFIG, env={"objects": "procedural:can:0-3"}, episodes=2)
    stopped = train_residual(tmp_path, base, run, 24, started=lambda found: found.interrupt())
    assert stopped.interrupted
    assert stopped.model.num_timesteps == 4
    done: list[int] = []
    found = train_residual(tmp_path, base, run, 24, on_progress=lambda steps, _: done.append(steps))
    assert done == [8, 12, 16, 20, 24]
    assert not found.interrupted
    # Stable-Baselines3 does not store the transitions of the step in which a callback ends the training.
    assert found.model.replay_buffer.size() == 5
    assert [row["timesteps"] for row in found.log.rows] == [0, 24]


def test_a_run_is_not_continued_with_other_bounds(tmp_path: Path) -> None:
    run = ResidualRun("ppo", 2, config=CONFIG, env={"objects": "procedural:can:0"}, episodes=2)
    train_residual(tmp_path, base, run, 0)
    other = ResidualRun("ppo", 2, config=ResidualConfig(), env={"objects": "procedural:can:0"}, episodes=2)
    with pytest.raises(ConfigError, match=r"distance was 0\.03, is now 0\.02"):
        train_residual(tmp_path, base, other, 0)
