"""A headless Chromium, driven over the WebDriver protocol; tests that use it are skipped without it.

Needs Chromium and its driver, such as Debian's packages ``chromium`` and ``chromium-driver``. ``python
tests/python/browsing.py PAGE.html`` prints how long a page takes to open, five times.
"""

import base64
import json
import re
import shutil
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

DRIVER = shutil.which("chromedriver")
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = ("headless", "no-sandbox", "disable-gpu", "disable-quic", "no-first-run", "disable-background-networking",
         "disable-component-update", "disable-sync", "window-size=1100,1150")  # fmt: skip
needs_browser = pytest.mark.skipif(not (DRIVER and BROWSER), reason="needs chromium and chromedriver")


class Browser:
    """A page, driven over the WebDriver protocol."""

    def __init__(self, driver: str, profile: Path, more: tuple[str, ...] = ()) -> None:
        self._driver = driver
        flags = [f"--{flag}" for flag in (*FLAGS, *more, f"user-data-dir={profile}")]
        options = {"goog:chromeOptions": {"args": flags, "binary": BROWSER}, "goog:loggingPrefs": {"browser": "ALL"}}
        session = self._call("POST", "/session", {"capabilities": {"alwaysMatch": options}})["sessionId"]
        self._path = f"/session/{session}"
        self._call("POST", f"{self._path}/timeouts", {"script": 60_000})

    def _call(self, method: str, path: str, fields: dict[str, Any] | None = None) -> Any:
        body = None if fields is None else json.dumps(fields).encode()
        request = urllib.request.Request(self._driver + path, body, {"Content-Type": "application/json"}, method=method)
        try:
            with urllib.request.urlopen(request, timeout=90) as response:
                return json.load(response)["value"]
        except urllib.error.HTTPError as error:
            raise AssertionError(json.load(error)["value"]["message"]) from None

    def open(self, url: str) -> None:
        """Open a page."""
        self._call("POST", f"{self._path}/url", {"url": url})

    def run(self, script: str, *values: Any) -> Any:
        """Run the body of an asynchronous function; ``values`` are its ``arguments``."""
        wrapped = (
            "const done = arguments[arguments.length - 1];"
            f"(async function() {{ {script} }}).apply(null, arguments)"
            ".then((value) => done({value}), (error) => done({error: error.message}));"
        )
        found = self._call("POST", f"{self._path}/execute/async", {"script": wrapped, "args": list(values)})
        if "error" in found:
            raise RuntimeError(found["error"])
        return found.get("value")

    def emulate(self, width: int, height: int, scheme: str) -> None:
        """Give the window a size, and the user a preference for light or dark pages."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
        for name, given in (("setDeviceMetricsOverride", size), ("setEmulatedMedia", media)):
            fields = {"cmd": f"Emulation.{name}", "params": given}
            self._call("POST", f"{self._path}/goog/cdp/execute", fields)

    def complaints(self) -> list[str]:
        """Return the complaints of the browser since the last call."""
        return [entry["message"] for entry in self._call("POST", f"{self._path}/se/log", {"type": "browser"})]

    def picture(self) -> bytes:
        """Take a picture of the window, PNG."""
        return base64.b64decode(self._call("GET", f"{self._path}/screenshot"))

    def close(self) -> None:
        """End the browser."""
        self._call("DELETE", self._path)


@contextmanager
def browsing(profile: Path, *more: str) -> Iterator[Browser]:
    """Run a browser with a new profile, and more flags."""
    assert DRIVER is not None
    with subprocess.Popen([DRIVER, "--port=0"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if found := re.search(r"started successfully on port (\d+)", line):
                break
        assert found is not None
        one = Browser(f"http://127.0.0.1:{found[1]}", profile, more)
        yield one
        one.close()
        process.terminate()


def opening_times(page: Path, times: int = 5) -> list[float]:
    """Return how long a page takes to open, seconds to the end of its load event, each time in a new browser."""
    found = []
    for _ in range(times):
        with tempfile.TemporaryDirectory() as profile, browsing(Path(profile)) as browser:
            browser.open(page.resolve().as_uri())
            found.append(browser.run("return performance.getEntriesByType('navigation')[0].loadEventEnd") / 1000.0)
    return found


if __name__ == "__main__":
    print("seconds:", *(f"{seconds:.2f}" for seconds in sorted(opening_times(Path(sys.argv[1])))))
