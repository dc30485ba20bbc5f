"""Videos: of pictures with captions, and of rounds of clearing."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from graspbox.configs import PictureConfig
from graspbox.errors import ConfigError, MissingExtraError
from graspbox.evaluation.rounds import clear_rounds
from graspbox.pictures import VIDEO_SUFFIXES, check_video, save_video

#: moviepy's readers of ffmpeg close their pipes when they are collected; its progress bars know an old numpy.
pytestmark = pytest.mark.filterwarnings(
    "default::pytest.PytestUnraisableExceptionWarning", "default::DeprecationWarning"
)
SETTINGS: dict[str, Any] = {"objects": "procedural:can:0-3", "hand": "panda_gripper", "layout": "packed"}


def shades() -> list[np.ndarray[Any, np.dtype[np.uint8]]]:
    """Three pictures of odd sides, each of one colour."""
    return [np.full((101, 161, 3), shade, dtype=np.uint8) for shade in (40, 120, 220)]


@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_frames_follow_each_other(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"clip{suffix}"
    save_video(path, shades(), ["one", "two", "three"], seconds=0.5)
    with Image.open(path) as clip:
        assert clip.n_frames == 3
        for index, shade in enumerate((40, 120, 220)):
            clip.seek(index)
            frame = np.asarray(clip.convert("RGB")).astype(int)
            assert clip.info["duration"] == 500
            assert abs(frame[60, 80] - shade).max() < 6
            assert frame[:9].min() < 120, "a caption"
            assert frame[:9].max() > 250, "on white"
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_an_mp4_shows_every_picture(tmp_path: Path) -> None:
    moviepy = pytest.importorskip("moviepy")
    path = tmp_path / "clip.mp4"
    save_video(path, shades(), ["one", "two", "three"], seconds=0.5)
    with moviepy.VideoFileClip(str(path)) as clip:
        assert clip.duration == pytest.approx(1.5, abs=0.15)
        for index, shade in enumerate((40, 120, 220)):
            assert abs(clip.get_frame(0.5 * index + 0.2)[60, 80].astype(int) - shade).max() < 12
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_what_makes_no_video_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "clip.gif"
    with pytest.raises(ConfigError, match=r"extension '\.avi'; use one of \.gif"):
        check_video(tmp_path / "clip.avi")
    for pictures, captions in (([], []), (shades(), ["one"])):
        with pytest.raises(ConfigError, match="one caption per picture"):
            save_video(path, pictures, captions)
    with pytest.raises(ConfigError, match="differ in size"):
        save_video(path, [shades()[0], shades()[1][:50]], ["one", "two"])
    with pytest.raises(ConfigError, match=r"seconds is 0\.0"):
        save_video(path, shades(), ["one", "two", "three"], seconds=0.0)
    monkeypatch.setitem(sys.modules, "moviepy", None)
    with pytest.raises(MissingExtraError, match="moviepy"):
        check_video(tmp_path / "clip.mp4")
    assert VIDEO_SUFFIXES == (".gif", ".webp", ".mp4")
    assert not list(tmp_path.iterdir())


def test_the_first_round_is_filmed_and_unchanged() -> None:
    seen: list[tuple[Any, str]] = []
    picture = PictureConfig(image_size=(48, 64), samples=1)
    filmed = clear_rounds(
        "top_down", rounds=2, picture=picture, film=lambda *both: seen.append(both), image_size=128, **SETTINGS
    )
    unseen = clear_rounds("top_down", rounds=2, image_size=128, **SETTINGS)
    assert filmed.to_json() == unseen.to_json()
    assert len(seen) == 1 + filmed.attempts[0]
    shown = [words for _, words in seen]
    assert shown[0] == "at first"
    assert sum(words.endswith("lifted an object") for words in shown) == filmed.successes[0]
    assert shown[1].startswith("attempt 1: ")
    assert all(one.shape == (48, 64, 3) for one, _ in seen)
    assert any((one != seen[0][0]).any() for one, _ in seen[1:]), "objects move or go"


def test_the_command_writes_a_video(tmp_path: Path) -> None:
    path = tmp_path / "clearing.gif"
    program = [sys.executable, "-m", "graspbox", "benchmark", "clutter", "top_down", "--hand", "panda_gripper"]
    words = ["--layout", "packed", "--rounds", "1", "--seed", "0", "--objects", SETTINGS["objects"], "--json"]
    done = subprocess.run([*program, *words, "--video", str(path)], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(done.stdout)
    with Image.open(path) as clip:
        assert clip.n_frames == 1 + row["attempts"]
    wrong = subprocess.run([*program, *words, "--video", "clip.avi"], capture_output=True, text=True, timeout=300)
    assert wrong.returncode in (1, 2)
    assert "use one of .gif" in wrong.stderr
