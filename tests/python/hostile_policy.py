"""Attacks on a policy server: malformed or abusive observations and grasp requests."""

import base64
import contextlib
import json
import random
from typing import Any
from urllib.parse import urlsplit

import numpy as np

from hostile_attacks import Attack, mutated
from hostile_wire import Peer, frame, http, msgpack, open_socket

__all__ = ["POLICY_ATTACKS", "grasps", "post"]


def post(url: str, body: bytes, kind: str = "application/json", length: int | None = None, token: str = "") -> bytes:
    """POST to ``/grasps``; the answer, possibly cut off by the server."""
    lines = [
        "POST /grasps HTTP/1.1",
        f"Host: {urlsplit(url).netloc}",
        f"Content-Type: {kind}",
        "Connection: close",
        f"Content-Length: {len(body) if length is None else length}",
    ]
    lines += [f"Authorization: Bearer {token}"] if token else []
    return http(url, "\r\n".join([*lines, "", ""]), body)


def grasps(rng: random.Random) -> dict[str, Any]:
    """Make a request of an empty table, small."""
    lens = [[60.0, 0, 32], [0, 60.0, 24], [0, 0, 1]]
    return {"depth": [[0.5 + 0.001 * rng.random()] * 64] * 48, "intrinsics": lens, "count": 2, "seed": 1}


def _encoded(dtype: Any, shape: Any, data: bytes = b"") -> dict[str, Any]:
    return {"data": base64.b64encode(data).decode(), "dtype": dtype, "shape": shape}


_LENS = [[60.0, 0, 32], [0, 60.0, 24], [0, 0, 1]]
_DEPTHS: list[Any] = [
    [],
    [[]],
    [[[]]],
    0,
    None,
    "x",
    [["a"]],
    [[1], [1, 2]],
    [[float("nan")] * 9] * 9,
    [[1e308] * 9] * 9,
    [[-1.0] * 9] * 9,
    [[0] * 9] * 9,
    [[0.5]],
    [[10**30]],
    [[True]],
    {},
    {"data": 5},
    _encoded("<u2", [48, 64], b"12"),
    _encoded("O", [1], b"12345678"),
    _encoded("<f4", [1 << 32, 1 << 32]),
    _encoded("<f4", [1 << 62, 4]),
    _encoded("<f4", [10**9, 10**9]),
    _encoded("<f4", [0, 0]),
    _encoded("<f4", [0, 1 << 62]),
    _encoded("<f4", [-1, -4], bytes(16)),
    _encoded("<f4", [2.5, 2], bytes(16)),
    _encoded("<f4", ["9" * 5000]),
    _encoded("<f4", [float("inf")]),
    _encoded("<f4", "12"),
    _encoded("<f4", 5),
    _encoded(",".join(["i4"] * 99), [1]),
    _encoded(["<f4"], [1]),
    _encoded({"names": ["a"], "formats": ["<f4"]}, [1], bytes(4)),
    _encoded("(3,)<f4", [1], bytes(12)),
    _encoded("<f2", [2, 2], bytes(8)),
    _encoded("|b1", [2, 2], bytes(4)),
    _encoded("<f4", [1] * 99, bytes(4)),
    _encoded(None, [2], bytes(16)),
    {"data": "%%%%", "dtype": "<f4", "shape": [1]},
    {"data": "é", "dtype": "<f4", "shape": [1]},
]
_VALUES: list[Any] = [
    None,
    0,
    -1,
    1 << 70,
    1e308,
    float("nan"),
    float("inf"),
    "x",
    [],
    [[]],
    {},
    True,
    [[0] * 3] * 3,
    [[1e300] * 3] * 3,
    [[[0.0] * 4] * 4],
    [[1e-300] * 4] * 4,
    [[float("nan")] * 4] * 4,
    [1e308] * 4,
    [-5, -5, -1, -1],
    [1e9, 1],
    [1, 2, 3],
]


_NAMES = ("intrinsics", "camera_pose", "region", "mask", "labels", "label", "all", "keep_off", "hand_error",
          "depth_scale", "depth_is", "workspace", "workspace_frame", "previous", "count", "seed")  # fmt: skip
_STILL = [[[1.0, 0, 0, 0], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]]
_EARLIER: dict[str, Any] = {"hand": "reflex", "camera_from_hand": _STILL, "table_from_hand": _STILL, "preshape": [0.0]}
_NONE: tuple[Any, ...] = (None, 5, "x", [], [[]], {}, [float("nan")], [1e308])
_EARLIERS: list[Any] = [
    _EARLIER,
    *({**_EARLIER, name: value} for name in _EARLIER for value in _NONE),
    *(
        {**_EARLIER, name: value}
        for name in ("camera_from_hand", "table_from_hand")
        for value in (
            [[[float("nan")] * 4] * 4],
            [[[float("inf")] * 4] * 4],
            [[[1e308] * 4] * 4],
            [[[0.0] * 4] * 4],
            [[[1.0] * 3] * 3],
            _STILL[0],
            [_STILL],
            [["a" * 1000] + [""] * 50],
            _STILL * 1000,
        )
    ),
    {**_EARLIER, "hand": "x" * 10_000},
    {**_EARLIER, "preshape": [[0.0]]},
    {**_EARLIER, "preshape": [0.0] * 1000},
    {"hand": "reflex"},
    {"images": [_EARLIER]},
    {"things": [], "labels": [[0]]},
    {"things": [_EARLIER], "labels": [[0]]},
    {"things": [{"thing": 1, **_EARLIER}], "labels": [[1]]},
    {"things": [{"thing": 1, **_EARLIER}], "labels": [["a" * 1000] + [""] * 50]},
    {"things": [{"thing": 1, **_EARLIER}] * 101, "labels": [[1]]},
    {"things": [{"thing": 1 << 70, **_EARLIER}], "labels": [[1]]},
    {"things": [{"thing": 1, "refused": 5}], "labels": [[1 << 62]]},
]


