"""The wire between the hosts, and names."""

from __future__ import annotations

import random
import signal
from collections.abc import Iterator

from fabric import Fabric
from kinds import Body, fault
from wire import Weather

LONG_S = (5.0, 7.0)
"""Longer than the four seconds after which a session gives a silent peer up."""


def _weather(words: str, weather: Weather) -> Body:
    def body(fabric: Fabric, dice: random.Random) -> Iterator[str]:
        fabric.wire.set(weather)
        yield words
        fabric.wire.set(Weather())

    return body


def _wire(name: str, weather: Weather, hold_s: tuple[float, float], stormy: bool = True) -> None:
    fault(name, hold_s, group="wire", stormy=stormy)(_weather(name, weather))


_CUT = Weather(loss_there=1.0, loss_back=1.0)
_wire("link down", _CUT, (0.5, 4.0))
_wire("link down for long", _CUT, LONG_S, stormy=False)
_wire("one-way loss, worker not heard", Weather(loss_back=1.0), (0.5, 4.0))
_wire("one-way loss, conductor not heard", Weather(loss_there=1.0), (0.5, 4.0))
_wire("200 ms delay", Weather(delay_s=0.2), (1.0, 4.0))
_wire("5 % loss", Weather(loss_there=0.05, loss_back=0.05), (1.0, 4.0))


@fault("DNS gone", (0.5, 3.0), extras=("names",), group="names")
def dns_gone(fabric: Fabric, dice: random.Random) -> Iterator[str]:
    """The name server answers nobody, and the worker dies: its successor needs the name."""
    server, worker = fabric.victim("dns", dice), fabric.victim("worker", dice)
    if server is None or worker is None:
        return
    server.send_signal(signal.SIGSTOP)
    worker.kill()
    yield f"no names, SIGKILL worker {worker.pid}"
    server.send_signal(signal.SIGCONT)
