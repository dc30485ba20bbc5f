"""The client: OpenEnv's own, with the models of graspbox."""

from typing import Any

from openenv.core import EnvClient
from openenv.core.client_types import StepResult

try:
    from .models import GraspAction, GraspObservation, GraspState
except ImportError:  # the folder itself is on the path
    from models import GraspAction, GraspObservation, GraspState

__all__ = ["GraspboxEnv"]


class GraspboxEnv(EnvClient[GraspAction, GraspObservation, GraspState]):
    """A session on a server of this folder.

    >>> with GraspboxEnv(base_url="http://localhost:8000").sync() as env:  # doctest: +SKIP
    ...     result = env.reset(seed=0)
    ...     proprio = decoded(result.observation.arrays["proprio"])
    ...     result = env.step(GraspAction(values=[0.0] * env.state().action_size))
    ...     print(result.reward, result.done, result.observation.metadata["failure"])
    """

    def _step_payload(self, action: GraspAction) -> dict[str, Any]:
        return action.model_dump()

    def _parse_result(self, payload: dict[str, Any]) -> StepResult[GraspObservation]:
        reward, done = payload.get("reward"), payload.get("done", False)
        observation = GraspObservation(**{**payload.get("observation", {}), "reward": reward, "done": done})
        return StepResult(observation=observation, reward=reward, done=done)

    def _parse_state(self, payload: dict[str, Any]) -> GraspState:
        return GraspState(**payload)
