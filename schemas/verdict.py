"""What counts as passed: the one rule behind headlines, bars, exit codes and comparisons."""

from __future__ import annotations

from typing import Any

from msgspec import Struct
from msgspec.structs import force_setattr

PASS = "pass"
COLLISION = "collision"


def is_pass(outcome: str, verdict: str) -> bool:
    """Whether a case passed: it came to the verdict ``pass``. Nothing else ever counts as one."""
    return outcome == "verdict" and verdict == PASS


def no_collision(outcome: str, verdict: str) -> bool | None:
    """The rule of the AutoDRIVE paper, as a column beside the verdict: the case came to a verdict,
    and the ego did not collide. None: there is no verdict."""
    return verdict != COLLISION if outcome == "verdict" else None


class Judged(Struct, frozen=True, kw_only=True):
    """How a case ended: messages and files with ``outcome`` and ``verdict``, from which ``passed``
    follows. It is written for other programs; what is read there has no say, because journals and
    outcomes of earlier versions count collision-free cases as passed."""

    passed: bool = False

    def __post_init__(self) -> None:
        end: Any = self
        force_setattr(self, "passed", is_pass(end.outcome, end.verdict))
