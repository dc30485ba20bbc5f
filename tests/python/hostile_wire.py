"""A client that can violate the protocol: the handshake and the frames of a WebSocket, and msgpack, written by hand."""

import base64
import os
import socket
import struct
import time
from typing import Any
from urllib.parse import urlsplit

import numpy as np

__all__ = ["Peer", "http", "msgpack", "open_socket", "parsed"]

#: Seconds after which a peer that waits gives up.
PATIENCE = 30.0


def msgpack(value: Any) -> bytes:
    """Write a value; arrays as openpi writes them."""
    if value is None or isinstance(value, bool):
        return {None: b"\xc0", False: b"\xc2", True: b"\xc3"}[value]
    if isinstance(value, int):
        return struct.pack(">Bq", 0xD3, value) if value < 1 << 63 else struct.pack(">BQ", 0xCF, value)
    if isinstance(value, float):
        return struct.pack(">Bd", 0xCB, value)
    if isinstance(value, str):
        text = value.encode()
        return struct.pack(">BI", 0xDB, len(text)) + text
    if isinstance(value, bytes):
        return struct.pack(">BI", 0xC6, len(value)) + value
    if isinstance(value, np.ndarray):
        array = {"__ndarray__": True, "dtype": value.dtype.str, "shape": list(value.shape), "data": value.tobytes()}
        return msgpack(array)
    if isinstance(value, dict):
        pairs = b"".join(msgpack(key) + msgpack(item) for key, item in value.items())
        return struct.pack(">BI", 0xDF, len(value)) + pairs
    return struct.pack(">BI", 0xDD, len(value)) + b"".join(msgpack(item) for item in value)


#: Format of the numbers of msgpack, by the first byte.
_NUMBERS = {
    0xCA: "f",
    0xCB: "d",
    0xCC: "B",
    0xCD: "H",
    0xCE: "I",
    0xCF: "Q",
    0xD0: "b",
    0xD1: "h",
    0xD2: "i",
    0xD3: "q",
}
#: Format of a length, and its type, by the first byte.
_LENGTHS = {
    0xC4: ("B", "bin"),
    0xC5: ("H", "bin"),
    0xC6: ("I", "bin"),
    0xD9: ("B", "str"),
    0xDA: ("H", "str"),
    0xDB: ("I", "str"),
    0xDC: ("H", "list"),
    0xDD: ("I", "list"),
    0xDE: ("H", "map"),
    0xDF: ("I", "map"),
}


def parsed(frame: bytes) -> Any:
    """Read a value of the server; arrays stay the maps that they are on the wire."""
    value, rest = _value(memoryview(frame))
    assert not rest, f"{len(rest)} bytes follow the value"
    return value


def _value(data: memoryview) -> tuple[Any, memoryview]:
    head, data = data[0], data[1:]
    if head <= 0x7F or head >= 0xE0:
        return (head if head <= 0x7F else head - 256), data
    if head in (0xC0, 0xC2, 0xC3):
        return {0xC0: None, 0xC2: False, 0xC3: True}[head], data
    if head in _NUMBERS:
        size = struct.calcsize(_NUMBERS[head])
        return struct.unpack(">" + _NUMBERS[head], data[:size])[0], data[size:]
    if head in _LENGTHS:
        form, kind = _LENGTHS[head]
        size = struct.calcsize(form)
        count, data = struct.unpack(">" + form, data[:size])[0], data[size:]
    else:
        kind = "map" if head <= 0x8F else "list" if head <= 0x9F else "str"
        count = head & (0x1F if kind == "str" else 0x0F)
    if kind in ("bin", "str"):
        found = bytes(data[:count])
        return (found if kind == "bin" else found.decode()), data[count:]
    items = []
    for _ in range(count * (2 if kind == "map" else 1)):
        item, data = _value(data)
        items.append(item)
    if kind == "list":
        return items, data
    keys = [key.decode() if isinstance(key, bytes) else key for key in items[::2]]
    return dict(zip(keys, items[1::2], strict=True)), data


def open_socket(url: str, timeout: float = PATIENCE) -> socket.socket:
    """Connect to a server on this machine; no other is ever attacked."""
    address = urlsplit(url)
    assert address.hostname == "127.0.0.1"
    return socket.create_connection(("127.0.0.1", address.port or 0), timeout=timeout)


