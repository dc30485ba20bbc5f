"""Export of scenes: an object, a hand about to grasp it and the table as MJCF, USD or URDF.

| module | contents |
|---|---|
| `exports`     | `export_scene`, `export_object`, `export_objects`: folders of files |
| `description` | reads a hand from the text of its URDF and its ``hand.toml`` |
| `contents`    | object, hand and start of a trial in plain values |
| `mjcf`        | the MJCF model, also for `graspbox.validation.mujoco` |
| `usd`, `usd_hand`, `usd_prims` | the USD stage (extra ``usd``) |
| `urdf`        | URDF files of object and table |
| `mesh_files`  | OBJ files, triangles of convex hulls (extra ``scenes``) |
| `records`     | ``scene.json`` and ``object.json``: poses, drives, limits of the format |
| `losses`      | limits of each format |
| `folders`     | folders that appear whole or not at all |

``graspbox export-scene OBJECT --to mjcf --out FOLDER``
"""

from graspbox.scene_export.exports import Export, SetExport, export_object, export_objects, export_scene
from graspbox.scene_export.losses import FORMATS, NOT_EXPRESSED, Format

__all__ = [
    "FORMATS",
    "NOT_EXPRESSED",
    "Export",
    "Format",
    "SetExport",
    "export_object",
    "export_objects",
    "export_scene",
]
