"""Scenario files of cases: from a name, numbers and a vehicle to a program."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from schemas.files.assets import SCENARIO_SUFFIX, asset_digest, asset_files, is_path
from schemas.kinds.scenarios.storyboard import StoryboardConfig
from twin.scenario.storyboard.native.document import scenario_path
from twin.scenario.storyboard.program.program import Program

if TYPE_CHECKING:
    from twin.scenario.storyboard.native.document import NativeDocument
    from twin.vehicle.vehicle_file import Vehicle

CACHED_MAX = 256
"""Most programs, and most files, that a process keeps."""


@dataclass(frozen=True, slots=True)
class LoadedStoryboard:
    """A scenario file as a program."""

    program: Program
    ego: int
    """Entity that is the ego."""
    road: str
    """OpenDRIVE file on which it takes place; empty: on open ground."""

    @property
    def bodies(self) -> tuple[int, ...]:
        """Entities other than the ego, in order."""
        return tuple(k for k in range(len(self.program.entities)) if k != self.ego)


_loaded: dict[tuple[Any, ...], LoadedStoryboard] = {}
_documents: dict[tuple[str, str], NativeDocument] = {}
"""Files that were read, by name and content: the cases of a campaign have few, with many numbers.
"""


def load_storyboard(
    name: str, numbers: dict[str, float], vehicle: Vehicle | None = None
) -> LoadedStoryboard:
    """The program of a shipped scenario or a scenario file; the same object each time.

    Args:
        name: shipped name, or path of a YAML or OpenSCENARIO XML file.
        numbers: numbers of the file that are others than it says.
        vehicle: the ego, from whose middle and ends places and gaps of a YAML file count; None: a
            car of the size of its kind. An OpenSCENARIO file says where the ego's origin is.

    Raises:
        ValueError: it cannot be used; a line for each mistake.
    """
    path = file_of(name)
    content = asset_digest(path) if is_path(name) else ""  # what ships does not change
    key = (name, content, tuple(sorted(numbers.items())), _size_m(vehicle))
    if key not in _loaded:
        program = _program(path, content, numbers, vehicle)
        while len(_loaded) >= CACHED_MAX:
            del _loaded[next(iter(_loaded))]
        _loaded[key] = LoadedStoryboard(program, _ego(path, program), _road(path, program))
    return _loaded[key]


def scene_name(config: StoryboardConfig) -> str:
    """The OpenDRIVE file on which a scenario takes place.

    Raises:
        ValueError: it has none, or cannot be used.
    """
    path = file_of(config.storyboard)
    if path.suffix == SCENARIO_SUFFIX:
        road = load_storyboard(config.storyboard, config.numbers).road
    else:  # it always has one, whoever the ego is
        from twin.road.shipped.library import road_path

        content = asset_digest(path) if is_path(config.storyboard) else ""
        scenario = _document(path, content).scenario
        road = _own_road(path, road_path(scenario.road, path.parent))
    if not road:
        raise ValueError(f"{config.storyboard}: it has no road; name a scene in scenario.scene")
    return road


def file_of(name: str) -> Path:
    """The scenario file of a shipped name, or of a path.

    Raises:
        ValueError: there is no such file.
    """
    path = Path(name) if is_path(name) else scenario_path(name)
    if not path.is_file():
        raise ValueError(f"{name}: no such file")
    return path


def _size_m(vehicle: Vehicle | None) -> tuple[float, ...]:
    """All that a program takes from a vehicle."""
    if vehicle is None:
        return ()
    hull = vehicle.length_m, vehicle.width_m, vehicle.height_m
    return *hull, vehicle.wheelbase_m, vehicle.rear_overhang_m


def _program(
    path: Path, content: str, numbers: dict[str, float], vehicle: Vehicle | None
) -> Program:
    # Both take libraries or tables that are slow to load, and a campaign needs one of them.
    if path.suffix == SCENARIO_SUFFIX:
        from twin.scenario.storyboard.apart import program_apart

        return program_apart(path, numbers)
    from twin.scenario.storyboard.native.bodies import BODIES
    from twin.scenario.storyboard.native.compiler import compile_native
    from twin.scenario.storyboard.native.document import with_values

    ego = BODIES["car"]
    if vehicle is not None:
        length_m, width_m, height_m, wheelbase_m, rear_m = _size_m(vehicle)
        ego = replace(
            ego,
            length_m=length_m,
            width_m=width_m,
            height_m=height_m,
            wheelbase_m=wheelbase_m,
            rear_m=rear_m,
        )
    return compile_native(with_values(_document(path, content), numbers), ego)


def _document(path: Path, content: str) -> NativeDocument:
    """A YAML file that is read once."""
    from twin.scenario.storyboard.native.document import load_native

    key = (str(path), content)
    if key not in _documents:
        document = load_native(path)
        while len(_documents) >= CACHED_MAX:
            del _documents[next(iter(_documents))]
        _documents[key] = document
    return _documents[key]


def _ego(path: Path, program: Program) -> int:
    egos = [index for index, entity in enumerate(program.entities) if entity.ego]
    if len(egos) != 1:
        names = ", ".join(program.entities[index].name for index in egos) or "none"
        raise ValueError(f"{path}: a case needs one ego, the scenario has {names}")
    return egos[0]


def _road(path: Path, program: Program) -> str:
    if program.network is None:
        return ""
    return _own_road(path, Path(program.network.file))


def _own_road(path: Path, road: Path) -> str:
    """The road file of a scenario.

    Raises:
        ValueError: it is not among the scenario's files.
    """
    # A file that the case's identity does not know could change unnoticed.
    if is_path(str(path)) and "shipped" not in road.parts:
        known = {file.resolve() for file in asset_files(path)}
        if road.resolve() not in known:
            raise ValueError(
                f"{path}: write the name of its road in one piece, {road} was put together"
            )
    return str(road)
