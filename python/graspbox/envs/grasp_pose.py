"""``graspbox/GraspPose-v0``: one decision an episode.

An object rests somewhere near the middle of a table. The agent names one hand pose and a preshape; the hand closes
there, lifts and holds; the episode ends.

Action
------
``Box(-1, 1, (10,), float32)``, in the world's frame (z up, table top at z = 0). The box of positions is fixed in the
world; the object is not at its centre.

| index | meaning                              | -1    | 1    | unit |
|---|---|---|---|---|
| 0     | hand position x                      | -0.25 | 0.25 | m |
| 1     | hand position y                      | -0.25 | 0.25 | m |
| 2     | hand position z                      | 0     | 0.40 | m |
| 3-5   | first column of ``world_from_hand``  | -1    | 1    | direction, any length |
| 6-8   | second column of ``world_from_hand`` | -1    | 1    | direction, any length |
| 9     | preshape                             | 0     | pi/2 | rad (the hand's limits) |

The two columns are made orthonormal in this order. Where that is impossible (a column shorter than 0.001, or the two
within a thousandth of a radian of parallel), or where the hand collides with the object or the table at the pose or
on the straight approach of 0.10 m along its -z, the attempt is ``infeasible``: no trial, reward 0.

Observation
-----------
``obs="state"``: ``Box(float32)`` of 19 numbers. It is **privileged**: no camera sees it.

| index | meaning                                            | min | max | unit |
|---|---|---|---|---|
| 0-2   | origin of the object's frame, world                | -1  | 1   | m |
| 3-8   | first two columns of ``world_from_object``         | -1  | 1   | 1 |
| 9-11  | centre of mass, world                              | -1  | 1   | m |
| 12-14 | centre of the bounds (object's axes), world        | -1  | 1   | m |
| 15-17 | half extents of the bounds along the object's axes | 0   | 1   | m |
| 18    | mass                                               | 0   | 10  | kg |

Values beyond their range are clipped. The observation that ends the episode is the one it began with.

Images (``rgb``, ``depth``, ``rgbd``, ``segmentation``, ``points``, ``voxels``; the table in `graspbox.envs.grasp` fixes
shapes, units and bounds) show the object on the table from the camera ``front``; the hand waits elsewhere. They hold no
pose of the object. Several names give a ``Dict``.

Reward
------
``reward="sparse"``: 1 for a success as `graspbox.simulation` defines it, else 0.

Info
----
After a step: ``is_success``, ``is_secure``, ``infeasible`` (bool), ``failure`` (str, empty for a success), ``lift``
(m), ``object`` (str). After a reset: ``object``.

Version history
---------------
v0: first version.
"""

from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from numpy.typing import NDArray

from graspbox import _core, object_sets
from graspbox.configs import FRONT, EyesConfig, PhysicsConfig, PictureConfig, TrialConfig
from graspbox.envs import spaces
from graspbox.envs.core import RenderMode, completed
from graspbox.errors import ConfigError
from graspbox.meshes import to_json
from graspbox.simulation import Scene, load_hand

#: Corners of the box of hand positions, world frame, metres: a hand's reach around the objects that `_SPREAD` allows.
POSITION_LOW = np.array([-0.25, -0.25, 0.0])
POSITION_HIGH = np.array([0.25, 0.25, 0.40])
#: The object is moved from the table's origin by up to this much in x and y, metres.
_SPREAD = 0.05
#: A direction shorter than this, or two directions with a smaller sine between them, name no rotation.
_DEGENERATE = 1e-3
#: Scenes kept ready; one takes about 1 MB.
_MAX_SCENES = 256

_STATE_LOW = np.concatenate([np.full(15, -1.0), np.zeros(4)]).astype(np.float32)
_STATE_HIGH = np.concatenate([np.full(18, 1.0), [10.0]]).astype(np.float32)


