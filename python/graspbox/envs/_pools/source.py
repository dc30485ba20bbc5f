"""Remote environments: requests to servers and their answers."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any, Literal

from gymnasium.vector import AutoresetMode

from graspbox import _core, object_sets
from graspbox._common.arguments import natural, plain, shown
from graspbox.configs import CamerasConfig, EnvConfig
from graspbox.envs import spaces
from graspbox.envs._pools.local import Fields
from graspbox.envs._pools.remote import RemotePool
from graspbox.envs._pools.spread import SpreadPool
from graspbox.envs.remote_config import RemoteConfig
from graspbox.envs.settings import KINDS, EnvironmentConfig, ObjectsArgument, arm_of
from graspbox.errors import ConfigError
from graspbox.object_sets import ObjectSet
from graspbox.simulation import load_hand

__all__ = ["RemoteSource"]

#: Keywords that concern only the client.
_LOCAL = ("remote", "num_threads", "copy", "prepare_files", "depth_limits")
#: Keywords that choose objects; those with a value other than the default are sent to the server.
_CHOICE: tuple[Literal["scale", "mass", "split"], ...] = ("scale", "mass", "split")


class RemoteSource:
    """Environments on servers; see `graspbox.envs._pools.local.Source`. `settings` are all keywords."""

    is_remote = True

    def __init__(
        self, remote: RemoteConfig, num_envs: int, objects: ObjectsArgument, settings: EnvironmentConfig
    ) -> None:
        hand = settings.hand
        if not isinstance(hand, str):
            raise ConfigError(f"hand is {shown(hand)}; environments on a server take a hand by its name")
        if not isinstance(settings.arm, str | None):
            raise ConfigError(f"arm is {shown(settings.arm)}; environments on a server take an arm by its name")
        self.arm, base = arm_of(settings)
        if base is not None:
            settings = replace(settings, base=base.tolist())
        _core.num_threads(settings.num_threads)  # only validated: nothing runs here
        self._objects = objects
        self._choice: dict[str, Any] = {name: getattr(settings, name) for name in _CHOICE}
        object_sets.check_sizes(settings.scale, settings.mass)
        environment, vector = KINDS[type(settings)]
        request = {
            "environment": environment,
            "vector": vector,
            "num_envs": natural(num_envs, "num_envs"),
            "objects": _named(objects),
            "keywords": _keywords(settings),
        }
        if len(remote.urls) == 1:
            self._pool: RemotePool | SpreadPool = RemotePool(remote.urls[0], remote, request)
        else:
            self._pool = SpreadPool(remote, request)
        described = self._pool.description
        self.hand = load_hand(hand)
        self.tables: spaces.Tables = described["tables"]
        self.has_files, self.count = described["has_files"], described["objects"]

    def images(self, cameras: CamerasConfig, objects: int = 1) -> list[spaces.Image]:
        """Rows of the images, as described by the server."""
        rows: list[spaces.Image] = self._pool.description["images"]
        return rows

    def names(self) -> list[str]:
        """Names of the objects, in order."""
        return self._pool.names()

    def objects(self) -> ObjectSet:
        """Look the objects up on this machine; ObjectSetError if the set is missing or has another name here."""
        return object_sets.load(self._objects, **self._choice)

    def close(self) -> None:
        """Return the environments to the server."""
        self._pool.close()

    def pool(self, config: EnvConfig, num_envs: int, picture: Fields, render: bool) -> RemotePool | SpreadPool:
        """Return the environments, which exist already."""
        return self._pool


def _named(objects: ObjectsArgument) -> list[str]:
    """Names of object sets, as a server finds them."""
    if isinstance(objects, ObjectSet):
        for spec in objects:
            if spec.mass_known in ("given", "table") or spec.scale != 1.0:
                raise ConfigError(
                    f"object {spec.name!r} has its own scale or mass; a server takes objects as in their sets"
                )
        return [spec.source for spec in objects]
    return object_sets.set_names(objects)


def _keywords(settings: EnvironmentConfig) -> dict[str, Any]:
    """Keywords for a server, as JSON holds them."""
    found: dict[str, Any] = {}
    for field in fields(settings):
        name, value = field.name, getattr(settings, field.name)
        if name in _LOCAL or (name in _CHOICE and value == field.default):
            continue
        if isinstance(value, AutoresetMode):
            value = value.value
        if isinstance(value, Mapping):
            value = dict(value)
        found[name] = plain(value, name)
    if settings.render_mode is not None:
        # The window is on this machine; the server renders the pictures.
        found["render_mode"] = "rgb_array"
    return found
