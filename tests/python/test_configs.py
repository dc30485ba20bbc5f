"""Configs: Python and Rust agree on every field and default.

``python tests/python/test_configs.py`` writes the fixture that both are compared with.
"""

import json
from dataclasses import FrozenInstanceError, replace
from pathlib import Path
from typing import Any

import pytest

from graspbox import _core, configs, errors, perception
from graspbox._common.arguments import config_dict
from validation.forces.config import ForceConfig

CONFIGS: list[Any] = [
    kind
    for module in (configs, perception.configs)
    for name in module.__all__
    if isinstance(kind := getattr(module, name), type) and name not in ("FinderConfig", "RehearsalConfig", "SeenConfig")
]


#: With the config of the comparison of engines under forces.
ALL = [*CONFIGS, ForceConfig]
FILE = Path(__file__).parents[1] / "fixtures" / "configs.json"
GOAL = config_dict(configs.GoalConfig("place", 0.1, True))
SHAKE = config_dict(configs.ShakeConfig(acceleration=1.0))


def changed(value: Any) -> Any:
    """Return another value of the same type."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value * 2 + 1
    if isinstance(value, list):
        return [changed(inner) for inner in value] or ["rgb"]
    if isinstance(value, dict):
        # None by default; a shake and a goal are configs.
        other_than_none = {"shake": SHAKE, "shape": [8, 16, 24], "layout": "packed", "goal": GOAL}
        return {key: other_than_none.get(key) or changed(inner) for key, inner in value.items()}
    other = {"minimum": "pca", "share": "area", "random": "grid"}
    other |= {"twist": "delta_pose", "synergy": "each", "next_step": "same_step"}
    other |= {"proprio": "tactile", "tactile": "state", "state": "proprio"}
    other |= {"implicit": "rapier"}
    other |= {"world": "hand", "front": "side", "palm": "wrist", "viewer": "me", "hand": "world"}
    return other[value] if isinstance(value, str) else 1


def crossing(config: Any) -> dict[str, Any]:
    """Return the default of a config, and another value of every field, as they cross."""
    default = config_dict(config())
    return {"default": default, "other": changed(default)}


@pytest.mark.parametrize("config", ALL, ids=lambda c: c.__name__)
def test_fields_and_defaults_are_those_of_the_core(config: Any) -> None:
    """The core compares the fixture with its own defaults and fields (``tests/rust/configs.rs``)."""
    crossed = crossing(config)
    assert crossed == json.loads(FILE.read_text())[config.__name__]
    assert all(crossed["other"][name] != value for name, value in crossed["default"].items())


def test_the_preset_is_that_of_the_core() -> None:
    tables = _core.env_tables(_core.Hand.named("reflex"))
    assert config_dict(configs.Randomization.standard()) == tables["randomization"]["standard"]


def test_configs_are_frozen_and_finite() -> None:
    config = configs.TrialConfig()
    with pytest.raises(FrozenInstanceError):
        config.lift_height = 1.0  # type: ignore[misc]
    with pytest.raises(errors.ConfigError, match="finite"):
        config_dict(replace(config, lift_height=float("nan")))


if __name__ == "__main__":
    contents = {config.__name__: crossing(config) for config in sorted(ALL, key=lambda config: config.__name__)}
    FILE.write_text(json.dumps(contents, indent=1) + "\n")
