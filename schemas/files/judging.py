"""What a judge needs to come to a verdict again: ``judge.json`` beside the KPI rows of an attempt,
and what is said between a conductor and its judge.

The record is written by the simulator when the attempt ends. It is in the attempt's manifest, and
in no KPI digest or fingerprint.
"""

from __future__ import annotations

import hashlib
from typing import Literal

from msgspec import UNSET, Struct, UnsetType

from schemas.digest import digest
from schemas.sections.scenario import Scenario

RECORD_FILE = "judge.json"
"""Name of an attempt's record, beside ``kpi.parquet``."""

RECORD_BYTES_MAX = 1 << 20
"""Largest record [bytes]; a lane of a thousand pieces is 100 kB."""


class LaneRecord(Struct, frozen=True, forbid_unknown_fields=True):
    """The lane of the scene, see :class:`twin.road.lane.LanePath`."""

    station_m: list[float]
    """Where each piece begins, along the way [P] [m]."""
    start: list[tuple[float, float, float]]
    """World x, y [m] and heading [rad] at the beginning of each [P]."""
    curvature_per_m: list[float]
    """Curvature of each piece, to the left positive [P] [1/m]."""
    length_m: float
    """Length of all pieces together [m]."""
    closed: bool


class HitRecord(Struct, frozen=True, forbid_unknown_fields=True):
    """What the ego hit first, see :class:`twin.world.things.Thing`."""

    name: str
    kind: str
    hull: int
    hulls: int


class JudgeRecord(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How an attempt ended, as far as its KPI rows do not say it."""

    v: int
    case: str
    scenario: Scenario
    """Scenario of the case: its limits and its kind."""
    collisions: int
    impact_speed_mps: float
    """Speed at the first collision; 0 without one [m/s]."""
    impact_step: int
    """Physics step of the first collision since the start; -1: none."""
    moved: bool
    """The ego has moved, perhaps between two rows only."""
    target: tuple[float, float, float, float, float] | None
    """Hull of the obstacle in the lane: x, y [m], yaw [rad], half length and width [m]."""
    centre_offset_m: float
    """Distance from the ego's reference point to the middle of its hull, forward."""
    half_length_m: float
    half_width_m: float
    lane: LaneRecord
    further: list[tuple[float, float, float, float, float] | None] = []
    """Hulls of the scenario's further targets, like ``target``."""
    hit: HitRecord | None = None
    """First thing that was hit; None: nothing, or the case failed."""
    target_name: str = ""
    """Name of the target, where a trial is about one; its hull is that at the start."""
    events: list[str] = []
    """Names of what may happen in the case; columns of events count them from 1."""
    formula: str | UnsetType = UNSET
    """Formula of its search, whose margin is among its scalars."""


class Claim(Struct, frozen=True, kw_only=True):
    """What was committed of an attempt: the judge is asked whether it follows from the files."""

    folder: str
    """Campaign folder."""
    case: str
    attempt_dir: str
    """Attempt folder, below the campaign folder."""
    outcome: str
    verdict: str
    scalars: dict[str, float | int | None] = {}
    names: dict[str, str] = {}
    reasons: list[str] = []
    kpi_sha256: str = ""
    manifest_sha256: str = ""
    scenario: Scenario | None = None
    """Scenario of the campaign; None: not compared."""


CLAIMED = (
    *("attempt_dir", "outcome", "verdict", "scalars", "names", "reasons"),
    *("kpi_sha256", "manifest_sha256"),
)
"""What results and outcomes say of an attempt under the names that a claim has."""


class Judgement(Struct, frozen=True, kw_only=True):
    """What the judge found about one attempt."""

    folder: str
    case: str
    found: Literal["agrees", "differs", "no record"]
    """``no record``: an earlier version wrote the attempt; only its digests were checked."""
    differences: list[str] = []
    """Differences, one line each."""


def attempt_digest(kpi_sha256: str, log: bytes, record: bytes) -> str:
    """Digest of an attempt's manifest: its KPI values, log and judge's record; attempts of earlier
    versions have none, which is empty here."""
    parts = [b"kpi.parquet", kpi_sha256.encode(), b"log.txt", _sha256(log)]
    return digest([*parts, RECORD_FILE.encode(), _sha256(record)] if record else parts)


def _sha256(data: bytes) -> bytes:
    return hashlib.sha256(data).hexdigest().encode()
