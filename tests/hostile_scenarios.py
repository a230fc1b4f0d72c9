"""Scenario and road files that somebody hostile would send, by name."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

HEADER = (
    '<FileHeader author="a" date="2026-01-31T12:00:00" description="d" revMajor="1" revMinor="3"/>'
)
BOX = '<Center x="0" y="0" z="1"/><Dimensions height="1" length="1" width="1"/>'
THING = (
    '<MiscObject mass="1" miscObjectCategory="obstacle" name="thing">'
    f"<BoundingBox>{BOX}</BoundingBox><Properties/></MiscObject>"
)
ENTITY = f'<ScenarioObject name="Ego">{THING}</ScenarioObject>'
LANES = (
    "<lanes><laneSection s='0'><center><lane id='0' type='none'/></center></laneSection></lanes>"
)


def scenario(
    *,
    parameters: str = "",
    catalogs: str = "",
    road: str = "",
    entities: str = ENTITY,
    init: str = "<Actions/>",
) -> str:
    """A scenario that waits, with what is given in its places."""
    logic = f'<RoadNetwork><LogicFile filepath="{road}"/></RoadNetwork>'
    return (
        f"<OpenSCENARIO>\n{HEADER}\n<ParameterDeclarations>{parameters}</ParameterDeclarations>\n"
        f"<CatalogLocations>{catalogs}</CatalogLocations>\n{logic if road else '<RoadNetwork/>'}\n"
        f"<Entities>{entities}</Entities>\n<Storyboard>\n<Init>{init}</Init>\n"
        "<StopTrigger/></Storyboard></OpenSCENARIO>\n"
    )


def catalogs_in(folder: str) -> str:
    """A folder of routes."""
    return f'<RouteCatalog><Directory path="{folder}"/></RouteCatalog>'


def parameter(value: str) -> str:
    """A parameter with this value."""
    return f'<ParameterDeclaration name="x" parameterType="double" value="{value}"/>'


def acting(action: str) -> str:
    """Init, in which the ego does this."""
    inner = f"<PrivateAction>{action}</PrivateAction>"
    return f'<Actions><Private entityRef="Ego">{inner}</Private></Actions>'


def following(shape: str) -> str:
    """Init, in which the ego follows a trajectory of this shape."""
    return acting(
        "<RoutingAction><FollowTrajectoryAction><TrajectoryRef>"
        f'<Trajectory name="t" closed="false"><ParameterDeclarations/><Shape>{shape}</Shape>'
        "</Trajectory></TrajectoryRef><TimeReference><None/></TimeReference>"
        '<TrajectoryFollowingMode followingMode="position"/>'
        "</FollowTrajectoryAction></RoutingAction>"
    )


def _place(x: int) -> str:
    return f'<Position><WorldPosition x="{x}" y="0"/></Position>'


def _text(folder: Path, text: str, name: str = "s.xosc") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def entities(folder: Path) -> Path:
    """Entities of XML that unfold to a billion."""
    inner = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
    return _text(
        folder, f'<!DOCTYPE x [<!ENTITY e0 "ha">{inner}]><OpenSCENARIO>&e9;</OpenSCENARIO>'
    )


def outside(folder: Path) -> Path:
    """An entity of XML that is another file."""
    text = '<!DOCTYPE x [<!ENTITY e SYSTEM "file:///etc/passwd">]><OpenSCENARIO>&e;</OpenSCENARIO>'
    return _text(folder, text)


def large(folder: Path) -> Path:
    """200 MB."""
    path = folder / "s.xosc"
    with path.open("wb") as file:
        file.truncate(200 << 20)
    return path


def deep(folder: Path) -> Path:
    """A hundred thousand elements in one another."""
    return _text(folder, "<OpenSCENARIO>" + "<a>" * 100_000)


def attribute(folder: Path) -> Path:
    """An attribute of 12 MB."""
    return _text(folder, scenario(parameters=parameter("1" * (12 << 20))))


def power(folder: Path) -> Path:
    """An expression whose value nobody can write."""
    return _text(folder, scenario(parameters=parameter("${10**10**10}")))


def tower(folder: Path) -> Path:
    """The same, higher."""
    return _text(folder, scenario(parameters=parameter("${" + "9**" * 3000 + "9}")))


def parentheses(folder: Path) -> Path:
    """An expression that nests four thousand times."""
    return _text(folder, scenario(parameters=parameter("${" + "(" * 4000 + "1" + ")" * 4000 + "}")))


def many_entities(folder: Path) -> Path:
    """Twenty thousand entities."""
    one = ENTITY.replace("Ego", "e{}")
    return _text(folder, scenario(entities="".join(one.format(i) for i in range(20_000))))


def nurbs(folder: Path) -> Path:
    """A NURBS of order one million."""
    points = "".join(f"<ControlPoint>{_place(x)}</ControlPoint>" for x in range(3))
    knots = "".join(f'<Knot value="{x}"/>' for x in range(7))
    return _text(
        folder, scenario(init=following(f'<Nurbs order="1000000">{points}{knots}</Nurbs>'))
    )


def polyline(folder: Path) -> Path:
    """A polyline of more vertices than a file may have elements."""
    one = f"<Vertex>{_place(1)}</Vertex>"
    return _text(folder, scenario(init=following(f"<Polyline>{one * 70_000}</Polyline>")))


def catalog_circle(folder: Path) -> Path:
    """Entries of a catalog, each of which refers to the one below a hundred times."""
    (folder / "routes").mkdir()
    routes = []
    for level in range(12):
        reference = f'<CatalogReference catalogName="Routes" entryName="R{level + 1}"/>'
        inner = (
            f"<Position><RoutePosition><RouteRef>{reference}</RouteRef><InRoutePosition>"
            '<FromCurrentEntity entityRef="Ego"/></InRoutePosition></RoutePosition></Position>'
        )
        place = inner if level < 11 else _place(1)
        points = f'<Waypoint routeStrategy="shortest">{place}</Waypoint>' * 100
        routes.append(f'<Route name="R{level}" closed="false">{points}</Route>')
    inner = f'<Catalog name="Routes">{"".join(routes)}</Catalog>'
    text = f"<OpenSCENARIO>\n{HEADER}\n{inner}</OpenSCENARIO>"
    _text(folder / "routes", text, "r.xosc")
    reference = '<CatalogReference catalogName="Routes" entryName="R0"/>'
    init = acting(
        f"<RoutingAction><AssignRouteAction>{reference}</AssignRouteAction></RoutingAction>"
    )
    return _text(folder, scenario(catalogs=catalogs_in("routes"), init=init))


def road_of_system(folder: Path) -> Path:
    """A road file that is the list of users."""
    return _text(folder, scenario(road="/etc/passwd"))


def road_of_process(folder: Path) -> Path:
    """A road file below a link to everything."""
    return _text(folder, scenario(road=f"/proc/self/root{folder}/r.xodr"))


def road_link(folder: Path) -> Path:
    """A link that ends as road files do, to a key."""
    (folder / "key.pem").write_text("a secret word")
    (folder / "r.xodr").symlink_to("key.pem")
    return _text(folder, scenario(road="r.xodr"))


def road_key(folder: Path) -> Path:
    """A key as road file."""
    (folder / "key.pem").write_text("a secret word")
    return _text(folder, scenario(road="key.pem"))


def road_pipe(folder: Path) -> Path:
    """A pipe as road file."""
    os.mkfifo(folder / "r.xodr")
    return _text(folder, scenario(road="r.xodr"))


def road_device(folder: Path) -> Path:
    """A device as road file."""
    (folder / "r.xodr").symlink_to("/dev/zero")
    return _text(folder, scenario(road="r.xodr"))


def road_folder(folder: Path) -> Path:
    """A folder as road file."""
    (folder / "r.xodr").mkdir()
    return _text(folder, scenario(road="r.xodr"))


def road_bomb(folder: Path) -> Path:
    """A road file of entities that unfold to a billion."""
    inner = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 10))
    bomb = f'<!DOCTYPE x [<!ENTITY e0 "ha">{inner}]><OpenDRIVE>&e9;</OpenDRIVE>'
    _text(folder, bomb, "r.xodr")
    return _text(folder, scenario(road="r.xodr"))


def road_spiral(folder: Path) -> Path:
    """A reference line that turns a million times on one metre."""
    line = (
        "<geometry s='0' x='0' y='0' hdg='0' length='1e6'><spiral curvStart='-1e9' curvEnd='1e9'/>"
    )
    text = (
        "<OpenDRIVE><header revMajor='1' revMinor='6'/><road id='1' length='1e6' junction='-1'>"
        f"<planView>{line}</geometry></planView>{LANES}</road></OpenDRIVE>"
    )
    _text(folder, text, "r.xodr")
    return _text(folder, scenario(road="r.xodr"))


def catalogs_of_system(folder: Path) -> Path:
    """Catalogs in the folder of settings."""
    return _text(folder, scenario(catalogs=catalogs_in("/etc")))


def catalogs_of_processes(folder: Path) -> Path:
    """Catalogs in the folder of processes."""
    return _text(folder, scenario(catalogs=catalogs_in("/proc/self/fd")))


def catalog_link(folder: Path) -> Path:
    """A catalog that is a link to a key."""
    (folder / "key.pem").write_text("a secret word")
    (folder / "routes").mkdir()
    (folder / "routes" / "k.xosc").symlink_to("../key.pem")
    return _text(folder, scenario(catalogs=catalogs_in("routes")))


def catalog_pipe(folder: Path) -> Path:
    """A catalog that is a pipe."""
    (folder / "routes").mkdir()
    os.mkfifo(folder / "routes" / "k.xosc")
    return _text(folder, scenario(catalogs=catalogs_in("routes")))


def many_catalogs(folder: Path) -> Path:
    """More catalogs than are read."""
    (folder / "routes").mkdir()
    for number in range(1001):
        (folder / "routes" / f"{number}.xosc").touch()
    return _text(folder, scenario(catalogs=catalogs_in("routes")))


def long_name(folder: Path) -> Path:
    """A road file with a name that no folder takes."""
    return _text(folder, scenario(road="r" * 5000 + ".xodr"))


def pipe(folder: Path) -> Path:
    """A pipe as scenario."""
    path = folder / "s.xosc"
    os.mkfifo(path)
    return path


def device(folder: Path) -> Path:
    """A device as scenario."""
    path = folder / "s.xosc"
    path.symlink_to("/dev/zero")
    return path


def no_file(folder: Path) -> Path:
    """A folder as scenario."""
    path = folder / "s.xosc"
    path.mkdir()
    return path


def binary(folder: Path) -> Path:
    """Words that move a terminal's cursor."""
    return _text(folder, "<OpenSCENARIO>\x1b[2J</OpenSCENARIO>")


HOSTILE: dict[str, Callable[[Path], Path]] = {
    make.__name__: make
    for make in (
        *(entities, outside, large, deep, attribute, power, tower, parentheses, many_entities),
        *(nurbs, polyline, catalog_circle, road_of_system, road_of_process, road_link, road_key),
        *(road_pipe, road_device, road_folder, road_bomb, road_spiral, catalogs_of_system),
        *(catalogs_of_processes, catalog_link, catalog_pipe, many_catalogs, long_name, pipe),
        *(device, no_file, binary),
    )
}
"""Makes a file in a folder, and what it needs beside it."""
