"""A data set survives SIGKILL at any moment: no row is lost or doubled, and no process stays behind."""

import os
import random
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from datasets_for_tests import command, contents, run

pytest.importorskip("pyarrow")

_PATIENCE = 300.0


def shards(folder: Path) -> dict[str, bytes]:
    """Complete shards, by name."""
    return {path.name: path.read_bytes() for path in folder.glob("trials/[a-z]*.parquet")}


def killed_when(folder: Path, moment: Callable[[], bool]) -> None:
    """Start the command, and kill its main process alone at a moment; its workers must follow it."""
    env = {**os.environ, "GRASPBOX_THREADS": "1"}
    child = subprocess.Popen(
        [*command(folder), "--workers", "2"],
        env=env,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    end = time.monotonic() + _PATIENCE
    while child.poll() is None and not moment():
        assert time.monotonic() < end
        time.sleep(0.01)
    child.send_signal(signal.SIGKILL)
    child.wait()
    while time.monotonic() < end:
        try:
            os.killpg(child.pid, 0)
        except ProcessLookupError:
            return
        time.sleep(0.05)
    os.killpg(child.pid, signal.SIGKILL)
    raise AssertionError("processes of a killed run stay behind")


def check(tmp_path: Path, moments: Callable[[int], Callable[[], bool]], count: int) -> None:
    assert run(tmp_path / "whole", "--workers", "2").returncode == 0
    whole = shards(tmp_path / "whole")
    assert len(whole) == 6
    folder = tmp_path / "killed"
    for index in range(count):
        killed_when(folder, moments(index))
        found = shards(folder)
        assert found.items() <= whole.items()
    assert run(folder, "--workers", "2").returncode == 0
    assert contents(folder) == contents(tmp_path / "whole")


def test_killed_three_times(tmp_path: Path) -> None:
    """As soon as one, three and five shards are there."""
    wanted = (1, 3, 5)
    check(tmp_path, lambda index: lambda: len(shards(tmp_path / "killed")) >= wanted[index], len(wanted))


@pytest.mark.slow
def test_killed_at_random_moments(tmp_path: Path) -> None:
    """20 times, anywhere between the start of the program and the end of its work."""
    generator = random.Random(0)
    started = time.monotonic()
    assert run(tmp_path / "timed", "--workers", "2").returncode == 0
    duration = time.monotonic() - started

    def at_random(_: int) -> Callable[[], bool]:
        end = time.monotonic() + generator.uniform(0.0, duration)
        return lambda: time.monotonic() > end

    check(tmp_path, at_random, 20)
