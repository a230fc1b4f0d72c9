"""Campaign files: shipped by name or given by path, loaded with every mistake explained."""

from __future__ import annotations

import functools
import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
from msgspec import UNSET

from conductor.run.changes import NO_CHANGES, CampaignChanges
from conductor.run.stack_check import stack_mistakes
from conductor.run.twin_check import twin_mistakes
from conductor.search.libraries import require
from schemas.campaign import UNREPEATABLE, Campaign
from schemas.case import Case
from schemas.files.assets import ROAD_SUFFIX, asset_digest, file_digest, is_path
from schemas.files.yaml_file import YamlError, line_of, load_yaml, read_yaml_text
from schemas.kinds.scenario import kind_of
from schemas.names import WEATHERS
from schemas.plan import Plan, examine, plan_of
from schemas.sections.autonomy import driver
from schemas.sections.lidar import Lidar
from schemas.sections.perception import file_fields, with_absolute_files
from schemas.sections.repeated import SEED_MAX
from schemas.sections.search import Search
from schemas.sections.stack_identity import StackIdentity
from schemas.validation import Mistake, did_you_mean, suggest
from twin.base.errors import InfrastructureError, UsageError
from twin.base.fetch import fetch
from twin.records.extended_file import read_extended
from twin.stack_identity.identity import Named, find_stack, named_files
from twin.stack_identity.stack_class import says_portable

WEATHER_AXIS = "weather"
"""Axis of a matrix that ``--weather`` sets."""
_SHIPPED = Path(__file__).parents[1] / "campaigns"


def shipped() -> list[str]:
    """Names of the campaigns that come with the package."""
    return sorted(path.stem for path in _SHIPPED.glob("*.yaml"))


def find(name: str) -> Path:
    """The file of a shipped campaign's name, or of a path.

    Raises:
        UsageError: neither exists.
    """
    if name in shipped():
        return _SHIPPED / f"{name}.yaml"
    path = Path(name)
    if path.is_dir():
        raise UsageError(f"{name}: a folder; give a campaign file or one of {', '.join(shipped())}")
    if path.exists():
        return path
    if path.suffix or "/" in name:
        raise UsageError(
            f"{name}: no such file; shipped campaigns: {', '.join(shipped())} "
            "(or give the path of a YAML file)"
        )
    raise UsageError(f"{name}: no such campaign; {suggest(name, shipped())}, or a file's path")


def listed(name: str) -> tuple[int, str]:
    """How many cases a shipped campaign has, a search at most, and what it is: from its file alone,
    whatever is installed."""
    plan, mistakes = examine(read_extended(find(name), name, find))
    assert plan is not None, mistakes
    campaign = plan.campaign
    cases = len(plan.cases) if campaign.search is UNSET else campaign.search.budget.cases
    return cases, campaign.description


def load(
    name: str,
    *,
    seed: int | None = None,
    fetch: bool = True,
    render: bool | None = None,
    weather: str = "",
    changes: CampaignChanges = NO_CHANGES,
) -> Plan:
    """Load and check a campaign, with its cases.

    Args:
        name: shipped name or path.
        seed: replaces the file's seed.
        fetch: fetch the repository that it names, run its set-up, and pin it to the commit.
        render: replaces the file's: whether cameras see.
        weather: weathers with commas between, or ``all``, in each of which all cases are run, in
            place of the file's; empty: as it is.
        changes: further keys and axes in place of the file's.

    Raises:
        UsageError: one line per mistake.
    """
    if seed is not None and not 0 <= seed <= SEED_MAX:
        raise UsageError(f"seed: given {seed}, allowed: 0 to {SEED_MAX}")
    changes.refuse_twice(
        {"seed": seed is not None, "render": render is not None, WEATHER_AXIS: bool(weather)}
    )
    path = find(name)
    shown = name if path.parent != _SHIPPED else path.name
    data = changes.made_in(read_extended(path, shown, find), shown)
    if seed is not None and isinstance(data, dict) and data.get("search"):
        data = {**data, "seed": seed}  # it decides what is proposed first
    if render is not None and isinstance(data, dict):
        data = {**data, "render": render}  # before rates are looked at: a blind camera has any
    if weather and isinstance(data, dict):
        data = _in_weathers(data, weather, shown)
    plan, mistakes = check(data, path.parent)
    if plan is None:
        options = {"render": render is not None, f"matrix.{WEATHER_AXIS}": bool(weather)}
        text = read_yaml_text(path)
        lines = [
            changes.line(mistake) or _line(mistake, shown, options, text) for mistake in mistakes
        ]
        raise UsageError("\n".join(lines))
    campaign = plan.campaign
    if fetch:
        campaign = with_repository(campaign, shown)
    if seed is not None:
        campaign = msgspec.structs.replace(campaign, seed=seed)
    return completed(plan.amended(campaign), shown)


