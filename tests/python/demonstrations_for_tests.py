"""Helpers of the demonstration tests."""

from pathlib import Path
from typing import Any

from graspbox.data.episodes import Demonstrations, record

OBJECTS = "procedural:can:0-9"
FAST: dict[str, Any] = {
    "objects": OBJECTS,
    "fingers": "each",
    "control_freq": 5,
    "max_episode_steps": 50,
    "image_size": 16,
}
OBS = ("proprio", "depth", "rgb")


def recorded(out: Path) -> Demonstrations:
    """Record three episodes with images, in files of two."""
    return record("expert", out, episodes=3, obs=OBS, num_envs=3, file_episodes=2, **FAST)
