"""Demonstrations in the formats of Minari and LeRobot."""

import json
import os
import shutil
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from demonstrations_for_tests import OBS, recorded
from graspbox.data.episodes import Demonstrations
from graspbox.errors import ConfigError
from graspbox.tools.demonstrations import to_lerobot, to_minari

datasets = pytest.importorskip("datasets")
parquet = pytest.importorskip("pyarrow.parquet")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Demonstrations:
    """Three episodes with images, in files of two."""
    return recorded(tmp_path_factory.mktemp("demonstrations") / "shown")


# --- Minari ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def minari(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Minari with a folder of its own."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    (tmp_path / "minari").mkdir()
    return pytest.importorskip("minari")


def test_minari_loads_them(made: Demonstrations, minari: Any) -> None:
    to_minari(made, "graspbox/expert-v0")
    found = minari.load_dataset("graspbox/expert-v0")
    assert (found.total_episodes, found.total_steps) == (3, sum(row.steps for row in made.episodes))
    assert found.spec.env_spec.id == "graspbox/Grasp-v0"
    about = list(found.storage.get_episode_metadata(range(3)))
    for mine, its, more in zip(made.read(), found, about, strict=True):
        assert (more["seed"], more["object"], more["secure"]) == (mine.episode.seed, mine.episode.object, True)
        for name in OBS:
            assert its.observations[name].dtype == mine.observations[name].dtype
            assert (its.observations[name] == mine.observations[name]).all()
        assert (its.actions == mine.actions).all()
        assert (its.rewards == mine.rewards).all()
        assert (its.terminations == mine.terminated).all()
        assert (its.truncations == mine.truncated).all()
    env = found.recover_environment()
    assert env.observation_space == found.observation_space
    assert env.action_space == found.action_space
    observation, _ = env.reset(seed=about[1]["seed"])
    assert all((observation[name] == found[1].observations[name][0]).all() for name in OBS)
    env.close()


def test_minari_records_the_same_by_itself(made: Demonstrations, minari: Any) -> None:
    """Minari's own `DataCollector` gives the same spaces, environment and arrays for the same actions."""
    pytest.importorskip("jax", reason="Minari collects with jax")
    exported = to_minari(made, "graspbox/expert-v0")
    collector = minari.DataCollector(exported.recover_environment(), data_format="parquet")
    for one in made.read():
        collector.reset(seed=one.episode.seed)
        for action in one.actions:
            collector.step(action)
    own = collector.create_dataset("graspbox/own-v0", author="x", author_email="x", code_permalink="x")
    assert own.observation_space == exported.observation_space
    assert own.spec.env_spec == exported.spec.env_spec
    for a, b in zip(own, exported, strict=True):
        assert (a.actions == b.actions).all()
        assert (a.observations["proprio"] == b.observations["proprio"]).all()


def test_minari_refuses_what_it_has(made: Demonstrations, minari: Any, tmp_path: Path) -> None:
    to_minari(made, "graspbox/expert-v0")
    with pytest.raises(ConfigError, match="exists; remove it, or pass another id"):
        to_minari(made, "graspbox/expert-v0")
    with pytest.raises(ConfigError, match="Minari does not take the id"):
        to_minari(made, "a b c")
    # A failed write leaves nothing behind.
    copy = tmp_path / "copy"
    shutil.copytree(made.folder, copy)
    damaged = Demonstrations(copy)
    (copy / "episodes-00001.parquet").write_bytes(b"PAR1")
    with pytest.raises(ConfigError, match="is damaged"):
        to_minari(damaged, "graspbox/damaged-v0")
    assert minari.list_local_datasets().keys() == {"graspbox/expert-v0"}


# --- LeRobot ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def lerobot(made: Demonstrations, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Export them as a LeRobotDataset."""
    return to_lerobot(made, tmp_path_factory.mktemp("export") / "lerobot")


def frames(made: Demonstrations, column: Callable[[Any], Any]) -> Any:
    return np.concatenate([column(one) for one in made.read()])


