"""The AutoDRIVE Simulator's part, played for an unmodified script of the AutoDRIVE devkit.

The script is the Socket.IO server; the bridge connects to it as the AutoDRIVE Simulator does and
exchanges one pair of ``Bridge`` events per tick, in lockstep. A script knows no new cases: it is
started anew for each, so that no case depends on the one before.
"""

from __future__ import annotations

import socket
import sys
import time
from typing import Annotated, Any

import numpy as np
from msgspec import Meta, Struct

from devkit.bridges import ScriptBridge
from devkit.bridges.autodrive.fields import FieldError, asks_for_weather, command, telemetry
from devkit.bridges.autodrive.socketio import SocketClient, SocketError, connect
from devkit.hosting.foreign import ForeignProcess
from devkit.stack import Observation
from schemas.kinds.bridge import AUTODRIVE, lacking_bridges
from schemas.messages import Command, Episode
from schemas.sections.lidar import POINT_COLUMNS
from schemas.validation import convert_all
from twin.base.errors import InfrastructureError, StackFaultError
from twin.base.picture_file import jpeg_of
from twin.fabric.port_turn import take_turn

EVENT = "Bridge"
"""The one event of the protocol, in both directions."""

LOOK_S = 0.2
"""Time between two looks at a script that is waited for [s]."""

TICKS_PER_REV = 44.0
"""Ticks per turn of the published car's encoders; for simulators that do not say it."""

POINT = np.dtype(
    {
        "names": ["x_m", "y_m", "z_m", "intensity", "ring"],
        "formats": ["<f4", "<f4", "<f4", "<f4", "<u2"],
        "offsets": [0, 4, 8, 16, 20],
        "itemsize": 24,
    }
)
"""A point as the devkit's ROS bridges take it apart."""


