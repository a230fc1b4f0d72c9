"""What counts as passed: the one rule behind headlines, bars, exit codes and comparisons."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec import Struct
from msgspec.structs import force_setattr

from schemas.kinds.scenario import passing_words

COLLISION = "collision"
IMPACT = "impact_speed_mps"
"""Scalar of cases in which the ego collided."""
TRIAL = "trial_speed_mps"
"""Scalar that all trials have, and no other case."""


def is_pass(outcome: str, verdict: str) -> bool:
    """Whether a case passed: it came to the verdict ``pass``, or to another word that is declared
    to pass (:attr:`schemas.kinds.verdict.VerdictKind.passes`). Nothing else ever counts as one."""
    return outcome == "verdict" and verdict in passing_words()


def no_collision(
    outcome: str, verdict: str, scalars: Mapping[str, float | int | None] | None = None
) -> bool | None:
    """The rule of the AutoDRIVE paper, as a column beside the verdict: the case came to a verdict,
    and the ego did not collide. None: there is no verdict.

    Words of trials do not tell of every collision, their scalars do.
    """
    if outcome != "verdict":
        return None
    if scalars and scalars.get(TRIAL) is not None:
        return scalars.get(IMPACT) is None
    return verdict != COLLISION


class Judged(Struct, frozen=True, kw_only=True):
    """How a case ended: messages and files with ``outcome`` and ``verdict``, from which ``passed``
    follows. It is written for other programs; what is read there has no say, because journals and
    outcomes of earlier versions count collision-free cases as passed."""

    passed: bool = False

    def __post_init__(self) -> None:
        end: Any = self
        force_setattr(self, "passed", is_pass(end.outcome, end.verdict))
