"""A campaign with its cases, expanded once and handed on as one thing."""

from __future__ import annotations

import functools
from collections.abc import Collection, Hashable, Iterable, Sequence
from typing import Any

import msgspec
from msgspec import UNSET

from schemas.campaign import CASES_MAX, Campaign, campaign_mistakes, count_of
from schemas.case import Case, RigSpec, Variation
from schemas.kinds.perception import perception_kind
from schemas.kinds.plugins import ForeignKind, foreign_kinds
from schemas.kinds.scenario import kind_of
from schemas.points import Point, points_of, probe_mistakes
from schemas.rulebook_rows import axes_beyond, rows_called
from schemas.searching.search_points import lineage
from schemas.sections.autonomy import DELAYS, driver
from schemas.sections.camera import Camera
from schemas.sections.perception import file_fields
from schemas.sections.scenario import SCENE, Scenario
from schemas.sections.search import Rows, Search, name_of
from schemas.validation import Mistake, convert_all

AMENDABLE = frozenset(
    {"seed", "view", "render", "recording", "autonomy", "files", "stack_identity"}
)
"""Fields of a campaign that decide no point, so that :meth:`Plan.amended` may change them; the seed
decides what repetitions of a rulebook's rows draw, which are drawn again."""
NO_RULEBOOK = "the campaign has no rulebook, so it has no rows; choose cases with --case or --cases"
"""Why nothing can be chosen by rows."""


