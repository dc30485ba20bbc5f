"""`Viewer`: a page in a viser server, by default reachable from this machine alone."""

import contextlib
import html
import io
import socket
import threading
from ipaddress import ip_address
from types import TracebackType
from typing import Any, Self

from graspbox._common.arguments import natural
from graspbox._common.extras import imported
from graspbox.errors import ConfigError, GraspboxError
from graspbox.viewer.canvas import Canvas
from graspbox.viewer.kinds import find
from graspbox.viewer.page import Options, Page

__all__ = ["DEFAULT_PORT", "Viewer"]

#: Port that is tried first; the next free one is taken where the caller names none.
DEFAULT_PORT = 8080
#: Ports that are tried.
_ATTEMPTS = 100
#: Intensity of the light from above and below.
_SKY = 1.9
#: Height of the frame in notebooks, pixels.
_HEIGHT = 600


class Viewer:
    """A running view, also a context manager; a notebook displays it as the last value of a cell.

    Parameters
    ----------
    source : object
        See `graspbox.viewer.show`.
    options : Options
        Options of the view.
    host : str
        Address to listen at.
    port : int or None
        Port; 0 for any that is free, None for 8080 or the next free one.
    insecure : bool
        Allow an address beyond this machine: anybody who reaches it may use the page.

    Attributes
    ----------
    page : Page
        The page.
    url : str
        Address of the page.

    Raises
    ------
    ConfigError
        If the address is not of this machine and `insecure` is False, or the port is in use.
    MissingExtraError
        Without viser (extra ``view``).
    GraspboxError
        If the thing cannot be shown.
    """

    def __init__(
        self,
        source: Any,
        options: Options = Options(),  # noqa: B008 (frozen)
        *,
        host: str = "127.0.0.1",
        port: int | None = None,
        insecure: bool = False,
    ) -> None:
        _check_host(host, insecure)
        _viser()
        kind, found = find(source, options)
        chosen = _free_port(host, port)
        self._server = _start(host, chosen, f"graspbox: {kind.title}")
        _arrange(self._server)
        self._closed, self._options = threading.Event(), options
        self._back: list[Any] = []
        self._source = source
        try:
            self._build(kind, found)
        except BaseException:
            self.close()
            raise
        self.url = f"http://{f'[{host}]' if ':' in host else host}:{self._server.get_port()}"

    def _build(self, kind: type[Page], found: Any) -> None:
        self.canvas = Canvas(self._server)
        self.canvas.open = self._open_later
        self.page: Page = kind(found, self.canvas, self._options)
        if self._back:
            self.canvas.on(self.canvas.gui.add_button("back", icon="arrow-left"), call=self._go_back)
        self.page.build()

    def open(self, source: Any) -> None:
        """Show another thing at the same address; a button leads back.

        Raises
        ------
        GraspboxError
            If it is not recognised or cannot be read; the present page is kept. The page shows later errors.
        """
        kind, found = find(source, self._options)
        self._back.append(self._source)
        self._replace(source, kind, found)

    def _replace(self, source: Any, kind: type[Page], found: Any) -> None:
        self._source = source
        self.canvas.closed.set()
        self.page.close()
        self.canvas.close()
        self._server.gui.reset()
        self._server.scene.reset()
        _arrange(self._server)
        try:
            self._build(kind, found)
        except GraspboxError as error:
            self.canvas.complain(str(error))

    def _open_later(self, source: Any) -> None:
        """Open from a callback; this closes the page of the callback."""
        threading.Thread(target=self.canvas.guarded(lambda: self.open(source)), daemon=True).start()

    def _go_back(self) -> None:
        source = self._back.pop()
        kind, found = find(source, self._options)
        threading.Thread(target=self.canvas.guarded(lambda: self._replace(source, kind, found)), daemon=True).start()

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
            f"host is {host!r}, which other machines reach; give insecure=True (--insecure) where everybody on that "
            "network may use this page"
        )


def _free_port(host: str, port: int | None) -> int:
    """Return a free port; viser itself would silently choose another one."""
    wanted = range(DEFAULT_PORT, DEFAULT_PORT + _ATTEMPTS) if port is None else (natural(port, "port", bits=16),)
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
    raise ConfigError(f"port {tried} of {host} cannot be used ({reason}); give another one, or 0 for any that is free")


def _viser() -> Any:
    """Import viser."""
    return imported("viser", "graspbox.viewer needs the package viser, from the extra 'view'", "view")


def _start(host: str, port: int, label: str) -> Any:
    """Start viser's server, without its tunnel to the internet, which any page on the server could request."""
    with contextlib.redirect_stdout(io.StringIO()):  # it prints a table even without `verbose`
        server = _viser().ViserServer(host, port, label, verbose=False)
    server.request_share_url = lambda verbose=True: None
    return server


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
