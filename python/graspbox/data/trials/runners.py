"""Runners that make the shards: this process, processes of this machine, or a Ray cluster. The rows are the same."""

import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from itertools import islice
from multiprocessing import active_children, get_context, parent_process
from typing import Any

from graspbox._common.arguments import natural
from graspbox._common.imports import imported
from graspbox._core import Hand
from graspbox.data.trials.settings import DatasetConfig
from graspbox.data.trials.shards import Shard, ShardFiles, make
from graspbox.errors import ConfigError, GraspboxError

__all__ = ["MOST_WORKERS", "Runner", "local", "on_ray"]

#: Makes shards, and yields each as soon as it is complete, in any order.
Runner = Callable[[Iterable[Shard], Hand, DatasetConfig], Iterator[ShardFiles]]

#: Shards queued per worker, so that none is idle while another's result is written.
_AHEAD = 2
#: Greatest number of processes.
MOST_WORKERS = 1024


def local(workers: int) -> Runner:
    """Make shards in several single-threaded processes of this machine; with one worker, in this process.

    A script that uses several must guard its main program with ``if __name__ == "__main__":``.

    Raises
    ------
    ConfigError
        If `workers` is not a number of processes, 1 to 1024.
    """
    if not 1 <= natural(workers, "workers") <= MOST_WORKERS:
        raise ConfigError(f"workers is {workers}; it must be from 1 to {MOST_WORKERS}")

    def run(shards: Iterable[Shard], hand: Hand, config: DatasetConfig) -> Iterator[ShardFiles]:
        if workers == 1:
            yield from (make(shard, hand, config) for shard in shards)
            return
        pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), initializer=_start_worker)
        mine: set[int] = set()
        done = False
        try:
            before = {child.pid for child in active_children()}
            waiting = iter(shards)
            running: set[Future[ShardFiles]] = set()
            while True:
                for shard in islice(waiting, _AHEAD * workers - len(running)):
                    running.add(pool.submit(make, shard, hand, config))
                mine |= {child.pid for child in active_children() if child.pid is not None} - before
                if not running:
                    break
                finished, running = wait(running, return_when=FIRST_COMPLETED)
                for future in finished:
                    yield future.result()
            done = True
        except BrokenProcessPool:
            raise GraspboxError(
                "a worker process was killed, perhaps because memory ran out; the same call resumes, with fewer workers"
            ) from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            if not done:
                # An interruption does not wait for the shards in progress.
                for child in active_children():
                    if child.pid in mine:
                        child.terminate()

    return run


def _start_worker() -> None:
    """Leave Ctrl-C to the main process, and end when it ends for any reason."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()

    def watch() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def on_ray(address: str | None = None) -> Runner:
    """Make shards as tasks of a Ray cluster, each on one CPU; the main process writes them.

    The cluster is by default that of ``RAY_ADDRESS``, else the one running on this machine, else a new local one. Every
    node needs the same version of graspbox, and mesh files at the same paths.

    Raises
    ------
    MissingExtraError
        If Ray is not installed.
    ConfigError
        If there is no cluster at the address.
    """
    ray = imported("ray", "data sets need the package ray", "ray")

    def run(shards: Iterable[Shard], hand: Hand, config: DatasetConfig) -> Iterator[ShardFiles]:
        started = not ray.is_initialized()
        if started:
            try:
                ray.init(address=address, log_to_driver=False)
            except (ConnectionError, ValueError) as error:
                raise ConfigError(f"Ray cannot be reached at {address!r}: {error}") from None
        try:
            # Rows do not depend on the number of threads; use one per CPU that Ray counts.
            task = ray.remote(num_cpus=1, max_retries=3)(make)
            shared = (ray.put(hand), ray.put(config))
            waiting, running = iter(shards), list[Any]()
            while True:
                limit = _AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
                running += [task.remote(shard, *shared) for shard in islice(waiting, limit - len(running))]
                if not running:
                    return
                finished, running = ray.wait(running, num_returns=1)
                try:
                    made = ray.get(finished[0])
                except ray.exceptions.RayTaskError as error:
                    raise error.cause from None
                yield made
        finally:
            if started:
                with suppress(Exception):
                    ray.shutdown()

    return run
