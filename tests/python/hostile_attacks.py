"""Attacks on an environment server: each sends malformed or abusive messages, and returns their number."""

import contextlib
import random
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hostile_wire import Peer, frame, http, msgpack, open_socket

__all__ = ["ATTACKS", "Attack", "absurd", "commands", "kill", "made", "mutated"]

#: An attack: the address of a server, a source of numbers, and how often; returns how many messages it sent.
Attack = Callable[[str, random.Random, int], int]

CAN = "procedural:can:0"
#: Numbers of an action of the hand by default.
ACTION = 8
#: Messages between two looks at the answers.
_BATCH = 50
_HUGE = [
    1 << 63,
    (1 << 64) - 1,
    -1,
    -(1 << 63),
    1 << 40,
    10**9,
    0,
    float("nan"),
    float("inf"),
    -1e308,
    "x" * 5000,
    b"\0" * 50,
    [None] * 1000,
    {"": {"": None}},
    True,
    np.zeros(0),
    np.full((3, 3), np.nan),
    [[]] * 100,
]


def commands(rng: random.Random) -> dict[str, Any]:
    """One valid command."""
    step = np.zeros((1, ACTION), np.float32)
    return rng.choice(
        [
            {"command": "make", "objects": CAN, "num_envs": 1, "keywords": {"obs": ["state"], "max_episode_steps": 9}},
            {"command": "reset", "seed": [1], "options": {}, "mask": np.ones(1, np.bool_)},
            {"command": "step", "actions": step},
            {"command": "send", "actions": step, "env_ids": [0]},
            {"command": "recv", "count": 1},
            {"command": "observe", "shm": True},
            {"command": "render", "env_ids": [0]},
            {"command": "cameras"},
            {"command": "get_state", "env_id": 0},
            {"command": "set_state", "env_id": 0, "state": bytes(80)},
            {"command": "resume", "session": 1, "secret": 5, "received": 0},
            {"command": "names", "seen": 3},
            {"command": "prepare"},
        ]
    )


def mutated(rng: random.Random, data: bytes) -> bytes:
    """Change some bytes, or cut or double a part."""
    found = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        at = rng.randrange(len(found) + 1)
        kind = rng.randrange(4)
        if kind == 0:
            del found[at:]
        elif kind == 1:
            found[at:at] = found[at : at + rng.randrange(40)]
        elif at < len(found):
            found[at] = rng.randrange(256) if kind == 2 else found[at] ^ 1 << rng.randrange(8)
    return bytes(found)


def made(url: str, *, reset: bool = True, **fields: Any) -> Peer:
    """Connect and make environments, as an honest client does."""
    peer = Peer(url)
    answer = peer.call("make", **{"objects": CAN, "num_envs": 1, **fields})
    assert "error" not in answer, answer
    if reset:
        assert "error" not in peer.call("reset", seed=1)
    return peer


def _exchange(url: str, count: int, message: Callable[[], bytes], begin: Callable[[str], Peer] = Peer) -> int:
    """Send messages in batches; wait after each until the server answers a command, and connect again if it closes."""
    peer, sent = begin(url), 0
    while sent < count:
        batch = [message() for _ in range(min(_BATCH, count - sent))]
        sent += len(batch)
        try:
            peer.socket.sendall(b"".join(batch))
            peer.call("names")
        except OSError:
            peer.socket.close()
            peer = begin(url)
    peer.socket.close()
    return sent


def garbage(url: str, rng: random.Random, count: int) -> int:
    return _exchange(url, count, lambda: frame(rng.randbytes(rng.choice((0, 1, 9, 60, 400)))))


def mutated_commands(url: str, rng: random.Random, count: int) -> int:
    return _exchange(url, count, lambda: frame(mutated(rng, msgpack({"id": rng.randrange(99), **commands(rng)}))))


def mutated_in_session(url: str, rng: random.Random, count: int) -> int:
    """Against a session that has environments."""
    return _exchange(url, count, lambda: frame(mutated(rng, msgpack({"id": 5, **commands(rng)}))), made)


def absurd(url: str, rng: random.Random, count: int) -> int:
    """Send valid commands with an absurd value in one field, or two."""

    def message() -> bytes:
        command = commands(rng)
        for name in rng.choices([*command, "seen", "shm"], k=rng.choice((1, 2))):
            command[name] = rng.choice(_HUGE)
        return frame(msgpack({"id": 7, **command}))

    return _exchange(url, count, message, lambda url: made(url, reset=rng.random() < 0.5))


def texts(url: str, rng: random.Random, count: int) -> int:
    return _exchange(url, count, lambda: frame(rng.choice((b"", b"{}", b"hello" * 50)), opcode=1))


