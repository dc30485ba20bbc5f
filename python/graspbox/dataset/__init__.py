"""Data sets of simulated grasp trials: generation, resuming, reading, and rendering (extra ``data``).

    graspbox dataset --objects procedural:0-99 --poses 128 --views 4 --out out/data
    graspbox dataset --objects procedural:0-99 --layout pile --out out/piles

A data set is a folder: ``trials`` holds Parquet files (zstd) by split, one row per trial with the columns of
`graspbox.dataset.schema.TRIALS`; ``images`` holds the images of its scenes, if they are stored; ``manifest.json``
records its settings. The same settings give the same rows with every runner.

| module | contents |
|---|---|
| `settings` | `DatasetConfig` |
| `schema` | the columns |
| `candidates`, `resting`, `scenes` | candidate poses from five sources; objects at rest; one scene with its trials |
| `shards`, `runners`, `generate` | the unit of work, its execution, and the whole generation |
| `manifest` | the record of a folder's contents |
| `learned` | the object sets that a policy learned from, as its folder records them |
| `tables`, `images`, `mappings` | rows as tables and arrays, images and voxels of rows, pairs for training |
| `replay` | the scene of a row, to try grasps in it again |
"""

from graspbox.dataset.generate import Progress, Result, generate
from graspbox.dataset.images import Rendered, render, voxels
from graspbox.dataset.mappings import Example, many_to_one, one_to_many, one_to_one
from graspbox.dataset.replay import scene_of
from graspbox.dataset.runners import Runner, local, on_ray
from graspbox.dataset.schema import IMAGES, TRIALS, Column
from graspbox.dataset.settings import CandidateShares, DatasetConfig
from graspbox.dataset.tables import column, load, load_images, matrices, stored_images

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
