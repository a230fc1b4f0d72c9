"""Nodes of ROS 2 drive one car, in lockstep, over the wire of rmw_zenoh.

A tick's messages are published, ``/clock`` last of all; sim time stands still until the nodes have
answered it (:mod:`devkit.bridges.ros2.lockstep`). A case gets a session of its own and nodes that
were started for it, so that no case depends on the one before.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from typing import Any

import msgspec

from devkit.bridges import ScriptBridge
from devkit.bridges.ros2.controllers import AskedError, MotionControl
from devkit.bridges.ros2.domain import STEP, TYPES_OF, RosDomain
from devkit.bridges.ros2.driving import AskedTick, RosDriver, TickMistakeError
from devkit.bridges.ros2.lockstep import Lockstep, StampError
from devkit.bridges.ros2.parameters import Ros2Parameters
from devkit.hosting.foreign import ForeignProcess
from devkit.stack import Observation, parameter_parts
from schemas.escape import escape
from schemas.kinds.bridge import ROS2, lacking_bridges
from schemas.messages import VEHICLE_COLUMNS, Command, Episode
from twin.base.errors import InfrastructureError, StackFaultError, TwinError, UsageError
from twin.base.own_folder import own_folder
from twin.fabric.ros2.names import check_name
from twin.fabric.ros2.place import MeetingPlace
from twin.fabric.ros2.session import WAITING_MAX, Message, Refused, ServiceCall
from twin.ros2.commands import read_command
from twin.ros2.sending import CarTick, TableSender
from twin.ros2.store import MessageError, type_store
from twin.ros2.tables import TopicTable, load_table
from twin.sandbox.inside import has_own

LOOK_S = 0.2
"""Time between two looks at a command that is waited for [s]."""

KEYS = "ros2"
"""Folder, in the user's own, of keys for nodes that somebody else starts."""

NO_SHARED_MEMORY = "shared_memory is left out: outside a sandbox, it stays behind at a kill"

UNSTAMPED = (
    "ackermann_msgs/msg/AckermannDrive",
    "geometry_msgs/msg/Twist",
)
"""Types of commands that say no time."""

_SPEED = VEHICLE_COLUMNS.index("speed_mps")


