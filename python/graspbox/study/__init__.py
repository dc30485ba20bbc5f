"""Learning to grasp from images and voxels: the reference study's networks, reimplemented (extra ``[train]``).

| module | contents | needs torch |
|---|---|---|
| `grasps`     | successful grasps of objects: planner poses that hold in simulation | no |
| `samples`    | images and voxels paired with grasps, in the study's three mappings; its random split | no |
| `losses`     | the six losses by name | yes |
| `networks`   | ``Cnn2d``, ``Cnn2dDropout``, ``Cnn3d`` | yes |
| `model_configs` | configuration of a network | no |
| `model`      | a network with its scaling: saving, loading, prediction of poses | yes |
| `training`   | the training of a network | yes |
| `execution`  | predicted poses tried in simulation; baselines without training | no |
| `regressor`  | a trained model as a policy of ``GraspPose-v0`` | for an unpublished model |
| `pose_folders` | folders of published models, and their runtime | no |
| `export`     | writes such folders | yes |
| `settings` | settings of the reproduction; results of the study | no |
| `results`, `figures` | tables 3.2 and 3.3 and figures 3.19 to 3.27 of the study next to ours | no |

``graspbox train study`` runs all of it. No module imports torch before it is used; `require` checks that it is
installed.
"""

from importlib.util import find_spec

from graspbox.errors import MissingExtraError

__all__ = ["require"]


def require() -> None:
    """Check that torch and tensorboard are installed.

    Raises
    ------
    MissingExtraError
        If one of them is missing.
    """
    missing = [name for name in ("torch", "tensorboard") if find_spec(name) is None]
    if missing:
        raise MissingExtraError(f"training networks needs {' and '.join(missing)}: pip install 'graspbox[train]'")
