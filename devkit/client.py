"""Interventions in a running case from Python: read and change it while it runs, at stated ticks.

    from devkit.client import Client

    with Client("yolov3-1300-clear", run="runs/aeb-demo") as case:
        case.pause()
        case.set(weather="heavy_rain", hour=22.5)
        walker = case.spawn("pedestrian", x_m=case.look().x_m + 30, y_m=0.0)
        case.step(20)
        case.drive(throttle=0.3, steering_rad=0.02)
        case.release()
        case.resume()

Every call answers with the control tick at which it was applied. An attempt that was changed gives
its case no verdict: it is journalled beside the KPIs, and the case runs once more by itself.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from schemas.settings import Value, actions_of
from schemas.validation import convert_all
from schemas.wire.interventions import (
    Action,
    ControlReply,
    FreeObject,
    GiveBack,
    InterventionState,
    MoveObject,
    Pause,
    Query,
    RemoveObject,
    Resume,
    SpawnObject,
    Step,
    Takeover,
)
from twin.base.errors import UsageError
from twin.fabric.bus import Bus
from twin.fabric.discovery import choose_target
from twin.fabric.endpoint import allow_plain
from twin.fabric.interventions import RunningAttempt, carry_out, find, find_in_rig, running
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import Mode, join

T = TypeVar("T")

CONNECT_S = 10.0
"""Longest time the other side may take to open a session [s]."""


class Client:
    """Session that intervenes in one attempt of a case; blocks until each call is answered.

    The attempt is the one that runs when the client is made. When it has ended every call raises
    ``UsageError``, and a new client finds the next.
    """

    def __init__(
        self,
        case: str,
        *,
        connect: str = "",
        run: str | Path | None = None,
        campaign: str = "",
        namespace: str = "twin",
        key: str | Path | None = None,
        insecure: bool = False,
        rig: str = "",
        slot: int = -1,
    ) -> None:
        """Find the running attempt of ``case``.

        Args:
            case: case id.
            connect: the conductor's endpoint; or, with ``rig``, that of its simulator.
            run: or: campaign or state folder of the conductor.
            campaign: if several campaigns have a case of that name.
            namespace: of the conductor; or, with ``rig``, of the rig.
            key: key file or folder of keys; by default ``keys/`` beside ``conductor.json``.
            insecure: plain TCP beyond loopback, as ``--insecure``; from then on for the whole
                process.
            rig: ask this rig's simulator directly, as a stack beside it may.
            slot: with ``rig`` and an empty ``case``: whatever runs in this slot.

        Raises:
            UsageError: no such case runs, or it takes no interventions; one line.
            InfrastructureError: nobody answers.
        """
        mode: Mode = "peer" if rig else "client"
        self._bus = _session(connect, run, namespace, key, mode, insecure=insecure)
        try:
            self._attempt: RunningAttempt = (
                find_in_rig(self._bus, rig, case, slot) if rig else find(self._bus, case, campaign)
            )
        except BaseException:
            self._bus.close()
            raise

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the session; what was changed stays, and a takeover is given back after 2 s."""
        self._bus.close()

    @property
    def state(self) -> InterventionState:
        """State of the case at the last answer."""
        return self._attempt.state

    def do(self, action: Action) -> ControlReply:
        """Any action of :mod:`schemas.wire.interventions`.

        Raises:
            UsageError: it cannot be done, or the attempt has ended; nothing has changed.
            UnreachableError: the simulator does not answer any more.
        """
        return self._attempt.do(action)

    def look(self) -> InterventionState:
        """State of the case now: weather, time of day, pose, objects; changes nothing."""
        self.do(Query())
        return self.state

    def set(self, **settings: Value) -> int:
        """Change what ``viewer set`` changes, by the same names; the tick of the last change.

        ``weather`` or intensities (``fog=0.7``), ``hour``, a pose (``x_m``, ``y_m``, ``yaw_deg``,
        ``speed_mps``), ``lights`` (``"low+left"``, ``"off"``, ``"stack"``), sensor errors
        (``gnss_noise=3``, ``imu_bias=0``, ``gnss_dropout=True``), ``pace`` (a factor or ``"max"``).

        Raises:
            UsageError: an unknown name, or a value that is not allowed or that the simulator
                refuses (no such weather, say): nothing has changed.
        """
        try:
            actions = actions_of(settings)
        except ValueError as error:
            raise UsageError(str(error)) from None
        return [reply.tick for _, reply in carry_out(self, actions)][-1]

    def pause(self) -> int:
        """Stand still; ends by itself after ten minutes without a word."""
        return self.do(Pause()).tick

    def step(self, ticks: int = 1) -> int:
        """Go on for so many ticks, then stand still; returns at once."""
        return self.do(_checked(Step, ticks=ticks)).tick

    def resume(self) -> int:
        """Let a paused case go on."""
        return self.do(Resume()).tick

    def drive(self, *, throttle: float = 0.0, brake: float = 0.0, steering_rad: float = 0.0) -> int:
        """Take the stack's place until another call or :meth:`release`; to be said again at least
        every 2 s, or the stack drives again."""
        return self.do(
            _checked(Takeover, throttle=throttle, brake=brake, steering_rad=steering_rad)
        ).tick

    def release(self) -> int:
        """The stack drives again."""
        return self.do(GiveBack()).tick

    def spawn(self, kind: str, *, x_m: float, y_m: float, **more: float) -> int:
        """Bring in an object of a kind the scene has, if one is not there now; its number.

        ``more``: ``z_m``, ``yaw_rad``, ``speed_mps``, as for :meth:`move`.
        """
        return self.do(_checked(SpawnObject, kind=kind, x_m=x_m, y_m=y_m, **more)).object

    def move(self, object_: int, *, x_m: float, y_m: float, **more: float) -> int:
        """Take an object off its script and put it somewhere, straight ahead at ``speed_mps``."""
        return self.do(_checked(MoveObject, object=object_, x_m=x_m, y_m=y_m, **more)).tick

    def remove(self, object_: int) -> int:
        """Take an object away."""
        return self.do(_checked(RemoveObject, object=object_)).tick

    def free(self, object_: int) -> int:
        """Give an object back to its script."""
        return self.do(_checked(FreeObject, object=object_)).tick


