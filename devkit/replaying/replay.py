"""``devkit replay``: recorded drives for a stack, without a simulator.

The stack sees, in a process of its own and through the drive plane, byte for byte what the recorded
one saw. What it commands changes nothing: the next frame is the recorded one, so the commands are
those of a passenger who says at every tick what to do.
"""

from __future__ import annotations

import contextlib
import re
import shlex
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from devkit.checking.check import check_present
from devkit.checking.stack_rig import StackRig, running
from devkit.replaying.compare import FieldRow, compared
from schemas import SCHEMA_VERSION
from schemas.case import Case, RigSpec
from schemas.escape import escape
from schemas.files.drive_record import DRIVE_FILE, RecordHead, RecordSeen
from schemas.identity import stack_name
from schemas.messages import Command, Frame, Tick
from schemas.sections.perception import Perception
from schemas.wire import topics
from twin.base.errors import EXIT_FAILED, InfrastructureError, TwinError, UsageError
from twin.fabric.drive import Outgoing
from twin.records.drive_record import RecordReader, decoded

COMMAND_CHARS_MAX = 500
"""Length at which a shown command is cut [characters]."""

_ATTEMPT = re.compile(r"attempt-(\d+)")


class StackFailedError(TwinError):
    """The stack under test does not start, which is its verdict."""

    exit_code = EXIT_FAILED


@dataclass(frozen=True, slots=True)
class StackChoice:
    """The stack that is to drive, where it is not the recorded one."""

    rig: RigSpec | None = None
    """Rig whose stack and parameters count; None: the recorded ones."""
    variants: Mapping[str, Perception] = field(default_factory=dict)
    """Perception variants that replace recorded ones of the same name."""
    parameters: Mapping[str, Any] | None = None
    """Parameters that replace single ones of the recorded stack."""
    device: str = ""
    """Device on which its networks may compute, ``cpu`` or ``cuda:N``; empty: as recorded."""
    timeout_s: float = 60.0
    """Longest time for an answer, start-up included [s]."""
    run_command: bool = False
    """Run the command that a record holds."""


@dataclass(frozen=True, slots=True)
class Replayed:
    """One attempt, and what the stack made of it."""

    head: RecordHead
    pairs: list[tuple[int, Command | None, Command]]
    """Case tick, recorded command (None: the attempt ended without one), and the stack's."""
    rows: list[FieldRow]
    ended: str
    """Why the stack did not get to the end; empty: it did."""
    notes: list[str]
    wall_s: float

    @property
    def equal(self) -> bool:
        """Whether no field differs by more than its tolerance."""
        return not self.ended and not any(row.differ for row in self.rows)


def find_records(folder: Path, cases: Sequence[str], attempt: int | None) -> list[Path]:
    """Record files: of an attempt, or of cases of a campaign folder, the last attempt of each.

    Args:
        folder: campaign folder, attempt folder, or one file.
        cases: ids; empty: all that have a record.
        attempt: its number; None: the last one with a record.

    Raises:
        UsageError: there is none; one line.
    """
    if folder.is_file() or (folder / DRIVE_FILE).is_file():
        if cases or attempt is not None:
            argument = cases[0] if cases else "--attempt"
            raise UsageError(f"{folder}: one attempt already; leave {argument} out")
        return [folder]
    if not folder.is_dir():
        raise UsageError(f"{folder}: no such folder; give a campaign folder, or that of an attempt")
    records_of: dict[str, dict[int, Path]] = {}
    for path in folder.glob(f"cases/*/attempt-*/{DRIVE_FILE}"):
        number = _ATTEMPT.fullmatch(path.parent.name)
        if number is not None:
            records_of.setdefault(path.parent.parent.name, {})[int(number[1])] = path
    if not records_of:
        raise UsageError(
            f"{folder}: no record of a drive; `recording: {{drive: all}}` in the campaign file "
            "leaves one per attempt"
        )
    chosen = []
    for case in cases or sorted(records_of):
        records = records_of.get(case, {})
        number_wanted = max(records, default=-1) if attempt is None else attempt
        if number_wanted not in records:
            which = f"attempt {attempt} of case {case}" if attempt is not None else f"case {case}"
            have = ", ".join(f"{c} ({max(n)})" for c, n in sorted(records_of.items())[:5])
            raise UsageError(
                f"{folder}: no record of {which}; there are {len(records_of)}, as in {have}"
            )
        chosen.append(records[number_wanted])
    return chosen


def replay(
    paths: Sequence[Path],
    asked: StackChoice,
    tolerances: Mapping[str, float],
    report: Callable[[Replayed], None],
) -> tuple[list[Replayed], list[str]]:
    """Show all records to the stack, one after the other; each is reported when it is over.

    Cases whose stack is the same are driven by one process, as in a rig.

    Returns:
        What came of them, and a line for each file that is damaged.

    Raises:
        UsageError: there is no such stack, it does not take its parameters, or a record holds a
            command and nobody asked to run it.
        StackFailedError: the stack does not start.
    """
    if asked.rig is None and not asked.run_command:
        _refuse_commands(paths)
    done, damaged = [], []
    with contextlib.ExitStack() as held:
        rig, of = None, None
        for path in paths:
            try:
                reader = RecordReader(path)
            except UsageError as error:
                damaged.append(str(error))
                continue
            case = _case(reader.head.case, asked)
            same = msgspec.json.encode((case.rig.stack, case.rig.parameters, case.rig.foreign))
            if rig is None or of != same:
                held.close()
                rig, of = _started(held, case, asked.timeout_s), same
            try:
                one = _drive(rig, reader, case, asked, tolerances)
            except UsageError as error:
                damaged.append(str(error))
                rig = None  # it is in the middle of a case
                continue
            done.append(one)
            report(one)
            if one.ended:
                rig = None
    return done, damaged


