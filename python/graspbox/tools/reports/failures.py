"""Pictures of failures for a report: trials run again, rendered and packed as WebP."""

import base64
from collections.abc import Callable, Sequence
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graspbox.errors import GraspboxError
from graspbox.tools.reports.runs import Picture, ReportRun

#: Greatest number of pictures of a report.
MAX_PICTURES = 200
#: Quality of WebP, percent.
_QUALITY = 78


def failure_pictures(
    runs: Sequence[ReportRun], most: int, progress: Callable[[int, int], None] = lambda done, total: None
) -> list[dict[str, Any]]:
    """Render at most `most` failures, each run and kind of failure in turn.

    Rows have ``run`` (its index), ``object``, ``failure`` and ``trial``; and ``now`` (the kind of failure of the
    repetition) with ``images`` (WebP in base64), or ``error``, why the trial cannot be repeated.
    """
    chosen = _chosen(runs, most)
    rows = []
    for done, (number, picture) in enumerate(chosen):
        progress(done, len(chosen))
        row = {"run": number, "object": picture.object, "failure": picture.failure, "trial": picture.trial}
        try:
            images, now = picture.render()
            rows.append({**row, "now": now, "images": [_webp(image) for image in images]})
        except GraspboxError as error:
            rows.append({**row, "error": str(error)})
    return rows


def _chosen(runs: Sequence[ReportRun], most: int) -> list[tuple[int, Picture]]:
    """Choose pictures in turn from each run and kind of failure."""
    queues: dict[tuple[int, str], list[Picture]] = {}
    for number, run in enumerate(runs):
        for picture in run.pictures:
            queues.setdefault((number, picture.failure), []).append(picture)
    chosen: list[tuple[int, Picture]] = []
    while len(chosen) < most and any(queues.values()):
        for (number, _), queue in queues.items():
            if queue and len(chosen) < most:
                chosen.append((number, queue.pop(0)))
    return sorted(chosen, key=lambda one: (one[0], one[1].failure))


def _webp(image: NDArray[np.uint8]) -> str:
    from PIL import Image

    packed = BytesIO()
    Image.fromarray(np.ascontiguousarray(image)).save(packed, format="webp", quality=_QUALITY, method=4)
    return base64.b64encode(packed.getvalue()).decode()
