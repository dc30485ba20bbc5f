"""Answers to the frames of a camera: by a policy of this machine, or by one on a server."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from graspbox import _core
from graspbox._common.arguments import shown
from graspbox.captures import Capture
from graspbox.envs.remote_config import client_token
from graspbox.errors import ConfigError
from graspbox.policies.grasp_image import EARLIER_ENTRIES, ImageGrasper, ImageGrasps, SceneGrasps

__all__ = ["Answer", "Best", "Grasping", "LocalGrasping", "ServedGrasping"]


class Best(NamedTuple):
    """The best grasp: position in the camera's frame, metres, and probability of success."""

    position: NDArray[np.float64]
    success: float


@dataclass(frozen=True, eq=False)
class Answer:
    """Grasps of a frame.

    Attributes
    ----------
    told : dict
        Plain values, for JSON.
    count : int
        Number of grasps.
    best : Best, optional
        The best one.
    grasps : ImageGrasps, optional
        The grasps, if they are of one object by a policy of this machine.
    """

    told: dict[str, Any]
    count: int
    best: Best | None
    grasps: ImageGrasps | None = None


class Grasping(Protocol):
    """Finds the grasps of each frame."""

    def __call__(self, seen: Capture) -> Answer:
        """Return the grasps of a frame; a ConfigError refuses it."""


@dataclass
class LocalGrasping:
    """Finds grasps with a policy of this machine; the best grasp of the last frame stays while it is nearly the best.

    Attributes
    ----------
    grasper : ImageGrasper
        The policy, loaded once.
    pose : (4, 4) float64, optional
        ``table_from_camera``; by default the table is searched in each frame, since the camera may move.
    everything : bool
        Whether grasps are of every object, those of the labels or all on the table.
    label : int, optional
        The object's number in the labels; by default the only one.
    options : dict
        Further arguments of `ImageGrasper.find`.
    """

    grasper: ImageGrasper
    pose: NDArray[np.float64] | None
    everything: bool
    label: int | None
    options: dict[str, Any]
    _scene: SceneGrasps | None = field(default=None, init=False)
    _grasps: ImageGrasps | None = field(default=None, init=False)

    def __call__(self, seen: Capture) -> Answer:
        """Return the grasps of a frame; a ConfigError refuses it."""
        place = (seen.depth, seen.intrinsics, self.pose)
        if self.everything:
            scene = self.grasper.find_all(*place, labels=seen.labels, previous=self._scene, **self.options)
            self._scene = scene
            order = scene.best()
            told = {**scene.to_json(), "warnings": list(seen.warnings)}
            return Answer(told, len(order), _best(scene.grasps[order[0][0]], order[0][1]) if order else None)
        mask = None if seen.labels is None and self.label is None else seen.mask(self.label)
        grasps = self.grasper.find(*place, mask=mask, previous=self._grasps, **self.options)
        self._grasps = grasps
        told = {**grasps.to_json(), "warnings": [*seen.warnings, *grasps.warnings]}
        return Answer(told, len(grasps), _best(grasps, 0) if len(grasps) else None, grasps)


def _best(grasps: ImageGrasps, rank: int) -> Best:
    return Best(grasps.camera_from_hand[rank, :3, 3], float(grasps.success[rank]))


class ServedGrasping:
    """Asks a server of a policy, as of ``graspbox serve-policy``; the best grasp stays as in `LocalGrasping`.

    Parameters
    ----------
    url : str
        ``ws://HOST:PORT`` or ``wss://HOST:PORT``; the token is in the environment variable ``GRASPBOX_TOKEN``.
    request : dict
        Entries of each request besides the image.
    label : int, optional
        The object's number in the labels; by default the only one.

    Raises
    ------
    ConnectionLostError
        If the server cannot be reached.
    ConfigError
        If it refuses this client, or finds no grasps in images.
    """

    #: Entries of an answer that are numbers of each grasp.
    _NUMBERS = ("success", "secure", "choice", "preshape", "free", "lift_free", "camera_from_hand", "table_from_hand")

    def __init__(self, url: str, request: dict[str, Any], label: int | None = None) -> None:
        self._label = label
        self._url, self._request = url, {name: value for name, value in request.items() if value is not None}
        self._client = _core.PolicyClient(url, token=client_token(None), ca=None)
        metadata = self._client.metadata
        if not isinstance(metadata, dict) or metadata.get("server") != "graspbox" or not metadata.get("grasps"):
            raise ConfigError(f"{url} finds no grasps in images; start a server with 'graspbox serve-policy depth'")
        self._policy = str(metadata.get("policy"))
        known = metadata.get("requests")
        # Servers of earlier versions do not keep a grasp.
        self._keeps = isinstance(known, list) and "previous" in known
        self._previous: dict[str, Any] = {}

    def __call__(self, seen: Capture) -> Answer:
        """Return the grasps of a frame; a ConfigError refuses it."""
        image = {"depth": seen.depth.astype(np.float32), "intrinsics": seen.intrinsics}
        if seen.labels is not None or self._label is not None:
            image["mask"] = seen.mask(self._label)
        self._client.send({**image, **self._request, **self._previous})
        answer = self._client.receive()
        if isinstance(answer, str):
            raise ConfigError((answer.strip() or f"{self._url} does not say why").splitlines()[-1])
        try:
            columns = {name: np.asarray(answer[name]).tolist() for name in self._NUMBERS}
            rows = zip(*columns.values(), strict=True)
            grasps = [{"rank": rank, **dict(zip(columns, row, strict=True))} for rank, row in enumerate(rows, start=1)]
            told = {
                "policy": self._policy,
                "hand": str(answer["hand"]),
                "table_from_camera": np.asarray(answer["table_from_camera"]).tolist(),
                "warnings": [*seen.warnings, *map(str, answer["warnings"])],
                "grasps": grasps,
            }
            best = Best(np.array(grasps[0]["camera_from_hand"])[:3, 3], float(grasps[0]["success"])) if grasps else None
        except (KeyError, TypeError, ValueError, IndexError):
            raise ConfigError(
                f"the server {self._url} answers {shown(answer)}; grasps of the image are needed"
            ) from None
        if self._keeps:
            self._previous = {"previous": {name: answer[name] for name in EARLIER_ENTRIES}}
        return Answer(told, len(grasps), best)