class BridgeParameters(Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the bridge, under ``autonomy.parameters``."""

    host: str = "127.0.0.1"
    """Address at which the script listens."""
    port: Annotated[int, Meta(ge=1, le=65_535)] = AUTODRIVE.port
    """Port of the script; one rig of a host uses it at a time."""
    start_s: Annotated[float, Meta(gt=0, le=600)] = 30.0
    """Longest time until the script listens [s]."""
    answer_s: Annotated[float, Meta(gt=0, le=3600)] = 30.0
    """Longest time until it answers an event [s]."""
    steering_max_rad: Annotated[float, Meta(gt=0, le=1.5)] = 0.62
    """Angle of the road wheels at a steering command of 1; opencav's limit [rad]."""
    jpeg_quality: Annotated[int, Meta(ge=1, le=100)] = 75
    """JPEG quality of the pictures; 75 is what Unity's encoder uses."""
    aeb_brake: Annotated[float, Meta(gt=0, le=1)] = 1.0
    """Braking as hard as this counts as emergency braking."""


class AutodriveBridge(ScriptBridge):
    """One car, driven by a script that waits for the AutoDRIVE Simulator."""

    PARAMETERS = (BridgeParameters,)

    def __init__(self, slots: int, **parameters: Any) -> None:
        """See :class:`BridgeParameters`."""
        super().__init__(slots)
        if slots != 1:
            raise ValueError(f"given {slots} slots: the bridge drives one car; set slots: 1")
        if lack := lacking_bridges().get(AUTODRIVE.name):
            raise InfrastructureError(lack)
        checked, mistakes = convert_all(parameters, BridgeParameters)
        if checked is None:
            raise ValueError(mistakes[0].line("autonomy.parameters"))
        self._given = checked
        self._where = f"{checked.host}:{checked.port}"
        self._turn: socket.socket | None = None
        self._script: ForeignProcess | None = None
        self._client: SocketClient | None = None
        self._episode: Episode | None = None
        self._rows: dict[str, np.ndarray] = {}
        self._images: dict[str, bytes] = {}
        self._points = b""
        self._said: set[str] = set()
        self._reverse = False
        self._looked_s = 0.0

    def attach(self, script: ForeignProcess | None) -> None:
        """Start ``script`` when it is our turn.

        Raises:
            UnfinishedError: another rig of this host uses the port.
        """
        self._turn = take_turn(self._given.port)
        self._script = script
        if script is not None:
            script.start()

    def reset(self, slot: int, episode: Episode) -> None:
        """A new case: a new script, which knows nothing of the last one."""
        if self._client is not None:
            self._client.close()
            if self._script is not None:
                self._script.restart()
        try:
            self._client = connect(
                *(self._given.host, self._given.port, self._given.start_s),
                self._check_script,
            )
        except SocketError as error:
            raise InfrastructureError(
                f"script at {self._where}: {error}; it has to serve Socket.IO there"
            ) from None
        assert slot == 0, "the only slot there is"
        self._episode = episode
        self._rows, self._images, self._points = {}, {}, b""
        self._said, self._reverse = set(), False

    def step(self, observation: Observation) -> list[Command]:
        """One exchange with the script."""
        slots = observation.active_slots()
        if not slots:
            return []
        assert self._client is not None
        assert self._episode is not None
        now_s = time.monotonic()
        if now_s - self._looked_s >= LOOK_S:  # one that answers at once is never waited for
            self._check_script()
            self._looked_s = now_s
        self._look(observation, slots[0])
        tick = int(observation.tick[slots[0]])
        fields = telemetry(
            *(self._rows, self._images, self._points),
            self._episode.ticks_per_rev or TICKS_PER_REV,
            reverse=self._reverse,
        )
        try:
            self._client.emit(EVENT, fields)
            data = self._answer()
            answer = command(
                *(data, slots[0], int(observation.token[slots[0]]), tick),
                *(self._given.steering_max_rad, self._given.aeb_brake),
                cosim=self._episode.cosim,
            )
        except (SocketError, FieldError) as error:
            self._check_script()  # its own end says more than that of the connection
            kind = StackFaultError if isinstance(error, FieldError) else InfrastructureError
            raise kind(f"script at {self._where}: {error}, at tick {tick}") from None
        self._reverse = answer.reverse
        if asks_for_weather(data):
            line = "the script's time and weather are ignored: the case decides"
            self._say_once("weather", line)
        if answer.reverse:
            self._say_once(
                "reverse",
                f"V1 Throttle is negative, at tick {tick}: the car drives backwards once it is as "
                "slow as a walk, and coasts until then",
            )
        return [answer]

    def _say_once(self, what: str, line: str) -> None:
        """Once in each case that it is about, so that it stands in the case's log."""
        if what not in self._said:
            self._said.add(what)
            print(line, file=sys.stderr, flush=True)

    def close(self) -> None:
        """Leave the script, and the port to the next rig."""
        if self._client is not None:
            self._client.close()
        if self._turn is not None:
            self._turn.close()

    def _answer(self) -> Any:
        """The script's next ``Bridge`` event.

        Raises:
            SocketError: none came in time.
        """
        assert self._client is not None
        until_s = time.monotonic() + self._given.answer_s
        while (left_s := until_s - time.monotonic()) > 0:
            received = self._client.receive(min(LOOK_S, left_s))
            if received is None:
                self._check_script()
                continue
            event, data = received
            if event == EVENT:
                return data
        raise SocketError(f"no answer to '{EVENT}' within {self._given.answer_s:g} s")

    def _check_script(self) -> None:
        if self._script is not None:
            self._script.check()

    def _look(self, observation: Observation, slot: int) -> None:
        """Keep the last reading of every sensor: the script gets all of them every time."""
        for name in ("vehicle", *AUTODRIVE.sensors):
            if name in observation.sensors:
                self._rows[name] = observation.sensors[name][slot]
        assert self._episode is not None
        for site in self._episode.cameras:
            if site.message in observation.sensors:
                pixels = observation.sensors[site.message][slot]
                self._images[site.name] = jpeg_of(pixels, self._given.jpeg_quality)
        for lidar in self._episode.lidars[:1]:
            if lidar.message in observation.sensors:
                rows = observation.sensors[lidar.message][slot]
                self._points = _points(rows, lidar.columns)


def _points(rows: np.ndarray, columns: int) -> bytes:
    """The returns of a lidar, :data:`POINT` each."""
    hits = np.flatnonzero(~np.isnan(rows[:, POINT_COLUMNS.index("x_m")]))
    points = np.zeros(len(hits), POINT)
    for name in ("x_m", "y_m", "z_m", "intensity"):
        points[name] = rows[hits, POINT_COLUMNS.index(name)]
    points["ring"] = hits // columns
    return points.tobytes()