def completed(plan: Plan, shown: str) -> Plan:
    """The plan with the digests of its files and of its stack, as they are here.

    Raises:
        UsageError: one cannot be read.
    """
    campaign = plan.campaign
    identity = _identity(campaign, shown)
    return plan.amended(
        msgspec.structs.replace(campaign, files=_digests(campaign), stack_identity=identity)
    )


def _line(mistake: Mistake, shown: str, options: dict[str, bool], text: str) -> str:
    """A mistake in the file that is ``shown``, with its line in the file's ``text`` as far as it
    has one, or in the option that has set its path."""
    if options.get(mistake.path):
        return f"--{mistake.path.rpartition('.')[2]}: {mistake.message}"
    number = line_of(text, mistake.path)
    return mistake.line(shown) + (f" (line {number})" if number is not None else "")


def _in_weathers(data: dict[str, Any], weather: str, shown: str) -> dict[str, Any]:
    """The content of a campaign with weathers as an axis of its matrix.

    Raises:
        UsageError: no such weather, one named twice, or the campaign lists its cases.
    """
    names = list(WEATHERS) if weather == "all" else [word.strip() for word in weather.split(",")]
    for name in names:
        if name not in WEATHERS:
            allowed = suggest(name, ["all", *WEATHERS])
            raise UsageError(f"--weather: no weather '{name}'; {allowed}")
        if names.count(name) > 1:
            raise UsageError(f"--weather: '{name}' is named twice; name each once")
    if data.get("cases"):
        raise UsageError(f"--weather: {shown} lists its cases; give them a weather there")
    matrix = data.get("matrix") or {}
    return {**data, "matrix": {**matrix, WEATHER_AXIS: names}} if isinstance(matrix, dict) else data


def _identity(campaign: Campaign, shown: str) -> StackIdentity:
    """What the campaign's stack consists of; nothing of it is run."""
    autonomy = campaign.autonomy
    driven = driver(autonomy)
    named = Named(driven["stack"], driven.get("foreign"), autonomy.files)
    prefix = "autonomy.parameters."
    parameters = list(autonomy.parameters.values())
    parameters += [value for axis, value in _axis_values(campaign) if axis.startswith(prefix)]
    try:
        identity = find_stack(named).identity
        return msgspec.structs.replace(
            identity,
            named=named_files(parameters),
            portable=(not autonomy.command and says_portable(autonomy.stack)) or UNSET,
        )
    except UsageError as error:
        key = "command" if autonomy.command else "stack"
        raise UsageError(Mistake(f"autonomy.{key}", str(error)).line(shown)) from None


def _axis_values(campaign: Campaign) -> Iterator[tuple[str, Any]]:
    """Every value that matrix, cases and rulebook give an axis."""
    for axis, values in campaign.matrix.items():
        yield from ((axis, value) for value in values)
    for point in campaign.cases:
        yield from point.items()
    if campaign.rulebook is not UNSET:
        file_axis = f"scenario.{kind_of(campaign.scenario).brings_scene}"
        for row in campaign.rulebook.rows:
            yield from row.conditions.items()
            if row.storyboard:
                yield file_axis, row.storyboard


def _digests(campaign: Campaign) -> dict[str, str]:
    """SHA-256 of every scene, vehicle, scenario and model file that the campaign names by path."""
    assets, models = named_paths(campaign)
    try:
        digests = {name: asset_digest(Path(name)) for name in assets if Path(name).is_file()}
        digests.update((n, file_digest(Path(n))) for n in models if Path(n).is_file())
        return digests
    except YamlError as error:
        raise UsageError(str(error)) from None
    except OSError as error:
        raise UsageError(f"{error.filename}: cannot be read ({error.strerror})") from None


