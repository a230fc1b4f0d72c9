"""OpenDRIVE files for tests, written from a few words."""

from __future__ import annotations

from collections.abc import Sequence

LINE = "<line/>"
WIDTH = '<width sOffset="0" a="3.5" b="0" c="0" d="0"/>'


def geometry(
    shape: str, length: float, s: float = 0.0, at: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> str:
    """A piece of a reference line; ``at`` is x, y [m] and heading [rad]."""
    x, y, heading = at
    return (
        f'<geometry s="{s!r}" x="{x!r}" y="{y!r}" hdg="{heading!r}" length="{length!r}">'
        f"{shape}</geometry>\n"
    )


def lane(lane_id: int, inside: str = WIDTH, kind: str = "driving", more: str = "") -> str:
    """A lane."""
    return f'<lane id="{lane_id}" type="{kind}" level="false" {more}>{inside}</lane>\n'


def section(s: float = 0.0, left: str | None = None, right: str | None = None) -> str:
    """A lane section; one lane on each side if nothing is said."""
    left = lane(1) if left is None else left
    right = lane(-1) if right is None else right
    sides = (f"<left>{left}</left>" if left else "") + (
        '<center><lane id="0" type="none" level="false"/></center>\n'
    )
    sides += f"<right>{right}</right>" if right else ""
    return f'<laneSection s="{s!r}">\n{sides}</laneSection>\n'


def road(
    length: float = 100.0,
    plan: str | None = None,
    lanes: str | None = None,
    *,
    road_id: str = "0",
    junction: str = "-1",
    link: str = "",
    more: str = "",
    attributes: str = "",
) -> str:
    """A road; straight along x if nothing is said."""
    plan = geometry(LINE, length) if plan is None else plan
    lanes = section() if lanes is None else lanes
    return (
        f'<road id="{road_id}" junction="{junction}" length="{length!r}" {attributes}>\n'
        f"<link>{link}</link>\n<planView>\n{plan}</planView>\n{more}<lanes>\n{lanes}</lanes>\n</road>\n"
    )


def xodr(*parts: str, version: tuple[object, object] = (1, 6)) -> bytes:
    """A whole file."""
    head = f'<header revMajor="{version[0]}" revMinor="{version[1]}" name="test"/>\n'
    body = "".join(parts) or road()
    return f'<?xml version="1.0"?>\n<OpenDRIVE>\n{head}{body}</OpenDRIVE>\n'.encode()


def crossing(rule: str = "RHT") -> bytes:
    """Two roads, joined by a junction with one way through it: 0 (50 m), 2 (20 m), 1 (50 m)."""
    through = lane(1, link((1,), (1,)) + WIDTH), lane(-1, link((-1,), (-1,)) + WIDTH)
    return xodr(
        road(50.0, link=end("successor", "junction", "9"), attributes=f'rule="{rule}"'),
        road(
            50.0,
            geometry(LINE, 50.0, at=(70.0, 0.0, 0.0)),
            road_id="1",
            link=end("predecessor", "junction", "9"),
            attributes=f'rule="{rule}"',
        ),
        road(
            20.0,
            geometry(LINE, 20.0, at=(50.0, 0.0, 0.0)),
            section(left=through[0], right=through[1]),
            road_id="2",
            junction="9",
            link=end("predecessor", "road", "0", "end") + end("successor", "road", "1", "start"),
            attributes=f'rule="{rule}"',
        ),
        '<junction id="9" name="j"><connection id="0" incomingRoad="0" connectingRoad="2" '
        'contactPoint="start"><laneLink from="-1" to="-1"/></connection></junction>\n',
    )


def link(before: Sequence[int] = (), after: Sequence[int] = ()) -> str:
    """Links of a lane."""
    parts = [f'<predecessor id="{i}"/>' for i in before] + [f'<successor id="{i}"/>' for i in after]
    return f"<link>{''.join(parts)}</link>"


def end(name: str, kind: str, other: str, contact: str = "") -> str:
    """What joins an end of a road."""
    point = f'contactPoint="{contact}"' if contact else ""
    return f'<{name} elementType="{kind}" elementId="{other}" {point}/>'
