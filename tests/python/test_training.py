"""The training loop: the same bits after an interruption for every learner, early stopping, limits, settings."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox import object_sets
from graspbox._common.runs import Rows
from graspbox.errors import ConfigError
from graspbox.learn.training.configs import TrainConfig
from graspbox.perception import HandGrid

torch = pytest.importorskip("torch")

from graspbox.learn.models.completion.network import train_completion  # noqa: E402
from graspbox.learn.models.head.batches import untried_scenes  # noqa: E402
from graspbox.learn.models.head.training import HeadData, train_head  # noqa: E402
from graspbox.learn.models.scene_views import SceneViews  # noqa: E402
from graspbox.learn.models.scenes import SceneConfig, SceneSampler  # noqa: E402
from graspbox.learn.models.scorer.training import train_scorer  # noqa: E402
from graspbox.learn.models.stability.network import train_stability  # noqa: E402
from graspbox.learn.models.trials import GraspTrials  # noqa: E402
from graspbox.learn.recipes.collection import CollectConfig, collect  # noqa: E402
from graspbox.learn.training.trainer import Trainer, TrainProgress, load_weights, moved  # noqa: E402
from graspbox.perception.anchors import AnchorConfig  # noqa: E402
from graspbox.perception.inputs.scorer import ScorerInputs  # noqa: E402
from graspbox.policies.published.head_configs import HeadConfig  # noqa: E402

pytestmark = [pytest.mark.train, pytest.mark.usefixtures("one_thread")]

SCENES = SceneConfig(image_size=96)
#: Six steps, a checkpoint after each second one.
SHORT = TrainConfig(batch_size=4, max_steps=6, validate_every=2)


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> GraspTrials:
    """Collect some trials of two cans, and add scenes without any."""
    sampler = SceneSampler(object_sets.load("procedural:can:0-1"), SCENES, 0)
    folder = tmp_path_factory.mktemp("trials")
    found = collect(folder, sampler, range(3), HandGrid(), CollectConfig(per_scene=12))
    return GraspTrials.joined([found, untried_scenes(object_sets.load("procedural:cup:0"), 2, 0)])


Learn = Callable[[Path, Callable[[TrainProgress], None]], Any]


def learners(trials: GraspTrials) -> dict[str, Learn]:
    """List all trainings of the package, each for six steps."""
    objects, grid = object_sets.load("procedural:can:0-1"), HandGrid()
    anchors = AnchorConfig(cells=12, heights=14)
    heads = HeadData.of(trials, trials, grid, anchors, SCENES)
    small = HeadConfig(width=8, features=8, hidden=16, anchors=anchors)
    readings = np.random.default_rng(0).normal(size=(60, 30)).astype(np.float32)
    held = readings[:, 0] > 0

    return {
        "completion": lambda folder, progress: train_completion(
            folder, objects, objects, SHORT, SCENES, validation_scenes=4, width=8, progress=progress
        ),
        "scorer": lambda folder, progress: train_scorer(
            folder,
            trials,
            trials,
            ScorerInputs(grid),
            SceneViews(SCENES),
            replace(SHORT, batch_size=32),
            on_policy=trials,
            width=16,
            progress=progress,
        ),
        "head": lambda folder, progress: train_head(folder, heads, small, SHORT, progress),
        # With dropout.
        "stability": lambda folder, progress: train_stability(
            folder, readings, held, (readings, held), SHORT, progress=progress
        ),
    }


@pytest.mark.parametrize("name", ["completion", "scorer", "head", "stability"])
def test_every_learner_ends_with_the_same_bits_after_an_interruption(
    name: str, trials: GraspTrials, tmp_path: Path
) -> None:
    learn = learners(trials)[name]
    learn(tmp_path / "whole", lambda _: None)

    def stop(done: TrainProgress) -> None:
        if done.step == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        learn(tmp_path / "parts", stop)
    torch.manual_seed(1234)
    seen: list[int] = []
    learn(tmp_path / "parts", lambda done: seen.append(done.step))
    assert seen == [5, 6]
    whole, parts = (torch.load(tmp_path / one / "checkpoint.pt", weights_only=True) for one in ("whole", "parts"))
    assert whole["step"] == parts["step"] == 6
    for key, weight in whole["net"].items():
        assert torch.equal(weight, parts["net"][key]), key
    rows = [Rows(tmp_path / one / "losses.jsonl") for one in ("whole", "parts")]
    assert [row | {"seconds": 0} for row in rows[0]] == [row | {"seconds": 0} for row in rows[1]]


class Toy:
    """A line through noisy points, learned by a `Trainer`."""

    def __init__(self, folder: Path, fail_at: int | None = None, trained: bool = False, **settings: Any) -> None:
        torch.manual_seed(0)
        self.net, self.fail_at, self.steps = torch.nn.Linear(3, 1), fail_at, 0
        given = {"batch_size": 4, "max_steps": 12, "validate_every": 3, "learning_rate": 0.1, **settings}
        self.trainer: Trainer[Any] = Trainer(
            self.net,
            folder,
            TrainConfig(**given),
            batch=lambda step: torch.randn(4, 3, generator=torch.Generator().manual_seed(step)),
            losses=self.losses,
            validate=lambda net: {"measure": -float((net.weight - 1.0).abs().sum())},
            trained=trained,
        )

    def losses(self, net: Any, batch: Any) -> dict[str, Any]:
        """Give the squared error, or fail at the step that was asked for."""
        self.steps += 1
        if self.steps == self.fail_at:
            raise KeyboardInterrupt
        return {"error": ((net(batch) - batch.sum(1, keepdim=True)) ** 2).mean()}


def test_an_interrupted_training_ends_with_the_same_bits(tmp_path: Path) -> None:
    whole = Toy(tmp_path / "whole")
    result = whole.trainer.run()
    assert (result.reason, result.step) == ("steps", 12)
    broken = Toy(tmp_path / "broken", fail_at=9)
    with pytest.raises(KeyboardInterrupt):
        broken.trainer.run()
    again = Toy(tmp_path / "broken")
    assert again.trainer.run().step == 12
    assert again.steps == 12 - 6
    for one, other in zip(whole.net.parameters(), again.net.parameters(), strict=True):
        torch.testing.assert_close(one, other, rtol=0, atol=0)
    logs = [Rows(tmp_path / name / "losses.jsonl") for name in ("whole", "broken")]
    assert [row["step"] for row in logs[0]] == [3, 6, 9, 12]
    for a, b in zip(*logs, strict=True):
        assert {k: v for k, v in a.items() if k != "seconds"} == {k: v for k, v in b.items() if k != "seconds"}
    with pytest.raises(ConfigError, match="max_steps was 12, is now 13"):
        Toy(tmp_path / "whole", max_steps=13).trainer.run()
    # A run that is over stays so.
    over = Toy(tmp_path / "whole")
    assert over.trainer.run().step == 12
    assert over.steps == 0


def test_training_stops_when_nothing_gets_better_and_keeps_the_best(tmp_path: Path) -> None:
    toy = Toy(tmp_path, max_steps=100, patience=2)
    measures = iter([0.1, 0.5, 0.4, 0.3, 0.9])
    toy.trainer._validate = lambda net: {"measure": next(measures)}
    result = toy.trainer.run()
    assert (result.reason, result.step, result.best) == ("patience", 12, 0.5)
    best = torch.nn.Linear(3, 1)
    load_weights(best, tmp_path / "weights.pt")
    torch.testing.assert_close(best.weight, toy.net.weight, rtol=0, atol=0)
    with pytest.raises(ConfigError, match="another network"):
        load_weights(torch.nn.Linear(4, 1), tmp_path / "weights.pt")
    with pytest.raises(ConfigError, match="no weights"):
        load_weights(best, tmp_path / "nothing.pt")


def test_trained_weights_are_kept_where_training_makes_them_worse(tmp_path: Path) -> None:
    toy = Toy(tmp_path / "one", trained=True, max_steps=6)
    begun = toy.net.weight.detach().clone()
    measures = iter([0.5, 0.4, 0.3])
    toy.trainer._validate = lambda net: {"measure": next(measures)}
    result = toy.trainer.run()
    assert (result.step, result.best, toy.steps) == (6, 0.5, 6)
    torch.testing.assert_close(toy.net.weight, begun, rtol=0, atol=0)
    assert [row["step"] for row in Rows(tmp_path / "one" / "losses.jsonl")] == [0, 3, 6]
    # An interruption before the first validation in the training changes nothing.
    broken = Toy(tmp_path / "two", trained=True, fail_at=2)
    with pytest.raises(KeyboardInterrupt):
        broken.trainer.run()
    again, whole = Toy(tmp_path / "two", trained=True), Toy(tmp_path / "three", trained=True)
    assert again.trainer.run().best == whole.trainer.run().best
    torch.testing.assert_close(again.net.weight, whole.net.weight, rtol=0, atol=0)
    assert [row["step"] for row in Rows(tmp_path / "two" / "losses.jsonl")] == [0, 3, 6, 9, 12]


def test_training_stops_in_time(tmp_path: Path) -> None:
    result = Toy(tmp_path, max_steps=10**6, validate_every=10**6, max_seconds=0.01).trainer.run()
    assert result.reason == "time"
    # A later call without more time makes no step; with more it continues.
    again = Toy(tmp_path, max_steps=10**6, validate_every=10**6, max_seconds=0.01)
    assert (again.trainer.run(), again.steps) == (result, 0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"optimizer": "lbfgs"}, "optimizer is 'lbfgs'; choose from adamw, adam, fused_adam, sgd, momentum, nesterov"),
        ({"schedule": "step"}, "schedule is 'step'; choose from warmup_cosine, epoch_cosine, constant"),
        ({"keep": "all"}, "keep is 'all'; choose from best, last"),
        ({"learning_rate": 0.0}, r"learning_rate is 0\.0; it must be positive"),
        ({"max_seconds": 0.0}, r"max_seconds is 0\.0; it must be positive"),
        ({"momentum": 1.0}, r"momentum is 1\.0; it must be in \[0, 1\)"),
        ({"weight_decay": -1.0}, r"weight_decay is -1\.0; it must be 0 or more"),
        ({"batch_size": 0}, "batch_size is 0; it must be 1 or more"),
        ({"log_every": 0}, "log_every is 0; it must be 1 or more"),
    ],
)
def test_wrong_settings_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        TrainConfig(**change)


@pytest.mark.parametrize(
    ("schedule", "shares"),
    [
        ("constant", [1.0] * 12),
        ("epoch_cosine", [1.0] * 3 + [0.854] * 3 + [0.5] * 3 + [0.146] * 3),
        ("warmup_cosine", [0.5 * (1 + np.cos(np.pi * step / 12)) for step in range(12)]),
    ],
)
def test_the_learning_rate_follows_the_schedule(schedule: Any, shares: list[float], tmp_path: Path) -> None:
    toy, rates = Toy(tmp_path, schedule=schedule, optimizer="adam"), []
    toy.trainer.run(lambda _: rates.append(toy.trainer._optimizer.param_groups[0]["lr"] / 0.1))
    np.testing.assert_allclose(rates, shares, atol=1e-3)


def test_the_last_weights_are_kept_where_these_are_asked_for(tmp_path: Path) -> None:
    toy = Toy(tmp_path, keep="last")
    measures = iter([0.9, 0.5, 0.4, 0.3])
    toy.trainer._validate = lambda net: {"measure": next(measures)}
    assert toy.trainer.run().best == 0.9
    last = torch.load(tmp_path / "checkpoint.pt", weights_only=True)["net"]
    torch.testing.assert_close(toy.net.state_dict(), last, rtol=0, atol=0)


def test_a_measure_that_is_not_finite_is_an_error(tmp_path: Path) -> None:
    toy = Toy(tmp_path)
    toy.trainer._validate = lambda net: {"measure": 1.0, "auc": float("nan")}
    with pytest.raises(ConfigError, match="in the validation of step 3, auc is nan; lower learning_rate"):
        toy.trainer.run()


def test_batches_move_as_a_whole() -> None:
    """To the device without memory: values other than tensors stay."""
    batch = {"rows": (torch.ones(2), np.ones(2)), "config": SHORT, "number": 3}
    found = moved(batch, "meta")
    assert found["rows"][0].device.type == "meta"
    assert found["rows"][1] is batch["rows"][1]  # type: ignore[index]
    assert (found["config"], found["number"]) == (SHORT, 3)