def test_lerobot_folder_has_the_layout_of_version_3(made: Demonstrations, lerobot: Path) -> None:
    """Files, columns, kinds and counts as the documentation of the format gives them."""
    info = json.loads((lerobot / "meta/info.json").read_text())
    total = sum(row.steps for row in made.episodes)
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"], info["fps"]) == (3, total, 1, 5)
    assert info["splits"] == {"train": "0:3"}
    data = parquet.read_table(lerobot / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(data.column_names) == set(info["features"])
    assert data["index"].to_pylist() == list(range(total))
    assert data["timestamp"].to_pylist() == pytest.approx([i / 5 for i in data["frame_index"].to_pylist()])
    episodes = parquet.read_table(lerobot / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    ends = np.cumsum([row.steps for row in made.episodes]).tolist()
    assert [row["dataset_to_index"] for row in episodes] == ends
    assert [row["dataset_from_index"] for row in episodes] == [0, *ends[:-1]]
    for index, row in enumerate(episodes):
        assert row["length"] == row["dataset_to_index"] - row["dataset_from_index"]
        assert (row["episode_index"], row["data/chunk_index"], row["data/file_index"]) == (index, 0, 0)
        found = data["episode_index"].to_numpy()[row["dataset_from_index"] : row["dataset_to_index"]]
        assert (found == index).all()
    assert sum(data["next.done"].to_pylist()) == sum(data["next.success"].to_pylist()) == 3


def test_lerobot_frames_are_what_was_recorded(made: Demonstrations, lerobot: Path) -> None:
    """Read with `datasets` and the features that LeRobot derives from the description."""
    info = json.loads((lerobot / "meta/info.json").read_text())["features"]
    kinds: dict[str, Any] = {}
    for name, row in info.items():
        shape = tuple(row["shape"])
        if row["dtype"] == "image":
            kinds[name] = datasets.Image()
        elif shape == (1,):
            kinds[name] = datasets.Value(row["dtype"])
        elif len(shape) == 1:
            kinds[name] = datasets.Sequence(datasets.Value(row["dtype"]), length=shape[0])
        else:
            kinds[name] = datasets.Array3D(shape=shape, dtype=row["dtype"])
    found = datasets.Dataset.from_parquet(
        str(lerobot / "data/chunk-000/file-000.parquet"), features=datasets.Features(kinds), keep_in_memory=True
    ).with_format("numpy")
    assert (found["action"][:] == frames(made, lambda one: one.actions)).all()
    assert (found["observation.state"][:] == frames(made, lambda one: one.observations["proprio"][:-1])).all()
    depth = frames(made, lambda one: one.observations["depth"][:-1])
    assert found["observation.images.depth"][:].dtype == np.float32
    assert (found["observation.images.depth"][:] == depth[..., 0]).all()
    assert (found["observation.images.rgb"][:] == frames(made, lambda one: one.observations["rgb"][:-1])).all()
    assert found["next.reward"][:] == pytest.approx(frames(made, lambda one: one.rewards))


def test_lerobot_marks_depth_images(lerobot: Path) -> None:
    """As LeRobot marks its own: an image of one channel, with its unit; a colour image has no mark."""
    info = json.loads((lerobot / "meta/info.json").read_text())["features"]
    names = ["height", "width", "channels"]
    mark = {"is_depth_map": True, "depth_unit": "m"}
    assert info["observation.images.depth"] == {"dtype": "image", "shape": [16, 16, 1], "names": names, "info": mark}
    assert info["observation.images.rgb"] == {"dtype": "image", "shape": [16, 16, 3], "names": names}


def test_lerobot_statistics_are_those_of_the_frames(made: Demonstrations, lerobot: Path) -> None:
    stats = json.loads((lerobot / "meta/stats.json").read_text())
    rows = frames(made, lambda one: one.actions)
    colours = frames(made, lambda one: one.observations["rgb"][:-1]) / 255
    assert stats["action"]["mean"] == pytest.approx(rows.mean(axis=0))
    assert stats["action"]["std"] == pytest.approx(rows.std(axis=0), abs=1e-6)
    assert stats["action"]["q10"] == pytest.approx(np.quantile(rows, 0.1, axis=0))
    assert stats["action"]["count"] == [len(rows)]
    assert np.shape(stats["observation.images.rgb"]["mean"]) == (3, 1, 1)
    assert np.ravel(stats["observation.images.rgb"]["mean"]) == pytest.approx(colours.mean(axis=(0, 1, 2)))
    depth = frames(made, lambda one: one.observations["depth"][:-1]).astype(np.float64)
    assert np.shape(stats["observation.images.depth"]["max"]) == (1, 1, 1)
    assert np.ravel(stats["observation.images.depth"]["max"]) == depth.max()
    assert np.ravel(stats["observation.images.depth"]["mean"]) == pytest.approx(depth.mean())


def test_lerobot_folder_is_whole_or_not_there(made: Demonstrations, lerobot: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="exists; remove it"):
        to_lerobot(made, lerobot)
    copy = tmp_path / "copy"
    shutil.copytree(made.folder, copy)
    damaged = Demonstrations(copy)
    (copy / "episodes-00001.parquet").write_bytes(b"PAR1")
    with pytest.raises(ConfigError, match="is damaged"):
        to_lerobot(damaged, tmp_path / "out")
    assert {path.name for path in tmp_path.iterdir()} == {"copy"}


@pytest.mark.skipif(
    find_spec("lerobot") is None and not os.environ.get("GRASPBOX_REQUIRE_LEROBOT"),
    reason="lerobot pins other versions than those that graspbox is tested with",
)
def test_lerobot_loads_it(made: Demonstrations, lerobot: Path) -> None:
    """With the package itself: frames, tasks, statistics, windows of actions, batches."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
    from torch.utils.data import DataLoader

    found = LeRobotDataset("graspbox/expert", root=lerobot, delta_timestamps={"action": [0.0, 0.2]})
    actions = frames(made, lambda one: one.actions)
    assert (found.num_episodes, found.num_frames) == (3, len(actions))
    frame = found[5]
    assert (frame["action"].numpy() == actions[5:7]).all()
    assert frame["task"] == "Grasp the object and lift it."
    assert frame["observation.images.rgb"].shape == (3, 16, 16)
    assert found.meta.stats["action"]["mean"] == pytest.approx(actions.mean(axis=0))
    assert next(iter(DataLoader(found, batch_size=4)))["observation.images.depth"].shape == (4, 1, 16, 16)
    # It reads millimetres unless it is told otherwise, and scales the statistics with them.
    depth = frames(made, lambda one: one.observations["depth"][:-1])
    assert found.meta.depth_keys == ["observation.images.depth"]
    assert frame["observation.images.depth"].numpy()[0] == pytest.approx(1000 * depth[5, ..., 0])
    assert np.ravel(found.meta.stats["observation.images.depth"]["max"]) == pytest.approx(1000 * depth.max())
    metres = LeRobotDataset("graspbox/expert", root=lerobot, depth_output_unit="m")
    assert (metres[5]["observation.images.depth"].numpy()[0] == depth[5, ..., 0]).all()
    assert np.ravel(metres.meta.stats["observation.images.depth"]["max"]) == pytest.approx(depth.max())
    second = LeRobotDataset("graspbox/expert", root=lerobot, episodes=[1])
    assert len(second) == made.episodes[1].steps
