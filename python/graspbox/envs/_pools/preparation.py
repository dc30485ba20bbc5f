"""Objects of environments: handles shared by environments, and preparation of their objects."""

import json
import os
from collections.abc import Callable
from dataclasses import asdict
from typing import Any, Protocol
from weakref import WeakValueDictionary

from graspbox import _core, object_sets
from graspbox._common.refusals import is_refusal
from graspbox._core import Hand, Objects
from graspbox.configs import PhysicsConfig
from graspbox.envs.settings import HandArgument
from graspbox.errors import GraspboxError
from graspbox.meshes import to_json
from graspbox.simulation import cache_folder, load_hand

__all__ = ["PreparesObjects", "load_objects", "prepare_objects"]

#: Handles in use, so that environments of one process prepare each object once.
_handles: WeakValueDictionary[tuple[Any, ...], Objects] = WeakValueDictionary()


def _describe(spec: object_sets.ObjectSpec) -> str:
    """Serialise an object for the core."""
    found = asdict(spec)
    del found["mass_known"], found["source"]
    return json.dumps({**found, "path": None if spec.path is None else str(spec.path)})


def load_objects(objects: object_sets.ObjectSet, hand: HandArgument, physics: PhysicsConfig) -> tuple[Objects, Hand]:
    """Make a handle on objects, or reuse the one of another environment."""
    cache = cache_folder()
    # A forked process inherits neither the thread nor the locks of its parent's handles.
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
) -> dict[int, GraspboxError]:
    """Prepare all objects of a handle in batches and report how many are ready.

    Parameters
    ----------
    handle : Objects
        From `load_objects`.
    models : bool
        Whether to prepare their models for the renderer too.
    num_threads : int, optional
        Threads to use; by default ``GRASPBOX_THREADS``, else all.
    progress : callable
        Called with the number of objects that are ready.
    skip_errors : bool
        Whether objects that cannot be prepared are left to the episodes that use them, which raise the error.

    Returns
    -------
    dict
        Errors of the objects that were skipped, by index.

    Raises
    ------
    ConfigError
        If the physics settings are wrong.
    MeshError, FileError, SimulationError
        If an object cannot be read or simulated; others may be ready by then.
    """
    errors: dict[int, GraspboxError] = {}
    # A few for each thread, since some objects take ten times as long as others.
    count, together = len(handle), 4 * (num_threads or _core.num_threads())
    for first in range(0, count, together):
        last = min(first + together, count)
        try:
            handle.prepare(range(first, last), models, num_threads)
        except GraspboxError as error:
            if not skip_errors or not is_refusal(error):
                raise
            for index in range(first, last):
                try:
                    handle.prepare([index], models, num_threads)
                except GraspboxError as error:
                    errors[index] = error
        progress(last)
    return errors


class _Core(Protocol):
    """The part of `graspbox.envs.core.GraspCore` used here."""

    def prepare(self, progress: bool) -> None: ...


class _HasCore(Protocol):
    @property
    def _core(self) -> _Core: ...


class PreparesObjects:
    """Mixin of single and vector environments: prepares their objects before the first episode."""

    def prepare(self: _HasCore, progress: bool = False) -> None:
        """Prepare all objects now: convex parts, resting poses and, if images are rendered, levels of detail.

        Otherwise the first reset of a vector environment prepares sets with mesh files (see its keyword
        ``prepare_files``), and during each episode a background thread prepares the objects of the next three; a step
        or reset that needs one sooner waits. Results are the same. Environments of this process with the same objects,
        hand and physics share prepared objects (512 stay in memory). Convex parts and levels of detail are also cached
        on disk for other processes.

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
