"""Averages of many images: what is computed, in bounded memory, and counted before anything is read."""

import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspbox.captures import Capture, average, read_capture, reading
from graspbox.captures.averaging import MOST_IMAGES
from graspbox.captures.capture import Found
from graspbox.errors import ConfigError

LENS = np.array([[60.0, 0.0, 32.0], [0.0, 60.0, 24.0], [0.0, 0.0, 1.0]])


def noisy(count: int, shape: tuple[int, int] = (48, 64), holes: float = 0.3) -> Iterator[Capture]:
    """Make images at 0.7 m with noise of 2 mm, an outlier now and then, and holes."""
    rng = np.random.default_rng(count)
    for _ in range(count):
        depth = 0.7 + rng.normal(0.0, 0.002, shape)
        depth = np.where(rng.random(shape) < 0.05, 1.5, depth)
        yield Capture(np.where(rng.random(shape) < holes, 0.0, depth), LENS)


@pytest.mark.parametrize("count", [2, 3, 10, 31])
def test_few_images_have_the_median_of_what_is_measured(count: int) -> None:
    images = list(noisy(count))
    found = average(images)
    stack = np.stack([one.depth for one in images])
    kept = (stack > 0).sum(axis=0) >= max(2, count / 2)
    exact = np.array([np.median(column[column > 0]) for column in stack.reshape(count, -1).T[kept.ravel()]])
    np.testing.assert_allclose(found.depth[kept], exact, atol=1e-6)
    assert not found.depth[~kept].any()
    assert found.source == f"{count} images, "


@pytest.mark.parametrize("count", [32, 47, 60, 120])
def test_many_images_have_less_noise_and_the_same_holes(count: int) -> None:
    images = list(noisy(count, holes=0.45))
    found = average(iter(images))
    measured = np.sum([one.depth > 0 for one in images], axis=0)
    np.testing.assert_array_equal(found.depth > 0, measured >= count / 2)
    own = found.depth[found.depth > 0]
    exact = np.array(
        [np.median(column[column > 0]) for column in np.stack([one.depth for one in images]).reshape(count, -1).T]
    )
    # The median of medians errs by a fifth more than the median of all, and not by outliers.
    assert np.abs(own - 0.7).mean() < 1.4 * np.abs(exact - 0.7).mean()
    assert np.abs(own - 0.7).max() < 0.01


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, -1.0, 1e300])
@pytest.mark.parametrize("count", [3, 40])
def test_what_is_not_finite_is_not_measured(wrong: float, count: int) -> None:
    """NaN is last in numpy's order, where the measured values are looked for."""
    images = list(noisy(count))
    broken = [Capture(np.where(one.depth > 0, one.depth, wrong), LENS) for one in images]
    np.testing.assert_array_equal(average(broken).depth, average(images).depth)


def test_memory_does_not_grow_with_the_images() -> None:
    def peak(count: int) -> int:
        tracemalloc.start()
        average(noisy(count, (300, 400)))
        used = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return used

    few, many = peak(40), peak(118)
    assert many < 1.3 * few
    assert many < 40 * 4 * 300 * 400 + (1 << 25)


def test_images_are_counted_before_they_are_read(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there are 121 images to average; pass 1 to 120"):
        average(noisy(MOST_IMAGES + 1, (4, 4)))
    with pytest.raises(ConfigError, match="there are 0 images"):
        average(iter(()))
    with pytest.raises(ConfigError, match="has more than 8388608 pixels"):
        average(Capture(np.broadcast_to(0.7, (2049, 4096)), LENS) for _ in range(2))
    pytest.importorskip("typer", reason="the command line needs the extra 'cli'")
    from command_line import invoke

    missing = [tmp_path / f"{number}.npy" for number in range(121)]
    words = ["grasp-image", *missing, "--policy", "depth", "--intrinsics", "60", "60", "32", "24"]
    assert "there are 121 images to average" in str(invoke(words).exception)
    assert "there are 240 images to average" in str(invoke([*words[:3], *words[-7:], "--frames", "120"]).exception)


@pytest.fixture
def recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Pretend that a file is a recording of 6 images, of which all but the first two have another size."""
    seen: dict[str, Any] = {"path": tmp_path / "made.bag", "decoded": 0, "open": 0}
    seen["path"].write_bytes(b"#ROSBAG V2.0")

    def decoded(number: int) -> Found:
        seen["decoded"] += 1
        return Found("made", image=np.full((48, 64 if number < 2 else 60), 0.7))

    def images(*_: Any) -> Iterator[tuple[float, Callable[[], Found]]]:
        seen["open"] += 1
        try:
            for number in range(6):
                yield float(number), lambda number=number: decoded(number)  # type: ignore[misc]
        finally:
            seen["open"] -= 1

    monkeypatch.setattr(reading, "recorded_images", images)
    monkeypatch.setattr(reading, "read_recording", lambda *_: decoded(0))
    return seen


def test_each_image_of_a_recording_is_decoded_once(recording: dict[str, Any]) -> None:
    read_capture(recording["path"], intrinsics=LENS, frames=2)
    assert (recording["decoded"], recording["open"]) == (2, 0)
    read_capture(recording["path"], intrinsics=LENS)
    assert recording["decoded"] == 3


def test_a_recording_that_cannot_be_averaged_is_closed(recording: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="pass images of one camera") as refused:
        read_capture(recording["path"], intrinsics=LENS, frames=5)
    assert refused.value is not None  # its traceback keeps the frames of the reader
    assert recording["open"] == 0


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (0, "there are 0 images to average; pass 1 to 120"),
        (121, "there are 121 images"),
        (-1, r"frames is -1 \(int\)"),
        (1.5, r"frames is 1\.5 \(float\); give an integer"),
        ("2", r"frames is '2' \(str\); give an integer"),
    ],
)
def test_frames_are_checked_before_anything_is_read(recording: dict[str, Any], frames: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_capture(recording["path"], intrinsics=recording["path"].parent / "none.json", frames=frames)
    assert recording["decoded"] == 0
