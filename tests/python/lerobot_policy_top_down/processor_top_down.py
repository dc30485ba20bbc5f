"""Nothing is normalized."""

from typing import Any

from lerobot.processor import PolicyProcessorPipeline
from lerobot.processor.converters import policy_action_to_transition, transition_to_policy_action

from lerobot_policy_top_down.configuration_top_down import TopDownConfig

__all__ = ["make_top_down_pre_post_processors"]


def make_top_down_pre_post_processors(config: TopDownConfig, dataset_stats: Any = None) -> tuple[Any, Any]:
    """Make pipelines that change nothing."""
    del config, dataset_stats
    after = PolicyProcessorPipeline(
        steps=[], to_transition=policy_action_to_transition, to_output=transition_to_policy_action
    )
    return PolicyProcessorPipeline(steps=[]), after