def named_paths(campaign: Campaign) -> tuple[list[str], list[str]]:
    """Paths of scene, vehicle and scenario files, and those of models, that a campaign names; none
    is looked at."""
    named = set()
    for field in ("scene", "vehicle", *kind_of(campaign.scenario).files):
        axis = f"scenario.{field}"
        named.add(getattr(campaign.scenario, field))
        named.update(str(value) for other, value in _axis_values(campaign) if other == axis)
    variants = campaign.autonomy.perception.values()
    models = {name for variant in variants for name in file_fields(variant).values()}
    return [name for name in sorted(named) if is_path(name)], sorted(models)


def stack_paths(campaign: Campaign) -> list[str]:
    """Absolute paths of this machine that the campaign's stack names: words of its command, its
    files and image, and parameters that are files."""
    autonomy = campaign.autonomy
    named = {*autonomy.command, *autonomy.files, *campaign.stack_identity.named}
    if autonomy.image is not None:
        named.add(autonomy.image.path)
    return sorted(name for name in named if name.startswith("/"))


def only_case(plan: Plan, case: str) -> Plan:
    """The plan with this one case.

    Raises:
        UsageError: it has no such case.
    """
    chosen = plan.only(case)
    if chosen is None:
        hint = did_you_mean(case, [point.id for point in plan.points])
        raise UsageError(
            f"--case {case}: no case of '{plan.campaign.campaign}'; {hint}"
            "`conductor validate FILE --output json` lists them"
        )
    return chosen


def of_rows(plan: Plan, rows: str, *, quick: bool) -> Plan:
    """The plan with the rows of its rulebook that ``rows`` names, with commas between; of them only
    the first and the last point, if ``quick``. Without either, the plan as it is.

    Raises:
        UsageError: it has no rulebook, or no row that is called so.
    """
    option = "--rows" if rows else "--quick"
    try:
        if rows:
            plan = plan.rows(rows.split(","))
        return plan.quick() if quick else plan
    except ValueError as error:
        raise UsageError(f"{option}: {error}") from None


def chosen(plan: Plan, case: str, cases: int | None, rows: str, *, quick: bool) -> Plan:
    """The plan with the cases that options of a command choose.

    Raises:
        UsageError: there are none.
    """
    plan = of_rows(plan, rows, quick=quick)
    if case:
        return only_case(plan, case)
    return begun(plan) if cases is None else plan.first(cases)


def begun(plan: Plan) -> Plan:
    """The plan with the first generation of each chain of its search alone, proposed anew: a file
    that a run has left lists all that were. The plan as it is, if it is no search.

    Raises:
        UsageError: nothing can be proposed.
    """
    search = plan.campaign.search
    if search is UNSET or search.chosen:
        return plan
    asked = msgspec.structs.replace(search, first=[], proposed=[])
    try:
        require(search)
        begun_search = _begun(
            msgspec.msgpack.encode(asked), plan.campaign.campaign, plan.campaign.seed
        )
    except ValueError as error:
        raise UsageError(f"search: {error}") from None
    return plan_of(msgspec.structs.replace(plan.campaign, search=begun_search))


@functools.lru_cache(maxsize=1)
def _begun(asked: bytes, campaign: str, seed: int) -> Search:
    """A search, packed, with the first generation of each chain; a command needs it when it checks
    a campaign and when it submits it."""
    # Late: only who searches has the libraries.
    from conductor.search.driver import first

    search = msgspec.msgpack.decode(asked, type=Search)
    proposals = [first(search, campaign, seed, chain) for chain in range(search.chains)]
    return msgspec.structs.replace(
        search,
        first=[row for proposal in proposals for row in proposal.u],
        proposed=[proposal.values for proposal in proposals],
        forks=UNSET,
    )


def with_drive(plan: Plan) -> Plan:
    """The plan with a record of every drive.

    Raises:
        UsageError: it goes with the wall clock.
    """
    if plan.campaign.clock == "realtime":
        raise UsageError(f"--record-drive: {UNREPEATABLE}")
    recording = msgspec.structs.replace(plan.campaign.recording, drive="all")
    return plan.amended(msgspec.structs.replace(plan.campaign, recording=recording))


