"""The campaign section ``autonomy``: what drives, and how late its commands take effect."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, Protocol

import msgspec
from msgspec import Meta, Struct

from schemas.kinds.bridge import NONE, BridgeChoice, BridgeKind, bridges
from schemas.names import Name
from schemas.sections.foreign import (
    PASSWORD,
    ContainerImage,
    Foreign,
    Repository,
    Word,
    holds_password,
)
from schemas.sections.perception import GroundTruthPerception, Perception
from schemas.sections.sensors import Sensors
from schemas.sections.stack_identity import StackIdentity, StackSource
from schemas.validation import Mistake

Told = Literal["case", "seed", "truth"]
"""What a stack may be told beyond what it needs. ``case``: the name of the case, in place of an
opaque one. ``seed``: the campaign's. ``truth``: boxes and the exact environment, also in cases
whose perception is no ground truth."""

Sandbox = Literal["default", "strict", "off"]
"""How a stack is kept from what is none of its business."""


class Autonomy(Struct, frozen=True, forbid_unknown_fields=True):
    """The stack under test and its perception variants."""

    stack: Annotated[str, Meta(pattern=r"^[A-Za-z_][\w.]*:[A-Za-z_]\w*\Z")] = "devkit.aeb:AebStack"
    """Entry point ``module:Class``."""
    command: list[Word] = []
    """Command line of a stack in a process of its own, instead of ``stack``; it finds the rig in
    its environment."""
    bridge: BridgeChoice = NONE
    """``autodrive``: the command is a script of the AutoDRIVE devkit, which waits for the AutoDRIVE
    Simulator. ``ros2``: it is a ROS 2 node on rmw_zenoh, or starts some. ``parameters`` are those
    of the bridge."""
    repository: Repository | None = None
    """Git repository that holds the command."""
    image: ContainerImage | None = None
    """Container in which the command runs."""
    slots: Annotated[int, Meta(ge=0, le=4096)] = 0
    """Most cases that the stack drives at once; 0: one for a command, for a class as many as the
    worker has slots."""
    placement: Literal["worker", "inline", "node"] = "worker"
    """``worker``: a process beside the simulator, frames in shared memory; ``inline``: in the
    simulator's process; ``node``: on another node, frames over TCP. Results are the same."""
    sandbox: Sandbox = "default"
    """``default``: the stack sees its own files and its rig, nothing else of the machine; on a GPU
    it shares with the machine what CUDA needs. ``strict``: it shares nothing, and frames may take
    a slower way. ``off``: it may do whatever its user may."""
    cosim: bool = False
    """The stack may command the car's poses: its own model moves the car, the simulator shows it,
    senses, and finds out what it hits. Poses count at the end of their tick, whatever the delays
    below."""
    latency_ms: Annotated[int, Meta(ge=0, le=10_000)] = 0
    """Delay between a frame and the effect of its command, in sim time [ms]."""
    latency_jitter_ms: Annotated[int, Meta(ge=0, le=10_000)] = 0
    """Longest further delay, drawn evenly for every command from the case's own stream [ms]."""
    rate_hz: Annotated[int, Meta(ge=0, le=500)] = 0
    """Commands per second that take effect, a divisor of `control_hz`; the last one stays in force
    between them; 0: all [Hz]."""
    drop: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Share of the commands that get lost, drawn from the case's own stream [-]."""
    parameters: dict[str, bool | int | float | str] = {}
    """Keyword arguments of the stack class."""
    tell: Annotated[list[Told], Meta(max_length=3)] = []
    """What the stack is told beyond what it needs: ``case``, ``seed``, ``truth``. Reports name
    it."""
    files: Annotated[list[Word], Meta(max_length=100)] = []
    """Further files and folders that the stack loads: what it imports by other means than import
    statements, data outside its package; their content is part of a case's identity. Relative to
    the campaign file."""
    perception: dict[Name, Perception] = msgspec.field(
        default_factory=lambda: {"default": GroundTruthPerception()}
    )
    """Perception variants by name; the matrix axis ``model`` chooses one."""


SANDBOX = "sandbox"
"""What a worker lacks that cannot give its stacks one."""

UNPROTECTED = "unprotected"
"""How what the record says of a stack without a sandbox begins."""


class _Driven(Protocol):
    """A campaign's section ``autonomy``, or a rig."""

    @property
    def placement(self) -> str: ...
    @property
    def sandbox(self) -> str: ...


def open_by_nature(autonomy: _Driven) -> str:
    """Why a stack runs without a sandbox wherever it runs; or nothing."""
    if autonomy.placement == "inline":
        return "autonomy.placement inline runs it in the simulator's process"
    if autonomy.placement == "node":
        return "autonomy.placement node runs it on another host, which nobody here sees"
    return "autonomy.sandbox is off" if autonomy.sandbox == "off" else ""


