"""What all environments share, single and vector: a pool, and what its rows mean."""

import json
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from graspbox import _core, object_sets
from graspbox._core import Hand, Objects
from graspbox.configs import (
    AgentConfig,
    CamerasConfig,
    PhysicsConfig,
    PictureConfig,
    Randomization,
    SuccessCriterion,
    TrialConfig,
)
from graspbox.envs import spaces
from graspbox.envs.reward import DECISION_WEIGHTS, WEIGHTS, term_weights, total
from graspbox.errors import ConfigError
from graspbox.meshes import to_json
from graspbox.simulation import cache_folder, load_hand

ObjectsArgument = str | Path | object_sets.ObjectSet | Sequence[str | Path]
HandArgument = str | Hand | tuple[str, str]
Control = Literal["twist", "delta_pose", "target_pose"]
Reward = Literal["sparse", "dense"]
RenderMode = Literal["rgb_array"] | None

#: Seconds between two actions are the core's; frames of a video are one for each action.
FPS = 20

#: Handles in use: environments beside each other prepare an object once.
_handles: WeakValueDictionary[tuple[Any, ...], Objects] = WeakValueDictionary()


def _describe(spec: object_sets.ObjectSpec) -> str:
    """Write an object as the core reads it."""
    found = asdict(spec)
    del found["mass_known"]
    return json.dumps({**found, "path": None if spec.path is None else str(spec.path)})


def load_objects(objects: object_sets.ObjectSet, hand: HandArgument, physics: PhysicsConfig) -> tuple[Objects, Hand]:
    """Make a handle on objects, or take the one that another environment uses."""
    cache = cache_folder()
    key = (objects.objects, hand, physics, cache)
    found = _handles.get(key) if hand == "reflex" else None
    loaded = load_hand(hand)
    if found is None:
        found = Objects([_describe(spec) for spec in objects], loaded, to_json(physics), cache)
        if hand == "reflex":
            _handles[key] = found
    return found, loaded


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    raise TypeError(f"not {type(value).__name__}")


def options_json(options: Mapping[str, Any] | None) -> str | None:
    """Write the options of a reset as the core reads them."""
    if not options:
        return None
    try:
        return json.dumps(dict(options), allow_nan=False, default=_plain)
    except (TypeError, ValueError) as error:
        raise ConfigError(f"the options of a reset must be finite numbers, strings and arrays ({error})") from None


def checked_seed(seed: int) -> int:
    """Refuse a seed that the core does not take."""
    if not 0 <= seed < 2**64:
        raise ConfigError(f"seed is {seed}; it must be between 0 and 2^64 - 1")
    return int(seed)


def fresh_seed() -> int:
    """Draw a seed that nobody chose."""
    return secrets.randbits(63)


