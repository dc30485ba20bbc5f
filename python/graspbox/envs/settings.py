"""Keywords of the environments: one frozen config per environment, with type, default and meaning of each.

| class | environment |
|---|---|
| `GraspConfig`, `GraspVectorConfig` | `graspbox.envs.grasp.GraspEnv`, `graspbox.envs.vector.GraspVectorEnv` |
| `GraspPoseConfig`, `GraspPoseVectorConfig` | `GraspPoseEnv`, `GraspPoseVectorEnv` of `graspbox.envs.grasp_pose` |
| `ClearConfig`, `ClearVectorConfig` | `ClearEnv`, `ClearVectorEnv` of `graspbox.envs.clear` |
| `ReachConfig`, `ReachVectorConfig` | `ReachEnv`, `ReachVectorEnv` of `graspbox.envs.goal_tasks.reach` |
| `PlaceConfig`, `PlaceVectorConfig` | `PlaceEnv`, `PlaceVectorEnv` of `graspbox.envs.goal_tasks.place` |

Constructors take the fields as keywords, and every keyword that takes a config also takes a dictionary of its fields,
so that ``EnvSpec.to_json`` and ``from_json`` work for environments whose hand is named or has paths.
"""

import difflib
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, SupportsFloat, SupportsIndex, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from graspbox import object_sets
from graspbox._common.arguments import about, config_in, config_of, floats, shown
from graspbox._core import Arm, Hand
from graspbox.arms.loading import load_arm
from graspbox.configs import CamerasConfig, PhysicsConfig, PictureConfig, Randomization, SuccessCriterion, TrialConfig
from graspbox.envs.remote_config import RemoteConfig
from graspbox.errors import ConfigError, UnknownKeywordError
from graspbox.simulation.layouts import SceneLayout

__all__ = [
    "KINDS",
    "ClearConfig",
    "ClearVectorConfig",
    "DecisionConfig",
    "EnvironmentConfig",
    "GoalTaskConfig",
    "GraspConfig",
    "GraspPoseConfig",
    "GraspPoseVectorConfig",
    "GraspVectorConfig",
    "PlaceConfig",
    "PlaceVectorConfig",
    "ReachConfig",
    "ReachVectorConfig",
    "VectorConfig",
    "arm_of",
    "complete",
    "documented_type",
    "kind_of",
]

ObjectsArgument = str | Path | object_sets.ObjectSet | Sequence[str | Path]
HandArgument = str | Hand | tuple[str, str]
ArmArgument = str | Arm | tuple[str, str]
Control = Literal["twist", "delta_pose", "target_pose", "top_down", "joint_velocity"]
DecisionControl = Literal["grasp_pose", "grasp_point"]
Fingers = Literal["synergy", "each"]
Reward = Literal["sparse", "dense", "firm"]
Info = Literal["full", "numeric"]
Rendering = Literal["human", "rgb_array"]
RenderMode = Rendering | None
#: The value of ``metadata["render_modes"]``.
RENDER_MODES: tuple[str, ...] = get_args(Rendering)