def check(data: Any, folder: Path | None = None) -> tuple[Plan | None, list[Mistake]]:
    """Every mistake of a campaign's content, also about things outside the file.

    Args:
        data: the content.
        folder: where the file lies: paths of models are relative to it, and absolute in the
            plan that is returned.
    """
    plan, mistakes = examine(data)
    if plan is None:
        return None, mistakes
    if plan.campaign.search is not UNSET:
        plan, mistakes = _searched(plan, mistakes)
    plan = plan.amended(_with_absolute_files(plan.campaign, folder or Path()))
    campaign, cases = plan.campaign, plan.cases
    if not cases:
        return None, mistakes
    if missing := _missing_files(cases):
        mistakes += missing
    else:
        mistakes += _missing_mounts(cases)
        mistakes += twin_mistakes(plan) if not mistakes else []
    mistakes += _missing_models(campaign, cases)
    mistakes += _missing_image(campaign)
    mistakes += stack_mistakes(campaign, cases)
    mistakes += _other_plugins(data.get("plugins") or {}, campaign.plugins)
    return (None, mistakes) if mistakes else (plan, [])


def _searched(plan: Plan, mistakes: list[Mistake]) -> tuple[Plan, list[Mistake]]:
    """The plan of a search that has not begun, with its first generation."""
    search = plan.campaign.search
    if search is UNSET or search.proposed or mistakes:
        return plan, mistakes
    try:
        return begun(plan), []
    except UsageError as error:
        return plan, [Mistake("", str(error))]
    except ValueError as error:  # of a point that is proposed
        return plan, [Mistake("search", str(error))]


def _other_plugins(required: dict[str, str], installed: dict[str, str]) -> list[Mistake]:
    """Plug-ins of a campaign that was read elsewhere, in other versions."""
    return [
        Mistake(
            f"plugins.{name}",
            f"given {required[name]}, installed is {version}; install that version, or remove the "
            "key",
        )
        for name, version in installed.items()
        if required.get(name, version) != version
    ]


def _missing_image(campaign: Campaign) -> list[Mistake]:
    """An image that is a path, and its folders; a name is the runtime's business."""
    image = campaign.autonomy.image
    if image is None:
        return []
    mistakes = [
        Mistake(f"autonomy.image.binds[{index}]", f"given '{path}', allowed: an absolute path")
        for index, path in enumerate(image.binds)
        if not path.startswith("/")
    ]
    if image.runtime == "podman":
        return mistakes
    if not Path(image.path).exists():
        mistakes.append(Mistake("autonomy.image.path", f"{image.path}: no such file or folder"))
    elif not image.path.startswith("/"):
        absolute = f"given '{image.path}', allowed: an absolute path, which all workers see"
        mistakes.append(Mistake("autonomy.image.path", absolute))
    return mistakes


def _with_absolute_files(campaign: Campaign, folder: Path) -> Campaign:
    variants = with_absolute_files(campaign.autonomy.perception, folder)
    files = [str((folder / path).absolute()) for path in campaign.autonomy.files]
    autonomy = msgspec.structs.replace(campaign.autonomy, perception=variants, files=files)
    return msgspec.structs.replace(campaign, autonomy=autonomy)


def _missing_models(campaign: Campaign, cases: list[Case]) -> list[Mistake]:
    """Files of the variants that cases use; what is in them is looked at elsewhere."""
    used = dict.fromkeys(case.variation.model for case in cases)
    return [
        Mistake(f"autonomy.perception.{name}.{key}", f"{path}: no such file")
        for name in used
        for key, path in file_fields(campaign.autonomy.perception[name]).items()
        if not Path(path).is_file()
    ]


