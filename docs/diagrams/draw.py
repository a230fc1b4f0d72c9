"""Diagrams of ARCHITECTURE.md as SVG: ``python docs/diagrams/draw.py`` writes them to docs/images.

``tests/house/test_documents.py`` compares the files with what this script draws.
"""

from __future__ import annotations

from html import escape
from pathlib import Path

IMAGES = Path(__file__).parents[1] / "images"
INK, SOFT, PAPER = "#1b2733", "#5a6b7b", "#ffffff"
CONTROL, DRIVE, VIEW = "#1f5fbf", "#c2410c", "#15803d"
FILLS = {"group": "#f3f6f9", "ours": "#e3edf9", "foreign": "#fdebd9", "file": "#eef0f2"}


class Drawing:
    """An SVG picture of boxes, arrows and lines of text."""

    def __init__(self, width: int, height: int, title: str) -> None:
        self._size = f'width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
        self._title = title
        self._parts: list[str] = []

    def text(
        self,
        x: float,
        y: float,
        words: str,
        *,
        size: int = 13,
        bold: bool = False,
        colour: str = INK,
        anchor: str = "start",
    ) -> None:
        """One line of text whose baseline begins (or is centred) at ``x, y``."""
        weight = ' font-weight="600"' if bold else ""
        self._parts.append(
            f'<text x="{x:g}" y="{y:g}" font-size="{size}" fill="{colour}" '
            f'text-anchor="{anchor}"{weight}>{escape(words)}</text>'
        )

    def box(
        self, at: tuple[int, int, int, int], name: str, *lines: str, fill: str = "ours"
    ) -> None:
        """A box ``at`` x, y, width, height, with a bold name and lines of explanation below it."""
        x, y, w, h = at
        dash = ' stroke-dasharray="5 4"' if fill == "group" else ""
        self._parts.append(
            f'<rect x="{x:g}" y="{y:g}" width="{w:g}" height="{h:g}" rx="6" '
            f'fill="{FILLS[fill]}" stroke="{SOFT}"{dash}/>'
        )
        self.text(x + 12, y + 21, name, size=14, bold=True)
        for row, line in enumerate(lines):
            self.text(x + 12, y + 40 + 17 * row, line, size=12, colour=SOFT)

    def arrow(
        self, points: list[tuple[float, float]], colour: str, *, both: bool = True, width: int = 3
    ) -> None:
        """A line along ``points`` with a head at its end, and at its start if ``both``."""
        path = "M" + " L".join(f"{x:g} {y:g}" for x, y in points)
        name = colour.lstrip("#")
        start = f' marker-start="url(#{name})"' if both else ""
        self._parts.append(
            f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width}" '
            f'marker-end="url(#{name})"{start}/>'
        )

    def svg(self) -> str:
        """The picture as text."""
        heads = "".join(
            f'<marker id="{colour.lstrip("#")}" viewBox="0 0 10 10" refX="8" refY="5" '
            f'markerWidth="4.5" markerHeight="4.5" orient="auto-start-reverse">'
            f'<path d="M0 0 L10 5 L0 10 z" fill="{colour}"/></marker>'
            for colour in (CONTROL, DRIVE, VIEW, SOFT)
        )
        body = "\n".join(self._parts)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" {self._size} role="img" '
            f'font-family="DejaVu Sans, Verdana, Helvetica, Arial, sans-serif">\n'
            f"<title>{escape(self._title)}</title>\n<defs>{heads}</defs>\n"
            f'<rect width="100%" height="100%" fill="{PAPER}"/>\n{body}\n</svg>\n'
        )


