"""graspbox as a benchmark of vla-eval: one task for each object set, one episode for each trial.

Trials are those of ``graspbox evaluate``: episode i of a task begins with the i-th seed of
`graspbox.evaluation.trial_seeds`. The environment runs in this process, on the CPU, or on a ``graspbox serve``.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from vla_eval.benchmarks.base import StepBenchmark, StepResult
from vla_eval.specs import IMAGE_RGB, LANGUAGE, DimSpec
from vla_eval.types import Action, EpisodeResult, Observation, Task

from graspbox.evaluation import trial_seeds

__all__ = ["GraspboxBenchmark"]

#: The instruction, which all episodes share.
TASK = "Grasp the object and lift it."


class GraspboxBenchmark(StepBenchmark):
    """``graspbox/Grasp-v0`` or ``graspbox/GraspPose-v0``.

    An observation is ``{"images": {"rgb": ...}, "state": proprio, "task_description": ...}``. Every other one that
    `obs` names keeps its name (``depth``, ``tactile``), but the privileged vector is ``environment_state``. An action
    is ``{"actions": (k,)}``, numbers in [-1, 1].

    Parameters
    ----------
    env_id : str
        Id of the environment.
    objects : str or sequence of str
        Object sets; each is a task.
    obs : sequence of str
        Observations, by their names in graspbox.
    seed : int
        Seed of the trials, as in ``graspbox evaluate``.
    max_episode_steps : int, optional
        Steps after which an episode is truncated; by default those of the environment.
    remote : str, optional
        Address of a ``graspbox serve`` that steps the environments.
    keywords : mapping, optional
        Other keywords of the environment: ``control``, ``fingers``, ``control_freq``, ``image_size`` and others.
    """

    render_backends: ClassVar[frozenset[str]] = frozenset({"gpu", "cpu"})

    @classmethod
    def configure_render(cls, mode: str) -> dict[str, str]:
        """Need nothing: images are always rendered on the CPU."""
        del mode
        return {}

    def __init__(
        self,
        env_id: str = "graspbox/Grasp-v0",
        objects: str | Sequence[str] = "procedural:unseen:0-19",
        obs: Sequence[str] = ("rgb", "proprio"),
        seed: int = 0,
        max_episode_steps: int | None = None,
        remote: str | None = None,
        keywords: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__()
        self._env_id, self._obs, self._seed = env_id, tuple(obs), seed
        self._sets = (objects,) if isinstance(objects, str) else tuple(objects)
        self._keywords = {"remote": remote, **(keywords or {})}
        spec = gymnasium.spec(env_id)
        self._max_steps = max_episode_steps or spec.max_episode_steps
        self._env: gymnasium.Env[Any, Any] | None = None
        self._objects: str | None = None

    def _made(self, objects: str) -> gymnasium.Env[Any, Any]:
        """Environment of an object set; one is kept at a time."""
        if self._env is None or self._objects != objects:
            self.cleanup()
            self._env = gymnasium.make(
                self._env_id,
                objects=objects,
                obs=self._obs,
                max_episode_steps=self._max_steps,
                disable_env_checker=True,
                **self._keywords,
            )
            self._objects = objects
        return self._env

    def cleanup(self) -> None:
        """Release the environment."""
        if self._env is not None:
            self._env.close()
            self._env = None

    def get_tasks(self) -> list[Task]:
        """List a task for each object set."""
        return [{"name": objects, "suite": self._env_id, "objects": objects} for objects in self._sets]

    def reset(self, task: Task) -> Any:
        """Begin the trial ``task["episode_idx"]`` of the task."""
        episode = int(task.get("episode_idx", 0))
        observation, _ = self._made(task["objects"]).reset(seed=trial_seeds(self._seed, episode + 1)[episode])
        self._recorder.record_video(self._frame(observation))
        return observation

    def step(self, action: Action) -> StepResult:
        """Act; ``action["actions"]`` is one action, not a chunk."""
        assert self._env is not None
        values = np.asarray(action.get("actions", action.get("action")), dtype=np.float32)
        observation, reward, terminated, truncated, info = self._env.step(values)
        done = bool(terminated or truncated)
        self._recorder.record_video(self._frame(observation))
        self._recorder.record_step(reward=float(reward), done=done, success=bool(info["is_success"]))
        return StepResult(obs=observation, reward=float(reward), done=done, info=info)

    def make_obs(self, raw_obs: Any, task: Task) -> Observation:
        """Name the observations as vla-eval does."""
        del task
        images = {name: array for name, array in raw_obs.items() if name.split("_")[0] == "rgb"}
        names = {"proprio": "state", "state": "environment_state"}
        others = {names.get(name, name): array for name, array in raw_obs.items() if name not in images}
        return {"images": images, "task_description": TASK, **others}

    def get_step_result(self, step_result: StepResult) -> EpisodeResult:
        """Return the result of the episode."""
        info = step_result.info
        return {
            "success": bool(info.get("is_success", False)),
            "secure": bool(info.get("is_secure", False)),
            "failure": str(info.get("failure", "")),
            "object": str(info.get("object", "")),
        }

    def get_metric_keys(self) -> dict[str, str]:
        """Average successes and secure successes."""
        return {"success": "mean", "secure": "mean"}

    def get_metadata(self) -> dict[str, Any]:
        """Return the number of steps after which an episode is truncated."""
        return {"max_steps": self._max_steps, "seed": self._seed}

    def get_action_spec(self) -> dict[str, DimSpec]:
        """Describe the action: the format is ``graspbox_`` and the control mode."""
        (size,) = self._made(self._sets[0]).action_space.shape or (0,)
        return {"action": DimSpec("action", size, f"graspbox_{self._control}", (-1.0, 1.0))}

    def get_observation_spec(self) -> dict[str, DimSpec]:
        """Describe the observations."""
        space = self._made(self._sets[0]).observation_space
        assert isinstance(space, gymnasium.spaces.Dict)
        known = {"language": LANGUAGE}
        for name, one in space.items():
            size = int(np.prod(one.shape or (0,)))
            if name.split("_")[0] == "rgb":
                known["image"] = IMAGE_RGB
            elif name == "proprio":
                known["state"] = DimSpec("state", size, "graspbox_proprio")
            else:
                key = "environment_state" if name == "state" else name
                known[key] = DimSpec(key, size, f"graspbox_{name}")
        return known

    def get_hold_action(self, last_action: Action | None) -> Action:
        """Stay: no motion with the last preshape in ``twist`` and ``delta_pose``, the last pose in ``target_pose``.

        Raises
        ------
        NotImplementedError
            Where nothing means to stay: for one decision per episode, and before the first target pose.
        """
        if self._control in ("twist", "delta_pose"):
            idle = self._made(self._sets[0]).unwrapped.idle_action.copy()
            if last_action is not None:
                idle[-1] = np.asarray(last_action["actions"], dtype=np.float32)[-1]
            return {"actions": idle}
        if self._control == "target_pose" and last_action is not None:
            return last_action
        raise NotImplementedError(f"{self._control} has no action that holds; run it in sync mode")

    @property
    def _control(self) -> str:
        decides = self._env_id.startswith("graspbox/GraspPose")
        return str(self._keywords.get("control", "grasp_pose" if decides else "twist"))

    @staticmethod
    def _frame(observation: Mapping[str, Any]) -> np.ndarray | None:
        """Frame of a video: the first colour image, if there is one."""
        return next((array for name, array in observation.items() if name.split("_")[0] == "rgb"), None)
