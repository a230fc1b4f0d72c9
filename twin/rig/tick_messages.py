"""Messages of one tick on the drive plane: what a stack is sent, and whether it answered all."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec import structs

from schemas import SCHEMA_VERSION
from schemas.messages import Command, Episode, Frame, Tick
from schemas.wire import topics
from twin.base.errors import StackFaultError
from twin.fabric.drive import Outgoing, Transport
from twin.rig.slot import RigTick, Slots

if TYPE_CHECKING:
    from twin.rig.engine import Engine
    from twin.sensors.data import SensorData


class TickMessages:
    """Makes the messages of a rig's ticks; a rig has one."""

    def __init__(
        self,
        engine: Engine,
        slots: Slots,
        device: str,
        transport: Transport,
        offsets: dict[str, int],
    ) -> None:
        """Take what the messages of a rig are made of.

        Args:
            engine: of the rig.
            slots: of the rig.
            device: where it computes.
            transport: how large arrays reach the stack.
            offsets: places of arrays in shared memory, by sensor message.
        """
        self._engine = engine
        self._slots = slots
        self._device = device
        self._transport = transport
        self._offsets = offsets
        self._handles: dict[str, bytes] = {}

    def tick(self, seq: int, sensors: list[str], episodes: int) -> Tick:
        """Message that names the others of a tick; ``episodes``: how many begin with it."""
        slots = self._slots.by_index
        return Tick(
            v=SCHEMA_VERSION,
            seq=seq,
            active=[slot is not None for slot in slots],
            token=[slot.lease.token if slot else 0 for slot in slots],
            tick=self._engine.tick.tolist(),
            sim_time_ns=self._engine.sim_time_ns.tolist(),
            sensors=sensors,
            episodes=episodes,
        )

    def episodes(self, seq: int) -> list[Episode]:
        """Episodes of the cases that the stack has not seen yet."""
        return [
            Episode.of(
                slot.lease.case,
                seq=seq,
                slot=slot.index,
                token=slot.lease.token,
                cameras=self._engine.camera_sites,
                lidars=self._engine.lidar_sites,
                device=self._device,
            )
            for slot in self._slots.running
            if slot.fresh
        ]

    def frames(self, seq: int, told: dict[str, SensorData]) -> list[Outgoing]:
        """A message per sensor."""
        slots = self._slots.by_index
        common = Frame(
            v=SCHEMA_VERSION,
            type="",
            seq=seq,
            active=[slot is not None for slot in slots],
            case=[slot.name if slot else "" for slot in slots],
            token=[slot.lease.token if slot else 0 for slot in slots],
            tick=self._engine.tick.tolist(),
            sim_time_ns=self._engine.sim_time_ns.tolist(),
            dtype="",
            shape=[],
            encoding="",
        )
        if self._transport == "device":
            self._engine.wait()
        return [self._frame(name, data, common) for name, data in told.items()]

    def checked(self, tick: RigTick, commands: list[Command]) -> list[Command | None]:
        """Commands by slot.

        Raises:
            StackFaultError: a slot has no valid one; it names the slot's case.
        """
        by_slot = {command.slot: command for command in commands}
        checked: list[Command | None] = [None] * len(self._slots)
        active = {slot.index for slot in self._slots.running}
        if odd := sorted(by_slot.keys() - active):
            raise StackFaultError(f"stack: command for slot {odd[0]}, which is not active")
        if len(by_slot) < len(commands):
            slots = Counter(command.slot for command in commands)
            twice = next(slot for slot in self._slots.running if slots[slot.index] > 1)
            raise StackFaultError(f"stack: two commands for case {twice.lease.case.id}")
        for slot in self._slots.running:
            command, case = by_slot.get(slot.index), slot.lease.case.id
            expected = slot.lease.token, tick.message.tick[slot.index]
            if command is None:
                raise StackFaultError(f"stack: no command for case {case}")
            if (command.token, command.tick) != expected:
                raise StackFaultError(
                    f"stack: command of case {case} is for {_not_echoed(command, *expected)}"
                )
            checked[slot.index] = command
        return checked

    def _frame(self, name: str, data: SensorData, common: Frame) -> Outgoing:
        """Message of one sensor; an array in shared memory has no payload."""
        handle, offset, payload = b"", -1, b""
        if self._transport == "device" and data.device is not None:
            handle = self._handle(name, data.device)
            dtype, shape = np.dtype(data.device.__cuda_array_interface__["typestr"]), data.shape
        else:
            values = np.ascontiguousarray(data.values)
            dtype, shape = values.dtype, values.shape
            if name in self._offsets and self._transport != "bytes":
                offset = self._offsets[name]
            else:
                payload = values.tobytes()
        frame = structs.replace(
            common,
            type=name,
            dtype=dtype.newbyteorder("<").str,
            shape=list(shape),
            encoding=topics.sensor_topic(name).type,
            count=[] if data.count is None else data.count.tolist(),
            offset=offset,
            handle=handle,
        )
        return Outgoing(name, frame, payload)

    def _handle(self, name: str, array: Any) -> bytes:
        """The handle of an array that stays where it is."""
        if name not in self._handles:
            from twin.base.gpu.cuda import handle_of

            self._handles[name] = handle_of(array)
        return self._handles[name]


def _not_echoed(command: Command, token: int, tick: int) -> str:
    """Mistakes of a command that does not echo token and tick, in a line."""
    echoes = (("token", command.token, token), ("tick", command.tick, tick))
    wrong = [
        f"{name} {echoed}, expected {asked}" for name, echoed, asked in echoes if echoed != asked
    ]
    return f"{' and '.join(wrong)}; echo those of the observation"