def processes() -> str:
    """The processes of a campaign and the planes between them."""
    d = Drawing(980, 560, "Processes of a campaign, and the planes between them")
    d.box((20, 20, 300, 330), "host of the conductor", fill="group")
    d.box((40, 55, 260, 62), "front", "owns the TLS port; passes members on")
    d.box(
        (40, 145, 260, 102),
        "conductor",
        "router, one session per role",
        "core: queue, leases, tokens",
        "conductor.db: journal of facts",
    )
    d.box((40, 275, 260, 60), "twin judge", "comes to each verdict again")
    d.arrow([(170, 117), (170, 145)], SOFT)
    d.arrow([(170, 247), (170, 275)], SOFT)

    d.box((410, 20, 550, 330), "host of workers (the same host, or many)", fill="group")
    d.box(
        (430, 55, 510, 62), "twin worker", "supervisor without Warp: leases in, results out, spool"
    )
    d.box((430, 150, 510, 185), "rig: S slots", fill="group")
    d.box((450, 185, 190, 80), "twin sim", "engine of S cases,", "Warp kernels")
    d.box(
        (740, 185, 180, 80), "devkit host", "the stack under test,", "in a sandbox", fill="foreign"
    )
    d.box((450, 285, 190, 38), "viewer record")
    d.arrow([(545, 117), (545, 185)], SOFT)
    d.arrow([(830, 117), (830, 185)], SOFT)
    d.arrow([(640, 225), (740, 225)], DRIVE)
    d.text(690, 213, "drive", bold=True, colour=DRIVE, anchor="middle")
    d.arrow([(545, 265), (545, 285)], VIEW, both=False)
    d.text(654, 308, "recording.rrd, one per attempt", size=12, colour=SOFT)
    d.arrow([(300, 86), (430, 86)], CONTROL)
    d.text(365, 76, "control", bold=True, colour=CONTROL, anchor="middle")

    d.box((20, 390, 300, 100), "laptop or login node", fill="group")
    d.box((40, 424, 260, 52), "viewer live, viewer web", "through the front, or a relay")
    d.arrow([(450, 240), (350, 240), (350, 104), (300, 104)], VIEW)
    d.arrow([(40, 104), (8, 104), (8, 450), (40, 450)], VIEW)
    d.text(362, 258, "view", bold=True, colour=VIEW)

    d.box(
        (410, 390, 550, 100),
        "run folder, on a file system that all see",
        "outcomes.json, timeline.jsonl, cases/<case>/attempt-<n>/kpi.parquet, ...",
        "manifest.json: SHA-256 of every file, signed at the end",
        fill="file",
    )
    d.arrow([(685, 350), (685, 390)], SOFT, both=False)
    d.arrow([(280, 350), (280, 370), (470, 370), (470, 390)], SOFT, both=False)

    for x, colour, words in (
        (20, CONTROL, "control: small typed messages, RPC"),
        (330, DRIVE, "drive: arrays of all slots, in lockstep"),
        (650, VIEW, "view: per case, dropped if nobody listens"),
    ):
        d.arrow([(x, 530), (x + 36, 530)], colour)
        d.text(x + 46, 534, words, size=12)
    return d.svg()


def packages() -> str:
    """The packages in layers: each may import what is below it."""
    d = Drawing(980, 516, "Packages: each imports only what lies below it")
    d.box((20, 16, 940, 34), "drivetwin")
    d.text(130, 37, "for programs and notebooks: what the commands do", size=12, colour=SOFT)
    for x in (370, 570, 900):
        d.arrow([(x, 50), (x, 72)], SOFT, both=False, width=2)
    d.box(
        (20, 74, 220, 138),
        "twin",
        "rig, worker, view, scenario, kpi",
        "vehicle, sensors, actors, road",
        "render, world, dataset",
        "bench, validate",
        "the only one with Warp (*)",
    )
    d.box(
        (260, 74, 220, 138),
        "conductor",
        "core: pure decisions",
        "journal: the only SQLite",
        "serve, run, commands",
        "records, report, trust",
        "bench",
    )
    d.box(
        (500, 74, 140, 138),
        "viewer",
        "live, browser",
        "recording",
        "playback",
        "intervening",
        "the only Rerun",
    )
    d.box(
        (660, 74, 160, 138),
        "devkit",
        "stack, client",
        "hosting, checking",
        "detector, lane",
        "bridges, replaying",
        "training: only torch",
    )
    d.box((840, 74, 120, 138), "hpc", "slurm, pbs", "software", "job scripts")
    for x in (130, 370, 570, 740, 900):
        d.arrow([(x, 212), (x, 240)], SOFT, both=False, width=2)
    d.box(
        (20, 242, 940, 54),
        "twin.fabric",
        "bus, drive plane, keys and roles, front: the only package with Zenoh",
    )
    d.box((20, 324, 300, 54), "twin.records", "KPI files, drive records, logs")
    d.box((340, 324, 300, 54), "twin.sandbox", "bubblewrap around a stack")
    d.box((660, 324, 300, 54), "twin.stack_identity", "what a stack consists of")
    d.box((20, 402, 940, 34), "twin.base")
    d.text(
        130, 423, "errors, command lines, files, child processes, GPU set-up", size=12, colour=SOFT
    )
    d.box((20, 454, 940, 34), "schemas")
    d.text(
        130,
        475,
        "sections of the campaign, wire messages, files, identity: the standard "
        "library, NumPy, msgspec",
        size=12,
        colour=SOFT,
    )
    for x in (170, 490, 810):
        d.arrow([(x, 296), (x, 322)], SOFT, both=False, width=2)
        d.arrow([(x, 378), (x, 400)], SOFT, both=False, width=2)
    d.arrow([(490, 436), (490, 452)], SOFT, both=False, width=2)
    d.text(
        20,
        507,
        "The five below drivetwin stand side by side: none imports another. (*) Two modules "
        "of devkit.detector use Warp as well, see docs/decisions/0013.",
        size=11,
        colour=SOFT,
    )
    return d.svg()


DIAGRAMS = {"processes.svg": processes, "packages.svg": packages}
"""File name -> what draws it."""


if __name__ == "__main__":
    for name, draw in DIAGRAMS.items():
        (IMAGES / name).write_text(draw(), encoding="utf-8")