DELAYS = ("latency_ms", "latency_jitter_ms", "rate_hz", "drop")
"""What a matrix may vary of the section ``autonomy``."""


def driver(
    autonomy: Autonomy,
    identity: StackIdentity = StackIdentity(),
    parameters: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """What a case says about the process that drives it.

    Args:
        autonomy: section of the campaign.
        identity: of the stack.
        parameters: those of the case.
    """
    files = {
        key: identity.named[value]
        for key, value in (parameters or {}).items()
        if isinstance(value, str) and value in identity.named
    }
    plain = StackIdentity(identity.digest, identity.parts)
    source = StackSource(autonomy.files, plain, files)
    bridge = bridges().get(autonomy.bridge)
    if not autonomy.command:
        alone = {"stack": bridge.implementation, "slots": 1} if bridge is not None else {}
        return {"stack": autonomy.stack, "slots": autonomy.slots, "source": source, **alone}
    return {
        "source": source,
        "stack": bridge.implementation if bridge is not None else "",
        "foreign": Foreign(
            command=autonomy.command,
            bridge=autonomy.bridge,
            repository=autonomy.repository,
            image=autonomy.image,
        ),
        "slots": autonomy.slots or 1,
    }


def driver_mistakes(
    autonomy: Autonomy, sensors: Sensors, seeing: list[str], *, paced: bool = False
) -> list[Mistake]:
    """A stack is a class or a command, and a bridge has what its messages hold.

    Args:
        autonomy: how the cars are driven.
        sensors: the vehicle's own.
        seeing: names of the cameras that see; none: the campaign does not render.
        paced: sim time follows the wall clock.
    """
    mistakes = []
    if len(set(autonomy.tell)) < len(autonomy.tell):
        listed = ", ".join(autonomy.tell)
        mistakes.append(Mistake("autonomy.tell", f"given {listed}; name each of them once"))
    if autonomy.command and autonomy.stack != Autonomy().stack:
        mistakes.append(Mistake("autonomy.command", "given beside stack; keep one of them"))
    if autonomy.command and autonomy.placement == "inline":
        mistakes.append(Mistake("autonomy.placement", "inline is for a class, not for a command"))
    for name in ("repository", "image"):
        if getattr(autonomy, name) is not None and not autonomy.command:
            mistakes.append(Mistake(f"autonomy.{name}", "needs the command that runs there"))
    if autonomy.repository is not None and holds_password(autonomy.repository.url):
        mistakes.append(Mistake("autonomy.repository.url", PASSWORD))
    mistakes += _bridge_mistakes(autonomy, sensors, seeing, paced=paced)
    return mistakes


def _bridge_mistakes(
    autonomy: Autonomy, sensors: Sensors, seeing: list[str], *, paced: bool
) -> list[Mistake]:
    if autonomy.bridge == NONE:
        return []
    try:
        bridge = bridges().find(autonomy.bridge)
    except ValueError as error:
        return [Mistake("autonomy.bridge", str(error))]
    mistakes = []
    if not autonomy.command:
        mistakes += _alone_mistakes(autonomy, bridge)
    name, value = bridge.unpaced
    if name and not paced and autonomy.parameters.get(name) == value:
        said = f"given '{value}', which waits for nobody; it needs clock: realtime"
        mistakes.append(Mistake(f"autonomy.parameters.{name}", said))
    if autonomy.slots > bridge.slots_max:
        allowed = f"given {autonomy.slots}, a bridge drives {bridge.slots_max}"
        mistakes.append(Mistake("autonomy.slots", allowed))
    off = [name for name in bridge.sensors if not getattr(sensors, name).on]
    if off:
        wanted = ", ".join(f"{name}: {{}}" for name in off)
        mistakes.append(Mistake("sensors", f"the bridge sends them; add {wanted}"))
    if not set(bridge.cameras) <= set(seeing):
        wanted = f"the bridge sends pictures of {' and '.join(bridge.cameras)}; add them"
        mistakes.append(Mistake("cameras", wanted))
    return mistakes


def _alone_mistakes(autonomy: Autonomy, bridge: BridgeKind) -> list[Mistake]:
    """A bridge without a command waits for what somebody else starts, where that can reach it."""
    if not bridge.alone or not autonomy.parameters.get(bridge.alone):
        alone = (
            f", or parameters.{bridge.alone}, if somebody else starts it" if bridge.alone else ""
        )
        return [Mistake("autonomy.bridge", f"needs the command that starts the script{alone}")]
    if autonomy.sandbox != "off":
        said = "nobody outside reaches a bridge in a sandbox; set it to off, or give a command"
        return [Mistake("autonomy.sandbox", said)]
    return []
