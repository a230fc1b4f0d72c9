"""The campaign file: simulator, scenario, sensors, autonomy and the matrix of cases.

Everything a case needs is inside its :class:`Case`; nothing about it depends on where it stands in
the file, so cases may be reordered, added and removed without changing the verdict of another.
"""

from __future__ import annotations

import itertools
import math
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from schemas.axes import (
    Memo,
    axes_allowed,
    case_id,
    is_axis,
    objects_of,
    parameters_of,
    section_of,
    sensors_of,
    value_of,
)
from schemas.names import WEATHERS as WEATHERS
from schemas.names import Name as Name
from schemas.names import Weather as Weather
from schemas.names import minutes
from schemas.sections.autonomy import Autonomy, Sandbox, Told, driver, driver_mistakes
from schemas.sections.camera import Camera as Camera
from schemas.sections.environment import Environment, environment_mistakes
from schemas.sections.foreign import Foreign
from schemas.sections.lidar import Lidar
from schemas.sections.objects import ObjectVariation
from schemas.sections.perception import GroundTruthPerception as GroundTruthPerception
from schemas.sections.perception import NetworkPerception as NetworkPerception
from schemas.sections.perception import Perception, file_fields
from schemas.sections.scenario import Scenario as Scenario
from schemas.sections.sensors import Sensors
from schemas.sections.stack_identity import StackIdentity, StackSource
from schemas.sections.view_mode import Keep, Recording, View
from schemas.validation import MISTAKES_MAX, Mistake, convert_all, suggest

ID_CHARS_MAX = 200
"""Longest name of a case: it becomes a folder's."""
CASES_MAX = 100_000
"""Largest number of cases in one campaign."""


class _Spec(Struct, frozen=True, forbid_unknown_fields=True):
    """Base of all file types: frozen, unknown keys are errors."""


Clock = Literal["lockstep", "realtime"]
"""What sim time waits for: the stack, or the wall clock."""


Tag = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9._=-]{0,62}\Z")]
"""A word that a worker carries and a campaign may ask for, such as ``a100`` or ``site=north``."""


class Requirements(_Spec, frozen=True):
    """What a worker must offer to get cases of the campaign."""

    device: Literal["any", "cpu", "cuda"] = "any"
    """Where a worker simulates."""
    memory_gb: Annotated[float, Meta(ge=0, le=100_000)] = 0.0
    """What a rig needs; workers that allow their rigs less get no case [GB]."""
    tags: list[Tag] = []
    """Every one of these, as given to ``twin worker --tag``."""


class Batch(_Spec, frozen=True):
    """Cases labelled in file order, ``size`` to a batch, as the paper ran them."""

    size: Annotated[int, Meta(ge=1, le=CASES_MAX)] = 32
    """Cases of one batch; `--by-batch` runs them one after the other."""


class Campaign(_Spec, frozen=True, kw_only=True):
    """One campaign file."""

    schema: Literal[1] = 1
    """Version of this file type."""
    campaign: Name
    """Its name: small letters, digits and any of `. _ -`; the run's folder is named after it."""
    description: str = ""
    """One line for `conductor campaigns`."""
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    """Of all random numbers; the same seed gives the same bytes."""
    simulator: Literal["warp", "noop"] = "warp"
    """``warp``: the simulator. ``noop``: nothing is simulated; scheduling tests only."""
    attempts_max: Annotated[int, Meta(ge=1, le=100)] = 3
    """Charged attempts before a case stays unresolved."""
    deadline_s: Annotated[float, Meta(gt=0, le=86_400)] = 60.0
    """Longest wall time without progress before an attempt is given up [s]; never a verdict."""
    device: Literal["same", "any"] = "same"
    """``same``: all cases on one device class; ``any``: mixed, and the fingerprint says so."""
    requires: Requirements = Requirements()
    view: View = "live"
    """What is shown of its cases, and recorded; no result depends on it."""
    recording: Recording = Recording()
    render: bool = True
    """Off: no camera sees anything, so there are no boxes either; for stacks that drive by lidars
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
    """Further cases, one point each."""
    exclude: list[dict[str, bool | int | float | str]] = []
    """Points removed from the matrix; an axis left out matches every value."""
    batch: Batch | None = None
    files: dict[str, str] = {}
    """SHA-256 of scene, vehicle and model files given by path, with the files that those name;
    filled in at submission, so that a file that changes meanwhile is noticed."""
    stack_identity: StackIdentity = StackIdentity()
    """Digest of the stack's code and data; filled in at submission."""


