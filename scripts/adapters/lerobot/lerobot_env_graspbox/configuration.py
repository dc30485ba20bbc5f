"""Settings of the environments, as ``--env.NAME`` on LeRobot's command lines."""

from dataclasses import dataclass, field
from typing import Any

import gymnasium
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.envs import EnvConfig

from graspbox.tools.demonstrations.lerobot import TASK

from .vector import LeRobotVectorEnv, kind, make

__all__ = ["GraspboxEnv"]

_ACTION = "action"


@EnvConfig.register_subclass("graspbox")
@dataclass
class GraspboxEnv(EnvConfig):
    """Environments of graspbox.

    Attributes
    ----------
    task : str
        ``Grasp-v0`` (closed loop) or ``GraspPose-v0`` (one decision per episode).
    fps : int
        Follows from `task` and `control_freq`; a value set here is ignored.
    objects : list of str
        Object sets.
    split : str, optional
        Sample from this split only.
    obs : list of str
        Observations, by their names in graspbox.
    image_size : int
        Rows and columns of the images.
    episode_length : int, optional
        Steps after which an episode is truncated; by default 40, of ``GraspPose-v0`` 1.
    control : str
        Control mode of ``Grasp-v0``.
    fingers : str
        How an action of ``Grasp-v0`` moves the fingers.
    control_freq : float
        Actions per second of ``Grasp-v0``, Hz.
    remote : str, optional
        Address of a ``graspbox serve`` that steps the environments.
    picture_size : list of int
        Rows and columns of the pictures of videos.
    task_description : str
        The instruction that policies read.
    keywords : dict
        Other keywords of the environments.
    """

    task: str | None = "Grasp-v0"
    objects: list[str] = field(default_factory=lambda: ["procedural"])
    split: str | None = None
    obs: list[str] = field(default_factory=lambda: ["rgb", "proprio"])
    image_size: int = 96
    episode_length: int | None = None
    control: str = "twist"
    fingers: str = "synergy"
    control_freq: float = 5.0
    remote: str | None = None
    picture_size: list[int] = field(default_factory=lambda: [240, 320])
    task_description: str = TASK
    keywords: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Read the features off the spaces of an environment."""
        if self.episode_length is None:
            self.episode_length = gymnasium.spec(self.gym_id).max_episode_steps
        envs = self._made(1)
        self.fps = envs.metadata["render_fps"]
        spaces = envs.env.single_observation_space
        action = envs.single_action_space
        envs.close()
        self.features = {_ACTION: PolicyFeature(type=FeatureType.ACTION, shape=action.shape)}
        self.features_map = {_ACTION: _ACTION}
        for name, space in spaces.items():
            key, policy_key, feature = _feature(name, space.shape)
            self.features[key], self.features_map[key] = feature, policy_key

    @property
    def package_name(self) -> str:
        """The package that registers the environments."""
        return "graspbox"

    @property
    def gym_id(self) -> str:
        """Id of the environment."""
        return f"graspbox/{self.task}"

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Keywords of the environments."""
        acting = {"control": self.control, "fingers": self.fingers, "control_freq": self.control_freq}
        return {
            "objects": self.objects,
            "split": self.split,
            "obs": tuple(self.obs),
            "image_size": self.image_size,
            "remote": self.remote,
            "render_mode": "rgb_array",
            "picture": {"image_size": self.picture_size},
            **(acting if self.task == "Grasp-v0" else {}),
            **self.keywords,
        }

    def create_envs(self, n_envs: int, use_async_envs: bool = False) -> dict[str, dict[int, LeRobotVectorEnv]]:
        """Make the environments; they step in threads, so that no processes are needed for `use_async_envs`."""
        del use_async_envs
        return {self.type: {0: self._made(n_envs)}}

    def _made(self, n_envs: int) -> LeRobotVectorEnv:
        assert self.task is not None
        assert self.episode_length is not None
        return make(self.task, n_envs, self.episode_length, self.task_description, **self.gym_kwargs)


def _feature(name: str, shape: tuple[int, ...]) -> tuple[str, str, PolicyFeature]:
    """Key among the features, key in a policy's batch, and the feature of an observation of graspbox.

    LeRobot's recordings look colour images up by the second key, everything else by the first.
    """
    key = f"observation.images.{name}"
    if kind(name) == "rgb":
        return key, key, PolicyFeature(type=FeatureType.VISUAL, shape=shape)
    if kind(name) == "depth":
        rows, columns, channels = shape
        return f"images.{name}", key, PolicyFeature(type=FeatureType.VISUAL, shape=(channels, rows, columns))
    if name == "state":
        return "environment_state", "observation.environment_state", PolicyFeature(type=FeatureType.ENV, shape=shape)
    key, policy_key = ("agent_pos", "observation.state") if name == "proprio" else (name, f"observation.{name}")
    return key, policy_key, PolicyFeature(type=FeatureType.STATE, shape=shape)