def hostile_grasps(url: str, rng: random.Random, count: int) -> int:
    """Images that are none, arrays that lie about their shape, absurd entries and earlier answers."""
    for index in range(count):
        request, number = grasps(rng), index // 3
        if index % 3 == 0:
            request["depth"] = _DEPTHS[number % len(_DEPTHS)]
        elif index % 3 == 1:
            # All values in turn, each beside other images and with another name in each turn.
            request[rng.choice(_NAMES)] = _VALUES[number % len(_VALUES)]
        else:
            request["all"], request["previous"] = rng.random() < 0.5, _EARLIERS[number % len(_EARLIERS)]
        answer = post(url, json.dumps(request).encode())
        assert b"InternalError" not in answer, (str(request)[-300:], answer[-400:])
    return count


def bombs(url: str, rng: random.Random, count: int) -> int:
    """JSON that is deep, long, or cut off, and other kinds of content."""
    bodies = [
        b"[" * 200_000,
        b'{"a":' * 100_000,
        b"1" * 100_000,
        b'"' + b"\\u0000" * 10_000,
        b"[1," * 1000,
        b"",
        b"\xff\xfe",
        b"null",
        b'{"depth":[[' + b"1," * 500_000 + b"1]]}",
        b'{"depth": 1e999999}',
        b"NaN",
        b"-" * 1000,
    ]
    for index in range(count):
        assert b"InternalError" not in (found := post(url, bodies[index % len(bodies)])), (index % len(bodies), found)
        if index % 3 == 0:
            kind = rng.choice(
                ("text/plain", "multipart/form-data; boundary=x", "", "application/x-www-form-urlencoded")
            )
            assert b" 415 " in post(url, b"{}", kind)
    return count


def half_bodies(url: str, rng: random.Random, count: int) -> int:
    """Bodies that never end."""
    with contextlib.ExitStack() as stack:
        for _ in range(min(count, 100)):
            plain = stack.enter_context(open_socket(url))
            head = "POST /grasps HTTP/1.1\r\nHost: x\r\nContent-Length: 60000000\r\nContent-Type: application/json\r\n"
            plain.sendall(head.encode() + b"\r\n{")
    return min(count, 100)


def observations(url: str, rng: random.Random, count: int) -> int:
    """Garbage, changed requests, and observations of absurd shapes; the connection answers each."""
    valid = msgpack({**grasps(rng), "depth": np.full((48, 64), 0.5, np.float32), "intrinsics": np.array(_LENS)})
    empty = {"__ndarray__": True, "dtype": "<f4", "shape": [0, 1 << 62], "data": b""}
    others: list[Any] = [
        {},
        {"depth": empty, "intrinsics": empty},
        {"state": empty},
        {"reset": True, "seed": -1},
        [],
        None,
        5,
        {"depth": None},
        {"x" * 5000: 1},
        {"depth": np.zeros((0, 0)), "intrinsics": np.zeros((3, 3))},
    ]
    with Peer(url) as peer:
        for index in range(count):
            random_bytes = rng.randbytes(rng.randrange(100))
            message = rng.choice((random_bytes, mutated(rng, valid), msgpack(others[index % len(others)])))
            peer.socket.sendall(frame(message))
            answer = peer.receive()
            assert b"please report" not in answer, (message[:200], answer[:400])
    return count


def gone(url: str, rng: random.Random, count: int) -> int:
    """Clients that ask, and are gone before they are answered."""
    request = frame(msgpack({"depth": np.full((48, 64), 0.5, np.float32), "intrinsics": np.array(_LENS)}))
    observation = frame(msgpack({"image": np.zeros((48, 64), np.float32)}))
    for index in range(count):
        with Peer(url) as peer:
            peer.socket.sendall(observation if index % 2 else request)
    return count


#: Every attack by name, with how many of each the campaign makes.
POLICY_ATTACKS: dict[str, tuple[Attack, int]] = {
    "garbage observations": (observations, 3000),
    "hostile requests for grasps": (hostile_grasps, 300),
    "JSON bombs": (bombs, 60),
    "bodies that never end": (half_bodies, 100),
    "gone before the answer": (gone, 60),
}