@dataclass(frozen=True, kw_only=True)
class EnvironmentConfig:
    """Keywords of all environments.

    Attributes
    ----------
    split : {"train", "validation", "test"}, optional
        Sample from this split only.
    scale : float
        Metres per unit of the mesh files: see `graspbox.object_sets.load`.
    mass : float, optional
        Kilograms of every object, instead of the masses of the set.
    obs : str or sequence of str
        Observation: a name, or several names for a ``Dict``.
    reward : {"sparse", "dense", "firm"}
        Weights of the reward terms.
    reward_weights : mapping of str to float, optional
        Weights that replace those of the same name in `reward`.
    success : SuccessCriterion, optional
        Criterion of success; by default ``SuccessCriterion()``, or that of `trial`.
    info : {"full", "numeric"}
        Contents of the info dictionary. ``numeric`` is flat and contains only numbers, for clients that turn infos into
        tensors: ``failure`` is an index into ``graspbox.envs.spaces.tables(hand)["failures"]``, ``object`` an index
        into ``env.objects``, and reward terms are entries such as ``reward_reach``.
    image_size : int or pair of int, optional
        Rows and columns of the images, 16 to 1024; by default those of `cameras`.
    depth_limits : pair of float, optional
        Near and far limit, metres, of depth images as uint8, which networks for pictures expect, such as ``CnnPolicy``
        of Stable-Baselines3: 1 is the near limit or less, 255 the far limit or more, and 0 still means missing
        (`graspbox.envs.spaces.depth_in_metres` is the inverse). By default depth is float32, in metres.
    randomization : "standard" or Randomization, optional
        Properties that vary from episode to episode besides the object and the start; by default none.
    render_mode : {"human", "rgb_array"}, optional
        ``rgb_array``: `render` returns pictures. ``human``: a window shows every reset and step (needs the extra
        ``human``); a vector environment shows its first environment.
    num_threads : int, optional
        Number of threads; by default ``GRASPBOX_THREADS``, else all cores. Results do not depend on it.
    remote : str, sequence of str or RemoteConfig, optional
        Address of a server that steps the environments (``ws://HOST:PORT``: see ``graspbox serve``), or several
        addresses to distribute them over. Results do not depend on it.
    physics : PhysicsConfig
        Settings of the engine; the time step must divide the control period.
    hand : str, Hand or pair of paths
        See `graspbox.load_hand`.
    arm : str, Arm or pair of paths, optional
        Arm that carries the hand: see `graspbox.arms.load_arm`, and the module of ``Grasp-v0``.
        By default the hand moves freely.
    base : (4, 4) array_like, optional
        Pose of the arm's base in the world; by default on the table, opposite the camera ``front``, at 0.55 of the
        arm's length from the middle and facing it. A list of rows for ``EnvSpec.to_json``.
    cameras : CamerasConfig
        Cameras, shadows, voxels; `obs` names the images.
    picture : PictureConfig
        Size, samples per pixel and camera of the pictures of `render`.
    layout : {"single", "packed", "pile", "bin"}
        How objects lie: a single one, or a target among others (see `graspbox.simulation.layouts`).
    objects_per_scene : int or pair of int
        Number of objects, or the least and the greatest; 1 to 40.
    object_scale : pair of float, optional
        Least and greatest scale of an object; by default `graspbox.simulation.layouts.SCALES`.
    bin_size : three float
        Sides of the floor of a bin along x and y, and height of its walls, metres.
    spread : float
        Distance of the objects from the middle, times that of VGN, 0.25 to 2: below 1 they lie closer together.
    """

    split: object_sets.Split | None = None
    scale: float = 1.0
    mass: float | None = None
    obs: str | Sequence[str] = "state"
    reward: Reward = "sparse"
    reward_weights: Mapping[str, float] | None = None
    success: SuccessCriterion | None = None
    info: Info = "full"
    image_size: int | tuple[int, int] | None = None
    depth_limits: tuple[float, float] | None = None
    randomization: Literal["standard"] | Randomization | None = None
    render_mode: RenderMode = None
    num_threads: int | None = None
    remote: RemoteConfig | str | Sequence[str] | None = None
    physics: PhysicsConfig = PhysicsConfig()  # noqa: RUF009 (frozen)
    hand: HandArgument = "reflex"
    arm: ArmArgument | None = None
    base: Sequence[Sequence[float]] | None = None
    cameras: CamerasConfig = CamerasConfig()  # noqa: RUF009 (frozen)
    picture: PictureConfig = PictureConfig()  # noqa: RUF009 (frozen)
    layout: SceneLayout = "single"
    objects_per_scene: int | tuple[int, int] = 5
    object_scale: tuple[float, float] | None = None
    bin_size: tuple[float, float, float] = (0.3, 0.25, 0.12)
    spread: float = 1.0


@dataclass(frozen=True, kw_only=True)
class GraspConfig(EnvironmentConfig):
    """Keywords of ``Grasp-v0``, besides those of `EnvironmentConfig`.

    Attributes
    ----------
    control : {"twist", "delta_pose", "target_pose", "top_down", "joint_velocity"}
        Control mode: how an action moves the hand; the last one needs an `arm`.
    fingers : {"synergy", "each"}
        How an action moves the fingers: one number along the hand's closing motion, and the preshape if the hand has
        one; or one number for each actuator, with which agents learn more slowly.
    control_freq : float
        Actions per second of simulated time, Hz, 5 to 100: an action is held for ``1 / control_freq`` seconds. Slower
        control eases exploration. `physics.dt` must divide this time (below 20 Hz, each of its equal parts of at most
        0.05 s).
    reward : {"dense", "sparse", "firm"}
        Weights of the reward terms.
    """

    control: Control = "twist"
    fingers: Fingers = "synergy"
    control_freq: float = 5.0
    reward: Reward = "dense"


