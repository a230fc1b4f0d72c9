"""Objects and signals of road files for tests."""

from __future__ import annotations

from road_files import road, xodr


def with_furniture(
    objects: str = "", signals: str = "", *, length: float = 100.0, **more: object
) -> bytes:
    """A file with one road, straight along x if nothing is said."""
    text = road(length, **more)  # type: ignore[arg-type]
    beside = f"<objects>\n{objects}</objects>\n<signals>\n{signals}</signals>\n"
    return xodr(text.replace("</road>", f"{beside}</road>"))


def _element(name: str, inside: str, values: dict[str, object]) -> str:
    words = " ".join(f'{key}="{value}"' for key, value in values.items())
    return f"<{name} {words}>{inside}</{name}>\n"


def road_object(kind: str, s: float, t: float, inside: str = "", **more: object) -> str:
    """An object of type ``kind``."""
    values = {"id": "1", "type": kind, "s": s, "t": t, "zOffset": 0.0, "hdg": 0.0}
    return _element("object", inside, {**values, **more})


def repeat(s: float, length: float, distance: float, **more: object) -> str:
    """A row."""
    return _element("repeat", "", {"s": s, "length": length, "distance": distance, **more})


def road_signal(kind: str, s: float, t: float, **more: object) -> str:
    """A sign of the German catalogue 2 m above the road."""
    values = {"id": "1", "type": kind, "subtype": "-1", "s": s, "t": t, "zOffset": 2.0}
    values |= {"dynamic": "no", "orientation": "+", "country": "DE"}
    return _element("signal", "", {**values, **more})


def furniture_file() -> bytes:
    """A file with objects of all kinds of bodies, paint and signals."""
    corners = ((0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3))
    local = "".join(f'<cornerLocal u="{u}" v="{v}" z="0" height="2"/>' for u, v in corners)
    fixed = "".join(
        f'<cornerRoad s="{50 + u}" t="{v - 1}" dz="0.01" height="0"/>' for u, v in corners
    )
    rail = repeat(0, 90, 0, tStart=-5, tEnd=-6, heightStart=0.7, widthStart=0.2)
    objects = [
        road_object("barrier", 0, -5, rail, subtype="guardRail"),
        road_object("tree", 0, 9, repeat(5, 80, 20, heightStart=5, heightEnd=9)),
        road_object("building", 40, 20, f"<outline>{local}</outline>", hdg=0.5),
        road_object("crosswalk", 50, 0, f"<outlines><outline>{fixed}</outline></outlines>"),
        road_object("parkingSpace", 70, -4, length=5, width=2),
        road_object("pole", 80, 5, radius=0.1, height=3, pitch=0.1, roll=-0.1),
    ]
    signals = [
        road_signal("274", 20, -5, value=50),
        road_signal("1000001", 60, -1, zOffset=5, dynamic="yes", orientation="-"),
    ]
    return with_furniture("".join(objects), "".join(signals))
