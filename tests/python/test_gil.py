"""Threads, forks, signals and panics during a call into Rust."""

import os
import subprocess
import sys
import threading
import time

import pytest

from graspbox import _core, errors
from interrupting import interrupted


def test_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _core._spin(0.0, num_threads=3) == 3
    monkeypatch.setenv("GRASPBOX_THREADS", "2")
    assert _core.num_threads() == 2
    assert _core._spin(0.0) == 2
    assert _core._spin(0.0, num_threads=1) == 1


@pytest.mark.parametrize("value", ["0", "many", "-1", "100000"])
def test_bad_number_of_threads_is_named(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
    monkeypatch.setenv("GRASPBOX_THREADS", value)
    with pytest.raises(errors.ConfigError, match="GRASPBOX_THREADS"):
        _core._spin(0.0)
    with pytest.raises(ValueError, match="num_threads is 0; give an integer between 1 and 1024, or None"):
        _core._spin(0.0, num_threads=0)


def test_panic_becomes_an_exception_and_the_pool_survives() -> None:
    with pytest.raises(errors.InternalError, match="please report"):
        _core._spin(0.0, num_threads=2, fail=True)
    assert _core._spin(0.0, num_threads=2) == 2


def test_gil_is_released() -> None:
    """Another Python thread continues while Rust works."""
    begun, ended = threading.Event(), threading.Event()
    during = []

    def tick() -> None:
        begun.wait()
        while not ended.is_set():
            during.append(time.monotonic())
            time.sleep(0.005)

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        begun.set()
        _core._spin(1.0)
        ended.set()
        count = len(during)
    finally:
        ended.set()
        thread.join()
    # One at most comes before the call, and one after it.
    assert count > 3


#: Tells that the main thread is in a call which has released the lock, by another thread that could not run otherwise.
CALLING = """
import threading
calling = threading.Event()
threading.Thread(target=lambda: (calling.wait(), ready()), daemon=True).start()
"""


@pytest.mark.parametrize("deaf", [False, True], ids=["listening", "deaf"])
def test_ctrl_c_stops_a_call(deaf: bool) -> None:
    """A deaf call never looks at its cancel flag, and is left behind. Both would run for a week."""
    code = f"{CALLING}from graspbox import _core\ntry: calling.set(); _core._spin(1e6, deaf={deaf})\n"
    ended = interrupted(f"{code}except KeyboardInterrupt: print('stopped')\n")
    assert ended == (0, "stopped\n", "")


def test_forked_child_gets_pools_of_its_own() -> None:
    """The parent's pool is alive; the child must not wait for threads that it does not have."""
    code = (
        "import os; from graspbox import _core; _core._spin(0.0, num_threads=2)\n"
        "child = os.fork()\n"
        "n = _core._spin(0.0, num_threads=2)\n"
        "if child == 0: os._exit(n)\n"
        "print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), n)\n"
    )
    env = {**os.environ, "PYTHONWARNINGS": "ignore"}
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=20, env=env)
    assert result.stdout.split() == ["2", "2"], result.stderr


def test_ctrl_c_stops_a_batch_of_trials() -> None:
    """Which would take hours."""
    code = (
        f"{CALLING}import numpy as np, graspbox\n"
        "scene = graspbox.Scene(graspbox.object_sets.load('procedural:can:0')[0].load())\n"
        "plan = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object).best(1)\n"
        "poses, preshape = np.repeat(plan.poses, 200_000, axis=0), np.repeat(plan.preshape, 200_000)\n"
        "try: calling.set(); scene.simulate(poses, preshape)\n"
        "except KeyboardInterrupt: print('stopped')\n"
    )
    assert interrupted(code) == (0, "stopped\n", "")