class Plan:
    """A campaign and its cases.

    Finding out what every point of a matrix means takes most of the time of a large campaign, so a
    command does it once and hands the plan on. What is learnt later, as digests of files, and what
    an option says, as a seed, gives another plan of the same points.

    Where a campaign comes as a message or lies in a run's folder it is expanded anew, also within
    one process: a conductor knows of a submission what the message says and its journal keeps, and
    a report is about the file as it is (:mod:`twin.records.campaign_file`).
    """

    def __init__(self, campaign: Campaign, points: Sequence[Point]) -> None:
        """``points`` are those of ``campaign``; :func:`parse_plan` finds them."""
        self.campaign = campaign
        self._points = points

    @functools.cached_property
    def cases(self) -> list[Case]:
        """All cases in file order."""
        campaign, shared = self.campaign, _Shared(self.campaign)
        size = campaign.batch.size if campaign.batch else 0
        return [
            _case(campaign, point, index // size + 1 if size else 0, shared)
            for index, point in enumerate(self._points)
        ]

    def amended(self, campaign: Campaign) -> Plan:
        """The plan of ``campaign``, which differs in fields of :data:`AMENDABLE` alone; of its
        autonomy, neither in delays nor in the names of perception variants.

        Raises:
            AssertionError: it differs in what decides a point.
        """
        before = self.campaign
        for name in campaign.__struct_fields__:
            if name not in AMENDABLE:
                assert getattr(campaign, name) == getattr(before, name), name
        for name in DELAYS:
            assert getattr(campaign.autonomy, name) == getattr(before.autonomy, name), name
        assert list(campaign.autonomy.perception) == list(before.autonomy.perception)
        if campaign.rulebook is not UNSET and campaign.seed != before.seed:
            return plan_of(campaign)  # repetitions of rows draw by the seed
        return Plan(campaign, self._points)

    def kinds_of_others(self) -> list[ForeignKind]:
        """The kinds of other distributions that the campaign names. A sensor that is named and off
        is in the messages of cases all the same."""
        return _kinds_of_others(self.campaign, self._points)

    def only(self, case: str) -> Plan | None:
        """The plan with this one case, which keeps its id; None: it has no such case."""
        points = [point for point in self._points if point.id == case]
        return self._restricted(points) if points else None

    def among(self, names: Collection[str]) -> Plan:
        """The plan with those of its cases that are named, in its order; they keep their ids."""
        wanted = set(names)
        return self._restricted([point for point in self._points if point.id in wanted])

    def first(self, count: int) -> Plan:
        """The plan with its first ``count`` cases, which keep their ids."""
        return self._restricted(self._points[:count])

    @property
    def points(self) -> Sequence[Point]:
        """The points of its cases, in their order; values of a rulebook's as its rows have them."""
        return self._points

    def rows(self, words: Sequence[str]) -> Plan:
        """The plan with the cases of those rows of its rulebook that are called by their names,
        groups or tests, or by tags of their groups; they keep their ids.

        Raises:
            ValueError: it has no rulebook, or nothing is called so; one line.
        """
        rulebook = self.campaign.rulebook
        if rulebook is UNSET:
            raise ValueError(NO_RULEBOOK)
        names = rows_called(rulebook, words)
        return self._restricted([point for point in self._points if point.row in names])

    def quick(self) -> Plan:
        """The plan with the first and the last point of each row of its rulebook, once each, for
        every value of a matrix; they keep their ids.

        Raises:
            ValueError: it has no rulebook; one line.
        """
        campaign = self.campaign
        rulebook = campaign.rulebook
        if rulebook is UNSET:
            raise ValueError(NO_RULEBOOK)
        beyond = axes_beyond(rulebook, campaign.scenario, campaign.matrix, campaign.cases)
        firsts: dict[tuple[Any, ...], Point] = {}
        lasts: dict[tuple[Any, ...], Point] = {}
        for point in self._points:
            key = (point.row, *(point.values.get(axis) for axis in beyond))
            firsts.setdefault(key, point)
            if point.repeat <= lasts.get(key, point).repeat:
                lasts[key] = point
        kept = {point.id for point in (*firsts.values(), *lasts.values())}
        return self._restricted([point for point in self._points if point.id in kept])

    def _restricted(self, points: Sequence[Point]) -> Plan:
        listed = [point.values for point in points]
        plugins = _plugins(self.campaign, points)
        search = self.campaign.search
        if search is not UNSET:  # names of its cases do not follow from their values
            search = _choosing(search, [point.id for point in points])
            chosen = msgspec.structs.replace(self.campaign, search=search, plugins=plugins)
            return Plan(chosen, points)
        campaign = msgspec.structs.replace(
            self.campaign, matrix={}, exclude=[], cases=listed, plugins=plugins
        )
        return Plan(campaign, points)


def _choosing(search: Search, names: list[str]) -> Search:
    """A search whose cases of these names are run again; of other generations it knows nothing."""
    needed = {name.partition("-")[0] for name in names}
    proposed: list[Rows] = [
        rows if name_of(generation, 0).partition("-")[0] in needed else []
        for generation, rows in enumerate(search.proposed)
    ]
    return msgspec.structs.replace(search, first=[], proposed=proposed, chosen=names)


def parse_campaign(data: Any) -> tuple[Campaign | None, list[Mistake]]:
    """Plain data (of a YAML file) -> campaign, with every mistake found, cross checks included."""
    plan, mistakes = parse_plan(data)
    return (plan.campaign if plan else None), mistakes


def parse_plan(data: Any) -> tuple[Plan | None, list[Mistake]]:
    """Like :func:`parse_campaign`, with the cases, whose points are found to check them anyway."""
    plan, mistakes = examine(data)
    return (None if mistakes else plan), mistakes


def examine(data: Any) -> tuple[Plan | None, list[Mistake]]:
    """Like :func:`parse_plan`, but what can be read of a campaign with mistakes is there, for
    those who look for further ones: the cases that have none of their own."""
    campaign, mistakes = convert_all(data, Campaign)
    if campaign is None:
        return None, mistakes
    mistakes = campaign_mistakes(campaign)
    points: list[Point] = []
    if campaign.search is not UNSET and not campaign.search.proposed and not mistakes:
        mistakes += probe_mistakes(campaign)
    # Rows with mistakes of their own have no points.
    rows = ("rulebook", "scenario", "matrix", "cases")
    readable = campaign.rulebook is UNSET or not any(m.path.startswith(rows) for m in mistakes)
    if readable and campaign.autonomy.perception and 0 < count_of(campaign) <= CASES_MAX:
        points, point_mistakes = points_of(campaign)
        known = [mistake.path for mistake in mistakes]
        mistakes += [
            m for m in point_mistakes if not any(_same_place(m.path, path) for path in known)
        ]
        campaign = msgspec.structs.replace(campaign, plugins=_plugins(campaign, points))
    return Plan(campaign, points), mistakes


def _plugins(campaign: Campaign, points: Sequence[Point]) -> dict[str, str]:
    """Name -> version of the plug-ins of this installation whose kinds the campaign names."""
    used = {kind.plugin for kind in _kinds_of_others(campaign, points)}
    return {plugin.name: plugin.version for plugin in sorted(used)}


def _kinds_of_others(campaign: Campaign, points: Sequence[Point]) -> list[ForeignKind]:
    sections = {id(point.sensors): point.sensors for point in points}
    sensors = {name for section in sections.values() for name in section.sections()}
    variants = [campaign.autonomy.perception[model] for model in {p.model for p in points}]
    perceptions = sorted({perception_kind(variant).name for variant in variants})
    samplers = [] if campaign.search is UNSET else [campaign.search.sampler]
    bridge = campaign.autonomy.bridge
    return list(foreign_kinds(campaign.scenario, sensors, bridge, perceptions, samplers))


def _same_place(one: str, other: str) -> bool:
    """Whether one of two paths is, or holds, the other: the mistake is told already."""
    return f"{one}.".startswith(f"{other}.") or f"{other}.".startswith(f"{one}.")


def expand(campaign: Campaign) -> list[Case]:
    """The cases of a campaign, in file order, as :func:`plan_of` finds them."""
    return plan_of(campaign).cases


def plan_of(campaign: Campaign) -> Plan:
    """The plan of a campaign that is no file's; who has its :class:`Plan` needs none.

    Raises:
        ValueError: the campaign has mistakes; :func:`parse_campaign` lists them.
    """
    points, mistakes = points_of(campaign)
    if mistakes:
        raise ValueError(mistakes[0].line(campaign.campaign))
    return Plan(campaign, points)


def _case(campaign: Campaign, point: Point, batch: int, shared: _Shared) -> Case:
    variant = campaign.autonomy.perception[point.model]
    autonomy = point.autonomy
    variation = Variation(
        id=point.id,
        campaign=campaign.campaign,
        seed=campaign.seed if point.repeats is UNSET else point.repeats.seed,
        deadline_s=campaign.deadline_s,
        scenario=point.scenario,
        formula=shared.formula,
        sensors=point.sensors,
        environment=point.environment,
        latency_ms=autonomy.latency_ms,
        latency_jitter_ms=autonomy.latency_jitter_ms,
        rate_hz=autonomy.rate_hz,
        drop=autonomy.drop,
        model=point.model,
        perception=variant,
        files=_named(
            campaign,
            [*file_fields(variant).values(), *kind_of(point.scenario).files_of(point.scenario)],
        ),
        time_of_day_min=point.time_of_day_min,
        weather=point.weather,
        objects=point.objects,
        repeat=point.repeat,
        batch=batch,
        drive=campaign.recording.drive,
        tell=shared.tell,
        origin=UNSET if point.repeats is UNSET else point.repeats.origin,
        forks=UNSET if campaign.search is UNSET else lineage(campaign.search, point.id),
    )
    return Case(rig=shared.rig(point), variation=variation)


def _named(campaign: Campaign, names: Iterable[str]) -> dict[str, str]:
    """Digests of those of a campaign's files that are named."""
    return {name: campaign.files[name] for name in names if name in campaign.files}


class _Shared:
    """What the cases of a campaign share; each different thing is made once."""

    def __init__(self, campaign: Campaign) -> None:
        self._campaign = campaign
        variants = campaign.autonomy.perception.values()
        self.models = sorted(
            {path for variant in variants for path in file_fields(variant).values()}
        )
        self.tell = sorted(campaign.autonomy.tell)
        search = campaign.search
        self.formula = "" if search is UNSET else search.objective.formula or ""
        self._rigs: dict[Hashable, RigSpec] = {}

    def rig(self, point: Point) -> RigSpec:
        """The rig of a case: of all that a matrix may vary, this decides about it."""
        campaign, scenario, camera = self._campaign, point.scenario, point.camera
        parameters = campaign.autonomy.parameters | point.parameters
        values = tuple((name, type(value), value) for name, value in parameters.items())
        rates = tuple(point.sensor_hz.items())
        kind = kind_of(scenario)
        scene = kind.scene_of(scenario, SCENE)
        key = (scene, scenario.vehicle, kind.bodies, id(camera), rates, values)
        if key not in self._rigs:
            rig = _rig(campaign, scenario, camera, point.sensor_hz, parameters)
            files = rig.files | _named(campaign, self.models)
            self._rigs[key] = msgspec.structs.replace(rig, files=files, models=self.models)
        return self._rigs[key]


def _rig(
    campaign: Campaign,
    scenario: Scenario,
    camera: Camera,
    sensor_hz: dict[str, int],
    parameters: dict[str, Any],
) -> RigSpec:
    kind = kind_of(scenario)
    scene = kind.scene_of(scenario, SCENE)
    return RigSpec(
        simulator=campaign.simulator,
        control_hz=campaign.control_hz,
        clock=campaign.clock,
        scene=scene,
        vehicle=scenario.vehicle,
        files=_named(campaign, (scene, scenario.vehicle)),
        camera=camera,
        cameras=campaign.cameras,
        lidars=campaign.lidars,
        sensor_hz=sensor_hz,
        render=campaign.render,
        view=campaign.view,
        keep=campaign.recording.keep,
        **driver(campaign.autonomy, campaign.stack_identity, parameters),
        parameters=parameters,
        placement=campaign.autonomy.placement,
        sandbox=campaign.autonomy.sandbox,
        cosim=campaign.autonomy.cosim,
        bodies=kind.bodies,
    )
