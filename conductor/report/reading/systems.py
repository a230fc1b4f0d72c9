"""What the systems under test are called, and what they really are."""

from __future__ import annotations

from pathlib import PurePosixPath

import msgspec

from conductor.report.reading.axes import axis_values
from conductor.report.reading.dossier import Dossier
from schemas.case import Case
from schemas.kinds.perception import perception_kind
from schemas.sections.autonomy import Autonomy
from schemas.sections.foreign import Foreign
from schemas.sections.perception import file_fields

SHIPPED_STACK = Autonomy().stack
"""Entry point of the stack that drives where a campaign names none."""
_UNNAMED = next(iter(Autonomy().perception))
"""Model of a campaign that names no perception variant."""
_INTERPRETERS = ("python", "bash", "sh", "env", "node", "java", "ruby", "julia")


def system_names(dossier: Dossier) -> dict[str, str]:
    """Model -> what the system under test is called, in the order of the axis."""
    cases = {row.case.variation.model: row.case for row in dossier.rows}
    return {model: system_name(cases[model]) for model in axis_values(dossier, "model")}


def system_name(case: Case) -> str:
    """The perception variant of the shipped stack; a stack of one's own by its entry point or
    command, with the variant if the campaign names one."""
    if not is_own(case):
        return case.variation.model
    name = stack_name(case.rig.stack, case.rig.foreign)
    return name if case.variation.model == _UNNAMED else f"{name}, {case.variation.model}"


def is_own(case: Case) -> bool:
    """Whether another stack than the shipped one drives."""
    return case.rig.foreign is not None or case.rig.stack != SHIPPED_STACK


def stack_name(entry_point: str, foreign: Foreign | None) -> str:
    """Entry point of a class; of a command its script, module or program without the folder."""
    if foreign is None:
        return entry_point
    names = [PurePosixPath(word).name or word for word in foreign.command if word[:1] != "-"]
    programs = [name for name in names if name.rstrip("0123456789.") not in _INTERPRETERS]
    return next(iter([*programs, *names]), foreign.command[0])


def system_text(case: Case) -> str:
    """What a system under test really is, e.g. ``network, model yolov3-w25``: the name of a network
    alone would claim too much. Files by their name."""
    if not is_own(case):
        return perception_text(case)
    what = "own stack"
    if case.rig.foreign is not None:
        bridge = "" if case.rig.foreign.bridge == "none" else f", bridge {case.rig.foreign.bridge}"
        what = f"command {' '.join(case.rig.foreign.command)}{bridge}"
    return (
        what
        if case.variation.model == _UNNAMED
        else f"{what}; it is offered {perception_text(case)}"
    )


def perception_text(case: Case) -> str:
    """What the perception variant of ``case`` really is. Files by their name."""
    spec = case.variation.perception
    declared = perception_kind(spec)
    defaults = dict(
        zip(reversed(spec.__struct_fields__), reversed(spec.__struct_defaults__), strict=False)
    )
    values = msgspec.to_builtins(spec)
    values.update((name, PurePosixPath(path).name) for name, path in file_fields(spec).items())
    shown = [
        name if values[name] is True else f"{name} {values[name]}"
        for name in spec.__struct_fields__
        if name in declared.shown or values[name] != defaults.get(name)
    ]
    kind = declared.name
    if declared.text:
        kind = "" if case.variation.model == kind else f"{kind}: "
        kind += declared.text
    return ", ".join([kind, *shown])
