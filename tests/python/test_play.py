"""``graspbox play``: episodes in a window or a video, with their outcomes. Runs of a training: `test_sb3_runs`."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from command_line import invoke
from graspbox import evaluation
from graspbox.errors import ConfigError

Image = pytest.importorskip("PIL.Image")

CLOSED, CANS = "graspbox/Grasp-v0", "procedural:can:0-3"


def played(*words: Any) -> Any:
    """Run the command with ``--json``."""
    result = invoke(["play", *words, "--json"], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def frames(path: Path) -> tuple[int, float]:
    """Return the number of pictures of a video, and its length in seconds."""
    with Image.open(path) as video:
        times = []
        for place in range(video.n_frames):
            video.seek(place)
            video.load()
            times.append(video.info["duration"])
    return len(times), sum(times) / 1000


def test_episodes_are_the_trials_of_an_evaluation(tmp_path: Path) -> None:
    """The video lasts as long as the episodes, and a second more for each end."""
    shown = played("planner", "--env", CLOSED, "--objects", CANS, "--episodes", 2, "--video", tmp_path / "film.webp")
    trials = evaluation.evaluate("planner", CLOSED, CANS, trials=2).trials
    wanted = [(one.seed, one.object, one.success, one.secure, one.failure, one.steps) for one in trials]
    names = ("seed", "object", "success", "secure", "failure", "steps")
    assert [tuple(row[name] for name in names) for row in shown["episodes"]] == wanted
    assert [row["reward"] for row in shown["episodes"]] == pytest.approx([one.reward for one in trials])
    assert shown["succeeded"] == sum(one.success for one in trials) > 0
    assert [row["seconds"] for row in shown["episodes"]] == pytest.approx([one.steps / 20 for one in trials])
    count, seconds = frames(tmp_path / "film.webp")
    assert count > 40
    # Of 20 steps a second every second one is a picture, the first of an episode is its start.
    assert seconds == pytest.approx(sum(one.steps for one in trials) / 20 + 2 * 1.0, abs=0.3)


def test_a_decision_has_two_pictures(tmp_path: Path) -> None:
    shown = played("planner", "--objects", CANS, "--episodes", 3, "--video", tmp_path / "film.gif")
    assert shown["env_id"] == "graspbox/GraspPose-v0"
    assert frames(tmp_path / "film.gif") == (6, 6.0)


def test_outcomes_are_printed(tmp_path: Path) -> None:
    words = ["play", "zero", "--env", CLOSED, "--objects", CANS, "--episodes", "2", "--video", tmp_path / "a.gif"]
    result = invoke(words, catch_exceptions=False)
    first, second, total, video = result.stdout.splitlines()
    assert first.startswith("1: can-00000")
    assert "no_contact after 40 steps (8.0 s), reward" in second
    assert total == "0 of 2 episodes succeed"
    assert video.startswith(f"video: {tmp_path / 'a.gif'}, ")


def test_a_long_video_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its pictures are in memory."""
    monkeypatch.setattr("graspbox.pictures.playback.MOST_PICTURES", 3)
    words = ["play", "planner", "--objects", CANS, "--episodes", "2", "--video", tmp_path / "a.gif"]
    result = invoke(words, catch_exceptions=False)
    assert "3 pictures; it ends after 3 pictures" in result.stdout
    assert frames(tmp_path / "a.gif")[0] == 3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("zero", "--video", "film.txt"), "has the extension '.txt'; use one of .gif, .webp, .mp4"),
        (("zero", "--env", "graspbox/Grasp-v9", "--video", "film.gif"), "no environment 'graspbox/Grasp-v9'"),
        (("nobody", "--video", "film.gif"), "there is no policy 'nobody'"),
    ],
)
def test_a_wrong_call_is_refused(
    words: tuple[str, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match=message):
        invoke(["play", *words], catch_exceptions=False)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("driver", "status"), [("dummy", 0), ("x11", 2)])
def test_a_window_needs_a_display(driver: str, status: int) -> None:
    pytest.importorskip("pygame")
    words = ["play", "zero", "--env", CLOSED, "--objects", CANS, "--episodes", "1"]
    variables = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    done = subprocess.run(
        [sys.executable, "-m", "graspbox", *words],
        env={**variables, "SDL_VIDEODRIVER": driver},
        capture_output=True,
        text=True,
    )
    assert done.returncode == status, done.stderr
    if status:
        assert "no window can be opened here" in done.stderr
        assert "--video FILE.webp" in done.stderr
    else:
        assert done.stdout.endswith("0 of 1 episodes succeed\n")