class AsyncClient:
    """:class:`Client` for ``asyncio``: the same calls, awaited.

    ::

        async with AsyncClient("yolov3-1300-clear", run="runs/aeb-demo") as case:
            await case.set(weather="heavy_fog")
    """

    def __init__(self, case: str, **options: Any) -> None:
        """A client as :class:`Client`; the session is opened by ``async with``."""
        self._case = case
        self._options = options
        self._client: Client | None = None
        # One after the other: what is done first is applied first.
        self._order = asyncio.Lock()

    async def __aenter__(self) -> AsyncClient:
        self._client = await asyncio.to_thread(Client, self._case, **self._options)
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._client is not None:
            await asyncio.to_thread(self._client.close)

    @property
    def state(self) -> InterventionState:
        """See :attr:`Client.state`."""
        return self._open.state

    async def do(self, action: Action) -> ControlReply:
        """See :meth:`Client.do`."""
        return await self._call(self._open.do, action)

    async def look(self) -> InterventionState:
        """See :meth:`Client.look`."""
        return await self._call(self._open.look)

    async def set(self, **settings: Value) -> int:
        """See :meth:`Client.set`."""
        return await self._call(self._open.set, **settings)

    async def pause(self) -> int:
        """See :meth:`Client.pause`."""
        return await self._call(self._open.pause)

    async def step(self, ticks: int = 1) -> int:
        """See :meth:`Client.step`."""
        return await self._call(self._open.step, ticks)

    async def resume(self) -> int:
        """See :meth:`Client.resume`."""
        return await self._call(self._open.resume)

    async def drive(self, **pedals: float) -> int:
        """See :meth:`Client.drive`."""
        return await self._call(self._open.drive, **pedals)

    async def release(self) -> int:
        """See :meth:`Client.release`."""
        return await self._call(self._open.release)

    async def spawn(self, kind: str, **place: float) -> int:
        """See :meth:`Client.spawn`."""
        return await self._call(self._open.spawn, kind, **place)

    async def move(self, object_: int, **place: float) -> int:
        """See :meth:`Client.move`."""
        return await self._call(self._open.move, object_, **place)

    async def remove(self, object_: int) -> int:
        """See :meth:`Client.remove`."""
        return await self._call(self._open.remove, object_)

    async def free(self, object_: int) -> int:
        """See :meth:`Client.free`."""
        return await self._call(self._open.free, object_)

    @property
    def _open(self) -> Client:
        assert self._client is not None, "use `async with AsyncClient(...)`"
        return self._client

    async def _call(self, call: Callable[..., T], *arguments: Any, **named: Any) -> T:
        async with self._order:
            return await asyncio.to_thread(call, *arguments, **named)


def running_cases(
    *,
    connect: str = "",
    run: str | Path | None = None,
    namespace: str = "twin",
    key: str | Path | None = None,
    insecure: bool = False,
) -> list[InterventionState]:
    """The attempts that take interventions now; arguments as of :class:`Client`.

    Raises:
        UsageError: no conductor there, or another version.
    """
    bus = _session(connect, run, namespace, key, "client", insecure=insecure)
    try:
        return running(bus)
    finally:
        bus.close()


def _session(
    connect: str,
    run: str | Path | None,
    namespace: str,
    key: str | Path | None,
    mode: Mode,
    *,
    insecure: bool,
) -> Bus:
    if insecure:
        allow_plain()
    folder = Path(run) if run is not None else None
    path = Path(key) if key is not None else None
    target = choose_target(connect, folder, namespace, path, Role.admin)
    return join(target, CONNECT_S, mode)


def _checked(type_: type[T], **values: object) -> T:
    """An action whose values are allowed."""
    tag = {"action": type_.__struct_config__.tag}  # type: ignore[attr-defined]
    action, mistakes = convert_all({**tag, **values}, type_)
    if action is None:
        raise UsageError(mistakes[0].line(str(tag["action"])))
    return action