def http(url: str, head: str, body: bytes = b"") -> bytes:
    """Send a request, and return all that comes until the server closes, or falls silent for a second."""
    with open_socket(url, 1.0) as plain:
        found = b""
        try:
            plain.sendall(head.encode("latin-1") + body)
            while part := plain.recv(1 << 16):
                found += part
        except OSError:
            pass  # A server may close before it has read everything.
        return found


class Peer:
    """A WebSocket to a server, whose frames are made by hand."""

    def __init__(self, url: str, headers: tuple[str, ...] = (), hello: bool = True) -> None:
        self.socket = open_socket(url)
        self.next = 1
        key = base64.b64encode(os.urandom(16)).decode()
        own = ("Upgrade: websocket", "Connection: Upgrade", f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13")
        lines = ["GET / HTTP/1.1", f"Host: {urlsplit(url).netloc}", *own, *headers, "", ""]
        self.socket.sendall("\r\n".join(lines).encode("latin-1"))
        self._rest = b""
        while b"\r\n\r\n" not in self._rest:
            self._rest += self._read()
        head, _, self._rest = self._rest.partition(b"\r\n\r\n")
        self.status = int(head.split()[1])
        self.hello = parsed(self.receive()) if hello and self.status == 101 else None

    def __enter__(self) -> "Peer":
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def _read(self) -> bytes:
        part = self.socket.recv(1 << 20)
        if not part:
            raise ConnectionError("the server closed the connection")
        return part

    def send(
        self, payload: bytes, opcode: int = 2, fin: bool = True, mask: bool = True, length: int | None = None
    ) -> None:
        """Send a frame; `length` is announced instead of its own."""
        self.socket.sendall(frame(payload, opcode, fin, mask, length))

    def _bytes(self, count: int) -> bytes:
        parts, missing = [self._rest], count - len(self._rest)
        while missing > 0:
            parts.append(self._read())
            missing -= len(parts[-1])
        whole = b"".join(parts)
        self._rest = whole[count:]
        return whole[:count]

    def frame(self) -> tuple[int, bytes]:
        """Return opcode and payload of the next frame."""
        first, second = self._bytes(2)
        length = second & 0x7F
        if length > 125:
            length = int.from_bytes(self._bytes(2 if length == 126 else 8), "big")
        return first & 0x0F, self._bytes(length)

    def receive(self) -> bytes:
        """Return the next message; pings are answered."""
        while True:
            opcode, payload = self.frame()
            if opcode == 8:
                raise ConnectionError(f"the server closes: {payload[2:].decode()}")
            if opcode == 9:
                self.send(payload, opcode=10)
            elif opcode in (1, 2):
                return payload

    def submit(self, command: Any, **fields: Any) -> int:
        """Send a command; return its number."""
        self.next += 1
        self.send(msgpack({"id": self.next, "command": command, **fields}))
        return self.next

    def answer(self, number: int) -> dict[str, Any]:
        """Wait for the answer to a command; earlier ones are dropped."""
        while True:
            found: dict[str, Any] = parsed(self.receive())
            if found["id"] == number:
                return found

    def call(self, command: Any, **fields: Any) -> dict[str, Any]:
        """Carry out a command."""
        return self.answer(self.submit(command, **fields))

    def closed(self, within: float = PATIENCE) -> bool:
        """Whether the server ends the connection."""
        until = time.monotonic() + within
        self.socket.settimeout(within)
        try:
            while time.monotonic() < until:
                self.receive()
        except TimeoutError:
            return False
        except OSError:
            return True
        return False


def frame(payload: bytes, opcode: int = 2, fin: bool = True, mask: bool = True, length: int | None = None) -> bytes:
    """Write a frame; its mask is zero, so that the payload stays as it is."""
    count = len(payload) if length is None else length
    bit = 0x80 if mask else 0
    head = bytes([(0x80 if fin else 0) | opcode])
    if count < 126:
        head += bytes([bit | count])
    elif count < 1 << 16:
        head += struct.pack(">BH", bit | 126, count)
    else:
        head += struct.pack(">BQ", bit | 127, count)
    return head + (bytes(4) if mask else b"") + payload