class Case(_Spec, frozen=True, kw_only=True):
    """One test case, complete in itself; this is what a lease carries."""

    id: str
    """``yolov3-0500-heavy_fog``: stable, unique in its campaign."""
    campaign: str
    seed: int
    simulator: Literal["warp", "noop"]
    control_hz: int
    deadline_s: float
    scenario: Scenario
    camera: Camera
    cameras: list[Camera] = []
    lidars: list[Lidar] = []
    sensors: Sensors = Sensors()
    environment: Environment = Environment()
    stack: str
    """Entry point; empty for a command that speaks the drive plane itself."""
    foreign: Foreign | None = None
    """The stack's own process; None: a class alone."""
    slots: int = 0
    """Most cases at once; 0: as many as the worker has slots."""
    placement: Literal["worker", "inline", "node"]
    sandbox: Sandbox = "default"
    """What its stack is kept from; no result depends on it."""
    models: list[str] = []
    """Paths of all networks of its campaign: cases share a stack's process, which reads them."""
    cosim: bool = False
    """The stack may command the car's poses."""
    latency_ms: int
    latency_jitter_ms: int = 0
    rate_hz: int = 0
    drop: float = 0.0
    parameters: dict[str, bool | int | float | str]
    model: str
    """Name of the perception variant."""
    perception: Perception
    time_of_day_min: Annotated[int, Meta(ge=0, lt=1440)]
    """Local time [minutes after midnight]."""
    weather: Name
    """One of :data:`WEATHERS`, or a custom one of its environment."""
    repeat: int
    batch: int
    """Label only, from 1; 0 without batches."""
    files: dict[str, str] = {}
    """Those of :attr:`Campaign.files` that the case uses."""
    source: StackSource = StackSource()
    """What the stack consists of, beside what its entry point or command says."""
    view: View = "live"
    """What its simulator shows."""
    keep: Keep = "all"
    """Of its recording."""
    drive: Keep = "none"
    """Of the record of its drive plane."""
    objects: dict[str, ObjectVariation] = {}
    """Scripted objects that differ from the scene; per slot, no rig is built for it."""
    render: bool = True
    """Its cameras see."""
    clock: Clock = "lockstep"
    """What sim time waits for."""
    tell: list[Told] = []
    """What its stack is told beyond what it needs, sorted."""

    @property
    def seeing(self) -> list[Camera]:
        """The cameras that see, the main one first."""
        return [self.camera, *self.cameras] if self.render else []

    def rig_slots(self, offered: int) -> int:
        """Slots of its rig on a worker that offers so many; a clock is that of one case."""
        if self.clock == "realtime":
            return 1
        return min(self.slots, offered) if self.slots else offered

    def simulator_files(self) -> dict[str, str]:
        """Digests of the files that the simulator reads: scene and vehicle."""
        names = (self.scenario.scene, self.scenario.vehicle)
        return {name: self.files[name] for name in names if name in self.files}

    def model_files(self) -> dict[str, str]:
        """Digests of the files that the stack reads: those of the perception variant."""
        names = file_fields(self.perception).values()
        return {name: self.files[name] for name in names if name in self.files}


def parse_campaign(data: Any) -> tuple[Campaign | None, list[Mistake]]:
    """Plain data (of a YAML file) -> campaign, with every mistake found, cross checks included."""
    campaign, _, mistakes = parse_cases(data)
    return campaign, mistakes


