"""The viewer in a headless Chromium: the scene appears, and ten thousand poses keep the connection.

Skipped without Chromium: see ``browsing.py``.
"""

import io
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from browsing import Browser, browsing, needs_browser
from graspbox.tools.viewer import show
from graspbox.tools.viewer.grasp_points import GraspPoints

pytestmark = needs_browser
#: WebGL without a graphics card, and a small window, which it draws faster.
SOFTWARE = ("use-angle=swiftshader", "enable-unsafe-swiftshader", "window-size=800,500")
#: Resolves once the page has drawn a frame.
FRAME = "await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))); return true;"


def wait_for(true: Callable[[], bool]) -> None:
    end = time.monotonic() + 60.0
    while not true():
        assert time.monotonic() < end
        time.sleep(0.1)


def scene_of(browser: Browser) -> NDArray[Any]:
    """Take a picture of the middle of the scene, left of the panel, (h, w, 3)."""
    from PIL import Image

    picture = np.asarray(Image.open(io.BytesIO(browser.picture())).convert("RGB"))
    height, width = picture.shape[:2]
    return picture[height // 4 : -height // 8, width // 8 : width // 2]


def test_a_page_shows_its_scene_and_keeps_its_connection(tmp_path: Path) -> None:
    with browsing(tmp_path, *SOFTWARE) as browser, show("procedural:can:0", port=0, poses=0) as viewer:
        page: Any = viewer.page
        browser.open(viewer.url)
        wait_for(lambda: viewer.clients == 1)
        wait_for(lambda: bool(browser.run("return document.querySelector('canvas') !== null;")))
        wait_for(lambda: "can-000000" in browser.run("return document.body.innerText;"))
        wait_for(lambda: len(np.unique(scene_of(browser).reshape(-1, 3), axis=0)) > 50)
        rows = np.arange(10_000) % len(page.plan)
        poses = page.rest @ page.plan.poses[rows]
        many = GraspPoints(viewer.canvas, "/many", poses, page.select)
        many.show(np.ones(10_000, dtype=np.bool_), np.zeros((10_000, 3), dtype=np.uint8))
        assert browser.run(FRAME)
        many.show(rows % 2 == 0, np.zeros((10_000, 3), dtype=np.uint8))
        assert browser.run(FRAME)
        assert viewer.clients == 1
        many.remove()
