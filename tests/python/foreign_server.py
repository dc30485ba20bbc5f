"""A scripted WebSocket server, for clients that connect to a server other than graspbox."""

import base64
import hashlib
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from hostile_wire import frame, msgpack

__all__ = ["Proxy", "close_frame", "foreign", "packed", "text"]

_MAGIC = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"


def packed(value: Any) -> bytes:
    """Write a frame of msgpack; a map begins as our servers' do, with its shortest head."""
    if isinstance(value, dict):
        entries = b"".join(msgpack(key) + msgpack(item) for key, item in value.items())
        return frame(bytes([0x80 | len(value)]) + entries, mask=False)
    return frame(msgpack(value), mask=False)


def text(words: str) -> bytes:
    """Write a frame of text."""
    return frame(words.encode(), opcode=1, mask=False)


def close_frame(code: int, reason: str = "") -> bytes:
    """Write a frame that closes the connection."""
    return frame(code.to_bytes(2, "big") + reason.encode(), opcode=8, mask=False)


def _serve(peer: socket.socket, frames: Sequence[bytes]) -> None:
    """Shake hands, send the first frame, and one more for each that comes in."""
    with peer, suppress(OSError):
        head = b""
        while b"\r\n\r\n" not in head:
            head += peer.recv(4096)
        lines = dict(line.split(b": ", 1) for line in head.split(b"\r\n")[1:] if b": " in line)
        key = next(value for name, value in lines.items() if name.lower() == b"sec-websocket-key")
        accept = base64.b64encode(hashlib.sha1(key + _MAGIC).digest()).decode()
        answer = ("HTTP/1.1 101 Switching Protocols", "Upgrade: websocket", "Connection: Upgrade")
        peer.sendall("\r\n".join([*answer, f"Sec-WebSocket-Accept: {accept}", "", ""]).encode() + frames[0])
        for one in frames[1:]:
            if not peer.recv(1 << 20):
                return
            peer.sendall(one)
        while peer.recv(1 << 20):
            pass


class Proxy:
    """Passes connections on to a server, until it closes them as a proxy does that is restarted.

    Parameters
    ----------
    url : str
        Address of the server.
    """

    def __init__(self, url: str) -> None:
        self._target = ("127.0.0.1", int(url.rpartition(":")[2]))
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self.url = f"ws://127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                server = socket.create_connection(self._target)
                self._pairs.append((client, server))
                for pair in ((client, server), (server, client)):
                    threading.Thread(target=self._pass, args=pair, daemon=True).start()

    @staticmethod
    def _pass(source: socket.socket, target: socket.socket) -> None:
        with suppress(OSError):
            while part := source.recv(1 << 20):
                target.sendall(part)

    def close_all(self, code: int, reason: str = "") -> None:
        """Close all connections with a frame of the proxy's own, and go on with new ones."""
        pairs, self._pairs = self._pairs, []
        for client, server in pairs:
            with suppress(OSError):
                client.sendall(close_frame(code, reason))
            server.close()
            client.close()

    def __enter__(self) -> "Proxy":
        return self

    def __exit__(self, *_: object) -> None:
        self.close_all(1001)
        self._listener.close()


@contextmanager
def foreign(*frames: bytes) -> Iterator[str]:
    """Serve at an address of this machine: the first frame at once, each further one after a message of the client."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def accept() -> None:
            with suppress(OSError):
                while True:
                    peer, _ = listener.accept()
                    threading.Thread(target=_serve, args=(peer, frames), daemon=True).start()

        threading.Thread(target=accept, daemon=True).start()
        yield f"ws://127.0.0.1:{listener.getsockname()[1]}"
        # Closing alone does not wake a thread that accepts.
        listener.shutdown(socket.SHUT_RDWR)
