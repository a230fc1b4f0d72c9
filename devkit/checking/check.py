"""``devkit check``: does a stack keep the rules that make its verdicts repeatable?

Two processes of the stack see the same drives without a simulator. What it commands does not
matter; that it commands the same each time does.
"""

from __future__ import annotations

import math
import re
import shlex
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from devkit.checking.frames import CheckDrive
from devkit.checking.rig import CheckRig
from devkit.checking.stack_rig import running
from schemas.case import Case
from schemas.files.yaml_file import YamlError, load_yaml
from schemas.messages import Command, command_mistake
from schemas.plan import Plan, parse_plan
from schemas.sections.perception import with_absolute_files
from schemas.words import counted
from twin.base.errors import InfrastructureError, UsageError
from twin.stack_identity.stack_class import class_mistakes

ENTRY_POINT = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")

NEAR = CheckDrive("near", 11, gap_m=30.0, speed_mps=8.0)
"""The drive that is compared."""
FAR = CheckDrive("far", 12, gap_m=70.0, speed_mps=11.0)
"""The drive that comes between, or beside."""

LOSE_AT, CHANGE_AT, REPEAT_AT = 5, 8, 11
"""Ticks with a lost message, with keys of a later version, and sent twice."""

TICKS_MIN = 15
"""Least number of ticks of a drive, so that all three of them come."""


@dataclass(frozen=True, slots=True)
class RuleCheck:
    """Outcome of one rule."""

    name: str
    passed: bool
    detail: str


def plan_of(stack: str, parameters: dict[str, Any]) -> Plan:
    """The plan of the campaign whose stack is meant, and whose sensors it sees.

    Args:
        stack: path of a campaign file, ``module:Class``, or a command line.
        parameters: of a class or a command.

    Raises:
        UsageError: none of them, or the file has mistakes.
    """
    try:
        words = shlex.split(stack)
    except ValueError as error:
        raise UsageError(f"STACK {stack!r}: {error}; close every quote") from None
    if not words:
        raise UsageError("STACK: give module:Class, a command line, or a campaign file")
    data: Any = {"campaign": "check", "matrix": {"weather": ["clear"]}}
    data["camera"] = {"width": 160, "height": 90, "hz": 10}
    if names_file(stack):
        if parameters:
            raise UsageError("--parameters: the campaign file has its own; change them there")
        try:
            data = load_yaml(Path(stack))
        except (OSError, YamlError) as error:
            raise UsageError(f"{stack}: {error}") from None
    elif ENTRY_POINT.fullmatch(stack):
        data["autonomy"] = {"stack": stack, "parameters": parameters}
    else:
        data["autonomy"] = {"command": words, "parameters": parameters}
    plan, mistakes = parse_plan(data)
    if plan is None:
        raise UsageError("\n".join(mistake.line(stack) for mistake in mistakes))
    folder = Path(stack).parent if names_file(stack) else Path()
    autonomy = plan.campaign.autonomy
    variants = with_absolute_files(autonomy.perception, folder)
    autonomy = msgspec.structs.replace(autonomy, perception=variants)
    return plan.amended(msgspec.structs.replace(plan.campaign, autonomy=autonomy))


def check_present(case: Case) -> None:
    """Before anything is started: a stack that is not there breaks no rule.

    Raises:
        UsageError: no such class or command, or parameters that the class does not take; one line
            per mistake.
    """
    foreign = case.rig.foreign
    if foreign is not None and foreign.image is None and foreign.repository is None:
        command = foreign.command[0]
        if shutil.which(command) is None:
            raise UsageError(f"no command '{command}' here; give its path, or one that is on PATH")
    mistakes = class_mistakes(case.rig.stack, sorted(case.rig.parameters)) if case.rig.stack else []
    if mistakes:
        raise UsageError("\n".join(mistake.line(case.rig.stack) for mistake in mistakes))


def names_file(stack: str) -> bool:
    """Whether what was given for a stack is the path of a campaign file; a command line may end
    with a file of its own."""
    one = " " not in stack.strip()
    return stack.endswith((".yaml", ".yml")) and (one or Path(stack).is_file())


def check_stack(
    case: Case, ticks: int, timeout_s: float, report: Callable[[RuleCheck], None]
) -> list[RuleCheck]:
    """Run all checks; each is reported as soon as it is decided."""
    done: list[RuleCheck] = []

    def say(name: str, passed: bool, detail: str) -> None:
        done.append(RuleCheck(name, passed, detail))
        report(done[-1])

    slots = case.rig.slots_of(2)
    try:
        with running(CheckRig, case, slots, timeout_s) as rig:
            say("starts", True, f"{counted(slots, 'slot')}, ready")
            reference = _first_process(rig, slots, ticks, timeout_s, say)
        with running(CheckRig, case, slots, timeout_s) as rig:
            _second_process(rig, slots, ticks, timeout_s, reference, say)
    except InfrastructureError as error:
        say("answers" if done else "starts", False, str(error))
    return done


