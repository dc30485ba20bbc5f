"""Paths of pictures are checked before the work, and files appear whole or not at all."""

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from graspbox import errors

pytest.importorskip("matplotlib")
from matplotlib.figure import Figure
from PIL import Image

from graspbox import pictures
from graspbox.pictures import files
from graspbox.study import comparison

#: Every function that writes a picture, without its input: a bad path must be refused before the input is used.
NOTHING: Any = None
WRITERS = {
    "plan": lambda path: pictures.save_plan(path, NOTHING, NOTHING),
    "gallery": lambda path: pictures.save_gallery(path, NOTHING),
    "sweep": lambda path: pictures.save_sweep(path, NOTHING),
    "kindness": lambda path: pictures.save_kindness(path, "object", NOTHING, NOTHING),
    "arrangements": lambda path: pictures.save_arrangements(path, NOTHING),
    "stages": lambda path: pictures.save_stages(path, NOTHING, NOTHING),
    "episode": lambda path: pictures.save_episode(path, NOTHING),
    "grasp_image": lambda path: pictures.save_grasp_image(path, NOTHING),
    "rates": lambda path: pictures.save_rates(path, "title", NOTHING),
    "reliability": lambda path: pictures.save_reliability(path, "title", NOTHING),
    "reach_map": lambda path: pictures.save_reach_map(path, NOTHING),
    "hand_frames": lambda path: pictures.save_hand_frames(path, NOTHING),
    "hand_motion": lambda path: pictures.save_hand_motion(path, NOTHING),
    "comparison": lambda path: comparison.save_comparison(path, NOTHING),
}


def chart() -> Figure:
    """Make a small figure."""
    figure = Figure(figsize=(1, 1))
    figure.subplots().plot([0, 1], [1, 0])
    return figure


def test_every_function_that_writes_a_picture_is_tried() -> None:
    found = {name.removeprefix("save_") for name in pictures.__all__ if name.startswith("save_")}
    # Videos have extensions and tests of their own.
    assert found - {"video", "trial", "path"} | {"comparison"} == set(WRITERS)


@pytest.mark.parametrize("name", WRITERS)
def test_bad_paths_are_refused_before_the_work(name: str, tmp_path: Path) -> None:
    """A str once had no ``suffix``, an unknown suffix failed after minutes, and a folder DIR became DIR.png."""
    save: Any = WRITERS[name]
    folder = tmp_path / "folder"
    folder.mkdir()
    for path, error, reason in (
        (str(tmp_path / "a.xyz"), errors.ConfigError, r"extension '.xyz'; use one of .png, .pdf"),
        (tmp_path / "a", errors.ConfigError, r"extension ''; use one of"),
        (tmp_path / "a.npy", errors.ConfigError, r"extension '.npy'"),
        (str(folder), errors.ConfigError, "is a folder; name a picture in it"),
        (tmp_path / "none" / "a.png", errors.FileError, "folder does not exist"),
        (3, errors.ConfigError, "path is 3; pass a str or a Path"),
    ):
        with pytest.raises(error, match=reason):
            save(path)
    assert list(tmp_path.iterdir()) == [folder]
    assert not list(folder.iterdir())


def test_folders_that_cannot_be_written_to_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(errors.FileError, match="cannot be written to"):
        pictures.check_path(tmp_path / "a.png")


@pytest.mark.parametrize("suffix", pictures.SUFFIXES)
def test_every_suffix_gives_its_format(suffix: str, tmp_path: Path) -> None:
    path = pictures.check_path(str(tmp_path / f"chart{suffix.upper()}"))
    files.write(chart(), path)
    start = path.read_bytes()[:5]
    if suffix in (".pdf", ".svg"):
        assert start == {".pdf": b"%PDF-", ".svg": b"<?xml"}[suffix]
    else:
        with Image.open(path) as image:
            assert image.format == {".png": "PNG", ".webp": "WEBP"}.get(suffix, "JPEG")


def test_a_picture_is_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "chart.png"
    path.write_text("precious")
    figure = chart()

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        with pytest.raises(errors.FileError, match="No space left") as caught:
            files.write(figure, path)
    assert (caught.value.errno, caught.value.filename) == (errno.ENOSPC, str(path))
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path], "nothing is left behind"
    files.write(figure, path)
    plain = tmp_path / "plain"
    plain.touch()
    assert stat.S_IMODE(path.stat().st_mode) == stat.S_IMODE(plain.stat().st_mode)
    with Image.open(path) as image:
        assert image.format == "PNG"


def run(code: str, **settings: str) -> "subprocess.CompletedProcess[str]":
    """Run code in a fresh interpreter."""
    environment = {**os.environ, **settings}
    return subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)


def test_the_backend_does_not_matter(tmp_path: Path) -> None:
    code = f"""
import os, sys
from graspbox.pictures import files
from graspbox.pictures.files import Figure
files.write(Figure(figsize=(1, 1)), files.check_path({str(tmp_path / "chart.png")!r}))
import graspbox.cli, graspbox.study.figures
assert "matplotlib.pyplot" not in sys.modules
import matplotlib
print(os.environ["MPLBACKEND"], matplotlib.get_backend())
"""
    # One that does not exist, and one that pyplot still uses.
    for chosen, backend in (("nope", "agg"), ("svg", "svg")):
        result = run(code, MPLBACKEND=chosen)
        assert result.returncode == 0, result.stderr
        assert result.stdout.split() == [chosen, backend]
        assert (tmp_path / "chart.png").stat().st_size > 50


@pytest.mark.parametrize("name", ["a.xyz", "folder"])
def test_the_command_line_refuses_bad_paths_at_once(name: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    arguments = ["graspbox", "plan", "procedural:can:0", "--picture", str(tmp_path / name)]
    result = run(f"import sys; sys.argv = {arguments!r}; from graspbox.__main__ import main; main()")
    assert result.returncode in (1, 2)
    assert result.stderr.startswith("graspbox: ")
    assert name in result.stderr
    assert "Traceback" not in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_the_extra_is_named_where_matplotlib_is_missing() -> None:
    blocked = "import sys; sys.modules['matplotlib'] = None\n"
    caught = "except graspbox.errors.MissingExtraError as error:\n print(error)"
    result = run(blocked + "import graspbox\ntry:\n import graspbox.pictures\n" + caught)
    assert result.returncode == 0, result.stderr
    assert "graspbox[cli]" in result.stdout
    arguments = ["graspbox", "plan", "procedural:can:0", "--picture", "a.png"]
    command = run(blocked + f"sys.argv = {arguments!r}; from graspbox.__main__ import main; main()")
    assert command.returncode == 2
    assert "graspbox[cli]" in command.stderr
    assert "Traceback" not in command.stderr