@dataclass(frozen=True, kw_only=True)
class DecisionConfig(EnvironmentConfig):
    """Keywords of environments whose steps are decisions, besides those of `EnvironmentConfig`.

    Attributes
    ----------
    trial : TrialConfig
        How the hand closes, lifts and holds.
    """

    trial: TrialConfig = TrialConfig()  # noqa: RUF009 (frozen)


@dataclass(frozen=True, kw_only=True)
class GraspPoseConfig(DecisionConfig):
    """Keywords of ``GraspPose-v0``, besides those of `DecisionConfig`.

    Attributes
    ----------
    control : {"grasp_pose", "grasp_point"}
        What an action names: a pose of the hand in the world, or where its grasp centre goes and how it tilts and
        turns, with which agents learn from success alone.
    """

    control: DecisionControl = "grasp_pose"


@dataclass(frozen=True, kw_only=True)
class ClearConfig(DecisionConfig):
    """Keywords of ``Clear-v0``, besides those of `DecisionConfig`.

    Attributes
    ----------
    layout : {"single", "packed", "pile", "bin"}
        How the objects lie: see `graspbox.simulation.layouts`.
    max_failures : int
        Failed attempts in a row after which the episode ends; 2 in the rounds of VGN.
    """

    layout: SceneLayout = "pile"
    max_failures: int = 2


@dataclass(frozen=True, kw_only=True)
class GoalTaskConfig(GraspConfig):
    """Keywords of ``Reach-v0`` and ``Place-v0``, besides those of `GraspConfig`.

    A reward follows from the achieved and the desired goal alone, and the scene is one object on a table: with values
    other than their defaults `reward_weights`, `success` and `layout` are refused.

    Attributes
    ----------
    control : {"top_down", "twist", "delta_pose", "target_pose", "joint_velocity"}
        Control mode: how an action moves the hand; the last one needs an `arm`.
    obs : str
        The vector or image under the key ``observation``.
    reward : {"sparse", "dense"}
        ``sparse``: 0 within the threshold of the goal, else -1. ``dense``: minus the distance from the goal, metres.
    threshold : float
        Greatest distance from the goal at success, metres, 0.001 to 0.5.
    terminate_on_success : bool
        Whether an episode ends at success. Hindsight relabels rewards, not ends: leave it out with HER.
    """

    control: Control = "top_down"
    reward: Reward = "sparse"
    threshold: float = 0.05
    terminate_on_success: bool = False


@dataclass(frozen=True, kw_only=True)
class ReachConfig(GoalTaskConfig):
    """Keywords of ``Reach-v0``: those of `GoalTaskConfig`."""

    obs: str | Sequence[str] = "proprio"


@dataclass(frozen=True, kw_only=True)
class PlaceConfig(GoalTaskConfig):
    """Keywords of ``Place-v0``: those of `GoalTaskConfig`."""

    threshold: float = 0.04


@dataclass(frozen=True, kw_only=True)
class VectorConfig:
    """Keywords only of vector environments.

    Attributes
    ----------
    autoreset_mode : AutoresetMode or its value
        When the next episode begins after an end.
    max_episode_steps : int, optional
        Episodes are truncated after this number of steps.
    prepare_files : int
        The first reset prepares all objects if some of them are mesh files and there are at most this many; otherwise
        it prepares only those of the first episodes. Preparation takes about a second per file the first time; later
        the results come from the cache. Episodes do not depend on it.
    copy : bool
        Whether observations are new arrays; otherwise they are views of buffers that the next call overwrites.
    """

    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP
    max_episode_steps: int | None = None
    prepare_files: int = 128
    copy: bool = True


@dataclass(frozen=True, kw_only=True)
class GraspVectorConfig(VectorConfig, GraspConfig):
    """Keywords of the vector environment of ``Grasp-v0``."""


@dataclass(frozen=True, kw_only=True)
class GraspPoseVectorConfig(VectorConfig, GraspPoseConfig):
    """Keywords of the vector environment of ``GraspPose-v0``."""


@dataclass(frozen=True, kw_only=True)
class ClearVectorConfig(VectorConfig, ClearConfig):
    """Keywords of the vector environment of ``Clear-v0``."""


