"""Export and import of grasps in the formats of other programs (extra ``exchange``).

>>> import graspbox
>>> from graspbox.tools import exchange
>>> mesh = graspbox.object_sets.load("procedural:box:0")[0].load()
>>> plan = graspbox.plan(mesh, hand="panda_gripper").best(3)
>>> grasps = exchange.simulated(exchange.from_plan(plan), mesh)
>>> len(grasps), grasps.closed.shape
(3, (3,))

``exchange.save(grasps, "box.h5", "acronym")`` writes a file; ``exchange.load("box.h5")`` reads it. On the command line:
``graspbox export-grasps FILE --to acronym --out box.h5``.

| format | file | poses | outcomes | joints |
|---|---|---|---|---|
| ``acronym`` | ``.h5``, ``.json`` | frame ``gripper``, object's frame | yes | no |
| ``graspgen`` | ``.json`` | frame ``gripper``, object's frame | yes | no |
| ``isaac`` | ``.yaml`` | base link, object's frame | as confidence | independent ones |
| ``dexgraspbench`` | ``.npy``, one grasp each | base link, world | no | all, in three stages |
"""

from graspbox.hands.conventions import CONVENTIONS, Convention, frame_from_hand
from graspbox.tools.exchange.formats import FORMATS, Format, load, save, save_each, with_mesh
from graspbox.tools.exchange.grasps import ExchangeGrasps
from graspbox.tools.exchange.sources import from_dataset, from_image, from_plan, from_scene, from_table, read
from graspbox.tools.exchange.trials import simulated

__all__ = [
    "CONVENTIONS",
    "FORMATS",
    "Convention",
    "ExchangeGrasps",
    "Format",
    "frame_from_hand",
    "from_dataset",
    "from_image",
    "from_plan",
    "from_scene",
    "from_table",
    "load",
    "read",
    "save",
    "save_each",
    "simulated",
    "with_mesh",
]