def parse_cases(data: Any) -> tuple[Campaign | None, list[Case], list[Mistake]]:
    """Like :func:`parse_campaign`, with the cases, which are expanded to find mistakes anyway."""
    campaign, cases, mistakes = examine(data)
    return (None, [], mistakes) if mistakes else (campaign, cases, [])


def examine(data: Any) -> tuple[Campaign | None, list[Case], list[Mistake]]:
    """Like :func:`parse_cases`, but what can be read of a campaign with mistakes is there, for
    those who look for further ones: the cases that have none of their own."""
    campaign, mistakes = convert_all(data, Campaign)
    if campaign is None:
        return None, [], mistakes
    mistakes = _cross_checks(campaign)
    cases: list[Case] = []
    if campaign.autonomy.perception and 0 < _count(campaign) <= CASES_MAX:
        cases, found = _expand(campaign)
        known = [mistake.path for mistake in mistakes]
        mistakes += [m for m in found if not any(_same_place(m.path, path) for path in known)]
    return campaign, cases, mistakes


def _same_place(one: str, other: str) -> bool:
    """Whether one of two paths is, or holds, the other: the mistake is told already."""
    return f"{one}.".startswith(f"{other}.") or f"{other}.".startswith(f"{one}.")


def expand(campaign: Campaign) -> list[Case]:
    """All cases in file order.

    Raises:
        ValueError: the campaign has mistakes; :func:`parse_campaign` lists them.
    """
    cases, mistakes = _expand(campaign)
    if mistakes:
        raise ValueError(mistakes[0].line(campaign.campaign))
    return cases


def only(campaign: Campaign, case: str) -> Campaign | None:
    """The campaign with this one case, which keeps its id; None: it has no such case."""
    kept, _ = _points(campaign)
    points = [point for _, point in kept]
    for found, point in zip(expand(campaign), points, strict=True):
        if found.id == case:
            return msgspec.structs.replace(campaign, matrix={}, exclude=[], cases=[point])
    return None


def first(campaign: Campaign, count: int) -> Campaign:
    """The campaign with its first ``count`` cases, which keep their ids."""
    kept, _ = _points(campaign)
    points = [point for _, point in kept[:count]]
    return msgspec.structs.replace(campaign, matrix={}, exclude=[], cases=points)


def _cross_checks(campaign: Campaign) -> list[Mistake]:
    mistakes = environment_mistakes(campaign.environment)
    allowed = axes_allowed()
    named = [("matrix", campaign.matrix)]
    named += [(f"cases[{i}]", point) for i, point in enumerate(campaign.cases)]  # type: ignore[misc]
    named += [(f"exclude[{i}]", point) for i, point in enumerate(campaign.exclude)]  # type: ignore[misc]
    for where, axes in named:
        for axis in axes:
            if not is_axis(axis, allowed):
                mistakes.append(
                    Mistake(f"{where}.{axis}", f"unknown axis; {suggest(axis, allowed)}")
                )
    for axis, values in campaign.matrix.items():
        if len({repr(v) for v in values}) != len(values):
            mistakes.append(Mistake(f"matrix.{axis}", "a value appears twice; list each once"))
    if not campaign.matrix and not campaign.cases:
        mistakes.append(Mistake("matrix", "no cases; give a matrix, a list of cases, or both"))
    for where, camera in (
        ("camera", campaign.camera),
        *((f"cameras[{i}]", more) for i, more in enumerate(campaign.cameras)),
    ):
        mistakes += _named_once(f"{where}.outputs", list(camera.outputs))
    seeing = [campaign.camera.name, *(c.name for c in campaign.cameras)] if campaign.render else []
    mistakes += driver_mistakes(campaign.autonomy, campaign.sensors, seeing)
    mistakes += _clock_mistakes(campaign)
    mistakes += _named_once("lidars", [lidar.name for lidar in campaign.lidars])
    mistakes += _named_once("cameras", [campaign.camera.name, *(c.name for c in campaign.cameras)])
    if not campaign.autonomy.perception:
        mistakes.append(Mistake("autonomy.perception", "empty; name at least one variant"))
    count = _count(campaign)
    if count > CASES_MAX:
        mistakes.append(Mistake("matrix", f"{count} cases, at most {CASES_MAX} are allowed"))
    return mistakes


