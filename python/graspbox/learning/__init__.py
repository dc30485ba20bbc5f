"""Learning to grasp from pictures and voxels: the reference study's networks, made again (extra ``[train]``).

| module | what it holds | needs torch |
|---|---|---|
| `grasps`     | successful grasps of objects: planner poses that hold in simulation | no |
| `samples`    | images and voxels paired with grasps, in the study's three mappings; its random split | no |
| `losses`     | the six losses by name | yes |
| `networks`   | ``Cnn2d``, ``Cnn2dDropout``, ``Cnn3d`` | yes |
| `model_configs` | what a network is made of | no |
| `model`      | a network with its scaling: saved, loaded, from inputs to poses | yes |
| `training`   | optimisers by name, early stopping, logs, checkpoints | yes |
| `execution`  | predicted poses tried in simulation; baselines that learn nothing | no |
| `regressor`  | a trained model as a policy of ``GraspPose-v0`` | when it loads one that was not published |
| `pose_folders` | folders of published models, and what runs them | no |
| `export`     | writes such folders | yes |
| `study_settings` | settings of the reproduction; what the study found | no |
| `study_results`, `study_figures` | tables 3.2 and 3.3 and figures 3.19 to 3.27 of the study beside ours | no |

``scripts/reproduce_study.py`` runs all of it. No module imports torch before it is used; `require` tells whether it is
there.
"""

from importlib.util import find_spec

from graspbox.errors import MissingExtraError

__all__ = ["require"]


def require() -> None:
    """Check that torch and tensorboard are installed.

    Raises
    ------
    MissingExtraError
        If one of them is not.
    """
    missing = [name for name in ("torch", "tensorboard") if find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"training networks needs {' and '.join(missing)}: pip install 'graspbox[train]'")