def broken_frames(url: str, rng: random.Random, count: int) -> int:
    """Half a frame, frames of 2 GB, without mask, of kinds that do not exist, and after the end: a connection each."""
    kinds = [
        frame(b"", length=1 << 31),
        frame(b"", length=(1 << 63) - 1),
        frame(b"x", mask=False),
        frame(b"x", opcode=7),
        frame(b"x", opcode=0),
        frame(b"x" * 126, opcode=9),
        frame(b"x", opcode=9, fin=False),
        frame(b"", opcode=8) + frame(b"x"),
        b"\xff" * 64,
    ]
    for index in range(count):
        with Peer(url) as peer:
            peer.socket.sendall(kinds[index % len(kinds)])
            assert peer.closed(20.0), f"kind {index % len(kinds)}"
    return count


def half_frames(url: str, rng: random.Random, count: int) -> int:
    """Half a frame each, and silence until all are there."""
    with contextlib.ExitStack() as stack:
        for _ in range(min(count, 200)):
            peer = stack.enter_context(Peer(url))
            peer.socket.sendall(frame(b"\x81" * 10, length=1 << 20))
        time.sleep(0.5)
    return min(count, 200)


def continuations(url: str, rng: random.Random, count: int) -> int:
    """Send a message without end, of tiny parts."""
    with Peer(url) as peer, contextlib.suppress(OSError):
        peer.send(b"", fin=False)
        part = frame(b"x", opcode=0, fin=False) * 1000
        for _ in range(count // 1000 + 1):
            peer.socket.sendall(part)
    return count


def unread(url: str, rng: random.Random, count: int) -> int:
    """Commands with large answers, none of which is read, until the server reads no more; then the client is gone."""
    peer = made(url, num_envs=4, keywords={"obs": ["rgb", "depth"], "image_size": 256})
    peer.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    peer.socket.settimeout(0.5)
    sent = 0
    with contextlib.suppress(TimeoutError):
        while sent < min(count, 20_000):
            peer.submit("observe")
            sent += 1
    peer.socket.close()
    return sent


def cancels(url: str, rng: random.Random, count: int) -> int:
    """Step and cancel in turn."""
    step = {"id": 5, "command": "step", "actions": np.zeros((4, ACTION), np.float32)}
    cancel = {"id": 6, "command": "cancel"}
    return _exchange(url, count, lambda: frame(msgpack(rng.choice((step, cancel)))), lambda url: made(url, num_envs=4))


def unacknowledged(url: str, rng: random.Random, count: int) -> int:
    """Ask for small answers of which the client never says that it has them; it could come back, so they are kept."""
    with made(url, grace=1.0) as peer:
        for _ in range(count // _BATCH):
            for _ in range(_BATCH):
                number = peer.submit("cancel")
            peer.answer(number)
    return count


def names(url: str, rng: random.Random, count: int) -> int:
    """Name thousands of object sets, the same one or others, twice at once; others' environments are made meanwhile."""
    kinds = [
        ["ycb:002_master_chef_can"] * 20_000,
        [f"procedural:can:{seed}" for seed in range(20_000)] * 2,
        [f"procedural:can:{seed}-99999" for seed in range(20_000)],
        [f"ycb:{'x' * 20}{index}" for index in range(20_000)],
    ]
    for index in range(count // 5):
        with Peer(url) as one, Peer(url) as two:
            asked = [(peer, peer.submit("make", objects=kinds[index % len(kinds)])) for peer in (one, two)]
            started = time.monotonic()
            with made(url, reset=False) as honest:
                honest.call("names")
            assert time.monotonic() - started < 10.0, f"kind {index % len(kinds)}"
            for peer, number in asked:
                error = peer.answer(number)["error"]
                assert error["type"] == "ObjectSetError", error
                assert len(error["message"]) < 1000
    return 2 * (count // 5)


def closes(url: str, rng: random.Random, count: int) -> int:
    """Sessions that are closed, or resumed wrongly, while they step."""
    for index in range(count):
        with made(url, num_envs=2) as peer:
            peer.submit("step", actions=np.zeros((2, ACTION), np.float32))
            if index % 2:
                peer.submit("close")
            else:
                found = peer.call("resume", session=rng.randrange(9), secret=rng.getrandbits(64), received=0)
                assert found["error"]["type"] == "ConnectionLostError"
    return count


def resumed_away(url: str, rng: random.Random, count: int) -> int:
    """Sessions whose client resumes another one instead; only that other one may stay."""
    with Peer(url) as first:
        ticket = first.call("make", objects=CAN, grace=1.0)
        for _ in range(count):
            with made(url, reset=False) as peer:
                peer.call("resume", session=ticket["session"], secret=ticket["secret"], received=2)
    return count


def states(url: str, rng: random.Random, count: int) -> int:
    """States that were changed, and random ones; the real one fits afterwards."""
    with made(url, objects="procedural:can:0-3") as peer:
        state = peer.call("get_state", env_id=0)["state"]
        for _ in range(count):
            wrong = rng.choice((mutated(rng, state), rng.randbytes(rng.randrange(200))))
            found = peer.call("set_state", env_id=0, state=wrong)
            assert found["error"]["type"] == "ConfigError" if wrong != state else True
        assert "error" not in peer.call("set_state", env_id=0, state=state)
    return count


def silent(url: str, rng: random.Random, count: int) -> int:
    """Hold connections that send nothing, or half a head of a request; more than the server takes."""
    with contextlib.ExitStack() as stack:
        for index in range(min(count, 2000)):
            with contextlib.suppress(OSError):
                plain = stack.enter_context(open_socket(url, 2.0))
                if index % 2:
                    plain.sendall(b"GET / HTTP/1.1\r\nHost: x\r\nX-Slow: ")
        time.sleep(1.0)
    return min(count, 2000)


def requests(url: str, rng: random.Random, count: int) -> int:
    """Headers that are too large or missing, and requests without an answer."""
    heads = [
        "GET / HTTP/1.1\r\n" + "X: " + "y" * 100_000 + "\r\n\r\n",
        "GET / HTTP/1.1\r\n" + "X: y\r\n" * 5000 + "\r\n",
        "GET /" + "a" * 50_000 + " HTTP/1.1\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n",
        "POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 99999999999\r\nConnection: close\r\n\r\n",
        "POST / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\nConnection: close\r\n\r\nffffffffffffffff\r\n",
        "\x16\x03\x01 no TLS here",
        "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    ]
    for index in range(count):
        found = http(url, heads[index % len(heads)])
        assert b" 101 " not in found, found[:200]
        assert b" 500 " not in found, found[:200]
    return count


#: Activity of a client when it is killed.
_VICTIM = """
import sys
sys.path.insert(0, {folder!r})
from hostile_attacks import ACTION, CAN, Peer, frame, made, np
url, how = sys.argv[1:]
peer = Peer(url) if how == "make" else made(url, num_envs=8)
if how == "frame":
    peer.socket.sendall(frame(b"x" * 1000, length=1 << 20))
print("ready", flush=True)
while how == "step":
    peer.call("step", actions=np.zeros((8, ACTION), np.float32))
if how == "make":
    peer.submit("make", objects="procedural:can:0-2000", num_envs=64)
    print("sent", flush=True)
sys.stdin.read()
"""


def kill(url: str, rng: random.Random, count: int) -> int:
    """Kill processes in mid-step, in mid-make and in mid-frame."""
    program = _VICTIM.format(folder=str(Path(__file__).parent))
    for index in range(count):
        how = ("step", "make", "frame")[index % 3]
        command = [sys.executable, "-c", program, url, how]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as victim:
            assert victim.stdout is not None
            assert victim.stdout.readline() == b"ready\n"
            if how == "make":
                victim.stdout.readline()
            time.sleep(0.02 * rng.random())
            victim.kill()
    return count


def resets(url: str, rng: random.Random, count: int) -> int:
    """Reset connections, instead of closing them, with a pending command."""
    for _ in range(count):
        peer = Peer(url)
        peer.submit("make", objects=CAN, num_envs=1)
        peer.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        peer.socket.close()
    return count


#: Every attack by name, and its share of the messages of a campaign; 0: as many as there are connections.
ATTACKS: dict[str, tuple[Attack, float]] = {
    "garbage frames": (garbage, 0.30),
    "mutated commands": (mutated_commands, 0.25),
    "mutated commands in a session": (mutated_in_session, 0.15),
    "text frames": (texts, 0.10),
    "continuations": (continuations, 0.10),
    "cancel storm": (cancels, 0.05),
    "answers never acknowledged": (unacknowledged, 0.03),
    "absurd values": (absurd, 0.02),
    "changed states": (states, 0.01),
    "broken frames": (broken_frames, 0),
    "half a frame, then silence": (half_frames, 0),
    "large answers, never read": (unread, 0),
    "thousands of object sets named": (names, 0),
    "close and wrong resume in mid-step": (closes, 0),
    "another session taken up": (resumed_away, 0),
    "silent and slow connections": (silent, 0),
    "hostile requests": (requests, 0),
    "connections reset": (resets, 0),
}