def _refuse_commands(paths: Sequence[Path]) -> None:
    """A record may come from anybody, and what it was made with is what it would run."""
    for path in paths:
        try:
            foreign = RecordReader(path).head.case.rig.foreign
        except UsageError:
            continue  # told when its turn comes
        if foreign is not None:
            shown = escape(shlex.join(foreign.command), COMMAND_CHARS_MAX)
            origin = f" from {foreign.repository.url}" if foreign.repository is not None else ""
            raise UsageError(
                f"{path}: its stack is the command `{shown}`{origin}; give --run-command to run it"
                " as you, or --stack with one of your own"
            )


def _started(held: contextlib.ExitStack, case: Case, timeout_s: float) -> ReplayRig:
    check_present(case)
    try:
        return held.enter_context(running(ReplayRig, case, 1, timeout_s))
    except InfrastructureError as error:
        raise StackFailedError(str(error)) from None


def _case(recorded: Case, asked: StackChoice) -> Case:
    """The recorded case with the stack that was asked for."""
    if asked.rig is None:
        parameters = {**recorded.rig.parameters, **(asked.parameters or {})}
        rig = msgspec.structs.replace(recorded.rig, parameters=parameters)
        return msgspec.structs.replace(recorded, rig=rig)
    return Case(
        rig=msgspec.structs.replace(
            recorded.rig,
            stack=asked.rig.stack,
            foreign=asked.rig.foreign,
            parameters=asked.rig.parameters,
        ),
        variation=msgspec.structs.replace(
            recorded.variation,
            perception=asked.variants.get(recorded.variation.model, recorded.variation.perception),
            # Networks that have changed since are what is to be tried.
            files={},
        ),
    )


def _drive(
    rig: ReplayRig,
    reader: RecordReader,
    case: Case,
    asked: StackChoice,
    tolerances: Mapping[str, float],
) -> Replayed:
    pairs: list[tuple[int, Command | None, Command]] = []
    ended = ""
    begun_s = time.monotonic()
    for recorded in reader.ticks():
        try:
            command = rig.show(recorded.seen, reader, case, asked)
        except InfrastructureError as error:
            ended = f"tick {recorded.seen.tick}: {error}"
            break
        reference = None if recorded.answer is None else recorded.answer.command
        pairs.append((recorded.seen.tick, reference, command))
    answered = [(tick, one, two) for tick, one, two in pairs if one is not None]
    return Replayed(
        reader.head,
        pairs,
        compared(answered, tolerances),
        ended,
        list(_notes(reader, pairs, whole=not ended)),
        time.monotonic() - begun_s,
    )


def _notes(
    reader: RecordReader, pairs: list[tuple[int, Command | None, Command]], *, whole: bool
) -> Iterator[str]:
    if whole and reader.end is None:
        yield "the record was cut off: the attempt has no result"
    elif whole and reader.end is not None and reader.end.cut:
        yield f"the record is incomplete: {reader.end.cut}"
    silent = [tick for tick, one, _ in pairs if one is None]
    if silent:
        yield f"tick {silent[0]}: no command in the record, the stack gives one now"
    if not pairs and whole:
        yield "no tick was recorded"


class ReplayRig(StackRig):
    """A stack process with one slot that sees recorded ticks."""

    def show(
        self, seen: RecordSeen, reader: RecordReader, case: Case, asked: StackChoice
    ) -> Command:
        """The stack's command for one recorded tick.

        Raises:
            InfrastructureError: it has none, or one for another tick.
            UsageError: the record is damaged.
        """
        if seen.episode is not None:
            self._token += 1
        stamp: dict[str, Any] = {
            "v": SCHEMA_VERSION,
            "seq": self._seq,
            "active": [True],
            "token": [self._token],
            "tick": [seen.tick],
            "sim_time_ns": [seen.sim_time_ns],
        }
        self._seq += 1
        episodes = []
        if seen.episode is not None:
            changed = {
                "seq": stamp["seq"],
                "token": self._token,
                "perception": case.variation.perception,
            }
            changed |= {"device": asked.device or seen.episode.device}
            if asked.rig is not None:
                changed["files"] = case.variation.files
            episodes = [msgspec.structs.replace(seen.episode, **changed)]
        sensors = list(sensor_messages(seen, reader, stamp))
        names = [sensor.name for sensor in sensors]
        tick = Tick(**stamp, sensors=names, episodes=len(episodes))
        what = f"does not answer tick {seen.tick}"
        answer = self.exchange(tick, sensors, episodes, asked.timeout_s, what)
        for command in answer.commands:
            if command.slot == 0 and (command.token, command.tick) == (self._token, seen.tick):
                return command
        raise InfrastructureError("stack: no command for this tick")


def sensor_messages(
    seen: RecordSeen, reader: RecordReader, each: Mapping[str, Any]
) -> Iterator[Outgoing]:
    """The sensors of a tick as they were published, with one slot.

    Raises:
        UsageError: the record is damaged.
    """
    for name, array in seen.sensors.items():
        try:
            kind = topics.sensor_topic(name).type
        except KeyError:
            words = f"no sensor is called {escape(name, 80)!r}"
            raise UsageError(f"{reader.path}: damaged: tick {seen.tick}, {words}") from None
        try:
            data = decoded(array).tobytes()
        except Exception as error:  # whatever the codecs raise
            raise UsageError(f"{reader.path}: damaged: tick {seen.tick}, {name}: {error}") from None
        frame = Frame(
            **each,
            type=name,
            case=[stack_name(reader.head.case)],
            dtype=array.dtype,
            shape=[1, *array.shape],
            encoding=kind,
            count=[] if array.count < 0 else [array.count],
        )
        yield Outgoing(name, frame, data)
