"""The campaign file: simulator, scenario, sensors, autonomy and the matrix of cases.

What is said here of one case stands in its :class:`schemas.case.Case`; :mod:`schemas.plan` makes
the cases of a campaign.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from msgspec import UNSET, Meta, Struct, UnsetType

from schemas.axes import axes_allowed, is_axis
from schemas.case import Clock
from schemas.names import WEATHERS as WEATHERS
from schemas.names import Name as Name
from schemas.rulebook_rows import ROW_AXIS, rows_given, rulebook_mistakes
from schemas.searching.search_points import proposed_count, search_mistakes
from schemas.sections.autonomy import Autonomy, driver_mistakes
from schemas.sections.camera import Camera as Camera
from schemas.sections.environment import Environment, environment_mistakes
from schemas.sections.lidar import Lidar
from schemas.sections.objects import ObjectVariation
from schemas.sections.repeated import DRAWN_AS
from schemas.sections.rulebook import Rulebook
from schemas.sections.scenario import Scenario as Scenario
from schemas.sections.search import Search
from schemas.sections.sensors import Sensors
from schemas.sections.stack_identity import StackIdentity
from schemas.sections.view_mode import Recording, View
from schemas.validation import Mistake, suggest

ID_CHARS_MAX = 200
"""Longest name of a case: it becomes a folder's."""
CASES_MAX = 100_000
"""Largest number of cases in one campaign."""


