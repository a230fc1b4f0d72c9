"""Shipped roads by name; ``python -m twin.road.shipped.library`` writes their files anew."""

from __future__ import annotations

from pathlib import Path

from schemas.files.assets import file_digest
from schemas.validation import suggest
from twin.road.opendrive.apart import network_apart
from twin.road.opendrive.reading.load import load_network
from twin.road.opendrive.records import RoadNetwork

FOLDER = Path(__file__).parent
SUFFIX = ".xodr"


def shipped_roads() -> tuple[str, ...]:
    """Names of the shipped roads."""
    return tuple(sorted(path.stem for path in FOLDER.glob(f"*{SUFFIX}")))


def road_path(name_or_path: str, folder: Path) -> Path:
    """The file of a shipped road, or of a path that is relative to ``folder``.

    Raises:
        ValueError: no road of this name is shipped.
    """
    if name_or_path in shipped_roads():
        return FOLDER / f"{name_or_path}{SUFFIX}"
    path = Path(name_or_path)
    if path.suffix != SUFFIX:
        names = suggest(name_or_path, [*shipped_roads()])
        raise ValueError(f"road '{name_or_path}' is not shipped; {names}, or the path of an .xodr")
    return path if path.is_absolute() else folder / path


NETWORKS_MAX = 8
"""Most road files of others that a process keeps: a hundred scenarios may take place on one."""
_networks: dict[tuple[str, str], RoadNetwork] = {}
"""By path and content."""


def roads_of(path: Path) -> RoadNetwork:
    """The roads of a file: ours are read here, those of others by a process apart, once per
    content.

    Raises:
        ValueError: it cannot be read; one line.
        InfrastructureError: the process did not start.
    """
    if path.parent == FOLDER:
        return load_network(path)
    try:
        key = str(path), file_digest(path)
    except OSError:
        return network_apart(path)  # which says why
    if key not in _networks:
        network = network_apart(path)
        while len(_networks) >= NETWORKS_MAX:
            del _networks[next(iter(_networks))]
        _networks[key] = network
    return _networks[key]


def write_roads(folder: Path) -> None:
    """Write the files of all shipped roads."""
    from twin.road.shipped.plans import PLANS

    for name, plan in PLANS.items():
        (folder / f"{name}{SUFFIX}").write_bytes(plan())


if __name__ == "__main__":
    write_roads(FOLDER)
