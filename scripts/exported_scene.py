"""The picture of a grasp held by graspbox, and by MuJoCo, which steps the exported scene; for ``figures.py``.

Needs OpenGL, and mujoco from the extra ``dev``.
"""

import tempfile
from pathlib import Path

import mujoco
import numpy as np
from matplotlib.figure import Figure

from graspbox import Plan, Scene, pictures
from graspbox.tools.scene_export import export_scene
from validation.mujoco.exported import ExportedReplay, load_export


def save_exported_scene(path: Path, scene: Scene, best: Plan) -> None:
    """Show the first of the poses that holds, in graspbox and in MuJoCo."""
    trial = pictures.Trial.run(scene, best, int(scene.simulate(best).success.argmax()))
    with tempfile.TemporaryDirectory() as folder:
        export_scene(scene, Path(folder) / "scene", "mjcf", best[trial.index])
        run = ExportedReplay(load_export(Path(folder) / "scene"))
    while run.steps * run.dt < run.times.end:
        run.step()
    figure = Figure(figsize=(9.6, 4.6), dpi=110, layout="constrained")
    panels = figure.subplots(1, 2)
    hand, item = trial.posed(scene.hand, -1), trial.trace.world_from_object[-1]
    shown = np.concatenate([hand.corners(), scene.mesh.vertices @ item[:3, :3].T + item[:3, 3], [[0.0, 0.0, 0.0]]])
    across, size = pictures.Camera.across(hand.world_from_hand[:3, 0], elevation=15.0), (720, 620)
    view = pictures.View(
        [pictures.Solid(scene.mesh, "#d98c40", item)], across, shown=shown, size=size, hand=hand, table=shown
    )
    view.show(panels[0])
    panels[0].set_title("graspbox", fontsize=10)
    lens, camera = view.lens, mujoco.MjvCamera()
    way = np.linalg.solve(lens.intrinsics, [size[0] / 2, size[1] / 2, 1.0])
    distance = float(np.linalg.norm(lens.world_from_camera[:3, 3] - shown.mean(axis=0)))
    camera.lookat[:] = lens.world_from_camera[:3, 3] + lens.world_from_camera[:3, :3] @ way * distance
    camera.distance, camera.azimuth, camera.elevation = distance, across.azimuth + 180.0, -across.elevation
    run.model.vis.global_.fovy = np.degrees(2.0 * np.arctan(size[1] / 2 / lens.intrinsics[1, 1]))
    run.model.vis.global_.offwidth, run.model.vis.global_.offheight = size
    run.model.vis.quality.offsamples = 8
    with mujoco.Renderer(run.model, size[1], size[0]) as renderer:
        renderer.update_scene(run.data, camera)
        panels[1].imshow(renderer.render())
    panels[1].set_title("MuJoCo, in the exported scene", fontsize=10)
    panels[1].set_axis_off()
    figure.savefig(path)
