"""Interfaces of pools and sources of environments, and those of this process."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.arguments import config_dict
from graspbox._common.progress import ProgressBar
from graspbox._core import Arm, Hand
from graspbox.configs import CamerasConfig, EnvConfig
from graspbox.envs import spaces
from graspbox.envs._pools.preparation import load_objects, prepare_objects
from graspbox.envs.settings import EnvironmentConfig, arm_of
from graspbox.object_sets import ObjectSet

__all__ = ["LocalPool", "LocalSource", "PoolInterface", "Source"]

Seeds = Sequence[int | None] | None
#: A config, or options, for the core.
Fields = dict[str, Any]
#: One for all environments, or one for each.
Options = Sequence[Fields]
Mask = NDArray[np.bool_] | None
#: Arrays to write observations into, by name.
Buffers = dict[str, Any] | None
Stepped = tuple["_core.EnvArrays", "_core.EnvArrays | None"]
Cameras = dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]


class PoolInterface(Protocol):
    """Parallel environments, in this process or on servers. The methods are those of `graspbox._core.EnvPool`."""

    @property
    def num_envs(self) -> int: ...
    def reset(self, seeds: Seeds, mask: Mask, options: Options, out: Buffers) -> "_core.EnvArrays": ...
    def step(self, actions: NDArray[np.float32], out: Buffers) -> Stepped: ...
    def send(self, actions: NDArray[np.float32], envs: Sequence[int]) -> None: ...
    def recv(self, count: int) -> Stepped: ...
    def get_state(self, env: int) -> bytes: ...
    def set_state(self, env: int, state: bytes) -> "_core.EnvArrays": ...
    def pictures(self, envs: Sequence[int]) -> NDArray[np.uint8]: ...
    def cameras(self) -> Cameras: ...
    def prepare(self, progress: bool, delay: float, skip_errors: bool) -> None: ...
    def close(self) -> None: ...


class Source(Protocol):
    """Makes pools of environments, and has their hand, tables and objects."""

    hand: Hand
    #: The arm that carries it, if one does.
    arm: Arm | None
    tables: spaces.Tables
    #: Whether some objects are mesh files; the number of objects.
    has_files: bool
    count: int
    #: Whether servers step the environments, whose objects need not be on this machine.
    is_remote: bool

    def images(self, cameras: CamerasConfig, objects: int = 1) -> list[spaces.Image]: ...
    def names(self) -> list[str]: ...
    def objects(self) -> ObjectSet: ...
    def pool(self, config: EnvConfig, num_envs: int, picture: Fields, render: bool) -> PoolInterface: ...
    def close(self) -> None: ...


class LocalPool:
    """A pool in this process; see `PoolInterface`."""

    def __init__(
        self, core: "_core.EnvPool", handle: "_core.Objects", picture: Fields, models: bool, num_threads: int | None
    ) -> None:
        self.core, self._handle, self._picture, self._models = core, handle, picture, models
        self._threads = num_threads
        self.num_envs = core.num_envs
        self.reset, self.step, self.send, self.recv = core.reset, core.step, core.send, core.recv
        self.get_state, self.set_state, self.poses = core.get_state, core.set_state, core.poses

    def pictures(self, envs: Sequence[int]) -> NDArray[np.uint8]:
        """Render pictures of some environments, (n, H, W, 3)."""
        return _core.pictures(self.core, envs, self._picture)

    def cameras(self) -> Cameras:
        """Intrinsics (3, 3) and ``world_from_camera`` (num_envs, 4, 4) of every camera at present, by name."""
        return _core.poses_of_cameras(self.core)

    def prepare(self, progress: bool, delay: float, skip_errors: bool) -> None:
        """Prepare all objects; with `progress`, a bar appears on standard error after `delay` seconds."""
        with ProgressBar("prepare objects", len(self._handle), progress, delay) as bar:
            prepare_objects(self._handle, self._models, self._threads, bar.update, skip_errors=skip_errors)

    def close(self) -> None:
        """Do nothing: the memory is freed with the pool."""


class LocalSource:
    """Objects and hand loaded in this process; see `Source`."""

    is_remote = False

    def __init__(self, objects: ObjectSet, settings: EnvironmentConfig) -> None:
        self._objects, self._threads = objects, settings.num_threads
        self.arm, base = arm_of(settings)
        # Kept alive so that environments made later share it.
        self.handle, self.hand = load_objects(objects, settings.hand, settings.physics, self.arm, base)
        self.tables = spaces.tables(self.hand, self.arm)
        self.has_files = any(spec.path is not None for spec in objects)
        self.count = len(objects)

    def images(self, cameras: CamerasConfig, objects: int = 1) -> list[spaces.Image]:
        """Return a row for each image in a config, of scenes of at most this number of objects."""
        return spaces.images(self.hand, cameras, objects, self.arm)

    def names(self) -> list[str]:
        """Return the names of the objects, in order."""
        return self.handle.names

    def objects(self) -> ObjectSet:
        """Return the objects."""
        return self._objects

    def close(self) -> None:
        """Do nothing: handles are freed with the source."""

    def pool(self, config: EnvConfig, num_envs: int, picture: Fields, render: bool) -> LocalPool:
        """Make the environments: `picture` has the fields of a `PictureConfig`."""
        core = _core.EnvPool(self.handle, config_dict(config), num_envs, self._threads)
        return LocalPool(core, self.handle, picture, bool(config.cameras.images) or render, self._threads)
