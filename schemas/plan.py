"""The cases of a campaign, from its file's plain data or from the campaign."""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Iterable
from typing import Any

import msgspec

from schemas.axes import (
    Memo,
    case_id,
    objects_of,
    parameters_of,
    section_of,
    sensors_of,
    value_of,
)
from schemas.campaign import CASES_MAX, ID_CHARS_MAX, Campaign, campaign_mistakes, count_of
from schemas.case import Case, RigSpec, Variation
from schemas.kinds.plugins import ForeignKind, foreign_kinds
from schemas.names import minutes
from schemas.sections.autonomy import Autonomy, driver
from schemas.sections.camera import Camera
from schemas.sections.perception import file_fields
from schemas.sections.scenario import Scenario
from schemas.sections.sensors import Sensors
from schemas.validation import MISTAKES_MAX, Mistake, convert_all, suggest


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
    mistakes = campaign_mistakes(campaign)
    cases: list[Case] = []
    if campaign.autonomy.perception and 0 < count_of(campaign) <= CASES_MAX:
        cases, found = _expand(campaign)
        known = [mistake.path for mistake in mistakes]
        mistakes += [m for m in found if not any(_same_place(m.path, path) for path in known)]
        campaign = msgspec.structs.replace(campaign, plugins=_plugins(campaign, cases))
    return campaign, cases, mistakes


def _plugins(campaign: Campaign, cases: Iterable[Case]) -> dict[str, str]:
    """Name -> version of the plug-ins of this installation whose kinds the campaign names."""
    used = {kind.plugin for kind in kinds_of_others(campaign, cases)}
    return {plugin.name: plugin.version for plugin in sorted(used)}


def kinds_of_others(campaign: Campaign, cases: Iterable[Case]) -> list[ForeignKind]:
    """The kinds of other distributions that the campaign names. A sensor that is named and off is
    in the messages of cases all the same."""
    sections = {id(case.variation.sensors): case.variation.sensors for case in cases}
    sensors = {name for section in sections.values() for name in section.sections()}
    return list(foreign_kinds(campaign.scenario, sensors, campaign.autonomy.bridge))


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
    shared = _Shared(campaign)
    for index, (where, point) in enumerate(kept):
        batch = index // size + 1 if size else 0
        case, found = _case(campaign, point, where, batch, memo, shared)
        mistakes += [m for m in found if m not in mistakes]
        if len(mistakes) > MISTAKES_MAX:
            mistakes[MISTAKES_MAX:] = [Mistake("", "and more; correct these first")]
            break
        if case is None:
            continue
        if case.id in cases:
            mistakes.append(Mistake(where, f"case '{case.id}' appears twice"))
        cases[case.id] = case
    if not kept and not mistakes:
        mistakes.append(Mistake("exclude", "every case is excluded; nothing is left to run"))
    return list(cases.values()), mistakes


def _model(campaign: Campaign, point: dict[str, Any], where: str) -> tuple[str, list[Mistake]]:
    """The perception variant of a point of the matrix; where there is but one it need not say."""
    variants = campaign.autonomy.perception
    given = point.get("model", next(iter(variants)) if len(variants) == 1 else None)
    path, model = f"{where}.model", str(given)
    if given is None:
        return model, [Mistake(path, f"missing; choose of {', '.join(variants)}")]
    if model not in variants:
        return model, [Mistake(path, f"given {given!r}; {suggest(model, list(variants))}")]
    return model, []


def _case(
    campaign: Campaign,
    point: dict[str, Any],
    where: str,
    batch: int,
    memo: Memo,
    shared: _Shared,
) -> tuple[Case | None, list[Mistake]]:
    model, mistakes = _model(campaign, point, where)
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
    name = case_id(model, time_of_day, weather, point)
    if len(name) > ID_CHARS_MAX:
        given = f"case '{name[:40]}...' would have a name of {len(name)} characters, at most"
        mistakes.append(Mistake(where, f"{given} {ID_CHARS_MAX} are allowed; shorten its values"))
    if mistakes:
        return None, mistakes
    parameters = campaign.autonomy.parameters | parameters_of(point)
    rig = shared.rig(scenario, camera, sensors.rates(campaign.control_hz), parameters)
    variant = campaign.autonomy.perception[model]
    variation = Variation(
        id=name,
        campaign=campaign.campaign,
        seed=campaign.seed,
        deadline_s=campaign.deadline_s,
        scenario=scenario,
        sensors=sensors,
        environment=environment,
        latency_ms=autonomy.latency_ms,
        latency_jitter_ms=autonomy.latency_jitter_ms,
        rate_hz=autonomy.rate_hz,
        drop=autonomy.drop,
        model=model,
        perception=variant,
        files=_named(campaign, file_fields(variant).values()),
        time_of_day_min=minutes(time_of_day),
        weather=weather,
        objects=objects,
        repeat=repeat,
        batch=batch,
        drive=campaign.recording.drive,
        tell=shared.tell,
    )
    return Case(rig=rig, variation=variation), []


def _named(campaign: Campaign, names: Iterable[str]) -> dict[str, str]:
    """Digests of those of a campaign's files that are named."""
    return {name: campaign.files[name] for name in names if name in campaign.files}


class _Shared:
    """What the cases of a campaign share; each different thing is made once."""

    def __init__(self, campaign: Campaign) -> None:
        self._campaign = campaign
        variants = campaign.autonomy.perception.values()
        self.models = sorted({path for each in variants for path in file_fields(each).values()})
        self.tell = sorted(campaign.autonomy.tell)
        self._rigs: dict[Hashable, RigSpec] = {}

    def rig(
        self,
        scenario: Scenario,
        camera: Camera,
        sensor_hz: dict[str, int],
        parameters: dict[str, Any],
    ) -> RigSpec:
        """The rig of a case: of all that a matrix may vary, this decides about it."""
        values = tuple((name, type(value), value) for name, value in parameters.items())
        key = (scenario.scene, scenario.vehicle, id(camera), tuple(sensor_hz.items()), values)
        if key not in self._rigs:
            rig = _rig(self._campaign, scenario, camera, sensor_hz, parameters)
            files = rig.files | _named(self._campaign, self.models)
            self._rigs[key] = msgspec.structs.replace(rig, files=files, models=self.models)
        return self._rigs[key]


def _rig(
    campaign: Campaign,
    scenario: Scenario,
    camera: Camera,
    sensor_hz: dict[str, int],
    parameters: dict[str, Any],
) -> RigSpec:
    return RigSpec(
        simulator=campaign.simulator,
        control_hz=campaign.control_hz,
        clock=campaign.clock,
        scene=scenario.scene,
        vehicle=scenario.vehicle,
        files=_named(campaign, (scenario.scene, scenario.vehicle)),
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