class GraspCore:
    """A pool of environments with its spaces, weights and names; the keywords are those of the environments.

    With ``control="grasp_pose"`` an episode is one decision, and `trial` is what follows it; its criterion of success then
    counts, else `success`.
    """

    def __init__(
        self,
        num_envs: int,
        objects: ObjectsArgument,
        *,
        split: object_sets.Split | None,
        obs: str | Sequence[str],
        reward: Reward,
        reward_weights: Mapping[str, float] | None,
        image_size: int | tuple[int, int] | None,
        cameras: CamerasConfig,
        picture: PictureConfig,
        control: Control | Literal["grasp_pose"],
        randomization: Literal["standard"] | Randomization | None,
        render_mode: RenderMode,
        num_threads: int | None,
        physics: PhysicsConfig,
        hand: HandArgument,
        autoreset: Literal["next_step", "same_step", "disabled"],
        max_episode_steps: int | None,
        frame_skip: int = 1,
        trial: TrialConfig | None = None,
        success: SuccessCriterion = SuccessCriterion(),  # noqa: B008 (frozen)
    ) -> None:
        if render_mode not in (None, "rgb_array"):
            raise ConfigError(f"render_mode={render_mode!r} is not available; use None or 'rgb_array'")
        cameras = completed(cameras, spaces.image_names(obs), image_size)
        self.object_set = object_sets.load(objects, split=split)
        # Kept, so that environments made later find it.
        self.handle, self.hand = load_objects(self.object_set, hand, physics)
        self.tables = spaces.tables(self.hand)
        if trial is None and control not in self.tables["actions"]:
            raise ConfigError(f"there is no control mode {control!r}; choose from {', '.join(self.tables['actions'])}")
        self.action_space = spaces.action_space(control, self.tables)
        self.action_size = spaces.size(spaces.columns_of(control, self.tables)[0])
        seen = spaces.images(self.hand, cameras)
        self.observation_space = spaces.observation_space(obs, control, self.tables, seen)
        # A space sorts its names.
        self.obs = obs if isinstance(obs, str) else tuple(sorted(obs))
        names = (self.obs,) if isinstance(self.obs, str) else self.obs
        self.weights = term_weights(reward, reward_weights, self.tables, DECISION_WEIGHTS if trial else WEIGHTS)
        config = AgentConfig(
            control=control,
            autoreset=autoreset,
            frame_skip=frame_skip,
            max_episode_steps=max_episode_steps,
            observations=tuple(name for name in names if name not in cameras.images),
            randomization=_randomization(randomization),
            cameras=cameras,
            success=trial.success if trial else success,
            trial=trial or TrialConfig(),
        )
        self.config = config
        self.pool = _core.EnvPool(self.handle, to_json(config), num_envs, num_threads)
        self._picture = to_json(picture)
        self._terms = [term["name"] for term in self.tables["terms"]]
        self._entries = spaces.entries(control, self.tables)
        names_of = {"failures": self.tables["failures"], "objects": self.handle.names}
        self._names = {kind: np.array(found, dtype=object) for kind, found in names_of.items()}

    def observations(self, arrays: "_core.EnvArrays") -> Any:
        """Pick the observations of all rows: an array, or a dictionary of arrays."""
        if isinstance(self.obs, str):
            return arrays[self.obs]  # type: ignore[literal-required]
        return {name: arrays[name] for name in self.obs}  # type: ignore[literal-required]

    def first(self, arrays: "_core.EnvArrays") -> tuple[Any, dict[str, Any]]:
        """Observation and info of the first row."""
        found = self.observations(arrays)
        observation = {name: rows[0] for name, rows in found.items()} if isinstance(found, dict) else found[0]
        return observation, row(self.columns(arrays), 0)

    def pictures(self) -> NDArray[np.uint8]:
        """Take a picture of every environment, (num_envs, H, W, 3)."""
        return _core.pictures(self.pool, range(self.pool.num_envs), self._picture)

    def cameras(self) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Intrinsics (3, 3) and world_from_camera (num_envs, 4, 4) of every camera as it stands, by name."""
        return _core.poses_of_cameras(self.pool)

    def rewards(self, arrays: "_core.EnvArrays") -> NDArray[np.float64]:
        """Weigh the terms of every row."""
        return total(self.weights, arrays["terms"])

    def columns(self, arrays: "_core.EnvArrays") -> dict[str, Any]:
        """Info of all rows, as the core's table lists it: an array per entry, and one per reward term."""
        terms = np.ascontiguousarray(arrays["terms"].T, dtype=np.float64)
        if arrays["reset"].any():
            # Where an episode ended and the next began in one step, the terms are those of the end.
            terms[:, arrays["reset"]] = 0.0
        info = {entry["name"]: self._entry(entry, arrays["info"][entry["name"]]) for entry in self._entries}
        return {**info, "reward_terms": dict(zip(self._terms, terms, strict=True))}

    def _entry(self, entry: spaces.Entry, values: NDArray[Any]) -> NDArray[Any]:
        """Replace indices by the names that they mean."""
        names: NDArray[Any] | None = self._names.get(entry["names"] or "")
        return values if names is None else names[values]

    def action(self, action: Any, rows: int) -> NDArray[np.float32]:
        """Actions as the core takes them; it checks that they are finite where they count."""
        size = self.action_size
        given = np.asarray(action, dtype=np.float32)
        if given.shape != (rows, size) and (rows, *given.shape) != (1, size):
            raise ConfigError(f"the action has shape {given.shape}; give {size} numbers for each of {rows} envs")
        return np.ascontiguousarray(given.reshape(rows, size))


def _randomization(given: Literal["standard"] | Randomization | None) -> Randomization:
    if given is None:
        return Randomization()
    if given == "standard":
        return Randomization.standard()
    if isinstance(given, Randomization):
        return given
    raise ConfigError(f"randomization is {given!r}; give None, 'standard' or a Randomization")


def completed(
    cameras: CamerasConfig, images: tuple[str, ...], image_size: int | tuple[int, int] | None
) -> CamerasConfig:
    """Complete the cameras by what `obs` and `image_size` ask for."""
    if cameras.images:
        raise ConfigError(f"cameras.images is {cameras.images!r}; name images in obs")
    size = cameras.image_size if image_size is None else image_size
    height, width = (size, size) if isinstance(size, int | np.integer) else size
    if not all(16 <= side <= 1024 for side in (height, width)):
        raise ConfigError(f"image_size is {size!r}; sides must be between 16 and 1024 pixels")
    return replace(cameras, images=images, image_size=(int(height), int(width)))


def row(columns: dict[str, Any], index: int) -> dict[str, Any]:
    """One row of the columns, as plain Python values."""
    return {
        name: row(values, index) if isinstance(values, dict) else values[index : index + 1].tolist()[0]
        for name, values in columns.items()
    }
