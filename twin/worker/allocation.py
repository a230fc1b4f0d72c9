"""What a worker has of its host: processor cores, and how long."""

from __future__ import annotations

import math
import os
import re

from schemas.escape import escape
from twin.base.command import SECONDS_MAX
from twin.base.errors import UsageError

WALLTIME_VARIABLE = "TWIN_WALLTIME_S"
"""Environment variable in which job scripts say how long the allocation lasts [s]."""


def walltime_s() -> float | None:
    """What :data:`WALLTIME_VARIABLE` says; None: nothing [s].

    Raises:
        UsageError: it is no such number.
    """
    text = os.environ.get(WALLTIME_VARIABLE, "")
    if not text:
        return None
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not abs(seconds) <= SECONDS_MAX:
        raise UsageError(
            f"environment variable {WALLTIME_VARIABLE}: given '{escape(text, 80)}', allowed: a "
            f"number of seconds up to {SECONDS_MAX:g}"
        )
    return seconds


def stay_on(text: str) -> None:
    """Keep this process and its children on the cores of ``text``, as in ``0-7,12``.

    Raises:
        UsageError: not such a list, or none of the cores may be used here.
    """
    wanted = parse_cores(text)
    allowed = os.sched_getaffinity(0)
    if not wanted & allowed:
        here = ",".join(str(core) for core in sorted(allowed)[:16])
        raise UsageError(f"--cores {text}: none of them is allowed here; allowed: {here}")
    os.sched_setaffinity(0, wanted & allowed)


def parse_cores(text: str) -> set[int]:
    """Numbers and ranges with commas.

    Raises:
        UsageError: something else.
    """
    cores: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"([0-9]{1,5})(?:-([0-9]{1,5}))?", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if first > last:
            raise UsageError(f"--cores {text[:80]}: expected numbers and ranges, as in 0-7,12")
        cores |= set(range(first, last + 1))
    return cores
