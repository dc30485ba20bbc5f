"""Export of scenes: an object, a hand about to grasp it and the table as MJCF, USD or URDF.

``graspbox export-scene OBJECT --to mjcf --out FOLDER``
"""

from graspbox.tools.scene_export.exports import Export, SetExport, export_object, export_objects, export_scene
from graspbox.tools.scene_export.losses import FORMATS, NOT_EXPRESSED, Format

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
