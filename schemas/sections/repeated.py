"""Cases of other campaigns that a campaign repeats: the same values, the same random numbers.

A point of the list ``cases`` says by its key ``drawn_as`` which case that is.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from msgspec import UNSET, Struct, UnsetType

from schemas.names import Name

DRAWN_AS = "drawn_as"
"""Key of a point of ``cases``, beside its axes."""
DRAWN_AS_ALLOWED = "allowed: CAMPAIGN/SEED/CASE, as rain/1/g0003-0017"
"""What may stand there."""
SEED_MAX = 2**63 - 1
_WORDS = re.compile(
    r"([a-z0-9](?:[a-z0-9._-]{0,62}[a-z0-9])?)/(0|[1-9][0-9]{0,18})/([A-Za-z0-9_.-]{1,200})"
)


class CaseOrigin(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The case of another campaign whose random numbers a case has, and whose name its stack is
    told; the seed is the variation's."""

    campaign: Name
    case: str


class Repeated(NamedTuple):
    """A case of another campaign."""

    seed: int
    origin: CaseOrigin

    @property
    def name(self) -> str:
        """What it is called here."""
        return f"{self.origin.campaign}-{self.seed}-{self.origin.case}"

    @property
    def words(self) -> str:
        """The value of ``drawn_as``."""
        return f"{self.origin.campaign}/{self.seed}/{self.origin.case}"


def repeated_of(point: Mapping[str, Any]) -> Repeated | UnsetType:
    """The case that a point repeats; unset: none, or what stands there names none."""
    found = _WORDS.fullmatch(str(point.get(DRAWN_AS, "")))
    if found is None or int(found[2]) > SEED_MAX:
        return UNSET
    return Repeated(int(found[2]), CaseOrigin(campaign=found[1], case=found[3]))
