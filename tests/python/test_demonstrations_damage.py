"""Damaged, incomplete or inconsistent demonstrations: each is named, none is used or overwritten."""

import json
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from graspbox.data.episodes import Demonstrations, record
from graspbox.data.episodes.manifest import _digest
from graspbox.errors import ConfigError, GraspboxError

pytest.importorskip("pyarrow")

SETTINGS: dict[str, Any] = {
    "objects": "procedural:can:0-9",
    "obs": ("proprio",),
    "keep": "all",
    "num_envs": 2,
    "max_episode_steps": 3,
    "file_episodes": 2,
}
FILES = [f"episodes-{number:05d}.parquet" for number in range(4)]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight short episodes in four files."""
    return record("zero", tmp_path_factory.mktemp("whole") / "made", episodes=8, **SETTINGS).folder


@pytest.fixture
def folder(whole: Path, tmp_path: Path) -> Path:
    """Copy them."""
    return Path(shutil.copytree(whole, tmp_path / "copy"))


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != ".lock"}


def flipped(path: Path, bit: int) -> None:
    content = bytearray(path.read_bytes())
    content[bit // 8] ^= 1 << bit % 8
    path.write_bytes(content)


def read(folder: Path) -> list[Any]:
    return list(Demonstrations(folder).read())


@pytest.mark.parametrize("damaged", [FILES[1], FILES[3]])
def test_a_damaged_file_is_recorded_again_as_the_error_advises(whole: Path, folder: Path, damaged: str) -> None:
    """Its place in the middle was once filled with later episodes, and a good file overwritten."""
    flipped(folder / damaged, 8 * 200)
    with pytest.raises(
        ConfigError, match=rf"{damaged}' is damaged.*; remove it, and the same call of record"
    ) as caught:
        record("zero", folder, episodes=8, **SETTINGS)
    (folder / damaged).unlink()
    with pytest.raises(ConfigError, match=rf"{damaged}' is missing; the same call of record makes"):
        Demonstrations(folder)
    assert damaged in str(caught.value)
    found = record("zero", folder, episodes=8, **SETTINGS)
    assert [episode.trial for episode in found.episodes] == list(range(8))
    assert contents(folder) == contents(whole)


def test_several_files_are_recorded_again_before_new_ones(whole: Path, folder: Path, tmp_path: Path) -> None:
    for name in (FILES[0], FILES[2]):
        (folder / name).unlink()
    found = record("zero", folder, episodes=10, **SETTINGS)
    assert [episode.trial for episode in found.episodes] == list(range(10))
    assert contents(folder).items() >= {name: raw for name, raw in contents(whole).items() if name in FILES}.items()
    assert len(read(folder)) == 10


def test_a_file_of_somebody_else_is_neither_read_nor_overwritten(folder: Path) -> None:
    stranger = folder / "episodes-00004.parquet"
    shutil.copy(folder / FILES[0], stranger)
    assert len(read(folder)) == 8
    with pytest.raises(ConfigError, match=r"holds 'episodes-00004\.parquet', which its manifest\.json does not name"):
        record("zero", folder, episodes=10, **SETTINGS)
    assert stranger.read_bytes() == (folder / FILES[0]).read_bytes()


def test_a_flipped_bit_is_noticed_wherever_it_is(whole: Path, tmp_path: Path) -> None:
    """In data, footers and manifests; exchanged files too."""
    chosen = random.Random(0)
    for number in range(60):
        folder = Path(shutil.copytree(whole, tmp_path / str(number)))
        name = chosen.choice([*FILES, "manifest.json"])
        flipped(folder / name, chosen.randrange(8 * (folder / name).stat().st_size))
        with pytest.raises(ConfigError, match=name):
            read(folder)
    folder = Path(shutil.copytree(whole, tmp_path / "exchanged"))
    first, second = (folder / name for name in FILES[:2])
    content = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(content)
    with pytest.raises(ConfigError, match="is damaged"):
        read(folder)


Change = Callable[[dict[str, Any]], None]
#: No values of fields.
WRONG: list[Any] = [None, [], 0.5, ...]


def at(*path: Any, value: Any) -> Change:
    """Replace a value within a manifest; `...` removes it."""

    def change(manifest: dict[str, Any]) -> None:
        *above, last = path
        place: Any = manifest
        for key in above:
            place = place[key]
        if value is ...:
            del place[last]
        else:
            place[last] = value

    return change


FIRST = ("files", 0, "episodes", 0)
TAMPERED: list[Change] = [
    at("format", value="other"),
    at("version", value=1),
    at("version", value="2"),
    *(at(key, value=value) for key in ("files", "settings", "refused") for value in (7, None, "a", ...)),
    *(at("files", 0, key, value=value) for key in ("name", "sha256", "first_trial") for value in WRONG),
    at("files", 0, "name", value="../../etc/passwd"),
    at("files", 0, "name", value="episodes-00000.parquet\0"),
    *(at(*FIRST, key, value=value) for key in ("steps", "seed", "object", "success") for value in WRONG),
    at(*FIRST, "steps", value=10**12),
    at(*FIRST, "steps", value=-1),
    *(at("settings", key, value=value) for key in ("observations", "env_spec", "action_size") for value in WRONG),
    at("settings", "observations", "proprio", value={"shape": [10**9, 10**9], "dtype": "float32"}),
    at("settings", "observations", "proprio", value={"shape": [-4], "dtype": "float32"}),
    at("settings", "observations", "proprio", value={"shape": [4], "dtype": "float32"}),
    at("settings", "observations", "proprio", value={"shape": [28], "dtype": "object"}),
    at("settings", "observations", "depth", value={"shape": [16, 16, 1], "dtype": "float32"}),
    at("settings", "action_size", value=10**12),
    at("settings", "action_size", value=-1),
    at("settings", "env_spec", "kwargs", value=[]),
]


@pytest.mark.parametrize("change", TAMPERED)
def test_a_manifest_that_was_tampered_with_is_refused(folder: Path, change: Change) -> None:
    """Also where its own hash is right again: nothing in it is believed before it is checked."""
    path = folder / "manifest.json"
    manifest = json.loads(path.read_text())
    change(manifest)
    path.write_text(json.dumps(manifest))
    with pytest.raises(ConfigError):
        read(folder)
    path.write_text(json.dumps({**manifest, "sha256": _digest(manifest)}))
    with pytest.raises(ConfigError):
        read(folder)


@pytest.mark.parametrize("text", ["", "{", "null", "[" * 100_000, '{"format": "other"}', "\0", '{"a": NaN}'])
def test_a_file_that_is_no_manifest_is_refused(folder: Path, text: str) -> None:
    (folder / "manifest.json").write_text(text)
    with pytest.raises(GraspboxError, match="is not a valid manifest of demonstrations"):
        Demonstrations(folder)
    with pytest.raises(GraspboxError, match="is not a valid manifest of demonstrations"):
        record("zero", folder, episodes=8, **SETTINGS)
