"""Damaged, incomplete or inconsistent data sets: each file is named, and none is used or overwritten."""

import json
import random
import shutil
from pathlib import Path
from typing import Any

import pytest

from datasets_for_tests import OBJECTS, config, contents
from graspbox import errors
from graspbox.data import trials as dataset
from graspbox.data.trials.learned import of_datasets
from graspbox.data.trials.runners import Runner

pytest.importorskip("pyarrow")

SETTINGS = config(poses=2, rests=1, views=1, images=True, image_size=(16, 16), shard_trials=2)


def generate(folder: Path, runner: Runner | None = None) -> dataset.Result:
    return dataset.generate(OBJECTS, folder, config=SETTINGS, runner=runner or dataset.local(1))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three shards with images."""
    folder = tmp_path_factory.mktemp("whole") / "made"
    assert generate(folder).made == 3
    return folder


@pytest.fixture
def folder(whole: Path, tmp_path: Path) -> Path:
    """Copy them."""
    return Path(shutil.copytree(whole, tmp_path / "copy"))


def files(folder: Path, kind: str) -> list[Path]:
    return sorted((folder / kind).glob("*.parquet"))


def flip(path: Path, bit: int) -> None:
    content = bytearray(path.read_bytes())
    content[bit // 8] ^= 1 << bit % 8
    path.write_bytes(content)


def load(folder: Path) -> None:
    dataset.load(folder)
    dataset.load_images(folder)


@pytest.mark.parametrize("kind", ["trials", "images"])
def test_a_damaged_shard_is_neither_read_nor_kept(whole: Path, folder: Path, kind: str) -> None:
    """Its hash was once written into the manifest, as if it were right."""
    before = (folder / "manifest.json").read_bytes()
    path = files(folder, kind)[1]
    flip(path, 8 * (path.stat().st_size // 2))
    for work in (load, generate):
        with pytest.raises(errors.ConfigError, match=rf"{kind}/{path.name}' is damaged.*; remove it, and the command"):
            work(folder)
    assert (folder / "manifest.json").read_bytes() == before
    path.unlink()
    with pytest.raises(errors.ConfigError, match=rf"{path.name}' is missing"):
        load(folder)
    result = generate(folder)
    assert (result.made, result.resumed) == (1, 2)
    assert contents(folder) == contents(whole)


def test_images_that_are_cut_off_are_noticed(folder: Path) -> None:
    path = files(folder, "images")[0]
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(errors.ConfigError, match=rf"{path.name}' is damaged"):
        generate(folder)


def test_exchanged_shards_are_noticed(folder: Path) -> None:
    first, second = files(folder, "trials")[:2]
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)
    for work in (load, generate):
        with pytest.raises(errors.ConfigError, match="is damaged"):
            work(folder)


def test_a_flipped_bit_is_noticed_wherever_it_is(whole: Path, tmp_path: Path) -> None:
    chosen = random.Random(0)
    for number in range(40):
        folder = Path(shutil.copytree(whole, tmp_path / str(number)))
        path = chosen.choice(files(folder, "trials") + files(folder, "images"))
        flip(path, chosen.randrange(8 * path.stat().st_size))
        with pytest.raises(errors.ConfigError, match=f"{path.name}' is damaged"):
            load(folder)


def test_files_of_somebody_else_are_not_read_and_not_kept_quiet(whole: Path, folder: Path) -> None:
    stranger = folder / "trials" / "train-00009-of-00010.parquet"
    shutil.copy(files(folder, "trials")[0], stranger)
    assert len(dataset.load(folder)) == len(dataset.load(whole)) == 6
    with pytest.raises(errors.ConfigError, match=rf"{stranger.name}' is not a file of this data set"):
        generate(folder)


def test_what_a_killed_run_did_not_write_into_the_manifest_is_made_again(whole: Path, folder: Path) -> None:
    """Such files are whole, but nothing says that they are right."""
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    left_out = manifest["shards"].pop(0)["name"]
    path.write_text(json.dumps(manifest))
    flip(folder / "trials" / left_out, 8 * 100)
    assert len(dataset.load(folder)) == 4
    assert generate(folder).made == 1
    assert contents(folder) == contents(whole)


def test_an_error_does_not_lose_finished_shards(tmp_path: Path) -> None:
    """Ctrl-C after the second shard, however soon it comes."""

    def stop(progress: dataset.Progress) -> None:
        if progress.made == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        dataset.generate(OBJECTS, tmp_path, config=SETTINGS, runner=dataset.local(1), progress=stop)
    assert len(dataset.load(tmp_path)) == 4
    assert generate(tmp_path).made == 1


#: Values that no entry of a manifest can have; the last one stands for its absence.
VALUES: tuple[Any, ...] = (None, 7, [[]], ...)
WRONG: list[tuple[str, Any]] = [
    (key, value)
    for key in ("format", "version", "fingerprint", "config", "versions", "shards", "objects")
    for value in VALUES
]
WRONG += [("hand", {}), ("hand", {"name": "reflex"}), ("versions", {}), ("config", {}), ("counts", {}), ("objects", [])]


@pytest.mark.parametrize(("key", "value"), WRONG)
def test_a_manifest_of_wrong_types_is_refused(folder: Path, key: str, value: Any) -> None:
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    if value is ...:
        del manifest[key]
    else:
        manifest[key] = value
    path.write_text(json.dumps(manifest))
    for work in (load, generate, lambda folder: of_datasets([folder])):
        with pytest.raises(errors.ConfigError, match=r"is not a valid data set manifest: .*"):
            work(folder)


@pytest.mark.parametrize(
    ("key", "value"),
    [("name", "../../secret.parquet"), ("name", 3), ("sha256", None), ("trials", "many"), ("images_sha256", 1)],
)
def test_shards_of_a_manifest_are_checked(folder: Path, key: str, value: Any) -> None:
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["shards"][0][key] = value
    path.write_text(json.dumps(manifest))
    with pytest.raises(errors.ConfigError, match="is not a valid data set manifest"):
        load(folder)


@pytest.mark.parametrize("text", ["", "{", "null", "[" * 100_000, "\0", '{"format": "other"}'])
def test_a_file_that_is_no_manifest_is_refused(folder: Path, text: str) -> None:
    (folder / "manifest.json").write_text(text)
    for work in (load, generate):
        with pytest.raises(errors.ConfigError, match="is not a valid data set manifest"):
            work(folder)


def test_other_objects_are_summed_up(folder: Path) -> None:
    """The message once listed every entry of every object."""
    others = ["procedural:can:1-200", "procedural:box:1"]
    with pytest.raises(errors.ConfigError) as caught:
        dataset.generate(others, folder, config=SETTINGS)
    assert str(caught.value) == (
        f"{str(folder)!r} was begun with other settings: 199 objects more (can-000002, can-000003, can-000004, "
        "...); 1 objects fewer (can-000000); name another folder"
    )
    changed = config(poses=3, rests=2, views=2, images=True, image_size=(16, 16), shard_trials=2, seed=9, replays=1)
    with pytest.raises(errors.ConfigError, match=r"config\.poses was 2, is now 3; .*; and \d+ more; name another"):
        dataset.generate(OBJECTS, folder, config=changed)


@pytest.mark.parametrize("columns", [["lifts"], ["success", "depth"]])
def test_columns_that_do_not_exist_are_named(whole: Path, columns: list[str]) -> None:
    with pytest.raises(errors.ConfigError, match=f"there is no column '{columns[-1]}'; choose from scene, trial"):
        dataset.load(whole, columns=columns)


@pytest.mark.parametrize("workers", [0, -1, 10**9, 1.5])
def test_a_number_of_workers_that_makes_no_sense_is_refused(workers: Any) -> None:
    with pytest.raises(errors.ConfigError, match="workers is"):
        dataset.local(workers)