def _missing_files(cases: list[Case]) -> list[Mistake]:
    mistakes = []
    # What is wrong with files of the scenario, its family says.
    brought = {
        name
        for case in cases
        for name in kind_of(case.variation.scenario).files_of(case.variation.scenario)
    }
    for field, patterns in (
        ("scene", ("world/scenes/*.yaml", f"road/shipped/*{ROAD_SUFFIX}")),
        ("vehicle", ("vehicle/models/*.yaml",)),
    ):
        names = _simulator_files(*patterns)
        used = {getattr(case.rig, field) for case in cases}
        for name in sorted(used - brought):
            if name not in names and not (is_path(name) and Path(name).is_file()):
                mistakes.append(
                    Mistake(
                        f"scenario.{field}",
                        f"given '{name}', neither shipped nor a file; {suggest(name, names)}",
                    )
                )
    return mistakes


def _missing_mounts(cases: list[Case]) -> list[Mistake]:
    """Cameras and lidars that the vehicle file does not have: no simulator would start."""
    any_case = cases[0]  # which sensors there are is no axis
    cameras = sorted(camera.name for camera in (any_case.rig.camera, *any_case.rig.cameras))
    lidars = sorted(any_case.rig.lidars, key=lambda lidar: lidar.name)
    mistakes = []
    for vehicle in sorted({case.rig.vehicle for case in cases}):
        path = Path(vehicle)
        if not is_path(vehicle):
            path = _simulator_folder("vehicle/models") / f"{vehicle}.yaml"
        try:
            data = load_yaml(path)
        except YamlError:
            continue  # the simulator says what is wrong with the file
        names = {"cameras": cameras, "lidars": [lidar.name for lidar in lidars]}
        for kind, wanted in names.items():
            mounts = _inner(data, kind)
            known = list(mounts) if isinstance(mounts, dict) else []
            for name in wanted:
                if name not in known:
                    hint = suggest(name, known) if known else "it has none"
                    mistakes.append(Mistake(kind, f"vehicle '{vehicle}' has no '{name}'; {hint}"))
        for lidar in lidars:
            mount = _inner(_inner(data, "lidars"), lidar.name)
            if isinstance(mount, dict):
                mistakes += _sweep_rate(path, lidar, mount, any_case.rig.control_hz)
    return mistakes


def _inner(data: Any, key: str) -> Any:
    """A value of something that should be a mapping, or None."""
    return data.get(key) if isinstance(data, dict) else None


def _sweep_rate(path: Path, lidar: Lidar, mount: dict[str, Any], control_hz: int) -> list[Mistake]:
    """A lidar that sweeps as often as its profile says must fit the control rate."""
    profile = mount.get("inline")
    named = mount.get("profile", "")
    if isinstance(named, str) and named:
        file = _simulator_folder("sensors/lidar/profiles") / f"{named}.yaml"
        try:
            profile = load_yaml(path.parent / named if is_path(named) else file)
        except YamlError as error:
            return [Mistake("lidars", str(error))]
    hz = _inner(profile, "hz")
    if not isinstance(hz, int) or hz < 1:
        return []  # the simulator says what is wrong with the profile
    if not lidar.hz and control_hz % hz:
        message = (
            f"'{lidar.name}' sweeps at {hz} Hz, no divisor of control_hz {control_hz}; give its hz"
        )
        return [Mistake("lidars", message)]
    return []


def _simulator_files(*patterns: str) -> list[str]:
    """Names of files that the simulator ships."""
    root = _simulator_folder("")
    return sorted(path.stem for pattern in patterns for path in root.glob(pattern))


def _simulator_folder(folder: str) -> Path:
    """A folder of the simulator, found without importing it."""
    spec = importlib.util.find_spec("twin")
    assert spec is not None
    assert spec.submodule_search_locations is not None
    return Path(next(iter(spec.submodule_search_locations))) / folder


def with_repository(campaign: Campaign, shown: str) -> Campaign:
    """The campaign with the commit in place of a branch or tag; the files are in the cache.

    Raises:
        UsageError: no such repository or ref, or its set-up failed, with its last lines.
    """
    repository = campaign.autonomy.repository
    if repository is None:
        return campaign
    try:
        commit = fetch(repository).commit
    except InfrastructureError as error:
        raise UsageError(Mistake("autonomy.repository", str(error)).line(shown)) from None
    pinned = msgspec.structs.replace(repository, ref=commit)
    autonomy = msgspec.structs.replace(campaign.autonomy, repository=pinned)
    return msgspec.structs.replace(campaign, autonomy=autonomy)
