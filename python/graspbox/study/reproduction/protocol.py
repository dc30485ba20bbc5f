"""Settings of the reproduction: the study's own, and sane ones under which its networks learn; the study's results."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

__all__ = ["SETTINGS", "TABLES", "SettingsName", "TableRow", "training_settings"]

SettingsName = Literal["legacy", "sane"]
SETTINGS: tuple[SettingsName, ...] = get_args(SettingsName)

#: Samples of the study: images of the 2D networks, grids of the 3D network.
SAMPLES = {"cnn2d": 1230, "cnn2d_dropout": 1230, "cnn3d": 189}
#: Samples per iteration in the study.
BATCH_SIZES = {"cnn2d": 10, "cnn2d_dropout": 10, "cnn3d": 6}
#: The study's weights of the errors, contained in its tables (`graspbox.study.losses.LossWeights`).
STUDY_WEIGHTS = {"rotation": 0.031, "position": 0.005}


@dataclass(frozen=True)
class TableRow:
    """A row of the study's table 3.2 or 3.3: a loss, and the predicted poses that succeeded, of about 61.

    Errors are the weighted sum of the loss over a batch of 10, judging by its size.
    """

    loss: str
    success: int
    train: float
    test: float
    validation: float


#: The study's tables by network: 3.2 without dropout, 3.3 with it. It has none for the 3D network.
TABLES: Mapping[str, tuple[str, tuple[TableRow, ...]]] = {
    "cnn2d": (
        "3.2",
        (
            TableRow("psi4", 6, 0.12, 0.11, 0.16),
            TableRow("psi3", 5, 0.25, 0.32, 0.25),
            TableRow("psi2", 4, 0.25, 0.25, 0.25),
            TableRow("euler", 1, 0.50, 0.67, 0.49),
        ),
    ),
    "cnn2d_dropout": (
        "3.3",
        (
            TableRow("psi4", 0, 0.20, 0.19, 0.18),
            TableRow("psi3", 0, 0.30, 0.37, 0.30),
            TableRow("psi2", 0, 0.30, 0.35, 0.30),
            TableRow("euler", 0, 0.50, 0.67, 0.52),
        ),
    ),
}


_TRAINING: Mapping[str, Mapping[str, Any]] = {
    "legacy": {
        "optimizer": "momentum",
        "learning_rate": 1e-9,
        "momentum": 0.5,
        "weights": STUDY_WEIGHTS,
        "reduction": "sum",
        "fit_scaling": False,
        "patience": 10,
        "zero_output": True,
    },
    "sane": {
        "optimizer": "fused_adam",
        "learning_rate": 1e-4,
        "weights": {"rotation": 1.0, "position": 10.0},
        "reduction": "mean",
        "fit_scaling": True,
        "patience": 20,
        "zero_output": False,
    },
}


def training_settings(name: SettingsName, network: str) -> dict[str, Any]:
    """Return a network's settings: fields of `TrainConfig`, of `graspbox.study.training.Objective`, ``zero_output``.

    ``legacy`` is the study: momentum 0.5 at a learning rate of 1e-9, the weighted errors summed over the batch, no
    scaling, a last layer initialized with zeros. ``sane`` changes these four and nothing else about the network: Adam,
    a mean in which 10 cm weigh as much as an error of 1, scaled inputs and positions, random weights everywhere.
    """
    settings = {**_TRAINING[name], "batch_size": BATCH_SIZES[network]}
    return settings | ({"learning_rate": 1e-3} if (name, network) == ("sane", "cnn3d") else {})
