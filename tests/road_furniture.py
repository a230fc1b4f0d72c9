"""Objects and signals of road files for tests."""

from __future__ import annotations

from tests.road_files import road, xodr


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