def _count(campaign: Campaign) -> int:
    """Cases before any is excluded."""
    return _counted(campaign.matrix, campaign.cases)


def cases_given(data: dict[str, Any]) -> int:
    """The same of plain data, by lengths alone; what is no list is a mistake that others tell."""
    matrix, cases = data.get("matrix"), data.get("cases")
    axes = matrix if isinstance(matrix, dict) else {}
    return _counted(
        {axis: values for axis, values in axes.items() if isinstance(values, list)},
        cases if isinstance(cases, list) else [],
    )


def _counted(matrix: dict[Any, list[Any]], cases: list[Any]) -> int:
    return len(cases) + (math.prod(map(len, matrix.values())) if matrix else 0)


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


def _points(campaign: Campaign) -> tuple[list[tuple[str, dict[str, Any]]], list[Mistake]]:
    """Where each case stands in the file, and its values; in file order."""
    points: list[tuple[str, dict[str, Any]]] = []
    if campaign.matrix:
        for values in itertools.product(*campaign.matrix.values()):
            points.append(("matrix", dict(zip(campaign.matrix, values, strict=True))))
    excluded = [False] * len(campaign.exclude)
    kept = []
    for where, point in points:
        hits = [
            index
            for index, pattern in enumerate(campaign.exclude)
            if all(axis in point and point[axis] == value for axis, value in pattern.items())
        ]
        for index in hits:
            excluded[index] = True
        if not hits:
            kept.append((where, point))
    mistakes = [
        Mistake(f"exclude[{index}]", "matches no case of the matrix; correct or remove it")
        for index, hit in enumerate(excluded)
        if not hit
    ]
    kept += [(f"cases[{index}]", dict(point)) for index, point in enumerate(campaign.cases)]
    return kept, mistakes


