"""Lockstep ticks per second of the drive plane, beside the bridges. No simulator.

One slot, two pictures of 640x360 and a sweep of 32 x 1024 points with every tick, a stack that
looks at nothing. All peers get the same sensors from the same end of the lockstep; the AutoDRIVE
bridge turns them into JPEG, base64 and JSON, as its protocol wants it, that to ROS 2 into CDR. The
latter gets one picture, as is its target.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import secrets
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from schemas import SCHEMA_VERSION
from schemas.kinds.bridge import AUTODRIVE, ROS2, lacking_bridges
from schemas.kinds.sensor import sensor_kinds
from schemas.messages import (
    VEHICLE_COLUMNS,
    CameraSite,
    Episode,
    Frame,
    LidarSite,
    Tick,
)
from schemas.sections.autonomy import Autonomy
from schemas.sections.lens import Lens
from schemas.sections.lidar import POINT_COLUMNS
from schemas.wire import topics
from twin.base.errors import InfrastructureError
from twin.base.process import end, how_it_ended, last_lines, spawn
from twin.base.progress import steps
from twin.fabric.drive import Outgoing, SimulatorEnd
from twin.fabric.endpoint import LOOPBACK
from twin.fabric.frames import FrameBuffer, FrameChannel, lay_out
from twin.fabric.rig_folder import RigFolder, frames_socket
from twin.fabric.zenoh_bus import open_bus
from twin.sandbox.possible import why_not
from twin.sandbox.reads import python_reads
from twin.sandbox.start import spawn_inside
from twin.sandbox.view import SandboxView

TARGET_TICKS_PER_S = 300.0
TARGET_RATIO = 20.0
TARGET_ROS2_TICKS_PER_S = 200.0
ROUNDS = 3
"""Measurements of each peer, in turns; the median counts."""
WIDTH, HEIGHT = 640, 360
CHANNELS, COLUMNS = 32, 1024
PATIENCE_S = 60.0
"""Longest wait for an answer [s]."""
PERIOD_NS = 50_000_000
NEEDED = ("socketio", "eventlet", "websockets")
"""Packages of the bridge and its script."""

PEERS = ("shared", "loopback", "payload", "bridge", "nodes", "memory")
"""What is measured, in the order of the figures."""

CHANNEL_LIST = (
    FrameChannel("camera", (1, HEIGHT, WIDTH, 3), "|u1"),
    FrameChannel("camera.front_left", (1, HEIGHT, WIDTH, 3), "|u1"),
    FrameChannel("lidar.roof", (1, CHANNELS * COLUMNS, len(POINT_COLUMNS)), "<f4"),
)
SMALL = {
    "vehicle": (len(VEHICLE_COLUMNS), "<f8"),
    **{
        kind.name: (len(kind.columns), kind.dtype)
        for kind in map(sensor_kinds().find, AUTODRIVE.sensors)
    },
}


@dataclass(frozen=True, slots=True)
class DriveFigures:
    """Figures of the drive plane's bench."""

    shared_ticks_per_s: float
    """Pictures and points in shared memory, the rest over a Unix socket, as beside a simulator."""
    loopback_ticks_per_s: float
    """Pictures and points in shared memory, the rest over TCP."""
    payload_ticks_per_s: float
    """All of it over TCP, as from another host or to a stack that maps nothing."""
    bridge_ticks_per_s: float | None
    """Rate through the AutoDRIVE bridge; None: its packages are not installed."""
    ros2_ticks_per_s: float | None = None
    """Rate through the bridge to ROS 2, in a sandbox if there is one; None: likewise."""
    ros2_memory_ticks_per_s: float | None = None
    """The same with large messages in shared memory; None: no sandbox, or likewise."""

    @property
    def ratio(self) -> float | None:
        """Drive plane over bridge."""
        if self.bridge_ticks_per_s is None:
            return None
        return self.shared_ticks_per_s / self.bridge_ticks_per_s

    @property
    def missed(self) -> list[str]:
        """Targets that were not reached."""
        misses = []
        if self.shared_ticks_per_s < TARGET_TICKS_PER_S:
            misses.append(f"{self.shared_ticks_per_s:.0f} of {TARGET_TICKS_PER_S:.0f} ticks/s")
        if self.ratio is not None and self.ratio < TARGET_RATIO:
            misses.append(f"{self.ratio:.1f} of {TARGET_RATIO:.0f} times the bridge")
        ros2 = self.ros2_ticks_per_s
        if ros2 is not None and ros2 < TARGET_ROS2_TICKS_PER_S:
            misses.append(f"{ros2:.0f} of {TARGET_ROS2_TICKS_PER_S:.0f} ticks/s to ROS 2")
        return misses


