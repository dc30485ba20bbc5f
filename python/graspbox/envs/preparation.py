"""Objects of environments: handles that environments share, and preparing all of their objects."""

import json
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from typing import Any, Protocol
from weakref import WeakValueDictionary

from graspbox import _core, object_sets
from graspbox._core import Hand, Objects
from graspbox.configs import PhysicsConfig
from graspbox.envs.settings import HandArgument
from graspbox.errors import GraspboxError
from graspbox.meshes import to_json
from graspbox.simulation import cache_folder, load_hand

__all__ = ["PreparesObjects", "load_objects", "prepare_objects"]

#: Handles in use: environments beside each other prepare an object once.
_handles: WeakValueDictionary[tuple[Any, ...], Objects] = WeakValueDictionary()


def _describe(spec: object_sets.ObjectSpec) -> str:
    """Write an object as the core reads it."""
    found = asdict(spec)
    del found["mass_known"], found["source"]
    return json.dumps({**found, "path": None if spec.path is None else str(spec.path)})


def load_objects(objects: object_sets.ObjectSet, hand: HandArgument, physics: PhysicsConfig) -> tuple[Objects, Hand]:
    """Make a handle on objects, or take the one that another environment uses."""
    cache = cache_folder()
    # A forked process has neither the thread nor the locks of its parent's handles.
    key = (objects.objects, hand, physics, cache, os.getpid())
    found = _handles.get(key) if isinstance(hand, str) else None
    loaded = load_hand(hand)
    if found is None:
        found = Objects([_describe(spec) for spec in objects], loaded, to_json(physics), cache)
        if isinstance(hand, str):
            _handles[key] = found
    return found, loaded


def prepare_objects(
    handle: Objects,
    models: bool,
    num_threads: int | None,
    progress: Callable[[int], None] = lambda _: None,
    *,
    skip_errors: bool = False,
) -> None:
    """Prepare all objects of a handle, a few at a time, and report how many are ready.

    Parameters
    ----------
    handle : Objects
        From `load_objects`.
    models : bool
        Whether their models for the renderer are needed too.
    num_threads : int, optional
        Threads to use; by default ``GRASPBOX_THREADS``, else all.
    progress : callable
        Called with the number of objects that are ready.
    skip_errors : bool
        Whether objects that cannot be prepared are left to the episodes that use them, which raise the error.

    Raises
    ------
    ConfigError, MeshError, FileError, SimulationError
        If an object cannot be read or simulated; others may be ready by then.
    """
    # A few for each thread, since some objects take ten times as long as others.
    count, together = len(handle), 4 * (num_threads or _core.num_threads())
    for first in range(0, count, together):
        last = min(first + together, count)
        try:
            handle.prepare(range(first, last), models, num_threads)
        except GraspboxError:
            if not skip_errors:
                raise
            for index in range(first, last):
                with suppress(GraspboxError):
                    handle.prepare([index], models, num_threads)
        progress(last)


class _Core(Protocol):
    """The part of `graspbox.envs.core.GraspCore` that is used here."""

    def prepare(self, progress: bool) -> None: ...


class _HasCore(Protocol):
    @property
    def _core(self) -> _Core: ...


class PreparesObjects:
    """What single and vector environments have in common: their objects can be prepared before they are used."""

    def prepare(self: _HasCore, progress: bool = False) -> None:
        """Prepare all objects now: convex parts, resting poses and, where images are rendered, levels of detail.

        Without it, the first reset of a vector environment prepares sets with mesh files (see its keyword
        ``prepare_files``), and a background thread prepares the objects of the next three episodes during the present
        one; a step or reset that needs one sooner waits. Results are the same. Environments of this process with the
        same objects, hand and physics share what is prepared (512 objects stay in memory). Convex parts and levels of
        detail are kept in the cache folder for other processes.

        Parameters
        ----------
        progress : bool
            Whether to show a progress bar on standard error.

        Raises
        ------
        MeshError, FileError, SimulationError
            If an object cannot be read or simulated; others may be ready by then.
        """
        self._core.prepare(progress)
