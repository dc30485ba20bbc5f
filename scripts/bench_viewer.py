"""Measures the viewer in a headless Chromium: first picture, frames a second while a trace plays, ten thousand poses.

Needs Chromium, its driver and ``pip install selenium``. Software draws the scene (SwiftShader): a graphics card shows
more frames. The time to the first picture begins with the command and ends with the first frame of the planned object
in a browser that is already open. Run it on an idle machine; the load is printed with the results.

    python scripts/bench_viewer.py --object procedural:mug:0 --json
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from typing import Annotated, Any

import numpy as np
import typer

from graspbox.programs import run_program
from graspbox.viewer import Viewer, show
from graspbox.viewer.drawn_hand import PoseSet

FLAGS = ("headless=new", "no-sandbox", "disable-quic", "no-first-run", "disable-background-networking",
         "disable-component-update", "disable-sync", "use-angle=swiftshader", "enable-unsafe-swiftshader")  # fmt: skip
FRAMES = """const done = arguments[0], began = performance.now(); let frames = 0;
function next() { frames += 1; const passed = performance.now() - began;
  passed > 3000 ? done(1000 * frames / passed) : requestAnimationFrame(next); } requestAnimationFrame(next);"""
DRAWN = "const done = arguments[0]; requestAnimationFrame(() => requestAnimationFrame(() => done(true)));"
POSES = 10_000


def browser(width: int, height: int) -> Any:
    """Start Chromium with a fresh profile."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    for flag in (*FLAGS, f"window-size={width},{height}", f"user-data-dir={tempfile.mkdtemp()}"):
        options.add_argument(f"--{flag}")
    driver = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    driver.set_script_timeout(120)
    return driver


def wait_for_text(driver: Any, text: str) -> None:
    """Wait until the page holds a text, and has drawn a frame after it."""
    while text not in str(driver.execute_script("return document.body ? document.body.innerText : '';")):
        time.sleep(0.02)
    driver.execute_async_script(DRAWN)


def first_picture(driver: Any, name: str) -> float:
    """Return the seconds from the command to the first picture of the planned object."""
    began = time.monotonic()
    command = [sys.executable, "-m", "graspbox", "view", name, "--no-browser", "--port", "0", "--poses", "20"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        driver.get(process.stdout.readline().split(" at ")[1].split()[0])
        wait_for_text(driver, "feasible")
        seconds = time.monotonic() - began
        process.terminate()
    return seconds


def frames_of_trace(driver: Any, viewer: Viewer) -> float:
    """Return the frames a second while the trace of the first pose plays."""
    page: Any = viewer.page
    page.select(0)
    driver.execute_async_script(DRAWN)
    page.player.toggle()
    frames = float(driver.execute_async_script(FRAMES))
    page.player.stop()
    return frames


def many_poses(driver: Any, viewer: Viewer) -> dict[str, Any]:
    """Show ten thousand poses and filter them; return the times, and whether the connection was kept."""
    page: Any = viewer.page
    before, rows = set(viewer.canvas.server.get_clients()), np.arange(POSES) % len(page.plan)
    poses = page.rest @ page.plan.poses[rows]
    many = PoseSet(viewer.canvas, "/many", page.hand.hand, poses, page.plan.preshape[rows])
    times = []
    for mask in (np.ones(POSES, dtype=np.bool_), rows % 2 == 0, rows % 3 == 0):
        began = time.monotonic()
        many.show(mask, np.zeros((POSES, 3), dtype=np.uint8))
        driver.execute_async_script(DRAWN)
        times.append(time.monotonic() - began)
    frames = float(driver.execute_async_script(FRAMES))
    kept = set(viewer.canvas.server.get_clients()) == before
    return {"show_s": times[0], "filter_s": max(times[1:]), "frames_per_s": frames, "connection_kept": kept}


def main(
    name: Annotated[str, typer.Option("--object", help="The object.")] = "procedural:mug:0",
    width: Annotated[int, typer.Option(help="Width of the window, pixels.")] = 1000,
    height: Annotated[int, typer.Option(help="Height of the window, pixels.")] = 700,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Measure the viewer in a headless Chromium."""
    driver = browser(width, height)
    try:
        found: dict[str, Any] = {"first_picture_s": min(first_picture(driver, name) for _ in range(3))}
        with show(name, port=0, poses=0) as viewer:
            driver.get(viewer.url)
            wait_for_text(driver, "feasible")
            found["trace_frames_per_s"] = max(frames_of_trace(driver, viewer) for _ in range(3))
            found[f"{POSES}_poses"] = many_poses(driver, viewer)
    finally:
        driver.quit()
    found |= {"window": [width, height], "cores": os.cpu_count(), "load": os.getloadavg()[0]}
    print(json.dumps(found) if as_json else "\n".join(f"{key}: {value}" for key, value in found.items()))


if __name__ == "__main__":
    run_program(lambda: typer.run(main))
