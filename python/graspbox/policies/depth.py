"""``depth``: grasps from one depth camera, without mesh or true pose."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from graspbox._core import Hand, Mesh
from graspbox.envs import spaces
from graspbox.envs.coding import Codec, encode_action, object_pose
from graspbox.envs.scripted import ScriptedGrasp, ScriptedMotion
from graspbox.errors import ConfigError
from graspbox.perception.cameras import camera_pose, lens
from graspbox.perception.configs import CropConfig, DepthNoise, HandGridConfig
from graspbox.perception.crops import add_depth_noise
from graspbox.perception.finder import Complete, Finder, FoundGrasp, GraspFinder, Head, Score, observed_only
from graspbox.perception.finder_configs import FinderConfig
from graspbox.perception.hand_grids import HandGrid
from graspbox.perception.hand_views import HandView
from graspbox.perception.perturbations import PoseNoise
from graspbox.perception.policy_folders import CONFIG, DepthPolicyConfig, read_depth_policy, read_learned_from
from graspbox.perception.runtimes import Backend, Scorer, load_parts
from graspbox.policies.base import Actions, Policy, Task
from graspbox.policies.depth_oracles import Truth
from graspbox.simulation import load_hand

__all__ = ["DepthGrasp", "Oracle"]

#: A part of the policy that the truth can stand in for.
Oracle = Literal["completion", "scorer"]
#: Meshes that the oracles keep.
_MESHES = 128


class DepthGrasp(Policy):
    """Grasps what a depth camera sees: crop, completion, proposals, scores, refinement (`GraspFinder`).

    It looks once per episode, with the first camera of the environments, which must stand in the world. In
    ``GraspPose-v0`` the grasp is the action. In ``Grasp-v0`` the hand first leaves the image, since it would be taken
    for a part of the object, and is then moved to the grasp as the scripted expert does it. Where no object is seen or
    no grasp is found, its actions are zeros.

    Parameters
    ----------
    folder : Path or None
        A policy's folder (`graspbox.perception.policy_folders`). None: no completion (the observed surface alone), and
        the scorer must be an oracle.
    oracles : sequence of {"completion", "scorer"}
        Parts that the truth stands in for, to measure what each part loses. ``completion``: the object's own occupancy.
        ``scorer``: simulation of the proposals with a wrong hand. With an oracle the policy is **privileged**: it reads
        ``state`` and ``info["object"]``.
    noise : DepthNoise
        Noise that is added to the depth that the environments render.
    config : FinderConfig, optional
        How grasps are found; by default as the folder says.
    hand_error : PoseNoise, optional
        How far the hand may go from where it is sent: grasps that tolerate it are chosen. A decision then takes several
        times as long.
    backend : {"onnx", "torch"}
        What runs the networks: onnxruntime (extra ``onnx``), or torch.
    num_threads : int, optional
        Threads of a decision; by default one per core. Geometry does not depend on it; networks differ in the last
        digits.

    Raises
    ------
    ConfigError
        For an unknown oracle or backend, if there is nothing to score with, or the folder is wrong.
    FileError
        If the folder lacks a file.
    """

    name = "depth"
    obs: tuple[str, ...] = ("depth", "proprio")
    settings = {"image_size": 128}  # noqa: RUF012 (read only)

    def __init__(
        self,
        folder: Path | None,
        *,
        oracles: Sequence[Oracle] = (),
        noise: DepthNoise = DepthNoise(),  # noqa: B008 (frozen)
        config: FinderConfig | None = None,
        hand_error: PoseNoise | None = None,
        backend: Backend = "onnx",
        num_threads: int | None = None,
    ) -> None:
        for oracle in oracles:
            if oracle not in get_args(Oracle):
                raise ConfigError(f"there is no oracle {oracle!r}; choose from {', '.join(get_args(Oracle))}")
        self.obs = ("depth", "proprio", *(("state",) if oracles else ()))
        if backend not in get_args(Backend):
            raise ConfigError(f"there is no backend {backend!r}; choose from {', '.join(get_args(Backend))}")
        self._folder, self._oracles, self._noise = folder, frozenset(oracles), noise
        self._backend, self._num_threads = backend, num_threads
        self._published = self._read(folder)
        self._config = config or (self._published.finder if self._published else FinderConfig())
        if hand_error is not None:
            self._config = self._config.tolerating(hand_error)
        if folder is not None and (Path(folder) / CONFIG).is_file():
            self.learned_from = read_learned_from(Path(folder))
        if self._published is not None:
            self.name = self._published.name
        #: Once the policy is bound: the hand, and the settings of the crop.
        self.hand: Hand
        self.crop: CropConfig
        #: The scorer, once the policy is bound; None where an oracle stands in.
        self.scorer: Scorer | None = None
        #: What was found last in each environment; None where nothing was.
        self.found: list[FoundGrasp | None] = []

    def _read(self, folder: Path | None) -> DepthPolicyConfig | None:
        """Read what a folder holds; None without one, and in a subclass that makes its finder from other files."""
        if folder is None and "scorer" not in self._oracles:
            raise ConfigError("there is nothing to score grasps with; name a folder of weights, or the oracle 'scorer'")
        return None if folder is None else read_depth_policy(Path(folder))

    def _bind(self, task: Task) -> None:
        camera = task.cameras.cameras[0]
        if camera.mount != "world":
            raise ConfigError(f"camera {camera.name!r} is mounted on the hand; put one first whose mount is 'world'")
        self.hand = load_hand(task.hand)
        self._world_from_camera = camera_pose(camera)
        self._intrinsics = lens(camera.fov, task.cameras.image_size)
        self.crop = self._published.crop if self._published else CropConfig()
        self._finder = self._make_finder()
        self._proprio = Codec(task.control, self.hand, "proprio") if task.closed_loop else None
        self._view = HandView(self.hand, self._world_from_camera, self._intrinsics, task.cameras.image_size)
        self._waiting: list[int | None] = [None] * task.num_envs
        self._objects: list[str] = [""] * task.num_envs
        self._drivers: list[ScriptedMotion | None] = [None] * task.num_envs
        self.found = [None] * task.num_envs
        self._streams = [np.random.default_rng() for _ in range(task.num_envs)]
        indices = {name: i for i, name in enumerate(task.objects.names)}

        @lru_cache(_MESHES)
        def mesh(name: str) -> Mesh:
            if name not in indices:
                raise ConfigError(f"there is no object {name!r} in the set {task.objects.name!r} that the policy knows")
            return task.objects[indices[name]].load()

        self._mesh = mesh

    def _make_finder(self) -> Finder:
        """Load the parts for which no oracle stands in."""
        grid_config = self._published.grid if self._published else HandGridConfig()
        grid = HandGrid(self.hand, grid_config, crop=self.crop, num_threads=self._num_threads)
        complete: Complete = observed_only
        score: Score = _no_score
        head: Head | None = None
        if self._folder is not None and self._published is not None:
            if (name := self.hand.name) != self._published.hand:
                raise ConfigError(f"the policy {self.name!r} knows the hand {self._published.hand!r}, not {name!r}")
            parts = load_parts(Path(self._folder), self._published, grid, self._backend, self._num_threads)
            complete = complete if "completion" in self._oracles else parts.complete
            self.scorer = None if "scorer" in self._oracles else parts.scorer
            score, head = self.scorer or score, parts.head
        return GraspFinder(
            grid, complete, score, self._config, crop=self.crop, head=head, num_threads=self._num_threads
        )

    def _begin(self, env: int, seed: int | None, info: dict[str, Any]) -> None:
        if seed is not None:
            self._streams[env] = np.random.default_rng(seed)
        # The decision waits for the first observation.
        self._waiting[env] = int(self._streams[env].integers(2**62))
        self._drivers[env] = None
        if self._oracles:
            if "object" not in info:
                raise ConfigError("an oracle needs info['object'], the object's name; give reset its info")
            given = info["object"]
            self._objects[env] = given if isinstance(given, str) else self.task.objects.names[int(given)]

    def act(self, observation: Any) -> Actions:
        """Decide where an episode has begun, and move on in the others."""
        actions = self._zeros()
        for env in range(self.task.num_envs):
            if self._proprio is not None:
                action = self._move(env, {name: observation[name][env] for name in self.obs})
                if action is not None:
                    actions[env] = action
                continue
            seed, self._waiting[env] = self._waiting[env], None
            if seed is None:
                continue
            found = self.found[env] = self.find(env, seed, {name: observation[name][env] for name in self.obs})
            if found is not None:
                actions[env] = encode_action(found.world_from_hand, found.preshape, hand=self.hand)
        return actions

    def confidence(self, env: int) -> float | None:
        """Give the scorer's probability of success; 0 where no grasp was found, None where an oracle scores."""
        found = self.found[env]
        if self.scorer is None:
            return None
        if found is None:
            return 0.0
        pose, preshape = found.best()
        return float(self.scorer.judge(found.volume, pose[None], np.array([preshape])).success[0])

    @property
    def period(self) -> float:
        """Seconds of a step of ``Grasp-v0``."""
        found: float = spaces.tables(self.hand)["control_period"]
        return found * self.task.frame_skip

    def hand_pose(self, proprio: NDArray[Any]) -> NDArray[np.float64]:
        """Read ``world_from_hand`` (4, 4) off a row of the observation ``proprio``."""
        assert self._proprio is not None
        return self._proprio.pose(proprio, "hand")

    def has_looked(self, env: int) -> bool:
        """Whether it has looked in the present episode of an environment."""
        return self._waiting[env] is None

    def look(self, env: int, seen: Mapping[str, Any]) -> None:
        """Look in ``Grasp-v0`` without moving, once per episode, as soon as the hand is out of the image.

        Parameters
        ----------
        env : int
            Index of the environment.
        seen : mapping
            The environment's row of each observation in `obs`.
        """
        seed = self._waiting[env]
        if seed is None or self._view.sees(self.hand_pose(seen["proprio"]), self._preshape(seen)):
            return
        self._waiting[env], self.found[env] = None, self.find(env, seed, seen)

    def _move(self, env: int, seen: Mapping[str, Any]) -> NDArray[np.float32] | None:
        """Choose the next action in ``Grasp-v0``: leave the image, look, grasp; `seen` is the environment's row."""
        hand = self.hand_pose(seen["proprio"])
        if self._waiting[env] is not None:
            if self._drivers[env] is None:
                self._drivers[env] = self._leaving(hand, seen)
            driver = self._drivers[env]
            if driver is None or driver.finished:
                seed, self._waiting[env] = self._waiting[env], None
                found = self.found[env] = self.find(env, int(seed or 0), seen)
                self._drivers[env] = None if found is None else self.grasping(found, hand)
        driver = self._drivers[env]
        return None if driver is None else driver.follow(hand)

    def _leaving(self, hand: NDArray[np.float64], seen: Mapping[str, Any]) -> ScriptedMotion | None:
        """Make what moves the hand out of the image; None if it is not there."""
        preshape = self._preshape(seen)
        stops = self._view.leave(hand, preshape)
        return ScriptedMotion([hand, *stops], preshape, **self._motion_settings()) if stops else None

    def _preshape(self, seen: Mapping[str, Any]) -> float:
        """Read the preshape that the hand has; one whose preshape has no actuator keeps the least."""
        assert self._proprio is not None
        if "preshape" not in self._proprio.names:
            return self.hand.preshape_limits[0]
        return float(self._proprio.column(seen["proprio"], "preshape")[0])

    def _motion_settings(self) -> dict[str, Any]:
        task = self.task
        return {"control": task.control, "hand": self.hand, "frame_skip": task.frame_skip}

    def find(self, env: int, seed: int, seen: Mapping[str, Any]) -> FoundGrasp | None:
        """Look once and choose.

        Parameters
        ----------
        env : int
            Index of the environment.
        seed : int
            Seed of the camera's noise and of the refinement.
        seen : mapping
            The environment's row of the observation: ``depth`` (H, W, 1), and ``state`` for an oracle.

        Returns
        -------
        FoundGrasp or None
            None where no object is seen, or no grasp of it is feasible.
        """
        depth = self._noisy(seed, seen)
        truth = None
        if self._oracles:
            pose = object_pose(seen["state"], hand=self.hand)
            truth = Truth(self._mesh(self._objects[env]), pose, self.crop, self.hand, seed)
        return self._finder.find(
            depth,
            self._intrinsics,
            self._world_from_camera,
            seed=seed,
            complete=truth.complete if truth and "completion" in self._oracles else None,
            score=truth.score if truth and "scorer" in self._oracles else None,
            on_crop=truth.place if truth else None,
        )

    def _noisy(self, seed: int, seen: Mapping[str, Any]) -> NDArray[np.uint16]:
        """Give the environment's depth image (H, W) as the camera would measure it."""
        clean = np.asarray(seen["depth"])[None, :, :, 0]
        return np.asarray(add_depth_noise(clean, self._intrinsics, seed, self._noise)[0])

    def grasping(self, found: FoundGrasp, world_from_hand: NDArray[np.float64]) -> ScriptedGrasp:
        """Make what moves the hand from ``world_from_hand`` (4, 4) to a grasp in ``Grasp-v0``, closes and lifts."""
        goal = found.world_from_hand
        return ScriptedGrasp(world_from_hand, goal, found.preshape, self.top(found), **self._motion_settings())

    def top(self, found: FoundGrasp) -> float:
        """Height over the table of the object as it is seen, metres."""
        filled = np.flatnonzero((found.occupancy >= 64).any(axis=(0, 1)))
        return float(self.crop.origin[2] + (filled[-1] + 1) * self.crop.voxel_size) if len(filled) else 0.0


def _no_score(
    volume: NDArray[np.uint8], poses: NDArray[np.float64], preshapes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Stand in for the scorer of a policy whose scorer is an oracle; it is never called."""
    raise ConfigError("the policy has no scorer; name a folder of weights")
