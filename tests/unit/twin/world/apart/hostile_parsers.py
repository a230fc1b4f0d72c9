"""Parsers that a file has taken over: what they try, each as an attribute of this module."""

from __future__ import annotations

import os
import signal
import socket
import stat
import sys
import time
from pathlib import Path

import numpy as np

from twin.world.apart.checks import Text
from twin.world.apart.parser import Parser
from twin.world.meshes.apart import MESH_DATA
from twin.world.meshes.mesh_file import MeshData, Part


def orders(path: Path) -> list[str]:
    """What the file tells its parser to do."""
    return path.read_text().split("\n")


def read(path: Path) -> str:
    """The content of another file."""
    return Path(orders(path)[0]).read_text()


def write(path: Path) -> str:
    """Write to another file."""
    Path(orders(path)[0]).write_bytes(b"taken over")
    return "written"


def connect(path: Path) -> str:
    """Send the file to somebody."""
    host, port = orders(path)[0].split(":")
    with socket.create_connection((host, int(port)), timeout=5) as to:
        to.sendall(path.read_bytes())
    return "sent"


def start(_path: Path) -> str:
    """Leave a process behind."""
    if not os.fork():
        time.sleep(1000)
    return "started"


def end(path: Path) -> str:
    """Signal another process."""
    os.kill(int(orders(path)[0]), signal.SIGKILL)
    return "ended"


def allocate(_path: Path) -> str:
    """Take 50 GB."""
    return str(len(np.ones(50 << 27)))


def spin(_path: Path) -> str:
    """Compute for ever."""
    while True:
        pass


def sleep(_path: Path) -> str:
    """Wait for ever."""
    time.sleep(100_000)
    return ""


def crash(_path: Path) -> str:
    """End as a damaged process does."""
    os.kill(os.getpid(), signal.SIGSEGV)
    return ""


def leave(_path: Path) -> str:
    """End without a word."""
    os._exit(0)


def chatter(_path: Path) -> str:
    """Print what could be taken for an answer."""
    for stream in (sys.stdout, sys.stderr):
        print("\0" * 1000 + '{"error": "", "tree": 1}', file=stream, flush=True)
    os.write(1, b"\xff" * 10_000)
    return "chattered"


def _answers() -> int:
    """The pipe of answers, as a taken-over process finds it."""
    found = [int(name) for name in os.listdir("/proc/self/fd")]
    pipes = []
    for number in found:
        try:
            if stat.S_ISFIFO(os.fstat(number).st_mode):
                pipes.append(number)
        except OSError:
            continue
    return max(pipes)


def forge(path: Path) -> str:
    """Write bytes of one's own into the pipe of answers, and end."""
    pipe = _answers()
    os.write(pipe, bytes.fromhex(orders(path)[0]))
    os._exit(0)


def raise_odd(_path: Path) -> str:
    """Raise what no parser of ours raises."""
    raise KeyError("lines\nand \x1b[2J")


def triangle() -> Part:
    """A part as it should be."""
    points = np.array([[0.0, 0, 0], [2, 0, 0], [0, 3, 0]])
    return Part(points, np.array([[0, 1, 2]]), np.full((1, 3), 0.5), uv=points[:, :2].copy())


def lie(path: Path) -> MeshData:
    """Answer a mesh that is wrong in one way."""
    part, data = triangle(), MeshData([])
    changes = {
        "index": lambda: part.faces.__setitem__((0, 1), 7),
        "negative": lambda: part.faces.__setitem__((0, 1), -1),
        "nan": lambda: part.points.__setitem__((0, 0), np.nan),
        "uv-nan": lambda: part.uv.__setitem__((0, 0), np.inf),
        "flat": lambda: setattr(part, "points", part.points[:, :2].copy()),
        "type": lambda: setattr(part, "faces", part.faces.astype(np.int32)),
        "short": lambda: setattr(part, "color", part.color[:0]),
        "uv-long": lambda: setattr(part, "uv", np.zeros((9, 2))),
        "missing": lambda: setattr(part, "faces", None),
        "picture": lambda: setattr(part, "image", np.zeros((1, 4096, 3), np.uint8)),
        "pixels": lambda: setattr(part, "image", np.zeros((0, 4, 3), np.uint8)),
        "note": lambda: data.notes.append("x" * 10_000),
        "notes": lambda: data.notes.extend(["x"] * 20_000),
        "no-parts": lambda: data.parts.clear(),
    }
    data.parts.append(part)
    changes[orders(path)[0]]()
    return data


def _text(name: str) -> Parser:
    return Parser(f"{__name__}:{name}", Text(), "cannot be parsed")


READ, WRITE, CONNECT, START, END = map(_text, ("read", "write", "connect", "start", "end"))
ALLOCATE, SPIN, SLEEP, CRASH, LEAVE = map(_text, ("allocate", "spin", "sleep", "crash", "leave"))
CHATTER, FORGE, RAISE = map(_text, ("chatter", "forge", "raise_odd"))
LIE = Parser(f"{__name__}:lie", MESH_DATA, "cannot be parsed")
TRUE = Parser(f"{__name__}:forge", MESH_DATA, "cannot be parsed")
