"""``graspbox benchmark captures``: grasps in real depth images, judged by what the camera saw."""

from pathlib import Path
from typing import Annotated, Any

import typer

from graspbox._common.files import dumps, write_text
from graspbox._common.progress import ProgressBar
from graspbox.cli.common import Json, Seed, check_files, console, print_json, print_table


def captures(
    folder: Annotated[Path, typer.Argument(help="Folder of captures: NAME/depth.npy, capture.json, labels.png.")],
    policy: Annotated[str, typer.Option(help="An installed policy such as depth, or the folder of one.")],
    masks: Annotated[
        bool, typer.Option("--masks", help="Give the mask of each thing; otherwise the policy chooses.")
    ] = (False),
    seed: Seed = 0,
    out: Annotated[Path | None, typer.Option(help="File for the result of every image, JSON.")] = None,
    as_json: Json = False,
) -> None:
    """Judge grasps in real depth images by what the camera saw; no robot executes them.

    Counts, for each kind of camera: images, or things with --masks; answered; best grasps that close within 2 cm and
    4 cm of seen points of the thing; open hands with seen points more than 3 mm inside; answers with warnings; wrong
    grasps that state a success of more than 0.7; and the mean stated success of the others. The files are documented
    in graspbox.evaluation.captures.
    """
    from graspbox.evaluation.captures import captures_in, judge_captures, summary
    from graspbox.policies.grasp_image import ImageGrasper

    check_files(out)
    folders, grasper = captures_in(folder), ImageGrasper(policy)
    with ProgressBar(f"{policy}", len(folders), not as_json) as bar:
        rows = list(judge_captures(grasper, folders, masks=masks, seed=seed, progress=bar.update))
    cameras = sorted({row.camera for row in rows})
    result: dict[str, Any] = {
        "policy": policy,
        "masks": masks,
        "cameras": {camera: summary([row for row in rows if row.camera == camera]) for camera in cameras},
        "all": summary(rows),
    }
    if out is not None:
        write_text(out, dumps({**result, "rows": [row.to_json() for row in rows]}))
    if as_json:
        print_json(result)
        return
    counts = {**result["cameras"], "all": result["all"]}
    columns = tuple(result["all"])
    shown = [
        (camera, *("" if v is None else f"{v:.2f}" if isinstance(v, float) else str(v) for v in row.values()))
        for camera, row in counts.items()
    ]
    print_table(f"captures, {policy}", ("camera", *(name.replace("_", " ") for name in columns)), shown)
    for row in rows:
        if row.refused is not None:
            console.print(f"{row.capture}{'' if row.thing is None else f', thing {row.thing}'}: {row.refused}")