class Ros2Bridge(ScriptBridge):
    """One car, driven by nodes of ROS 2."""

    PARAMETERS = (Ros2Parameters, MotionControl)

    def __init__(self, slots: int, **parameters: Any) -> None:
        """See :class:`Ros2Parameters` and :class:`MotionControl`.

        Raises:
            InfrastructureError: packages are missing.
            TypeError: there is no such parameter.
            ValueError: a parameter is not allowed, or the table is wrong; one line.
        """
        super().__init__(slots)
        if slots != 1:
            raise ValueError(f"given {slots} slots: the bridge drives one car; set slots: 1")
        if lack := lacking_bridges().get(ROS2.name):
            raise InfrastructureError(lack)
        self._given, self._control = parameter_parts(self.PARAMETERS, parameters)
        self.table = with_command(_table(self._given.table), self._given.command)
        self._main = self.table.driving().topic
        self._waits_for = [check_name(topic) for topic in self._given.wait_for.split()]
        if self._given.answer == "stamp" and self.table.driving().type in UNSTAMPED:
            raise ValueError(
                f"answer: stamp is given, but {self.table.driving().type} on {self._main} has "
                "no stamp; take a stamped type, or answer: step"
            )
        self._store = type_store(TYPES_OF[self._given.rmw_zenoh])
        self._script: ForeignProcess | None = None
        self._place: MeetingPlace | None = None
        self.domain: RosDomain | None = None
        self._sender: TableSender | None = None
        self._driver: RosDriver | None = None
        self.lockstep = Lockstep(self._given.answer)
        self._cases, self._speed_mps, self._tick = 0, 0.0, 0
        self._commander = ""
        self.left = ""

    def attach(self, script: ForeignProcess | None) -> None:
        """Listen, and start ``script``.

        Raises:
            StackFaultError: nobody starts a node.
        """
        if script is None and not self._given.keys:
            raise StackFaultError(
                "no command and no parameter keys: nobody can reach the bridge; give one of them"
            )
        own_network = script is not None and has_own("network")
        self._script = script
        self._place = MeetingPlace(
            secrets.token_hex(8),
            own_network=own_network,
            folder=own_folder() / KEYS / self._given.keys if script is None else None,
            port=self._given.port,
            shared_memory=self._given.shared_memory and has_own("ipc"),
        )
        self._open()
        if self._given.shared_memory and not self._place.shared_memory:
            self.domain.tell([NO_SHARED_MEMORY])
        if script is not None:
            script.start()

    def reset(self, slot: int, episode: Episode) -> None:
        """A new case: new nodes, which know nothing of the last one.

        Raises:
            StackFaultError: the table does not fit the case, or the nodes are to blame.
            InfrastructureError: the nodes do not come.
        """
        assert slot == 0, "the only slot there is"
        self._speed_mps, self._tick = 0.0, 0
        runs_on = self._script is None or not self._given.restart
        if runs_on:
            self._forget()
        elif self._cases and self._script is not None:
            self._script.end()
            self._open()
            self._script.start()
        period_s = episode.control_period_ns * 1e-9
        try:
            self._sender = TableSender(self.table, episode, self._store)
        except UsageError as error:
            raise StackFaultError(f"ros2: {error}") from None
        exact = self._given.answer == "stamp"
        self._driver = RosDriver(self._control, period_s, self._given.aeb_brake, exact=exact)
        self.lockstep = Lockstep(
            self._given.answer, carried_over=exact and runs_on and self._cases > 0
        )
        self._cases += 1
        self._wait(self._is_ready, self._given.start_s, self._missing)
        assert self.domain is not None
        self.domain.send(self._sender.start())

    def step(self, observation: Observation) -> list[Command]:
        """One exchange with the nodes."""
        slots = observation.active_slots()
        if not slots:
            return []
        assert self.domain is not None
        assert self._sender is not None
        car = car_tick(observation, slots[0])
        self._tick = car.tick
        if "vehicle" in car.sensors:
            self._speed_mps = float(car.sensors["vehicle"][_SPEED])
        self._take_waiting()  # what came before the tick cannot answer it
        self.lockstep.begin(car.time_ns)
        self.domain.send(self._sender.tick(car))
        self._take_waiting()
        self._wait(lambda: self.lockstep.is_answered, self._given.answer_s, self._unanswered)
        return [self._command(AskedTick(0, 0, car.tick, self._speed_mps), observation, slots[0])]

    def close(self) -> None:
        """Leave the domain."""
        if self.domain is not None:
            self.domain.close()
        if self._place is not None:
            self._place.close()

    def _open(self) -> None:
        """A session without a past, and an environment that leads to it."""
        if self.domain is not None:
            self.domain.close()
        assert self._place is not None
        self._commander, self.left = "", ""
        given = self._given
        self.domain = RosDomain(self._place, self.table, self._store, given.domain, given.rmw_zenoh)
        variables = self._place.variables(self.domain.endpoint, given.domain)
        if self._script is not None:
            self._script.tell(variables)

    def _forget(self) -> None:
        """Nodes run on between cases: what they sent in the last one does not count in the next."""
        assert self.domain is not None
        for _ in range(WAITING_MAX):
            try:
                arrived = self.domain.receive(0.0)
            except StackFaultError as error:  # while no case ran: none is charged for it
                raise InfrastructureError(str(error)) from None
            if arrived is None:
                break
            if isinstance(arrived, ServiceCall):
                self.domain.answer(arrived, self.lockstep.stamp_ns, "no tick waits")
        self.left, self._commander = "", ""
        try:
            self._look_at_commanders()
        except StampError as error:
            raise self._fault(error) from None

    def _take_waiting(self) -> None:
        """Take what has come; a flood does not hold it up for ever."""
        assert self.domain is not None
        for _ in range(WAITING_MAX):
            arrived = self.domain.receive(0.0)
            if arrived is None:
                break
            self._take(arrived)

    def _wait(self, done: Callable[[], bool], longest_s: float, why: Callable[[], str]) -> None:
        """Take what comes until ``done``; ``why`` says what has not come.

        Raises:
            TwinError: the nodes or the machine are to blame.
        """
        assert self.domain is not None
        until_s = time.monotonic() + longest_s
        while not done():
            arrived = self.domain.receive(LOOK_S)
            if arrived is not None:
                self._take(arrived)
            else:
                self._check_script()
                if self.left:
                    raise InfrastructureError(f"ros2: {self.left}, at tick {self._tick}")
            if time.monotonic() >= until_s and not done():
                self._check_script()
                # A command of another type never passes, however often it is tried.
                wrong = bool(self.domain.graph.mistakes(self._main))
                kind = StackFaultError if wrong else InfrastructureError
                raise kind(f"ros2: {why()} within {longest_s:g} s{self._hint()}")

    def _take(self, arrived: Any) -> None:
        """Anything that came in.

        Raises:
            StackFaultError: nodes sent what no tick can have asked for.
        """
        assert self.domain is not None
        try:
            if isinstance(arrived, Message):
                self._take_command(arrived)
            elif isinstance(arrived, ServiceCall):
                why_not = self.lockstep.step()
                self.domain.answer(arrived, self.lockstep.stamp_ns, why_not)
            elif isinstance(arrived, Refused):
                raise StampError(arrived.reason)
            else:
                self._look_at_commanders()
        except (MessageError, StampError) as error:
            raise self._fault(error) from None

    def _take_command(self, message: Message) -> None:
        assert self.domain is not None
        type_name = next(r.type for r in self.table.commands if r.topic == message.topic)
        demand = read_command(self._store, type_name, message.payload)
        line = self.lockstep.command(
            *(message.topic, demand, demand.stamp_ns, message.attachment.gid),
            main=message.topic == self._main,
        )
        if line:
            self.domain.tell([line])

    def _look_at_commanders(self) -> None:
        """The graph has changed: one node commands, and stays.

        Raises:
            StampError: several do, or one whose commands cannot arrive.
        """
        assert self.domain is not None
        if unheard := self.domain.unheard_commanders(self._main):
            raise StampError(unheard[0])
        names = self.domain.commanders(self._main)
        if len(names) > 1:
            raise StampError(
                f"{len(names)} publishers command on {self._main}: {', '.join(names)}; one may"
            )
        if names:
            self.left, self._commander = "", names[0]
        elif self._commander and not self.left:
            self.left = f"node {self._commander}, which commands on {self._main}, has left"

    def _is_ready(self) -> bool:
        """Whether the nodes are there that a case needs."""
        assert self.domain is not None
        return bool(self.domain.commanders(self._main)) and not self._unheard()

    def _unheard(self) -> list[str]:
        """What nobody subscribes to or calls yet."""
        assert self.domain is not None
        missing = [topic for topic in self._waits_for if not self.domain.is_heard(topic)]
        stepped = self._given.answer != "step" or self.domain.is_stepped()
        return missing if stepped else [*missing, STEP]

    def _missing(self) -> str:
        assert self.domain is not None
        if not self.domain.commanders(self._main):
            command = self.table.driving()
            return f"no node publishes {self._main} as {command.type}"
        return f"no node hears {', '.join(self._unheard())}"

    def _unanswered(self) -> str:
        if self._given.answer == "step":
            return f"no call of {STEP} at tick {self._tick}"
        seconds = self.lockstep.stamp_ns / 1e9
        return (
            f"no command on {self._main} with the stamp {seconds:.9f} s, that of tick {self._tick},"
        )

    def _hint(self) -> str:
        """What the graph says of it."""
        assert self.domain is not None
        mistakes = self.domain.graph.mistakes(self._main)
        nodes = self.domain.graph.nodes()
        there = f"nodes: {', '.join(nodes[:10])}" if nodes else "there is no node"
        return f"; {escape('; '.join([*mistakes[:3], there]), 500)}"

    def _command(self, now: AskedTick, observation: Observation, slot: int) -> Command:
        assert self._driver is not None
        try:
            command = self._driver.command(self._main, self.lockstep.latest, now)
        except (AskedError, TickMistakeError) as error:
            raise self._fault(error) from None
        token = int(observation.token[slot])
        return msgspec.structs.replace(command, slot=slot, token=token)

    def _fault(self, error: Exception) -> TwinError:
        """The nodes' own doing; their own end says more."""
        self._check_script()
        return StackFaultError(f"ros2: {escape(str(error), 500)}, at tick {self._tick}")

    def _check_script(self) -> None:
        if self._script is not None:
            self._script.check()


def _table(name: str) -> TopicTable:
    try:
        return load_table(name)
    except UsageError as error:
        raise ValueError("; ".join(str(error).splitlines())) from None


def with_command(table: TopicTable, topic: str) -> TopicTable:
    """``table`` with another topic of the command that moves the car; empty: as it is.

    Raises:
        NameMistakeError: ROS 2 allows no such topic.
    """
    if not topic:
        return table
    driving = table.driving()
    renamed = msgspec.structs.replace(driving, topic=check_name(topic))
    commands = [renamed if row is driving else row for row in table.commands]
    return msgspec.structs.replace(table, commands=commands)


def car_tick(observation: Observation, slot: int) -> CarTick:
    """What one car's sensors saw."""
    return CarTick(
        tick=int(observation.tick[slot]),
        time_ns=int(observation.sim_time_ns[slot]),
        sensors={name: values[slot] for name, values in observation.sensors.items()},
        counts={name: int(counts[slot]) for name, counts in observation.counts.items()},
    )