def measure(ticks: int, rounds: int = ROUNDS) -> DriveFigures:
    """Time all peers in turns.

    Args:
        ticks: of the drive plane per round; the bridge gets a hundredth.
        rounds: how many turns.
    """
    with contextlib.ExitStack() as stack:
        shared = stack.enter_context(_running("devkit.idle:IdleStack", shared=True))
        loopback = stack.enter_context(_running("devkit.idle:IdleStack", shared=True, tcp=True))
        payload = stack.enter_context(_running("devkit.idle:IdleStack", shared=False, tcp=True))
        bridge = None
        if all(importlib.util.find_spec(name) for name in NEEDED):
            bridge = stack.enter_context(_running(AUTODRIVE.implementation, shared=True))
        ros2 = memory = None
        if ROS2.name not in lacking_bridges():
            ros2 = stack.enter_context(_running(ROS2.implementation, shared=True, cameras=1))
            if not why_not():
                words = {"shared_memory": True}
                memory = stack.enter_context(
                    _running(ROS2.implementation, shared=True, cameras=1, parameters=words)
                )
        rates: dict[str, list[float]] = {name: [] for name in PEERS}
        for _ in steps("rounds", range(rounds)):
            rates["shared"].append(shared.rate(ticks))
            rates["loopback"].append(loopback.rate(ticks))
            rates["payload"].append(payload.rate(ticks))
            if bridge is not None:
                rates["bridge"].append(bridge.rate(max(3, ticks // 100)))
            if ros2 is not None:
                rates["nodes"].append(ros2.rate(max(3, ticks // 4)))
            if memory is not None:
                rates["memory"].append(memory.rate(max(3, ticks // 4)))
    median = {name: statistics.median(values) for name, values in rates.items() if values}
    return DriveFigures(*(median.get(name) for name in PEERS))  # type: ignore[arg-type]


def lines(found: DriveFigures) -> list[str]:
    """Figures in lines for people."""
    size = f"2 x {WIDTH}x{HEIGHT} RGB and {CHANNELS} x {COLUMNS} points per tick, one slot"
    socket = found.shared_ticks_per_s / found.loopback_ticks_per_s
    shown = [
        f"{found.shared_ticks_per_s:,.0f} lockstep ticks/s in shared memory, by a Unix socket "
        f"(target {TARGET_TICKS_PER_S:.0f}); {size}",
        f"{found.loopback_ticks_per_s:,.0f} ticks/s in shared memory, by TCP on this host: "
        f"the socket has {socket:.2f} times as many",
        f"{found.payload_ticks_per_s:,.0f} ticks/s as payload over TCP",
    ]
    if found.ros2_ticks_per_s is None:
        shown.append(f"no rate to ROS 2: {lacking_bridges().get(ROS2.name, 'not asked for')}")
    else:
        shown.append(
            f"{found.ros2_ticks_per_s:,.0f} ticks/s through the bridge to ROS 2 "
            f"(target {TARGET_ROS2_TICKS_PER_S:.0f}); one picture, the node comes by "
            f"{'TLS: there is no sandbox' if why_not() else 'TCP in its sandbox'}"
        )
    if found.ros2_memory_ticks_per_s is not None:
        shown.append(f"{found.ros2_memory_ticks_per_s:,.0f} ticks/s with shared_memory: true")
    if found.ratio is None:
        return [*shown, f"no ratio: the bridge needs {', '.join(NEEDED)}"]
    bridge = f"{found.bridge_ticks_per_s:,.1f} ticks/s through the AutoDRIVE bridge"
    return [*shown, f"{bridge}: {found.ratio:.0f} times (target {TARGET_RATIO:.0f})"]


def as_json(found: DriveFigures) -> dict[str, Any]:
    """Figures for ``--output json``."""
    targets = {"target_ticks_per_s": TARGET_TICKS_PER_S, "target_ratio": TARGET_RATIO}
    targets["target_ros2_ticks_per_s"] = TARGET_ROS2_TICKS_PER_S
    return {**asdict(found), "ratio": found.ratio, **targets}


class _Peer:
    """Our end of a rig without a simulator."""

    def __init__(
        self, end: SimulatorEnd, buffer: FrameBuffer | None, check: Any, cameras: int
    ) -> None:
        self._end, self._check = end, check
        self._channels = CHANNEL_LIST if cameras == 2 else CHANNEL_LIST[::2]
        self._cameras = cameras
        rng = np.random.default_rng(1)
        self._offsets, _ = lay_out(CHANNEL_LIST)
        self._bytes = {}
        for channel in CHANNEL_LIST:
            values = (100 * rng.random(channel.shape)).astype(channel.dtype)
            if buffer is not None:
                buffer.array(channel, self._offsets[channel.name])[...] = values
            self._bytes[channel.name] = values.tobytes()
        self._seq = 0

    def rate(self, ticks: int) -> float:
        """Ticks per second; the first ticks of all are not counted."""
        for _ in range(3):
            self._exchange()
        started_s = time.perf_counter()
        for _ in range(ticks):
            self._exchange()
        return ticks / (time.perf_counter() - started_s)

    def _exchange(self) -> None:
        seq = self._seq
        stamp: dict[str, Any] = {
            "v": SCHEMA_VERSION,
            "seq": seq,
            "active": [True],
            "token": [1],
            "tick": [seq],
            "sim_time_ns": [seq * PERIOD_NS],
        }
        sensors = [self._large(channel, stamp) for channel in self._channels]
        sensors += [_small(name, *form, stamp) for name, form in SMALL.items()]
        episodes = [_episode(self._cameras)] if seq == 0 else []
        tick = Tick(**stamp, sensors=[s.name for s in sensors], episodes=len(episodes))
        self._end.exchange(seq, tick, sensors, episodes, self._check)
        self._seq += 1

    def _large(self, channel: FrameChannel, stamp: dict[str, Any]) -> Outgoing:
        shared = self._end.transport == "memory"
        offset = self._offsets[channel.name] if shared else -1
        frame = _frame(channel.name, channel.dtype, channel.shape, stamp, offset)
        return Outgoing(channel.name, frame, b"" if shared else self._bytes[channel.name])


def _small(name: str, columns: int, dtype: str, stamp: dict[str, Any]) -> Outgoing:
    values = np.ones((1, columns), dtype)
    return Outgoing(name, _frame(name, dtype, values.shape, stamp, -1), values.tobytes())


def _frame(
    name: str, dtype: str, shape: tuple[int, ...], stamp: dict[str, Any], offset: int
) -> Frame:
    encoding = topics.sensor_topic(name).type
    fields = {"type": name, "case": ["bench"], "dtype": dtype, "shape": list(shape)}
    return Frame(**stamp, **fields, encoding=encoding, offset=offset)


@contextlib.contextmanager
def _running(
    stack: str,
    *,
    shared: bool,
    tcp: bool = False,
    cameras: int = 2,
    parameters: Mapping[str, Any] | None = None,
) -> Iterator[_Peer]:
    """A stack process that is ready, and its end afterwards."""
    rig = secrets.token_hex(4)
    folder = RigFolder()
    listen = LOOPBACK if tcp else folder.drive
    bus = open_bus("peer", listen=[listen], namespace=f"bench/{rig}")
    size = lay_out(CHANNEL_LIST)[1]
    buffer = FrameBuffer(size, frames_socket(folder.drive)) if shared else None
    arguments = [
        *("--connect", bus.endpoints[0], "--rig", rig, "--namespace", f"bench/{rig}"),
        *("--stack", stack, "--slots", "1"),
    ]
    if stack == AUTODRIVE.implementation:
        port = 20_000 + secrets.randbelow(10_000)
        script = str(Path(__file__).with_name("drive_script.py"))
        command = [sys.executable, script, str(port)]
        arguments += ["--foreign", json.dumps({"command": command, "bridge": AUTODRIVE.name})]
        arguments += ["--parameters", json.dumps({"port": port})]
    if stack == ROS2.implementation:
        command = [sys.executable, "-m", "twin.bench.drive_node"]
        arguments += ["--foreign", json.dumps({"command": command, "bridge": ROS2.name})]
        arguments += ["--parameters", json.dumps(parameters or {})]
    with tempfile.TemporaryFile() as log:
        words = [sys.executable, "-m", "devkit", "host", *arguments]
        if stack == ROS2.implementation and not why_not():
            reads = [*python_reads(), folder.path]
            child = spawn_inside(words, SandboxView(readable=reads, folder=Path.cwd()), log)
        else:
            child = spawn(words, log=log)

        def check() -> None:
            if (code := child.poll()) is not None:
                raise InfrastructureError(f"{stack} {how_it_ended(code)}: {last_lines(log)}")

        try:
            link = SimulatorEnd(bus, rig, 1, buffer, resend_s=PATIENCE_S)
            link.handshake(check)
            yield _Peer(link, buffer, check, cameras)
        finally:
            end(child)
            bus.close()
            if buffer is not None:
                buffer.close()
            folder.close()


def _episode(cameras: int) -> Episode:
    messages = {"front_right": "camera", "front_left": "camera.front_left"}
    sites = [
        CameraSite(
            name=name,
            message=message,
            width=WIDTH,
            height=HEIGHT,
            hz=20,
            hfov_deg=70.0,
            position_m=[2.0, 0.0, 1.3],
            rotation_deg=[0.0, 0.0, 0.0],
            lens=Lens(),
        )
        for name, message in list(messages.items())[:cameras]
    ]
    lidar = LidarSite(
        name="roof",
        message="lidar.roof",
        hz=20,
        channels=CHANNELS,
        columns=COLUMNS,
        fields=list(POINT_COLUMNS),
        position_m=[1.3, 0.0, 1.9],
        rotation_deg=[0.0, 0.0, 0.0],
    )
    return Episode(
        v=SCHEMA_VERSION,
        seq=0,
        slot=0,
        token=1,
        case="bench",
        seed=1,
        model="default",
        perception=Autonomy().perception["default"],
        camera="front_right",
        width=WIDTH,
        height=HEIGHT,
        hfov_deg=70.0,
        control_period_ns=PERIOD_NS,
        cameras=sites,
        lidars=[lidar],
    )