def rotation_from_columns(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Make a rotation (3, 3) from its first two columns; None where they name none."""
    length = np.linalg.norm(first)
    if length < _DEGENERATE:
        return None
    x = first / length
    rest = second - x * (x @ second)
    if np.linalg.norm(rest) < _DEGENERATE * max(1.0, float(np.linalg.norm(second))):
        return None
    y = rest / np.linalg.norm(rest)
    return np.stack([x, y, np.cross(x, y)], axis=1)


class GraspPoseEnv(gymnasium.Env[Any, NDArray[np.float32]]):
    """One decision an episode: see the module for the tables of action and observation.

    Parameters
    ----------
    objects : str or sequence of str
        Object sets to draw from: see `graspbox.object_sets`.
    split : {"train", "validation", "test"}, optional
        Draw from this split only.
    obs : str or sequence of str
        What is observed: ``state``, or images by name; several names give a ``Dict``.
    reward : {"sparse"}
        What is rewarded.
    hand : str or pair of paths
        See `graspbox.load_hand`.
    trial : TrialConfig
        The trial.
    physics : PhysicsConfig
        The engine.
    num_threads : int, optional
        Threads to use.
    render_mode : "rgb_array", optional
        Whether `render` gives pictures: of the object, and after a step of the open hand where it was sent.
    image_size : int or pair of int, optional
        Rows and columns of the images, 16 to 1024; by default those of `eyes`.
    eyes : EyesConfig
        Cameras of the world, shadows, voxels; `obs` names the images.
    picture : PictureConfig
        Size, smoothness and camera of the pictures that `render` gives.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012 (as Gymnasium declares it)

    def __init__(
        self,
        objects: str | Path | object_sets.ObjectSet | Sequence[str | Path] = "procedural",
        *,
        split: object_sets.Split | None = None,
        obs: str | Sequence[str] = "state",
        reward: Literal["sparse"] = "sparse",
        hand: str | tuple[str, str] = "reflex",
        trial: TrialConfig = TrialConfig(),  # noqa: B008 (frozen)
        physics: PhysicsConfig = PhysicsConfig(),  # noqa: B008 (frozen)
        num_threads: int | None = None,
        render_mode: RenderMode = None,
        image_size: int | tuple[int, int] | None = None,
        eyes: EyesConfig = EyesConfig(cameras=(FRONT,)),  # noqa: B008 (frozen)
        picture: PictureConfig = PictureConfig(),  # noqa: B008 (frozen)
    ) -> None:
        if reward != "sparse":
            raise ConfigError(f"reward={reward!r} is not available; use 'sparse'")
        if render_mode not in (None, "rgb_array"):
            raise ConfigError(f"render_mode={render_mode!r} is not available; use None or 'rgb_array'")
        if any(camera.mount != "world" for camera in eyes.cameras):
            raise ConfigError("the hand waits elsewhere before it is sent; give cameras of the world alone")
        eyes = completed(eyes, spaces.image_names(obs), image_size)
        self.objects = object_sets.load(objects, split=split)
        self.render_mode = render_mode
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (10,), dtype=np.float32)
        self._hand = load_hand(hand)
        self._obs = spaces.observation_names(obs, ("state", *spaces.IMAGES, *eyes.images))
        boxes = {row["name"]: spaces.image_space(row) for row in spaces.images(self._hand, eyes)}
        boxes["state"] = gymnasium.spaces.Box(_STATE_LOW, _STATE_HIGH, dtype=np.float32)
        self.observation_space = (
            boxes[obs] if isinstance(obs, str) else gymnasium.spaces.Dict({name: boxes[name] for name in self._obs})
        )
        self._single = isinstance(obs, str)
        self._gaze, self._picture = _core.Gaze(self._hand, to_json(eyes)), to_json(picture)
        self._sent: tuple[NDArray[np.float64], float] | None = None
        self._trial, self._physics, self._num_threads = trial, physics, num_threads
        self._scenes: OrderedDict[int, Scene] = OrderedDict()
        self._scene: Scene | None = None
        self._world_from_table = np.eye(4)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Draw an object and its place on the table.

        Parameters
        ----------
        seed : int, optional
            Seed of the draws from here on.
        options : dict, optional
            ``{"object": name}`` takes that object of the set.
        """
        super().reset(seed=seed)
        wanted = (options or {}).get("object")
        index = int(self.np_random.integers(len(self.objects)))
        if wanted is not None:
            if wanted not in self.objects.names:
                raise ConfigError(f"there is no object {wanted!r} in {self.objects.name!r}")
            index = self.objects.names.index(wanted)
        self._scene, self._sent = self._prepare(index), None
        x, y = self.np_random.uniform(-_SPREAD, _SPREAD, size=2)
        turn = self.np_random.uniform(-np.pi, np.pi)
        cos, sin = np.cos(turn), np.sin(turn)
        self._world_from_table = np.array([[cos, -sin, 0, x], [sin, cos, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]])
        return self._observe(self._scene), {"object": self._scene.name}

    def step(self, action: NDArray[np.float32]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Try the grasp; the episode ends."""
        scene = self._scene
        if scene is None:
            raise gymnasium.error.ResetNeeded("call reset before step")
        observation = self._observe(scene)
        values = np.asarray(action, dtype=np.float64)
        if values.shape != (10,) or not np.isfinite(values).all():
            raise ConfigError(f"the action has shape {values.shape}; give 10 finite numbers")
        values = np.clip(values, -1.0, 1.0)
        info: dict[str, Any] = {"object": scene.name, "is_success": False, "is_secure": False, "lift": 0.0}
        info |= {"failure": "infeasible", "infeasible": True}
        rotation = rotation_from_columns(values[3:6], values[6:9])
        if rotation is not None:
            world_from_hand = np.eye(4)
            world_from_hand[:3, :3] = rotation
            world_from_hand[:3, 3] = POSITION_LOW + (values[:3] + 1) / 2 * (POSITION_HIGH - POSITION_LOW)
            low, high = self._hand.preshape_limits
            pose = np.linalg.inv(self._world_from_table @ scene.world_from_object) @ world_from_hand
            preshape = float(low + (values[9] + 1) / 2 * (high - low))
            self._sent = (world_from_hand, preshape)
            out = scene.simulate(pose[None], [preshape], config=self._trial, num_threads=self._num_threads)
            info |= {"is_success": bool(out.success[0]), "is_secure": bool(out.secure[0]), "lift": float(out.lift[0])}
            info |= {"failure": str(out.failure[0]), "infeasible": str(out.failure[0]) == "infeasible"}
        return observation, float(info["is_success"]), True, False, info

    def render(self) -> NDArray[np.uint8] | None:
        """Take a picture, (H, W, 3), with ``render_mode="rgb_array"``; nothing without."""
        if self.render_mode is None:
            return None
        if self._scene is None:
            raise gymnasium.error.ResetNeeded("call reset before render")
        pose = self._world_from_table @ self._scene.world_from_object
        hand, preshape = self._sent or (None, 0.0)
        return self._gaze.picture(self._scene.mesh, pose, hand, preshape, self._picture, self._num_threads)

    def _prepare(self, index: int) -> Scene:
        """Take the scene of an object from those kept ready, or settle it."""
        if index in self._scenes:
            self._scenes.move_to_end(index)
            return self._scenes[index]
        scene = Scene(self.objects[index].load(), hand=self._hand, physics=self._physics)
        self._scenes[index] = scene
        if len(self._scenes) > _MAX_SCENES:
            self._scenes.popitem(last=False)
        return scene

    def _observe(self, scene: Scene) -> Any:
        pose = self._world_from_table @ scene.world_from_object
        found: dict[str, NDArray[Any]] = {}
        if set(self._obs) != {"state"}:
            found |= self._gaze.see(scene.mesh, pose, self._num_threads)
        found["state"] = self._state(scene, pose)
        return found[self._obs[0]] if self._single else {name: found[name] for name in self._obs}

    def _state(self, scene: Scene, pose: NDArray[np.float64]) -> NDArray[np.float32]:
        low, high = scene.mesh.bounds
        center = pose[:3, :3] @ scene.center_of_mass + pose[:3, 3]
        middle = pose[:3, :3] @ ((low + high) / 2) + pose[:3, 3]
        parts = [pose[:3, 3], pose[:3, 0], pose[:3, 1], center, middle, (high - low) / 2, [scene.mesh.mass]]
        state = np.concatenate(parts).astype(np.float32)
        return np.clip(state, _STATE_LOW, _STATE_HIGH)
