"""The page in ``scripts/examples/browser``, in a headless Chromium: the same bits as an environment of this process.

Skipped without Chromium: see ``browsing.py``.
"""

import functools
import os
import threading
import time
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from browsing import Browser, browsing, needs_browser
from graspbox.configs import PictureConfig
from graspbox.tools.remote import EnvironmentServer, ServerSettings

PAGE = Path(__file__).parents[2] / "scripts/examples/browser"
TOKEN = "a-token-of-some-length"
OBJECTS = "procedural:can:0-3"
pytestmark = needs_browser


@pytest.fixture(scope="module")
def page() -> Iterator[str]:
    """Address of the page, as ``python -m http.server`` serves it."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, format: str, *args: Any) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=PAGE)) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.fixture(scope="module")
def url(page: str) -> Iterator[str]:
    """Start a server that allows the page."""
    with EnvironmentServer(ServerSettings(port=0, origins=(page,), token=TOKEN)) as server:
        yield server.url


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browsing(tmp_path_factory.mktemp("profile")) as one:
        yield one


def opened(browser: Browser, url: str) -> None:
    """Open a page and wait until its program runs."""
    browser.open(url)
    assert browser.run("return typeof window.graspbox") == "object"


@pytest.fixture
def connected(browser: Browser, page: str, url: str) -> Browser:
    opened(browser, f"{page}/index.html")
    given = {"url": url, "token": TOKEN, "objects": OBJECTS}
    browser.run("await graspbox.connect(arguments[0])", given)
    return browser


STEP = """
const {now} = await graspbox.step(arguments[0]);
return [now.reward.data[0], [...now.observations.proprio.data], now.touches];
"""
SHOWN = """
const picture = document.getElementById("picture");
return [picture.height, picture.width,
        [...picture.getContext("2d").getImageData(0, 0, picture.width, picture.height).data]];
