"""Threads, forks and signals during a call into Rust."""

import os
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import graspbox
from graspbox import _core, errors
from interrupting import interrupted

#: Counts the threads of the core in this process.
COUNTING = """
import pathlib, time, graspbox
mesh = graspbox.object_sets.load('procedural:box:0')[0].load()
def count():
    time.sleep(0.2)  # a thread names itself once it runs
    names = [task.read_text() for task in pathlib.Path('/proc/self/task').glob('*/comm')]
    return sum(name.startswith('graspbox-') for name in names)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="threads are counted in /proc")
def test_number_of_threads() -> None:
    """A pool of each size is started at its first use, and stays."""
    code = (
        f"{COUNTING}counts = [count()]\n"
        "graspbox.plan(mesh, num_threads=3); counts.append(count())\n"
        "graspbox.plan(mesh); counts.append(count())\n"
        "print(*counts, graspbox._core.num_threads())\n"
    )
    env = {**os.environ, "GRASPBOX_THREADS": "2"}
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=env)
    assert result.stdout.split() == ["2", "5", "5", "2"], result.stderr


@pytest.mark.parametrize("value", ["0", "many", "-1", "100000"])
def test_bad_number_of_threads_is_named(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
    monkeypatch.setenv("GRASPBOX_THREADS", value)
    with pytest.raises(errors.ConfigError, match="GRASPBOX_THREADS"):
        _core.num_threads()
    with pytest.raises(ValueError, match="num_threads is 0; give an integer between 1 and 1024, or None"):
        _core.num_threads(0)


@pytest.mark.skipif(sys.platform != "linux", reason="sizes are read in /proc")
def test_defects_are_internal_errors() -> None:
    """Here, threads that cannot start; panics take the same way (Rust: `a_panic_is_an_error_with_its_message`)."""
    code = (
        "import pathlib, resource, graspbox\n"
        "mesh = graspbox.object_sets.load('procedural:box:0')[0].load()\n"
        "pages = int(pathlib.Path('/proc/self/statm').read_text().split()[0])\n"
        "most = pages * resource.getpagesize() + (256 << 20)\n"
        "resource.setrlimit(resource.RLIMIT_AS, (most, most))\n"
        "try:\n"
        "    graspbox.plan(mesh, num_threads=1024)\n"  # each thread has a stack of 8 MiB
        "except graspbox.errors.InternalError as error:\n"
        "    print(error)\n"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert result.stdout.startswith("internal error, please report it together with the input: cannot start"), result


def test_gil_is_released() -> None:
    """Another Python thread continues while Rust works, for about a second."""
    scene = graspbox.Scene(graspbox.object_sets.load("procedural:box:0")[0].load())
    best = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object).best(1)
    poses, preshape = np.repeat(best.poses, 20, axis=0), np.repeat(best.preshape, 20)
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
        scene.simulate(poses, preshape, num_threads=1)
        ended.set()
        count = len(during)
    finally:
        ended.set()
        thread.join()
    # One at most comes before the call, and one after it.
    assert count > 3


#: Tells that the main thread is in a call which has released the lock, by another thread that could not run otherwise.
#: The call must have been made before, so that it imports nothing: a Ctrl-C within an import may end Python with the
#: status of SIGINT although it was caught.
CALLING = """
import threading
calling = threading.Event()
threading.Thread(target=lambda: (calling.wait(), ready()), daemon=True).start()
"""


def test_ctrl_c_stops_a_call_that_does_not_look_for_it() -> None:
    """Such a call is left behind; it would take hours."""
    code = (
        f"{CALLING}import graspbox\n"
        "mesh = graspbox.object_sets.load('procedural:mug:0')[0].load()\n"
        "graspbox.arrange([mesh], physics=graspbox.PhysicsConfig(dt=1e-3))\n"
        "physics = graspbox.PhysicsConfig(dt=1e-5)\n"
        "try: calling.set(); graspbox.arrange([mesh] * 64, physics=physics)\n"
        "except KeyboardInterrupt: print('stopped')\n"
    )
    assert interrupted(code) == (0, "stopped\n", "")


def test_forked_child_gets_pools_of_its_own() -> None:
    """The parent's pool is alive; the child must not wait for threads that it does not have."""
    code = (
        "import os, graspbox\n"
        "mesh = graspbox.object_sets.load('procedural:box:0')[0].load()\n"
        "count = len(graspbox.plan(mesh, num_threads=2))\n"
        "child = os.fork()\n"
        "same = len(graspbox.plan(mesh, num_threads=2)) == count\n"
        "if child == 0: os._exit(7 if same else 1)\n"
        "print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), same)\n"
    )
    env = {**os.environ, "PYTHONWARNINGS": "ignore"}
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, env=env)
    assert result.stdout.split() == ["7", "True"], result.stderr


def test_ctrl_c_stops_a_batch_of_trials() -> None:
    """Which would take hours."""
    code = (
        f"{CALLING}import numpy as np, graspbox\n"
        "scene = graspbox.Scene(graspbox.object_sets.load('procedural:can:0')[0].load())\n"
        "plan = graspbox.plan(scene.mesh, world_from_object=scene.world_from_object).best(1)\n"
        "poses, preshape = np.repeat(plan.poses, 200_000, axis=0), np.repeat(plan.preshape, 200_000)\n"
        "scene.simulate(plan.poses, plan.preshape)\n"
        "try: calling.set(); scene.simulate(poses, preshape)\n"
        "except KeyboardInterrupt: print('stopped')\n"
    )
    assert interrupted(code) == (0, "stopped\n", "")
