"""Fixtures of all Python tests."""

import os
import signal
from collections.abc import Iterator
from importlib import import_module

import pytest

#: Where the training extra must be present, a skipped test would hide that it is not.
REQUIRE_TRAIN = os.environ.get("GRASPBOX_REQUIRE_TRAIN", "0") not in ("", "0")

_skipped: list[str] = []

# A shell starts background jobs with SIGINT ignored, which children inherit; tests of Ctrl-C need Python's handler.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def one_thread() -> Iterator[None]:
    """Let torch use one thread: small networks are slowed by more, on a busy machine by much."""
    torch = import_module("torch")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture
def stopped_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `time.time` stand still, for infos that contain times."""
    monkeypatch.setattr("time.time", lambda: 1e9)


@pytest.fixture(scope="module", params=["here", "on a server"])
def remote(request: pytest.FixtureRequest) -> Iterator[str | None]:
    """Where environments step: None in this process."""
    if request.param == "here":
        yield None
        return
    served = import_module("graspbox.tools.remote")
    with served.EnvironmentServer(served.ServerSettings(port=0)) as server:
        yield server.url


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.skipped and "train" in report.keywords and not hasattr(report, "wasxfail"):
        _skipped.append(report.nodeid)


def pytest_collectreport(report: pytest.CollectReport) -> None:
    # A module that skips itself while it is imported (`importorskip`) carries no marker yet.
    if report.skipped:
        _skipped.append(report.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    if REQUIRE_TRAIN and _skipped and session.exitstatus == pytest.ExitCode.OK:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if REQUIRE_TRAIN and _skipped:
        terminalreporter.section("training tests must run here", red=True)
        for nodeid in _skipped:
            terminalreporter.line(f"SKIPPED, which counts as failed: {nodeid}")
