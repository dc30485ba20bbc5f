"""Objects of environments: handles shared by environments, and preparation of their objects."""

import os
from collections.abc import Callable
from dataclasses import asdict
from typing import Any
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from graspbox import _core, object_sets
from graspbox._common.arguments import config_dict
from graspbox._common.refusals import is_refusal
from graspbox._core import Arm, Hand, Objects
from graspbox.configs import PhysicsConfig
from graspbox.envs.settings import HandArgument
from graspbox.errors import GraspboxError
from graspbox.simulation import cache_folder, load_hand

__all__ = ["load_objects", "prepare_objects"]

#: Handles in use, so that environments of one process prepare each object once.
_handles: WeakValueDictionary[tuple[Any, ...], Objects] = WeakValueDictionary()


def _describe(spec: object_sets.ObjectSpec) -> dict[str, Any]:
    """Convert an object for the core."""
    found = asdict(spec)
    del found["mass_known"], found["source"]
    return {**found, "path": None if spec.path is None else str(spec.path)}


def load_objects(
    objects: object_sets.ObjectSet,
    hand: HandArgument,
    physics: PhysicsConfig,
    arm: Arm | None = None,
    base: NDArray[np.float64] | None = None,
) -> tuple[Objects, Hand]:
    """Make a handle on objects, or reuse the one of another environment."""
    cache = cache_folder()
    # A forked process inherits neither the thread nor the locks of its parent's handles.
    place = None if base is None else base.tobytes()
    key = (objects.objects, hand, arm, place, physics, cache, os.getpid())
    found = _handles.get(key) if isinstance(hand, str) else None
    loaded = load_hand(hand)
    if found is None:
        found = Objects([_describe(spec) for spec in objects], loaded, config_dict(physics), cache, arm, base)
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
    """Prepare all objects of a handle in batches; `progress` is called with the number of objects that are ready.

    With `models`, their models for the renderer are prepared too. With `skip_errors`, objects that cannot be prepared
    are left to the episodes that use them, which raise the error. Returns the skipped errors by the objects' indices.

    Raises
    ------
    ConfigError
        If the physics settings are invalid.
    MeshError, FileError, SimulationError
        If an object cannot be read or simulated; others may be ready by then.
    """
    errors: dict[int, GraspboxError] = {}
    # A few for each thread, since some objects take ten times as long as others.
    count, batch = len(handle), 4 * (num_threads or _core.num_threads())
    for first in range(0, count, batch):
        last = min(first + batch, count)
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
