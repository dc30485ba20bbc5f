"""Keywords of the environments: one row each, with type, default and meaning.

Constructors take them as ``**settings: Unpack[...]``, so type checkers check every keyword. `signed` adds the same list
with its defaults to their signatures, for `inspect.signature` and ``help``, and ``scripts/generate_docs.py`` writes
their docstrings from it.

| class | environment |
|---|---|
| `GraspSettings` | `graspbox.envs.grasp.GraspEnv` |
| `GraspPoseSettings` | `graspbox.envs.grasp_pose.GraspPoseEnv` |
| `GraspVectorSettings` | `graspbox.envs.vector.GraspVectorEnv` |
| `GraspPoseVectorSettings` | `graspbox.envs.grasp_pose.GraspPoseVectorEnv` |
| `ClearSettings` | `graspbox.envs.clear.ClearEnv` |
| `ClearVectorSettings` | `graspbox.envs.clear.ClearVectorEnv` |

Every keyword that takes a config also takes a dictionary of its fields, so that ``EnvSpec.to_json`` and ``from_json``
work for environments whose hand is given by name or by paths.

`OBJECTS` and `NUM_ENVS` are the rows of ``objects`` and ``num_envs``, which can also be given by position.
"""

import difflib
import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import (
    Annotated,
    Any,
    Literal,
    SupportsFloat,
    SupportsIndex,
    TypedDict,
    TypeVar,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

from gymnasium.vector import AutoresetMode

from graspbox import object_sets
from graspbox._common.arguments import about, config_in, config_of, shown
from graspbox._core import Hand
from graspbox.configs import CamerasConfig, PhysicsConfig, PictureConfig, Randomization, SuccessCriterion, TrialConfig
from graspbox.envs.remote_config import RemoteConfig
from graspbox.errors import ConfigError
from graspbox.layouts import SceneLayout

__all__ = [
    "NUM_ENVS",
    "OBJECTS",
    "ClearSettings",
    "ClearVectorSettings",
    "GraspPoseSettings",
    "GraspPoseVectorSettings",
    "GraspSettings",
    "GraspVectorSettings",
    "Keyword",
    "complete",
    "keywords",
    "signed",
]

ObjectsArgument = str | Path | object_sets.ObjectSet | Sequence[str | Path]
HandArgument = str | Hand | tuple[str, str]
Control = Literal["twist", "delta_pose", "target_pose"]
Reward = Literal["sparse", "dense", "firm"]
Info = Literal["full", "numeric"]
Rendering = Literal["human", "rgb_array"]
RenderMode = Rendering | None
#: The value of ``metadata["render_modes"]``.
RENDER_MODES: tuple[str, ...] = get_args(Rendering)


@dataclass(frozen=True)
class Keyword:
    """A keyword: its default, and its type and meaning in the form of numpy docstrings."""

    default: Any
    type: str
    meaning: str


#: Keywords that can be given by position.
OBJECTS = Keyword(
    "procedural", "str, Path, ObjectSet or sequence of str", "Object sets to sample from: see `graspbox.object_sets`."
)
NUM_ENVS = Keyword(1, "int", "Number of environments.")


class _Common(TypedDict, total=False):
    """Keywords of all environments."""

    split: Annotated[
        object_sets.Split | None,
        Keyword(None, '{"train", "validation", "test"}, optional', "Sample from this split only."),
    ]
    scale: Annotated[
        float, Keyword(1.0, "float", "Metres per unit of the mesh files: see `graspbox.object_sets.load`.")
    ]
    mass: Annotated[
        float | None, Keyword(None, "float, optional", "Kilograms of every object, instead of the masses of the set.")
    ]
    obs: Annotated[
        str | Sequence[str],
        Keyword("state", "str or sequence of str", "Observation: a name, or several names, which give a ``Dict``."),
    ]
    reward: Annotated[Reward, Keyword("sparse", '{"sparse", "dense", "firm"}', "Weights of the reward terms.")]
    reward_weights: Annotated[
        Mapping[str, float] | None,
        Keyword(None, "mapping of str to float, optional", "Weights that replace those of the same name in `reward`."),
    ]
    success: Annotated[
        SuccessCriterion | None,
        Keyword(
            None,
            "SuccessCriterion, optional",
            "Criterion of success; by default ``SuccessCriterion()``, or that of `trial`.",
        ),
    ]
    info: Annotated[
        Info,
        Keyword(
            "full",
            '{"full", "numeric"}',
            "Contents of the info dictionary. ``numeric`` is flat and contains only numbers, for clients that turn "
            'infos into tensors: ``failure`` is an index into ``graspbox.envs.spaces.tables(hand)["failures"]``, '
            "``object`` an index into ``env.objects``, and reward terms are entries such as ``reward_reach``.",
        ),
    ]
    image_size: Annotated[
        int | tuple[int, int] | None,
        Keyword(
            None,
            "int or pair of int, optional",
            "Rows and columns of the images, 16 to 1024; by default those of `cameras`.",
        ),
    ]
    randomization: Annotated[
        Literal["standard"] | Randomization | None,
        Keyword(
            None,
            '"standard" or Randomization, optional',
            "Properties that vary from episode to episode besides the object and the start; by default none.",
        ),
    ]
    render_mode: Annotated[
        RenderMode,
        Keyword(
            None,
            '{"human", "rgb_array"}, optional',
            "``rgb_array``: `render` returns pictures. ``human``: a window shows every reset and step (needs the extra "
            "``human``); a vector environment shows its first environment.",
        ),
    ]
    num_threads: Annotated[
        int | None,
        Keyword(
            None,
            "int, optional",
            "Number of threads; by default ``GRASPBOX_THREADS``, else all cores. Results do not depend on it.",
        ),
    ]
    remote: Annotated[
        RemoteConfig | str | Sequence[str] | None,
        Keyword(
            None,
            "str, sequence of str or RemoteConfig, optional",
            "Address of a server that steps the environments (``ws://HOST:PORT``: see ``graspbox serve``), or several "
            "addresses to distribute them over. Results do not depend on it.",
        ),
    ]
    physics: Annotated[
        PhysicsConfig,
        Keyword(PhysicsConfig(), "PhysicsConfig", "Settings of the engine; the time step must divide 0.05 s."),
    ]
    hand: Annotated[HandArgument, Keyword("reflex", "str, Hand or pair of paths", "See `graspbox.load_hand`.")]
    cameras: Annotated[
        CamerasConfig, Keyword(CamerasConfig(), "CamerasConfig", "Cameras, shadows, voxels; `obs` names the images.")
    ]
    picture: Annotated[
        PictureConfig,
        Keyword(PictureConfig(), "PictureConfig", "Size, samples per pixel and camera of the pictures of `render`."),
    ]


class _ClosedLoop(TypedDict, total=False):
    """Keywords of ``Grasp-v0`` alone."""

    control: Annotated[
        Control, Keyword("twist", '{"twist", "delta_pose", "target_pose"}', "Control mode: the meaning of actions.")
    ]
    frame_skip: Annotated[
        int,
        Keyword(
            1,
            "int",
            "Control periods of 0.05 s per step: the action is held for all of them, and their reward terms are added. "
            "Slower control eases exploration.",
        ),
    ]


class _Decision(TypedDict, total=False):
    """Keywords of ``GraspPose-v0`` and ``Clear-v0``."""

    trial: Annotated[TrialConfig, Keyword(TrialConfig(), "TrialConfig", "How the hand closes, lifts and holds.")]


class _Target(TypedDict, total=False):
    """Keyword of ``Grasp-v0`` and ``GraspPose-v0``."""

    layout: Annotated[
        SceneLayout,
        Keyword(
            "single",
            '{"single", "packed", "pile", "bin"}',
            "How objects lie: a single one, or a target among others (see `graspbox.layouts`).",
        ),
    ]


class _Scene(TypedDict, total=False):
    """Keywords of scenes of several objects."""

    objects_per_scene: Annotated[
        int | tuple[int, int],
        Keyword(5, "int or pair of int", "Number of objects, or the least and the greatest; 1 to 40."),
    ]
    object_scale: Annotated[
        tuple[float, float] | None,
        Keyword(
            None,
            "pair of float, optional",
            "Least and greatest scale of an object; by default those of the layout in `graspbox.layouts.SCALES`.",
        ),
    ]
    bin_size: Annotated[
        tuple[float, float, float],
        Keyword(
            (0.3, 0.25, 0.12),
            "three float",
            "Sides of the floor of a bin along x and y, and height of its walls, metres.",
        ),
    ]
    spread: Annotated[
        float,
        Keyword(
            1.0,
            "float",
            "Distance of the objects from the middle, times that of VGN, 0.25 to 2: below 1 they lie closer together.",
        ),
    ]


class _Clear(TypedDict, total=False):
    """Keywords of ``Clear-v0`` alone."""

    layout: Annotated[
        SceneLayout,
        Keyword("pile", '{"single", "packed", "pile", "bin"}', "How the objects lie: see `graspbox.layouts`."),
    ]
    max_failures: Annotated[
        int, Keyword(2, "int", "Failed attempts in a row after which the episode ends; 2 in the rounds of VGN.")
    ]


class _Vector(TypedDict, total=False):
    """Keywords of vector environments alone."""

    autoreset_mode: Annotated[
        AutoresetMode | str,
        Keyword(AutoresetMode.NEXT_STEP, "AutoresetMode or its value", "When the next episode begins after an end."),
    ]
    max_episode_steps: Annotated[
        int | None, Keyword(None, "int, optional", "Episodes are truncated after this number of steps.")
    ]
    prepare_files: Annotated[
        int,
        Keyword(
            128,
            "int",
            "The first reset prepares all objects if some of them are mesh files and there are at most this many; "
            "otherwise it prepares only those of the first episodes. Preparation takes about a second per file the "
            "first time; later the results come from the cache. Episodes do not depend on it.",
        ),
    ]
    copy: Annotated[
        bool,
        Keyword(
            True,
            "bool",
            "Whether observations are new arrays; otherwise they are views of buffers that the next call overwrites.",
        ),
    ]


class GraspSettings(_Common, _ClosedLoop, _Target, _Scene, total=False):
    """Keywords of the single ``Grasp-v0``."""


class GraspPoseSettings(_Common, _Decision, _Target, _Scene, total=False):
    """Keywords of the single ``GraspPose-v0``."""


class GraspVectorSettings(_Common, _ClosedLoop, _Target, _Scene, _Vector, total=False):
    """Keywords of the native vector environment of ``Grasp-v0``."""


class GraspPoseVectorSettings(_Common, _Decision, _Target, _Scene, _Vector, total=False):
    """Keywords of the native vector environment of ``GraspPose-v0``."""


class ClearSettings(_Common, _Decision, _Clear, _Scene, total=False):
    """Keywords of the single ``Clear-v0``."""


class ClearVectorSettings(_Common, _Decision, _Clear, _Scene, _Vector, total=False):
    """Keywords of the native vector environment of ``Clear-v0``."""


class Settings(_Common, _ClosedLoop, _Decision, _Clear, _Scene, _Vector, total=False):
    """Keywords of any environment; `layout` has the default of ``Clear-v0``."""


#: Keywords whose types are checked where they are used.
_CHECKED_LATER = ("remote", "hand", "num_threads")


@cache
def keywords(kind: type) -> Mapping[str, Keyword]:
    """Return the rows of the keywords of one of the classes above, by name."""
    hints = get_type_hints(kind, include_extras=True)
    return {name: get_args(hint)[-1] for name, hint in hints.items()}


def complete(kind: type, arguments: Mapping[str, Any], hidden: Collection[str] = ()) -> Settings:
    """Add missing keywords with their defaults, and convert dictionaries to configs.

    Raises
    ------
    ConfigError
        For an unknown keyword (the message suggests the nearest one, or all but those `hidden`), or a value of the
        wrong type for a keyword that takes a config. Its `field` is the keyword.
    """
    rows = keywords(kind)
    for name in arguments:
        if name not in rows:
            offered = [row for row in rows if row not in hidden]
            near = difflib.get_close_matches(name, offered, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"choose from {', '.join(offered)}"
            with about(name):
                raise ConfigError(f"this environment has no keyword {name!r}; {hint}")
    hints, chosen = get_type_hints(kind), {}
    for name, value in arguments.items():
        with about(name):
            chosen[name] = _configured(name, value, hints[name])
    for name, value in chosen.items():
        if name not in _CHECKED_LATER and not _fits(value, hints[name]):
            with about(name):
                raise ConfigError(f"{name} is {shown(value)}; its type is {rows[name].type}")
    return cast(Settings, {**{name: row.default for name, row in rows.items()}, **chosen})


def _configured(name: str, value: Any, hint: Any) -> Any:
    """Accept a config, a dictionary of its fields (as from ``EnvSpec.from_json``), or another type of the hint."""
    config = config_in(hint)
    if config is None or isinstance(value, config):
        return value
    if isinstance(value, Mapping):
        return config_of(config, value, name)
    others = [choice for choice in get_args(hint) if choice is not config]
    if isinstance(value, list | tuple) and any(get_origin(choice) is Sequence for choice in others):
        return value
    if (value is None and type(None) in others) or (isinstance(value, str) and any(map(get_args, others))):
        return value
    raise ConfigError(f"{name} is {shown(value)}; give a {config.__name__}, or a dictionary of its fields")


def _fits(value: Any, hint: Any) -> bool:
    """Whether a value has a type that an annotation allows; names and ranges are checked where they are used."""
    if isinstance(hint, type):
        kind = {int: SupportsIndex, float: SupportsFloat}.get(hint, hint)
        return isinstance(value, kind) and isinstance(value, bool) <= (hint is bool)
    origin, parts = get_origin(hint), get_args(hint)
    if origin is Literal:
        return isinstance(value, str)
    if origin is Mapping:
        return isinstance(value, Mapping)
    if origin is tuple:  # for which JSON has a list
        return isinstance(value, list | tuple) and len(value) == len(parts) and all(map(_fits, value, parts))
    if origin is Sequence:
        return isinstance(value, Sequence) and not isinstance(value, str) and all(_fits(x, parts[0]) for x in value)
    return any(_fits(value, part) for part in parts)


_Init = TypeVar("_Init", bound=Callable[..., None])


def signed(kind: type) -> Callable[[_Init], _Init]:
    """Give a constructor that takes ``**settings`` a signature with every keyword and its default."""

    def mark(init: _Init) -> _Init:
        own = inspect.signature(init)
        named = [p for p in own.parameters.values() if p.kind is not p.VAR_KEYWORD]
        types = get_type_hints(kind)
        rest = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=row.default, annotation=types[name])
            for name, row in keywords(kind).items()
        ]
        init.__signature__ = own.replace(parameters=[*named, *rest])  # type: ignore[attr-defined]
        return init

    return mark
