"""Settings of the server, from environment variables."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from os import environ
from typing import Any, Literal, Self

__all__ = ["ServerSettings"]

#: Each variable begins with it.
PREFIX = "GRASPBOX_OPENENV_"


@dataclass(frozen=True)
class ServerSettings:
    """Environment of every session.

    Attributes
    ----------
    env_id : str
        Id of the Gymnasium environment.
    objects : tuple of str
        Object sets.
    obs : tuple of str
        Names of the observations.
    remote : str or None
        Address of a ``graspbox serve`` that steps the environments; None: this process does.
    images : {"png", "raw"}
        How images travel.
    sessions : int
        Most sessions at once.
    keywords : dict
        Other keywords of the environment.
    """

    env_id: str = "graspbox/GraspPose-v0"
    objects: tuple[str, ...] = ("procedural",)
    obs: tuple[str, ...] = ("depth", "proprio", "rgb")
    remote: str | None = None
    images: Literal["png", "raw"] = "png"
    sessions: int = 16
    keywords: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def from_environment(cls, variables: Mapping[str, str] = environ) -> Self:
        """Read ``GRASPBOX_OPENENV_ENV_ID``, ``_OBJECTS``, ``_OBS``, ``_REMOTE``, ``_IMAGES``, ``_SESSIONS`` and
        ``_KEYWORDS`` (a JSON object); names in a list are separated by commas.

        Raises
        ------
        ValueError
            If a variable has a value that is not possible.
        """  # noqa: D205
        values = {
            name.removeprefix(PREFIX).lower(): text
            for name, text in variables.items()
            if name.startswith(PREFIX) and text
        }
        unknown = values.keys() - cls.__dataclass_fields__.keys()
        if unknown:
            known = ", ".join(PREFIX + name.upper() for name in cls.__dataclass_fields__)
            raise ValueError(f"there is no variable {PREFIX}{min(unknown).upper()}; choose from {known}")
        fields: dict[str, Any] = dict(values)
        for name in ("objects", "obs"):
            if name in fields:
                fields[name] = tuple(fields[name].split(","))
        if "sessions" in fields:
            fields["sessions"] = int(fields["sessions"])
        if "keywords" in fields:
            fields["keywords"] = json.loads(fields["keywords"])
        settings = cls(**fields)
        if settings.images not in ("png", "raw") or settings.sessions < 1 or not isinstance(settings.keywords, dict):
            raise ValueError(
                f"{PREFIX}IMAGES is 'png' or 'raw', {PREFIX}SESSIONS is at least 1, {PREFIX}KEYWORDS is a JSON object"
            )
        return settings