def _expand(campaign: Campaign) -> tuple[list[Case], list[Mistake]]:
    kept, mistakes = _points(campaign)
    cases: dict[str, Case] = {}
    size = campaign.batch.size if campaign.batch else 0
    memo: Memo = {}
    variants = campaign.autonomy.perception.values()
    models = sorted({path for each in variants for path in file_fields(each).values()})
    for index, (where, point) in enumerate(kept):
        case, found = _case(campaign, point, where, index // size + 1 if size else 0, memo)
        mistakes += [m for m in found if m not in mistakes]
        if len(mistakes) > MISTAKES_MAX:
            mistakes[MISTAKES_MAX:] = [Mistake("", "and more; correct these first")]
            break
        if case is None:
            continue
        if case.id in cases:
            mistakes.append(Mistake(where, f"case '{case.id}' appears twice"))
        cases[case.id] = msgspec.structs.replace(case, models=models) if models else case
    if not kept and not mistakes:
        mistakes.append(Mistake("exclude", "every case is excluded; nothing is left to run"))
    return list(cases.values()), mistakes


def _case(
    campaign: Campaign, point: dict[str, Any], where: str, batch: int, memo: Memo
) -> tuple[Case | None, list[Mistake]]:
    variants = campaign.autonomy.perception
    default_model = next(iter(variants)) if len(variants) == 1 else None
    model = point.get("model", default_model)
    mistakes = []
    if model is None:
        mistakes.append(Mistake(f"{where}.model", f"missing; choose of {', '.join(variants)}"))
    elif model not in variants:
        mistakes.append(
            Mistake(f"{where}.model", f"given {model!r}; {suggest(str(model), list(variants))}")
        )
    time_of_day, found = value_of(point, "time_of_day", where, memo)
    mistakes += found
    weather, found = value_of(point, "weather", where, memo)
    mistakes += found
    known = campaign.environment.weathers()
    if weather is not None and weather not in known:
        given = f"given {weather!r}; {suggest(weather, known)}"
        mistakes.append(Mistake(f"{where}.weather", given))
    repeat, found = value_of(point, "repeat", where, memo)
    mistakes += found
    scenario, found = section_of(campaign.scenario, "scenario", point, where, memo)
    mistakes += found
    camera, found = section_of(campaign.camera, "camera", point, where, memo)
    mistakes += found
    sensors, found = sensors_of(campaign.sensors, point, where, memo)
    mistakes += found
    environment, found = section_of(campaign.environment, "environment", point, where, memo)
    mistakes += found
    autonomy, found = section_of(campaign.autonomy, "autonomy", point, where, memo)
    mistakes += found
    objects, found = objects_of(campaign.objects, point, where, memo)
    mistakes += found
    if mistakes:
        return None, mistakes
    mistakes = _rates(campaign, camera, sensors, autonomy)
    name = case_id(str(model), time_of_day, weather, point)
    if len(name) > ID_CHARS_MAX:
        given = f"case '{name[:40]}...' would have a name of {len(name)} characters, at most"
        mistakes.append(Mistake(where, f"{given} {ID_CHARS_MAX} are allowed; shorten its values"))
    if mistakes:
        return None, mistakes
    parameters = campaign.autonomy.parameters | parameters_of(point)
    return (
        Case(
            id=name,
            campaign=campaign.campaign,
            seed=campaign.seed,
            simulator=campaign.simulator,
            control_hz=campaign.control_hz,
            deadline_s=campaign.deadline_s,
            scenario=scenario,
            camera=camera,
            cameras=campaign.cameras,
            lidars=campaign.lidars,
            sensors=sensors,
            environment=environment,
            **driver(campaign.autonomy, campaign.stack_identity, parameters),
            placement=campaign.autonomy.placement,
            sandbox=campaign.autonomy.sandbox,
            cosim=campaign.autonomy.cosim,
            latency_ms=autonomy.latency_ms,
            latency_jitter_ms=autonomy.latency_jitter_ms,
            rate_hz=autonomy.rate_hz,
            drop=autonomy.drop,
            parameters=parameters,
            model=str(model),
            perception=variants[str(model)],
            time_of_day_min=minutes(time_of_day),
            weather=weather,
            repeat=repeat,
            batch=batch,
            files={
                name: campaign.files[name]
                for name in (
                    *(scenario.scene, scenario.vehicle),
                    *file_fields(variants[str(model)]).values(),
                )
                if name in campaign.files
            },
            view=campaign.view,
            keep=campaign.recording.keep,
            drive=campaign.recording.drive,
            objects=objects,
            render=campaign.render,
            clock=campaign.clock,
            tell=sorted(campaign.autonomy.tell),
        ),
        [],
    )


def _rates(
    campaign: Campaign, camera: Camera, sensors: Sensors, autonomy: Autonomy
) -> list[Mistake]:
    """Periods are whole physics steps of 2 ms, and sensors' rates divide the control rate."""
    mistakes = []
    control_hz = campaign.control_hz
    if 500 % control_hz:
        mistakes.append(
            Mistake("control_hz", f"given {control_hz}, allowed: a divisor of 500 (2 ms steps)")
        )
    rates = {"camera": camera.hz}
    rates.update((f"cameras[{i}]", more.hz) for i, more in enumerate(campaign.cameras))
    rates.update((f"lidars[{i}]", more.hz) for i, more in enumerate(campaign.lidars) if more.hz)
    rates.update((f"sensors.{name}", hz) for name, hz in sensors.rates(control_hz).items())
    if autonomy.rate_hz and control_hz % autonomy.rate_hz:
        allowed = f"given {autonomy.rate_hz}, allowed: a divisor of control_hz {control_hz}"
        mistakes.append(Mistake("autonomy.rate_hz", allowed))
    mistakes += [
        Mistake(f"{name}.hz", f"given {hz}, allowed: a divisor of control_hz {control_hz}")
        for name, hz in rates.items()
        if hz > control_hz or control_hz % hz
    ]
    return mistakes