class _Spec(Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all file types: frozen, unknown keys are errors."""


Tag = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9._=-]{0,62}\Z")]
"""A word that a worker carries and a campaign may ask for, such as ``a100`` or ``site=north``."""


class Requirements(_Spec, frozen=True):
    """What a worker must offer to get cases of the campaign."""

    device: Literal["any", "cpu", "cuda"] = "any"
    """Where a worker simulates."""
    memory_gb: Annotated[float, Meta(ge=0, le=100_000)] = 0.0
    """What a rig needs; workers that allow their rigs less get no case [GB]."""
    tags: list[Tag] = []
    """Tags that a worker must have, all of them, as given to ``twin worker --tag``."""


class Batch(_Spec, frozen=True):
    """Cases labelled in file order, ``size`` to a batch, as the paper ran them."""

    size: Annotated[int, Meta(ge=1, le=CASES_MAX)] = 32
    """Cases of one batch; `--by-batch` runs them one after the other."""


class Campaign(_Spec, frozen=True, kw_only=True):
    """One campaign file."""

    schema: Literal[1] = 1
    """Version of this file type."""
    campaign: Name
    """Name of the campaign: small letters, digits and any of `. _ -`; the run's folder is named
    after it."""
    description: str = ""
    """One line for `conductor campaigns`."""
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    """Seed of all random numbers; the same seed gives the same bytes."""
    simulator: Literal["warp", "noop"] = "warp"
    """``warp``: the simulator. ``noop``: nothing is simulated; scheduling tests only."""
    attempts_max: Annotated[int, Meta(ge=1, le=100)] = 3
    """Charged attempts before a case stays unresolved."""
    deadline_s: Annotated[float, Meta(gt=0, le=86_400)] = 60.0
    """Longest wall time without progress before an attempt is given up [s]; never a verdict."""
    device: Literal["same", "any"] = "same"
    """``same``: all cases on the device class that their results depend on, which is none of
    portable campaigns; ``any``: mixed, and the fingerprint says so."""
    requires: Requirements = Requirements()
    view: View = "live"
    """What is shown of its cases, and recorded; no result depends on it."""
    recording: Recording = Recording()
    render: bool = True
    """Whether cameras see; without them there are no boxes either, for stacks that drive by lidars
    or the car's own sensors."""
    clock: Clock = "lockstep"
    """``lockstep``: sim time waits for the stack. ``realtime``: it goes with the wall clock and
    waits for nobody; such results do not repeat."""
    control_hz: Annotated[int, Meta(ge=1, le=500)] = 20
    """Control rate [Hz]; the camera's rate divides it."""
    scenario: Scenario = Scenario()
    objects: dict[str, ObjectVariation] = {}
    """Scripted objects of the scene, by name, that go by another speed, start or place."""
    camera: Camera = Camera()
    cameras: list[Camera] = []
    """Further cameras; their pictures are called `camera.NAME`."""
    lidars: list[Lidar] = []
    """Lidars of the vehicle; their points are called `lidar.NAME`."""
    sensors: Sensors = Sensors()
    environment: Environment = Environment()
    autonomy: Autonomy = Autonomy()
    matrix: dict[str, Annotated[list[bool | int | float | str], Meta(min_length=1)]] = {}
    """Axis -> values; the cases are the cross product, last axis fastest."""
    cases: list[dict[str, bool | int | float | str]] = []
    """Further cases, one point each. With a rulebook: points of it, which are run instead of all.
    `drawn_as: CAMPAIGN/SEED/CASE` repeats a case of another campaign, as `conductor regress` writes
    it."""
    exclude: list[dict[str, bool | int | float | str]] = []
    """Points removed from the matrix; an axis left out matches every value."""
    rulebook: Rulebook | UnsetType = UNSET
    """Rows of a test protocol, from which cases are made; each for every point of the matrix."""
    search: Search | UnsetType = UNSET
    """Parameters, an objective and a budget, from which cases are proposed generation by
    generation."""
    batch: Batch | None = None
    files: dict[str, str] = {}
    """SHA-256 of scene, vehicle and model files given by path, with the files that those name;
    filled in at submission, so that a file that changes meanwhile is noticed."""
    plugins: dict[str, str] = {}
    """Other distributions whose kinds it uses, with their versions; filled in where it is read, so
    that workers with another version are noticed."""
    stack_identity: StackIdentity = StackIdentity()
    """Digest of the stack's code and data; filled in at submission."""


def campaign_mistakes(campaign: Campaign) -> list[Mistake]:
    """What is wrong with a campaign beside the types of its values, before cases are made."""
    mistakes = environment_mistakes(campaign.environment)
    allowed = [*axes_allowed(), *([] if campaign.rulebook is UNSET else [ROW_AXIS])]
    named = [("matrix", campaign.matrix)]
    named += [(f"cases[{i}]", point) for i, point in enumerate(campaign.cases)]  # type: ignore[misc]
    named += [(f"exclude[{i}]", point) for i, point in enumerate(campaign.exclude)]  # type: ignore[misc]
    for where, axes in named:
        for axis in axes:
            if axis == DRAWN_AS and where.startswith("cases") and campaign.rulebook is UNSET:
                continue
            if not is_axis(axis, allowed):
                mistakes.append(
                    Mistake(f"{where}.{axis}", f"unknown axis; {suggest(axis, allowed)}")
                )
    for axis, values in campaign.matrix.items():
        if len({repr(v) for v in values}) != len(values):
            mistakes.append(Mistake(f"matrix.{axis}", "a value appears twice; list each once"))
    if campaign.rulebook is not UNSET:
        mistakes += rulebook_mistakes(
            campaign.rulebook, campaign.scenario, campaign.matrix, campaign.cases
        )
    elif campaign.search is UNSET and not campaign.matrix and not campaign.cases:
        mistakes.append(Mistake("matrix", "no cases; give a matrix, a list of cases, or both"))
    for where, camera in (
        ("camera", campaign.camera),
        *((f"cameras[{i}]", more) for i, more in enumerate(campaign.cameras)),
    ):
        mistakes += _named_once(f"{where}.outputs", list(camera.outputs))
    seeing = [campaign.camera.name, *(c.name for c in campaign.cameras)] if campaign.render else []
    paced = campaign.clock == "realtime"
    mistakes += driver_mistakes(campaign.autonomy, campaign.sensors, seeing, paced=paced)
    mistakes += _clock_mistakes(campaign)
    mistakes += _search_mistakes(campaign)
    mistakes += _named_once("lidars", [lidar.name for lidar in campaign.lidars])
    mistakes += _named_once("cameras", [campaign.camera.name, *(c.name for c in campaign.cameras)])
    if not campaign.autonomy.perception:
        mistakes.append(Mistake("autonomy.perception", "empty; name at least one variant"))
    count = count_of(campaign)
    if count > CASES_MAX:
        mistakes.append(Mistake("matrix", f"{count} cases, at most {CASES_MAX} are allowed"))
    return mistakes


def count_of(campaign: Campaign) -> int:
    """Cases before any is excluded; of a search, those that are proposed so far."""
    if campaign.search is not UNSET:
        return proposed_count(campaign.search)
    count = _counted(campaign.matrix, campaign.cases)
    if campaign.rulebook is UNSET or campaign.cases:
        return count
    return sum(row.count for row in campaign.rulebook.rows) * max(1, count)


def cases_given(data: dict[str, Any]) -> int:
    """Count of the cases in plain data, by lengths alone; what is no list is a mistake that others
    tell."""
    matrix, cases = data.get("matrix"), data.get("cases")
    if isinstance(search := data.get("search"), dict):
        budget = search.get("budget")
        count = budget.get("cases") if isinstance(budget, dict) else 0
        return count if isinstance(count, int) else 0
    axes = matrix if isinstance(matrix, dict) else {}
    listed = cases if isinstance(cases, list) else []
    count = _counted({axis: v for axis, v in axes.items() if isinstance(v, list)}, listed)
    if "rulebook" not in data or listed:
        return count
    return rows_given(data["rulebook"]) * max(1, count)


def _counted(matrix: dict[Any, list[Any]], cases: list[Any]) -> int:
    return len(cases) + (math.prod(map(len, matrix.values())) if matrix else 0)


def _search_mistakes(campaign: Campaign) -> list[Mistake]:
    """What is wrong with a search, beside the points that it proposes."""
    if campaign.search is UNSET:
        return []
    beside = {
        "rulebook": campaign.rulebook is not UNSET,
        "cases": bool(campaign.cases),
        "exclude": bool(campaign.exclude),
        "batch": campaign.batch is not None,
    }
    mistakes = search_mistakes(campaign.search, campaign.scenario, campaign.matrix, beside)
    if campaign.simulator == "noop":
        mistakes.append(Mistake("simulator", "noop measures nothing that could be searched"))
    if campaign.clock == "realtime":
        mistakes.append(Mistake("clock", "realtime does not repeat, and a search must"))
    return mistakes


UNREPEATABLE = "a stack cannot be shown a drive again that went with the wall clock; take lockstep"
"""Why there are no records of real time."""


def _clock_mistakes(campaign: Campaign) -> list[Mistake]:
    """In real time nothing waits for the stack, and a clock is that of one case."""
    if campaign.clock == "lockstep":
        return []
    mistakes = []
    if campaign.simulator == "noop":
        mistakes.append(Mistake("clock", "realtime needs simulator warp; noop has no time"))
    if campaign.autonomy.placement == "inline":
        waits = "inline waits for the stack, clock realtime does not; take worker or node"
        mistakes.append(Mistake("autonomy.placement", waits))
    if campaign.autonomy.slots > 1:
        alone = f"given {campaign.autonomy.slots}, a rig of clock realtime has 1"
        mistakes.append(Mistake("autonomy.slots", alone))
    if campaign.recording.drive != "none":
        mistakes.append(Mistake("recording.drive", UNREPEATABLE))
    return mistakes


def _named_once(where: str, names: list[str]) -> list[Mistake]:
    twice = sorted({name for name in names if names.count(name) > 1})
    return [Mistake(where, f"'{name}' appears twice; name each once") for name in twice]