_Say = Callable[[str, bool, str], None]
_Commands = list[list[Command]]


def _first_process(rig: CheckRig, slots: int, ticks: int, timeout_s: float, say: _Say) -> _Commands:
    """Alone in slot 0; then another case; then the first again, with faults on the way."""
    alone: list[CheckDrive | None] = [NEAR, *[None] * (slots - 1)]
    first = rig.drive(alone, ticks, timeout_s)
    say("commands", *_well_formed(first, rig.tokens[0]))
    say("units and ranges", *_in_range(first))
    rig.drive([FAR, *[None] * (slots - 1)], ticks // 2, timeout_s)
    repeats: list[bool] = []

    def before(tick: int) -> bool:
        if tick == LOSE_AT:
            rig.bus.lose = "vehicle"
        if tick == CHANGE_AT:
            rig.bus.change_tick = True
        if tick == REPEAT_AT:
            one, two = rig.repeat(timeout_s)
            repeats.append(one == two)
        return tick in (LOSE_AT, CHANGE_AT, REPEAT_AT)

    again = rig.drive(alone, ticks, timeout_s, before)
    same = _difference(first, again)
    echoed, mistake = _well_formed(again, rig.tokens[0])
    same_until = _difference(first[:LOSE_AT], again[:LOSE_AT]) or ("" if echoed else mistake)
    say(
        "forgets at reset",
        not same_until,
        same_until or "the same case after another one: the same commands",
    )
    say(
        "repeated seq",
        repeats == [True],
        "answered from the cache"
        if repeats == [True]
        else "the answer to a repeated seq has other bytes; keep it and send it again",
    )
    assert rig.bus.lost == rig.bus.changed == 1, "a fault was set up and never came"
    say("lost frames", not same, same or "waits until the seq is complete, steps once")
    return first


def _second_process(
    rig: CheckRig, slots: int, ticks: int, timeout_s: float, reference: _Commands, say: _Say
) -> None:
    """A fresh process: in the last slot, beside another case if there is room."""
    beside: list[CheckDrive | None] = [*[FAR] * (slots - 1), NEAR]
    answers = rig.drive(beside, ticks, timeout_s)
    last_slot = [[c for c in commands if c.slot == slots - 1] for commands in answers]
    different = _difference(reference, last_slot)
    what = "in another process"
    if slots > 1:
        what += ", another slot and beside another case"
    say("deterministic", not different, different or f"the same frames {what}: the same commands")
    wall_ms = sorted(1000 * s for s in rig.wall_s)
    say(
        "deadline",
        wall_ms[-1] <= 1000 * timeout_s,
        f"median {wall_ms[len(wall_ms) // 2]:.1f} ms, longest {wall_ms[-1]:.1f} ms, "
        f"allowed {1000 * timeout_s:g} ms",
    )


def _well_formed(commands: _Commands, token: int) -> tuple[bool, str]:
    for tick, answer in enumerate(commands):
        slots = [command.slot for command in answer]
        if slots != [0]:
            return False, f"tick {tick}: commands for slots {slots}, only 0 is active"
        if answer[0].tick != tick:
            return False, f"tick {tick}: the command is for tick {answer[0].tick}"
        if answer[0].token != token:
            return (
                False,
                f"tick {tick}: token {answer[0].token} instead of {token}; echo the tick's",
            )
    return True, f"one per tick, slot, token and tick echoed, {len(commands)} ticks"


def _in_range(commands: _Commands) -> tuple[bool, str]:
    for tick, answer in enumerate(commands):
        for command in answer:
            if mistake := command_mistake(command):
                return False, f"tick {tick}: {mistake}"
    largest = max((abs(c.steering_rad) for answer in commands for c in answer), default=0.0)
    return True, f"numbers in range; largest steering angle {math.degrees(largest):.1f} deg"


def _difference(one: _Commands, two: _Commands) -> str:
    """The first difference in words; what says which slot and attempt it was does not count."""
    for tick, (left, right) in enumerate(zip(one, two, strict=True)):
        if len(left) != len(right):
            return f"tick {tick}: {len(right)} commands instead of {len(left)}"
        for a, b in zip(left, right, strict=True):
            plain_a, plain_b = msgspec.to_builtins(a), msgspec.to_builtins(b)
            for name, value in plain_a.items():
                if name not in ("slot", "token") and _bits(value) != _bits(plain_b[name]):
                    return f"tick {tick}: {name} is {plain_b[name]} instead of {value}"
    return ""


def _bits(value: Any) -> bytes:
    return msgspec.msgpack.encode(value)
