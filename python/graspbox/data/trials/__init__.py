"""Data sets of simulated grasp trials: generation, resuming, reading, and rendering (extra ``data``).

    graspbox dataset --objects procedural:0-99 --poses 128 --views 4 --out out/data
    graspbox dataset --objects procedural:0-99 --layout pile --out out/piles

A data set is a folder: ``trials`` holds Parquet files (zstd) by split, one row per trial with the columns of
`graspbox.data.trials.schema.TRIALS`; ``images`` holds the images of its scenes, if they are stored; ``manifest.json``
records its settings. The rows depend only on the settings, with every runner.
"""

from graspbox.data.trials.generate import Progress, Result, generate
from graspbox.data.trials.images import Rendered, render, voxels
from graspbox.data.trials.mappings import Example, many_to_one, one_to_many, one_to_one
from graspbox.data.trials.replay import scene_of
from graspbox.data.trials.runners import Runner, local, on_ray
from graspbox.data.trials.schema import IMAGES, TRIALS, Column
from graspbox.data.trials.settings import CandidateShares, DatasetConfig
from graspbox.data.trials.tables import column, load, load_images, matrices, stored_images

__all__ = [
    "IMAGES",
    "TRIALS",
    "CandidateShares",
    "Column",
    "DatasetConfig",
    "Example",
    "Progress",
    "Rendered",
    "Result",
    "Runner",
    "column",
    "generate",
    "load",
    "load_images",
    "local",
    "many_to_one",
    "matrices",
    "on_ray",
    "one_to_many",
    "one_to_one",
    "render",
    "scene_of",
    "stored_images",
    "voxels",
]
