"""Threads, forks, signals and panics: what happens around a call into Rust."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from graspbox import _core, errors

#: A shell starts what it puts in the background deaf to Ctrl-C, and Python leaves it so.
LISTEN = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
#: Seconds; the work that is interrupted takes a minute and more. On an idle machine it ends within one second.
FAR_LESS = 20.0


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
    """Another Python thread counts on while Rust works."""
    count, stop = 0, threading.Event()

    def tick() -> None:
        nonlocal count
        while not stop.is_set():
            count += 1
            time.sleep(0.005)

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        _core._spin(0.5)
    finally:
        stop.set()
        thread.join()
    assert count > 10


@pytest.mark.parametrize("deaf", [False, True], ids=["listening", "deaf"])
def test_ctrl_c_stops_a_call(deaf: bool) -> None:
    """A deaf call never looks at its cancel flag, and is left behind."""
    code = (
        f"{LISTEN}import time; from graspbox import _core; print('ready', flush=True)\n"
        f"try: _core._spin(60.0, deaf={deaf})\n"
        "except KeyboardInterrupt: print('stopped', flush=True)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.3)
        started = time.monotonic()
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "stopped\n"
        assert time.monotonic() - started < FAR_LESS
        assert process.wait(timeout=5) == 0


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
    code = (
        f"{LISTEN}import numpy as np, graspbox\n"
        "scene = graspbox.Scene(graspbox.object_sets.load('procedural:can:0')[0].load())\n"
        "plan = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object).best(1)\n"
        "print('ready', flush=True)\n"
        "try: scene.simulate(np.repeat(plan.poses, 5000, axis=0), np.repeat(plan.preshape, 5000))\n"
        "except KeyboardInterrupt: print('stopped', flush=True)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.5)
        started = time.monotonic()
        process.send_signal(signal.SIGINT)
        assert process.stdout.readline() == "stopped\n"
        assert time.monotonic() - started < FAR_LESS
        assert process.wait(timeout=10) == 0
