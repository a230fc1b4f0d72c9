"""Bounds of what control messages hold: what is outside is refused while decoding.

MessagePack carries numbers up to 2^64 - 1; SQLite, NumPy and Parquet take at most 2^63 - 1.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

INT64_MAX = 2**63 - 1
TOKEN_DIGITS_MAX = 18
"""Longest token in decimal digits; every number of so many digits is below 2^63."""
COUNT_MAX = 2**31 - 1
TICKS_MAX = 10**12
"""Most ticks of a case: 63 years at 500 Hz. Sums over all cases of a worker stay below 2^63."""
ENTRIES_MAX = 100_000
"""Most results, ended leases or tokens in one request: the cases of the largest campaign."""

STEPS_MAX = 100_000
"""Most control ticks that one request lets a case go on for."""

SEALED_MAX = 64
"""Most sealed results in one request: each seal takes 0.1 ms to check."""

Int64 = Annotated[int, Meta(ge=-INT64_MAX - 1, le=INT64_MAX)]
Whole = Annotated[int, Meta(ge=0, le=INT64_MAX)]
Count = Annotated[int, Meta(ge=0, le=COUNT_MAX)]
Ticks = Annotated[int, Meta(ge=0, le=TICKS_MAX)]
Token = Annotated[int, Meta(ge=0, le=10**TOKEN_DIGITS_MAX - 1)]
"""Fencing token: epoch * 2^32 + n."""
TokenText = Annotated[str, Meta(pattern=rf"^[0-9]{{1,{TOKEN_DIGITS_MAX}}}\Z")]
"""The same in decimal, where it is the key of a map."""
Progress = Annotated[int, Meta(ge=-1, le=TICKS_MAX)]
"""Case ticks; -1: the case has not begun."""
Session = Annotated[bytes, Meta(max_length=32)]
"""Secret of a worker's session, see :mod:`twin.fabric.session`; empty: there is none."""
Priority = Annotated[int, Meta(ge=-COUNT_MAX, le=COUNT_MAX)]
