"""A rig without a simulator: a real stack process, and our end of its lockstep."""

from __future__ import annotations

import contextlib
import json
import secrets
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import msgspec

from schemas.case import Case
from schemas.messages import Commands, Episode, Tick
from twin.base.errors import InfrastructureError
from twin.base.process import bound_log, end, how_it_ended, last_lines, spawn
from twin.fabric.bus import Bus
from twin.fabric.drive import STACK_BYTES_MAX, Outgoing, SimulatorEnd
from twin.fabric.endpoint import LOOPBACK
from twin.fabric.zenoh_bus import open_bus

RESEND_S = 0.5
"""A seq without an answer is published again after this long [s]."""

END_S = 5.0
"""Longest wait for the end of everything that a stack started [s]."""


class StackRig:
    """One stack process with S slots; exchanges ticks with it."""

    def __init__(
        self, case: Case, slots: int, bus: Bus, rig: str, child: subprocess.Popen[bytes], log: Any
    ) -> None:
        self._case, self._slots = case, slots
        self._child, self._log = child, log
        self._end = SimulatorEnd(bus, rig, slots, None, resend_s=RESEND_S)
        self._seq = 0
        self._token = 1 << 32  # as in a campaign, and too large for 32 bits

    def handshake(self, timeout_s: float) -> None:
        """Wait until the stack is ready.

        Raises:
            InfrastructureError: it ends, or takes too long; one line with its last words.
        """
        self._end.handshake(self._patience(timeout_s, "does not say that it is ready"))

    def exchange(
        self,
        tick: Tick,
        sensors: list[Outgoing],
        episodes: list[Episode],
        timeout_s: float,
        what: str,
    ) -> Commands:
        """The answer to one tick.

        Args:
            tick: names the sensors.
            sensors: their messages.
            episodes: cases that begin.
            timeout_s: longest wait [s].
            what: is not done if there is no answer, as in ``does not answer tick 3``.

        Raises:
            InfrastructureError: there is none; one line with the stack's last words.
        """
        bound_log(self._log)
        return self._end.exchange(
            tick.seq, tick, sensors, episodes, self._patience(timeout_s, what)
        )

    def _patience(self, timeout_s: float, what: str) -> Callable[[], None]:
        until_s = time.monotonic() + timeout_s

        def wait() -> None:
            bound_log(self._log)
            code = self._child.poll()
            if code is not None:
                raise InfrastructureError(f"stack {how_it_ended(code)}{self._words()}")
            if time.monotonic() > until_s:
                raise InfrastructureError(f"stack {what} within {timeout_s:g} s{self._words()}")

        return wait

    def _words(self) -> str:
        tail = last_lines(self._log)
        return f": {tail}" if tail else ""


R = TypeVar("R", bound=StackRig)


@contextlib.contextmanager
def running(kind: type[R], case: Case, slots: int, timeout_s: float) -> Iterator[R]:
    """A stack process that is ready, and its end afterwards.

    Raises:
        InfrastructureError: it does not get ready.
    """
    rig = secrets.token_hex(4)
    namespace = f"devkit/{rig}"
    limit = STACK_BYTES_MAX
    bus = open_bus("peer", listen=[LOOPBACK], namespace=namespace, message_bytes_max=limit)
    with tempfile.TemporaryFile() as log:
        arguments = [
            *("--connect", bus.endpoints[0], "--rig", rig, "--namespace", namespace),
            *("--slots", str(slots), "--stack", case.rig.stack),
            *("--parameters", json.dumps(case.rig.parameters)),
        ]
        if case.rig.foreign is not None:
            arguments += ["--foreign", msgspec.json.encode(case.rig.foreign).decode()]
        child = spawn([sys.executable, "-m", "devkit", "host", *arguments], log=log)
        try:
            stack_rig = kind(case, slots, bus, rig, child, log)
            stack_rig.handshake(timeout_s)
            yield stack_rig
        finally:
            end(child, END_S)
            bus.close()
