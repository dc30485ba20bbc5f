"""`Viewer`: a page in a viser server, by default reachable only from this machine."""

import contextlib
import html
import io
import socket
import threading
from collections.abc import Callable
from ipaddress import ip_address
from types import TracebackType
from typing import Any, Self

from graspbox._common.arguments import natural
from graspbox._common.imports import imported
from graspbox.errors import ConfigError, GraspboxError
from graspbox.tools.viewer.canvas import Canvas
from graspbox.tools.viewer.page import Page, ViewerOptions
from graspbox.tools.viewer.sources import page_of

#: Port that is tried first; the next free one is taken where the caller names none.
_PORT = 8080
#: Number of ports that are tried.
_ATTEMPTS = 100
#: Intensity of the light from above and below.
_SKY = 1.9
#: Height of the frame in notebooks, pixels.
_HEIGHT = 600


class Viewer:
    """A running view, also a context manager; a notebook displays it as the last value of a cell.

    Parameters and errors are those of `graspbox.tools.viewer.show`.

    Attributes
    ----------
    page : Page
        The page.
    url : str
        Its address.
    """

    def __init__(
        self,
        source: Any,
        options: ViewerOptions = ViewerOptions(),  # noqa: B008 (frozen)
        *,
        host: str = "127.0.0.1",
        port: int | None = None,
        insecure: bool = False,
    ) -> None:
        _check_host(host, insecure)
        viser = imported("viser", "graspbox.tools.viewer needs the package viser, from the extra 'view'", "view")
        kind, content = page_of(source, options)
        with contextlib.redirect_stdout(io.StringIO()):  # it prints a table even without `verbose`
            self._server = viser.ViserServer(host, _free_port(host, port), f"graspbox: {kind.title}", verbose=False)
        # Any page on the server could request its tunnel to the internet.
        self._server.request_share_url = lambda verbose=True: None
        _arrange(self._server)
        self._closed, self._options = threading.Event(), options
        self._back: list[Any] = []
        self._source = source
        try:
            self._build(kind, content)
        except BaseException:
            self.close()
            raise
        self.url = f"http://{f'[{host}]' if ':' in host else host}:{self._server.get_port()}"

    def _build(self, kind: type[Page], content: Any) -> None:
        self.canvas = Canvas(self._server)
        self.canvas.open = self._open_later
        self.page: Page = kind(content, self.canvas, self._options)
        if self._back:
            self.canvas.on(self.canvas.gui.add_button("back", icon="arrow-left"), call=self._go_back)
        self.page.build()

    def open(self, source: Any) -> None:
        """Show another source at the same address; a button leads back.

        Raises
        ------
        GraspboxError
            If it is not recognised or cannot be read; the present page is kept. The page shows later errors.
        """
        kind, content = page_of(source, self._options)
        self._back.append(self._source)
        self._replace(source, kind, content)

    def _replace(self, source: Any, kind: type[Page], content: Any) -> None:
        """Replace the page; errors are shown in the new one."""
        self._source = source
        self.canvas.closed.set()
        self.page.close()
        self.canvas.close()
        self._server.gui.reset()
        self._server.scene.reset()
        _arrange(self._server)
        try:
            self._build(kind, content)
        except GraspboxError as error:
            self.canvas.complain(str(error))

    def _open_later(self, source: Any) -> None:
        """Open from a callback, whose page this closes."""
        self._later(lambda: self.open(source))

    def _later(self, work: Callable[[], None]) -> None:
        threading.Thread(target=self.canvas.guarded(work), daemon=True).start()

    def _go_back(self) -> None:
        source = self._back.pop()
        kind, content = page_of(source, self._options)
        self._later(lambda: self._replace(source, kind, content))

    def __repr__(self) -> str:
        return f"Viewer({self.page.title!r}, {self.url!r})"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _repr_html_(self) -> str:
        """Show the page in a notebook that runs on this machine."""
        return f'<iframe src="{html.escape(self.url)}" width="100%" height="{_HEIGHT}" frameborder="0"></iframe>'

    @property
    def clients(self) -> int:
        """Number of browsers that show the page."""
        return len(self._server.get_clients())

    def wait(self) -> None:
        """Return when the view is closed; Ctrl-C raises KeyboardInterrupt."""
        while not self._closed.wait(0.5):
            pass

    def close(self) -> None:
        """End the view; repeated calls do nothing."""
        if self._closed.is_set():
            return
        self._closed.set()
        self.canvas.closed.set()
        self.page.close()
        self.canvas.close()
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()


def _check_host(host: str, insecure: bool) -> None:
    """Refuse an address that other machines can reach, unless `insecure` is set."""
    try:
        local = host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        local = False
    if not local and not insecure:
        raise ConfigError(
            f"host is {host!r}, which other machines reach; pass insecure=True (--insecure) where everybody on that "
            "network may use this page"
        )


def _free_port(host: str, port: int | None) -> int:
    """Return a free port; viser itself would silently choose another one."""
    wanted = range(_PORT, _PORT + _ATTEMPTS) if port is None else (natural(port, "port", bits=16),)
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    reason = ""
    for one in wanted:
        with socket.socket(family, socket.SOCK_STREAM) as attempt:
            attempt.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                attempt.bind((host, one))
                return int(attempt.getsockname()[1])
            except OSError as error:
                reason = error.strerror or str(error)
    tried = f"{wanted[0]} to {wanted[-1]}" if port is None else f"{port}"
    raise ConfigError(f"port {tried} of {host} cannot be used ({reason}); pass another one, or 0 for any that is free")


def _arrange(server: Any) -> None:
    """Set the theme of all pages."""
    server.gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    server.scene.set_up_direction("+z")
    # Without the map of surroundings a software renderer draws three times as many frames a second.
    server.scene.configure_environment_map(None)
    server.scene.configure_default_lights(cast_shadow=False)
    server.scene.add_light_hemisphere(
        "/sky", sky_color=(255, 255, 255), ground_color=(225, 220, 215), intensity=_SKY, position=(0.0, 0.0, 1.0)
    )