@dataclass(frozen=True, kw_only=True)
class ReachVectorConfig(VectorConfig, ReachConfig):
    """Keywords of the vector environment of ``Reach-v0``."""


@dataclass(frozen=True, kw_only=True)
class PlaceVectorConfig(VectorConfig, PlaceConfig):
    """Keywords of the vector environment of ``Place-v0``."""


#: Environment id, and whether it is a vector environment, by the class of its keywords.
KINDS: dict[type[EnvironmentConfig], tuple[str, bool]] = {
    GraspConfig: ("graspbox/Grasp-v0", False),
    GraspVectorConfig: ("graspbox/Grasp-v0", True),
    GraspPoseConfig: ("graspbox/GraspPose-v0", False),
    GraspPoseVectorConfig: ("graspbox/GraspPose-v0", True),
    ClearConfig: ("graspbox/Clear-v0", False),
    ClearVectorConfig: ("graspbox/Clear-v0", True),
    ReachConfig: ("graspbox/Reach-v0", False),
    ReachVectorConfig: ("graspbox/Reach-v0", True),
    PlaceConfig: ("graspbox/Place-v0", False),
    PlaceVectorConfig: ("graspbox/Place-v0", True),
}
#: What to pass instead of former keywords.
_REPLACED = {"frame_skip": "pass control_freq=20 / frame_skip"}
#: Keywords whose types are checked where they are used.
_CHECKED_LATER = ("remote", "hand", "arm", "base", "num_threads")


Config = TypeVar("Config", bound=EnvironmentConfig)


def kind_of(environment: str, vector: bool) -> type[EnvironmentConfig]:
    """Find the class of the keywords of an environment; ConfigError for an unknown id."""
    for kind, found in KINDS.items():
        if found == (environment, vector):
            return kind
    known = ", ".join(sorted({name for name, _ in KINDS.values()}))
    raise ConfigError(f"there is no environment {shown(environment)}; choose from {known}")


def arm_of(settings: EnvironmentConfig) -> tuple[Arm | None, NDArray[np.float64] | None]:
    """Load the arm of an environment, and take the pose (4, 4) of its base if it is given.

    Raises
    ------
    ConfigError, ArmError
        If there is no such arm, or the base is no matrix, or that of no arm.
    """
    if settings.arm is None:
        if settings.base is not None:
            with about("base"):
                raise ConfigError("base is the place of an arm, but there is none; name one as arm, or leave base out")
        return None, None
    with about("arm"):
        arm = load_arm(settings.arm)
    with about("base"):
        base = None if settings.base is None else floats(settings.base, "base")
        if base is not None and base.shape != (4, 4):
            raise ConfigError(f"base has the shape {base.shape}; give a homogeneous matrix (4, 4)")
    return arm, base


def complete(kind: type[Config], arguments: Mapping[str, Any], hidden: Collection[str] = ()) -> Config:
    """Make the config of an environment from keywords; dictionaries become configs.

    Raises
    ------
    UnknownKeywordError
        For an unknown keyword; the message suggests the nearest one, or all but those `hidden`.
    ConfigError
        For a value of the wrong type for a keyword that takes a config. Its `field` is the keyword.
    """
    hints, chosen = get_type_hints(kind), {}
    for name in arguments:
        if name not in hints:
            offered = ["objects", *(field.name for field in fields(kind) if field.name not in hidden)]
            near = difflib.get_close_matches(name, offered, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"choose from {', '.join(offered)}"
            with about(name):
                # The first words are Python's, which TorchRL looks for before it tries without a keyword.
                raise UnknownKeywordError(
                    f"unexpected keyword argument {name!r}: this environment has no keyword {name!r}; "
                    f"{_REPLACED.get(name, hint)}"
                )
    for name, value in arguments.items():
        with about(name):
            chosen[name] = _configured(name, value, hints[name])
    for name, value in chosen.items():
        if name not in _CHECKED_LATER and not _fits(value, hints[name]):
            with about(name):
                raise ConfigError(f"{name} is {shown(value)}; its type is {documented_type(kind, name)}")
    return kind(**chosen)


def documented_type(kind: type, name: str) -> str:
    """Return the type of a keyword as the docstring of its class words it."""
    docs = "\n".join(one.__doc__ or "" for one in kind.__mro__)
    found = re.search(rf"^ +{name} : (.+)$", docs, flags=re.MULTILINE)
    return found[1] if found else str(get_type_hints(kind)[name])


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
