"""Finders of published policies of one depth image."""

from pathlib import Path
from typing import get_args

from graspbox._core import Hand
from graspbox.errors import ConfigError
from graspbox.perception.configs import FinderConfig
from graspbox.perception.finder import GraspFinder
from graspbox.perception.hand_grids import HandGrid
from graspbox.policies.published.configs import DepthPolicyConfig
from graspbox.policies.published.runtimes import Backend, load_parts

__all__ = ["check_backend", "load_finder"]


def load_finder(
    folder: Path,
    published: DepthPolicyConfig,
    hand: Hand,
    *,
    config: FinderConfig | None = None,
    backend: Backend = "onnx",
    num_threads: int | None = None,
) -> GraspFinder:
    """Load the finder of a published policy; `published` is its config, other parameters are those of `DepthGrasp`.

    Raises ConfigError for a hand other than the policy's, or an unknown backend.
    """
    settings, finder = published.settings_for(hand, config)
    check_backend(backend)
    grid = HandGrid(hand, settings, crop=published.crop, num_threads=num_threads)
    parts = load_parts(folder, published, grid, backend, num_threads)
    return GraspFinder(grid, parts.complete, parts.scorer, finder, head=parts.head)


def check_backend(backend: str) -> None:
    """Raise ConfigError for an unknown backend."""
    if backend not in get_args(Backend):
        raise ConfigError(f"there is no backend {backend!r}; choose from {', '.join(get_args(Backend))}")
