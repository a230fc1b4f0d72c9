"""A cable between two hosts as a program: it can be pulled, lose and delay packets.

Both ends are TUN devices, and every packet passes this process. So it needs no kernel module for
loss or delay, and what is lost follows from a seed. `python wire.py ONE TWO` opens ``wire0`` in
both network namespaces, says ``ready``, and reads a JSON line of :class:`Weather` at a time from
standard input; end of file ends it.
"""

from __future__ import annotations

import ctypes
import fcntl
import heapq
import json
import os
import random
import select
import struct
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import IO, TYPE_CHECKING, cast

if TYPE_CHECKING:
    from namespaces import Host

DEVICE = "wire0"
MTU = 1500
"""Largest packet [bytes]."""
WAITING_MAX = 4096
"""Packets on their way; more are lost, as in any router."""
_TUNSETIFF, _IFF_TUN, _IFF_NO_PI, _CLONE_NEWNET = 0x400454CA, 0x1, 0x1000, 0x40000000


@dataclass(frozen=True, slots=True)
class Weather:
    """What happens to packets, from the first host to the second and back."""

    loss_there: float = 0.0
    """Share of packets that is lost, 0 to 1; 1: none arrives."""
    loss_back: float = 0.0
    delay_s: float = 0.0
    """Each way [s]."""


class Wire:
    """The cable's process, and its handle."""

    def __init__(self, one: Host, two: Host, network: str) -> None:
        """Join the hosts; they get ``network``.1 and ``network``.2."""
        self._child = subprocess.Popen(
            [sys.executable, __file__, one.name, two.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert self._out.readline() == "ready\n", "the wire did not start; its words are above"
            for number, host in enumerate((one, two), 1):
                address = f"{network}.{number}"
                ip = ("ip", "-n", host.name)
                subprocess.run([*ip, "addr", "add", f"{address}/24", "dev", DEVICE], check=True)
                subprocess.run([*ip, "link", "set", DEVICE, "up"], check=True)
                host.addresses.append(address)
        except BaseException:
            self.close()
            raise

    @property
    def _out(self) -> IO[str]:
        return cast(IO[str], self._child.stdout)

    def set(self, weather: Weather) -> None:
        """From now on; returns when it holds."""
        stdin = cast(IO[str], self._child.stdin)
        stdin.write(json.dumps(asdict(weather)) + "\n")
        stdin.flush()
        assert self._out.readline() == "set\n", "the wire has ended"

    def close(self) -> None:
        """Cut it for good."""
        self._child.kill()
        self._child.wait()
        for stream in (self._child.stdin, self._child.stdout):
            if stream is not None:
                with suppress(BrokenPipeError):
                    stream.close()


def _open_end(namespace: str) -> int:
    """A TUN device in a network namespace; the descriptor stays valid outside."""
    libc = ctypes.CDLL(None, use_errno=True)
    place = os.open(f"/run/netns/{namespace}", os.O_RDONLY)
    if libc.setns(place, _CLONE_NEWNET):
        raise OSError(ctypes.get_errno(), f"namespace {namespace}")
    os.close(place)
    end = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    request = struct.pack("16sH22x", DEVICE.encode(), _IFF_TUN | _IFF_NO_PI)
    fcntl.ioctl(end, _TUNSETIFF, request)
    return end


def _carry(ends: tuple[int, int]) -> None:
    """Pass packets on until standard input ends."""
    dice = random.Random(0)
    weather = Weather()
    waiting: list[tuple[float, int, int, bytes]] = []
    number = 0
    while True:
        patience_s = max(0.0, waiting[0][0] - time.monotonic()) if waiting else None
        ready, _, _ = select.select([*ends, 0], [], [], patience_s)
        if 0 in ready:
            # Unbuffered: a line that a buffer held back would never wake `select`.
            line = os.read(0, 4096)
            if not line:
                return
            weather = Weather(**json.loads(line))
            os.write(1, b"set\n")
        for side, end in enumerate(ends):
            if end not in ready:
                continue
            loss = weather.loss_back if side else weather.loss_there
            with suppress(BlockingIOError):
                while packet := os.read(end, MTU + 64):
                    if dice.random() >= loss and len(waiting) < WAITING_MAX:
                        number += 1
                        due_s = time.monotonic() + weather.delay_s
                        heapq.heappush(waiting, (due_s, number, ends[1 - side], packet))
        now_s = time.monotonic()
        while waiting and waiting[0][0] <= now_s:
            _, _, end, packet = heapq.heappop(waiting)
            with suppress(OSError):  # the device is down, or full: the packet is lost
                os.write(end, packet)


if __name__ == "__main__":
    pair = (_open_end(sys.argv[1]), _open_end(sys.argv[2]))
    print("ready", flush=True)
    _carry(pair)
