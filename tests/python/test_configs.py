"""Configs: Python and Rust agree on every field and default, and unknown fields are refused."""

import json
from dataclasses import FrozenInstanceError, replace
from typing import Any

import pytest

from graspbox import _core, configs, errors, perception
from graspbox._common.arguments import to_json

CONFIGS: list[Any] = [
    kind
    for module in (configs, perception.configs)
    for name in module.__all__
    if isinstance(kind := getattr(module, name), type) and name not in ("FinderConfig", "RehearsalConfig")
]


SHAKE = json.loads(to_json(configs.ShakeConfig(acceleration=1.0)))


def changed(value: Any) -> Any:
    """Give another value of the same type."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value * 2 + 1
    if isinstance(value, list):
        return [changed(inner) for inner in value] or ["rgb"]
    if isinstance(value, dict):
        # None by default; a shake is a config.
        other_than_none = {"shake": SHAKE, "shape": [8, 16, 24], "layout": "packed"}
        return {key: other_than_none.get(key) or changed(inner) for key, inner in value.items()}
    other = {"minimum": "pca", "share": "area", "random": "grid"}
    other |= {"twist": "delta_pose", "next_step": "same_step"}
    other |= {"proprio": "tactile", "tactile": "state", "state": "proprio"}
    other |= {"newton": "rapier"}
    other |= {"world": "hand", "front": "side", "palm": "wrist", "viewer": "me", "hand": "world"}
    return other[value] if isinstance(value, str) else 1


@pytest.mark.parametrize("config", CONFIGS, ids=lambda c: c.__name__)
def test_defaults_are_those_of_the_core(config: Any) -> None:
    core = json.loads(_core._config(config.__name__, "{}"))
    assert core == json.loads(to_json(config()))


@pytest.mark.parametrize("config", CONFIGS, ids=lambda c: c.__name__)
def test_every_field_crosses(config: Any) -> None:
    sent = changed(json.loads(to_json(config())))
    assert json.loads(_core._config(config.__name__, json.dumps(sent))) == sent
    assert all(sent[name] != value for name, value in json.loads(to_json(config())).items())


@pytest.mark.parametrize("config", CONFIGS, ids=lambda c: c.__name__)
def test_unknown_fields_are_refused(config: Any) -> None:
    with pytest.raises(errors.ConfigError, match="colour"):
        _core._config(config.__name__, json.dumps({"colour": 1}))


def test_the_preset_is_that_of_the_core() -> None:
    tables = json.loads(_core.agent_tables(_core.Hand.named("reflex")))
    assert json.loads(to_json(configs.Randomization.standard())) == tables["randomization"]["standard"]


def test_configs_are_frozen_and_finite() -> None:
    config = configs.TrialConfig()
    with pytest.raises(FrozenInstanceError):
        config.lift_height = 1.0  # type: ignore[misc]
    with pytest.raises(errors.ConfigError, match="finite"):
        to_json(replace(config, lift_height=float("nan")))
