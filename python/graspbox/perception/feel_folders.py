"""What a policy's folder holds to feel before it lifts: ``feel.json``, ``feel.onnx`` and ``feel.safetensors``.

They lie beside the files of `graspbox.perception.policy_folders`; the folder stays a policy without them.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from graspbox.arguments import config_of, to_json
from graspbox.errors import ConfigError
from graspbox.files import dumps, read_bounded, write_text
from graspbox.perception.policy_folders import check_files, check_hashes

__all__ = ["FEEL", "FeelConfig", "read_feel", "write_feel"]

#: File of a folder that says how it feels.
FEEL = "feel.json"
_LARGEST = 1 << 20


@dataclass(frozen=True)
class FeelConfig:
    """How a policy feels, and what it makes of it.

    Attributes
    ----------
    times : tuple of float
        When the hand feels, seconds after it began to close; at the last of them it decides.
    threshold : float
        Below this probability that the grasp holds, the hand opens and the policy chooses again.
    calibration : pair of float
        Slope and offset of the logit; part of ``feel.onnx``.
    width, members : int
        Of the networks: `graspbox.perception.stability_net.StabilityNet`.
    files : mapping of str to str
        SHA-256 of every file of the networks.
    """

    times: tuple[float, ...]
    threshold: float
    calibration: tuple[float, float]
    width: int
    members: int
    files: Mapping[str, str]

    def __post_init__(self) -> None:
        if not 0.0 <= self.threshold <= 1.0:
            raise ConfigError(f"threshold is {self.threshold}; give a probability, 0 to 1")
        check_hashes(self.files)


def write_feel(folder: Path, config: FeelConfig) -> None:
    """Write ``feel.json``."""
    write_text(Path(folder) / FEEL, dumps(json.loads(to_json(config, FeelConfig))) + "\n")


def read_feel(folder: Path) -> FeelConfig:
    """Read ``feel.json``, and check the files that it names.

    Raises
    ------
    FileError
        If a file is missing.
    ConfigError
        If an entry is missing, unknown or wrong, or a file is not the one that was exported.
    """
    path = Path(folder) / FEEL
    try:
        content = json.loads(read_bounded(path, _LARGEST))
        if not isinstance(content, dict):
            raise ConfigError(
                f"{path} holds a {type(content).__name__}; expected an object with the fields of FeelConfig"
            )
        config = config_of(FeelConfig, content, str(path))
    except TypeError as error:
        # Of the class's own __init__: "missing ... required positional arguments: 'times'".
        raise ConfigError(f"{path} is incomplete: {str(error).partition('__init__() ')[2]}") from None
    except ConfigError as error:
        text = str(error)
        raise ConfigError(text if text.startswith(str(path)) else f"{path}: {text}") from None
    except ValueError as error:
        raise ConfigError(f"{path} is no JSON: {error}") from None
    check_files(path, config.files)
    return config