"""


def local(steps: int) -> tuple[Any, NDArray[np.float32]]:
    env = gymnasium.make(
        "graspbox/Grasp-v0",
        objects=OBJECTS,
        obs="proprio",
        reward="dense",
        render_mode="rgb_array",
        picture=PictureConfig(image_size=(360, 480)),
    )
    return env, np.random.default_rng(0).uniform(-1, 1, (steps, 8)).astype(np.float32)


def same_steps(browser: Browser, env: Any, actions: NDArray[np.float32]) -> None:
    """Rewards and observations are equal to the bit: JSON holds every float."""
    for action in actions:
        reward, proprio, _ = browser.run(STEP, action.tolist())
        observation, expected, *_ = env.step(action)
        assert reward == expected
        assert np.array(proprio, dtype=np.float32).tobytes() == observation.tobytes()


def test_results_and_pictures_are_those_of_this_process(connected: Browser) -> None:
    env, actions = local(5)
    connected.run("await graspbox.reset(7)")
    env.reset(seed=7)
    same_steps(connected, env, actions)
    height, width, pixels = connected.run(SHOWN)
    np.testing.assert_array_equal(np.array(pixels, dtype=np.uint8).reshape(height, width, 4)[..., :3], env.render())


def test_a_session_survives_a_connection_that_breaks_off(connected: Browser) -> None:
    """The secret of the session has 64 bits, more than a Number of JavaScript holds."""
    env, actions = local(4)
    connected.run("await graspbox.reset(3)")
    env.reset(seed=3)
    same_steps(connected, env, actions[:2])
    connected.run("graspbox.client.breakOff()")
    same_steps(connected, env, actions[2:])


def test_errors_are_those_of_the_server(connected: Browser) -> None:
    with pytest.raises(RuntimeError, match="no field 'mass'"):
        connected.run("await graspbox.client.call('reset', {mass: 1})")
    connected.run("await graspbox.reset(3)")
    with pytest.raises(RuntimeError, match=r"give \(1, 8\)"):
        connected.run("await graspbox.step([0, 0])")


def test_a_reader_of_the_page_can_press_its_buttons(browser: Browser, page: str, url: str) -> None:
    opened(browser, f"{page}/index.html?url={url}&token={TOKEN}&objects={OBJECTS}&seed=7")
    browser.run("document.querySelector('#connect button').click()")
    told = "return Object.fromEntries([...document.querySelectorAll('#told tr')].map((row) => "
    told += "[...row.children].map((cell) => cell.textContent)))"
    wait(lambda: browser.run(told).get("step") == "0")
    assert browser.run("return document.querySelectorAll('#sliders input').length") == 8
    browser.run("document.getElementById('step').click()")
    wait(lambda: browser.run(told).get("step") == "1")
    browser.run("for (const name of ['random', 'run']) document.getElementById(name).click()")
    wait(lambda: int(browser.run(told)["step"]) > 5)
    browser.run("document.getElementById('run').click()")
    assert browser.run("return document.getElementById('error').textContent") == ""
    assert float(browser.run(told)["return"]) != 0.0
    if "GRASPBOX_SCREENSHOT" in os.environ:
        Path(os.environ["GRASPBOX_SCREENSHOT"]).write_bytes(browser.picture())


def wait(condition: Any) -> None:
    for _ in range(200):
        if condition():
            return
        time.sleep(0.05)
    raise AssertionError("the page did not get there within 10 s")


def test_pages_of_other_origins_and_without_token_are_refused(browser: Browser, page: str, url: str) -> None:
    opened(browser, f"{page}/index.html")
    with EnvironmentServer(ServerSettings(port=0)) as closed:
        for given in ({"url": closed.url}, {"url": url, "token": "another-token-of-length"}):
            with pytest.raises(RuntimeError, match=f"--origin {page}"):
                browser.run("await graspbox.connect({token: '', objects: '', ...arguments[0]})", given)


ROUND_TRIP = """
const {encode, decode, NdArray} = await import("./msgpack.js");
const sizes = [0, 1, 31, 32, 255, 256, 65535, 65536];
const values = [null, true, false, 0, 127, 128, 255, 65536, 2 ** 53 - 1, -1, -32, -33, -128, -129, -(2 ** 31) - 1,
                2n ** 53n, 2n ** 64n - 1n, -(2n ** 63n), 0.1, -0.5, 1e300, Infinity,
                ...sizes.map((n) => "x".repeat(n)), ...sizes.map((n) => new Uint8Array(n)), "ü",
                ...sizes.slice(0, 6).map((n) => new Array(n).fill(7)),
                Object.fromEntries(Array.from({length: 300}, (_, i) => [`k${i}`, [i, {}]]))];
const shown = (value) => JSON.stringify(value, (_, v) => typeof v === "bigint" ? `${v}n` : v);
for (const value of values) {
  if (typeof value === "number" && !Object.is(decode(encode(value)), value)) throw new Error(`number ${value}`);
  if (shown(decode(encode(value))) !== shown(value)) throw new Error(shown(value).slice(0, 80));
}
const array = new NdArray("<f8", [2, 1], Float64Array.of(0.25, -1));
const found = decode(encode({x: array})).x;
if (!(found instanceof NdArray) || shown(found) !== shown(array)) throw new Error(shown(found));
for (const bad of [[0xc1], [0x92, 1], [1, 2], [0xdd, 255, 255, 255, 255], [0xa2, 0xff, 0xff]]) {
  let refused = false;
  try { decode(Uint8Array.from(bad)); } catch { refused = true; }
  if (!refused) throw new Error(`decoded ${bad}`);
}
return [...encode([2n ** 64n - 1n, -1, "a", new Uint8Array(1), 0.5])];
"""


def test_its_codec_reads_what_it_writes(browser: Browser, page: str) -> None:
    """Every form of every type, 64-bit integers, and frames that are cut off."""
    opened(browser, f"{page}/index.html")
    written = bytes(browser.run(ROUND_TRIP))
    assert written.hex() == "95cfffffffffffffffffd3ffffffffffffffffa161c40100cb3fe0000000000000"
