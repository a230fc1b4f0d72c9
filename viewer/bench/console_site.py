"""A console's files of made-up cases: as many as a test or a measurement wants.

Everything follows from the number of a case. Pictures are drawn, and of many cases few differ.
"""

from __future__ import annotations

import io
import json
import math
import shutil
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import plotly
from PIL import Image, ImageDraw

from schemas.names import WEATHERS

AXES: dict[str, list[Any]] = {
    "model": ["tiny", "small", "large", "fusion"],
    "weather": list(WEATHERS),
    "ego_speed_mps": [6, 8, 10, 12, 14],
}
"""Axes of the matrix; `repeat` counts how often it is gone through."""

SIZES = ((80, 45), (160, 90))
PER_ATLAS = 64
SIDE = 8
FILM_FPS = 5
FILM_FRAMES = 50
FILM_SIZE = (320, 180)
PER_STRIP = 16
PICTURE_SIZE = (640, 360)
"""Size of the camera's picture, in which boxes are [px]."""
TICK_S = 0.05
TICKS = 200
PAGES_MAX = 1000
"""In larger sites only cases with a film have a page of their own."""
EMPTY: dict[str, Any] = {"t": [], "series": {}, "actors": [], "road": None, "detections": []}
DRAWN_ATLASES = 4
"""Pictures that differ; sheets beyond are copies of these."""

VERDICTS = [
    {"name": "collision", "color": "#D55E00", "symbol": "✕", "rank": 0, "passes": False},
    {"name": "unresolved", "color": "#565B62", "symbol": "?", "rank": 7, "passes": False},
    {"name": "false_braking", "color": "#E69F00", "symbol": "◐", "rank": 8, "passes": False},
    {"name": "pass", "color": "#0072B2", "symbol": "✓", "rank": 9, "passes": True},
]
COLUMNS = [
    *({"name": name, "kind": "axis", "unit": "", "better": None, "title": ""} for name in AXES),
    {"name": "repeat", "kind": "axis", "unit": "", "better": None, "title": ""},
    {"name": "verdict", "kind": "verdict", "unit": "", "better": None, "title": ""},
    {"name": "state", "kind": "text", "unit": "", "better": None, "title": "State"},
    {"name": "reason", "kind": "text", "unit": "", "better": None, "title": "Reason"},
    *(
        {"name": name, "kind": "kpi", "unit": unit, "better": better, "title": title}
        for name, unit, better, title in (
            ("impact_speed_mps", "m/s", "low", "impact speed"),
            ("dtc_min_m", "m", "high", "least distance"),
            ("aeb_time_s", "s", None, "time of the trigger"),
            ("decel_peak_mps2", "m/s²", "low", "peak deceleration"),
        )
    ),
]
WORKERS = {
    "age_s": None,
    "draining": False,
    "storage_error": None,
    "workers": [],
    "leases": [],
    "notes": [],
    "hosts": [],
    "quarantine": [],
    "resources": {"worker-1": {"t": [0, 5, 10, 15], "cpu_cores": [0.9, 1.0, 0.8, 1.0]}},
}
"""``workers.json`` of a campaign that has ended."""
HOSTILE = "<img src=x onerror=alert(1)> </script><b>&amp;"
"""Text of a stack that wants to be markup."""


@dataclass(frozen=True, slots=True)
class MadeCase:
    """One made-up case."""

    name: str
    axes: dict[str, Any]
    verdict: str
    reasons: str
    impact_mps: float | None
    dtc_m: float
    trigger_s: float | None


def name_of(axes: dict[str, Any]) -> str:
    """Name of the case of these axes."""
    return f"{axes['model']}-{axes['weather']}-{axes['ego_speed_mps']}-r{axes['repeat']}"


def made_case(index: int) -> MadeCase:
    """The case of a number: heavy weather and speed make it worse."""
    rest, axes = index, {}
    for name, values in AXES.items():
        rest, place = divmod(rest, len(values))
        axes[name] = values[place]
    axes["repeat"] = rest
    heavy = str(axes["weather"]).startswith("heavy")
    risk = (
        (axes["ego_speed_mps"] - 5) / 10 + (0.5 if heavy else 0) - 0.2 * (axes["model"] == "fusion")
    )
    chance = (index * 2654435761 % 2**32) / 2**32
    name = name_of(axes)
    late = round(5 + index % 7 * 0.15, 3)
    if chance < risk - 0.6:
        speed = round(axes["ego_speed_mps"] * (0.3 + 0.6 * chance), 3)
        words = f"collided with the van at {speed} m/s"
        return MadeCase(name, axes, "collision", words, speed, 0.0, late)
    if chance > 0.97:
        return MadeCase(name, axes, "false_braking", "braked 41 m before the van", None, 41.0, 2.1)
    if chance > 0.965:
        return MadeCase(name, axes, "unresolved", "no command for 60 s", None, 33.0, None)
    gap = round(2 + 12 * chance, 3)
    return MadeCase(name, axes, "pass", f"came to rest {gap} m from the van", None, gap, late)


def table_of(cases: list[MadeCase]) -> dict[str, Any]:
    """``table.json``: one list per column."""
    columns: dict[str, list[Any]] = {
        name: [c.axes[name] for c in cases] for name in (*AXES, "repeat")
    }
    columns["verdict"] = [case.verdict or None for case in cases]
    columns["state"] = ["ended" if case.verdict else "running" for case in cases]
    columns["reason"] = [case.reasons or None for case in cases]
    columns["impact_speed_mps"] = [case.impact_mps for case in cases]
    columns["dtc_min_m"] = [case.dtc_m for case in cases]
    columns["aeb_time_s"] = [case.trigger_s for case in cases]
    columns["decel_peak_mps2"] = [round(7 + len(case.name) % 5 / 4, 3) for case in cases]
    return {"version": "first", "cases": [case.name for case in cases], "columns": columns}


def summary_of(run: str, cases: list[MadeCase], *, running: bool) -> dict[str, Any]:
    """The run's entry in ``runs.json``."""
    counts: dict[str, int] = {}
    for case in cases:
        counts[case.verdict] = counts.get(case.verdict, 0) + 1
    ended = sum(n for name, n in counts.items() if name)
    return {
        "id": run,
        "name": run,
        "state": "running" if running else "finished",
        "cases": len(cases),
        "done": ended,
        "verdicts": {name: n for name, n in counts.items() if name},
        "running": counts.get("", 0) if running else None,
        "started_s": 1000.0,
        "elapsed_s": 723.0,
        "eta_s": 60.0 if running else None,
        "per_minute": 21.5,
        "workers": 4,
        "gpus": 1,
        "device_hours": 0.8,
    }


def beside_of(name: str, value: Any, names: dict[str, int]) -> dict[str, Any] | None:
    """A neighbour in the matrix, with its verdict; None: there is no such case."""
    if name not in names:
        return None
    index = names[name]
    verdict = made_case(index).verdict
    return {"case": name, "value": value, "index": index, "verdict": verdict}


def case_of(
    case: MadeCase, index: int, names: dict[str, int], *, recording: bool = True
) -> dict[str, Any]:
    """``case.json``; ``names``: index of each case."""
    beside: dict[str, Any] = {}
    for axis, values in AXES.items():
        place = values.index(case.axes[axis])
        found: dict[str, Any] = {"before": None, "after": None}
        for side, at in (("before", place - 1), ("after", place + 1)):
            if 0 <= at < len(values):
                name = name_of({**case.axes, axis: values[at]})
                found[side] = beside_of(name, values[at], names)
        beside[axis] = found
    failed = case.verdict == "collision"
    trace = ["Traceback (most recent call last):", '  File "stack.py", line 7', HOSTILE]
    kpis = (
        ("impact_speed_mps", "impact speed", case.impact_mps, "m/s"),
        ("dtc_min_m", "least distance", case.dtc_m, "m"),
    )
    attempts = {"count": 1, "committed": 1, "charges": [], "steered": [], "worker": "worker-1"}
    return {
        "case": case.name,
        "index": index,
        "state": "ended" if case.verdict else "running",
        "outcome": "verdict" if case.verdict else None,
        "verdict": case.verdict or None,
        "reasons": [case.reasons] if case.reasons else [],
        "axes": case.axes,
        "kpis": [
            {"name": name, "title": title, "value": value, "unit": unit, "better": None}
            for name, title, value, unit in kpis
        ],
        "names": {"nearest_object": "van"},
        "events": [
            {"t": 1.0, "what": "info", "detail": HOSTILE},
            {"t": 5.0, "what": "warn", "detail": "AEB triggered by the box van 0.71"},
        ]
        if case.verdict
        else [],
        "neighbours": beside,
        "repeat": f"conductor run made-up --case {case.name} --view record --out again",
        "log": {
            "lines": ["started", HOSTILE],
            "traceback": trace if failed else None,
            "cut": False,
        },
        "attempts": attempts | {"device_class": "cpu:x86_64", "wall_s": 6.2},
        "moment": None
        if case.trigger_s is None
        else {"t": case.trigger_s, "what": "impact" if failed else "trigger"},
        "film": None
        if not case.verdict or not recording
        else {"per_strip": PER_STRIP, "strips": -(-FILM_FRAMES // PER_STRIP), "fps": FILM_FPS}
        | {"frames": FILM_FRAMES, "size": list(FILM_SIZE), "picture": list(PICTURE_SIZE)}
        | {"first_t": 0.0},
        "links": {"recording": None, "in_full": None, "video": None, "incomplete": None},
    }


def series_of(case: MadeCase) -> dict[str, Any]:
    """``series.json``: a drive towards a van that stands in the lane."""
    t = np.arange(TICKS) * TICK_S
    speed = np.minimum(case.axes["ego_speed_mps"], t * 3)
    if case.trigger_s is not None:
        speed = np.maximum(0, speed - 7 * np.maximum(0, t - case.trigger_s))
    x = np.cumsum(speed) * TICK_S
    van = float(x[-1] + 2.5 + case.dtc_m)
    distance = np.maximum(0, van - 2.5 - x)
    ttc = [
        None if v < 0.1 else round(float(d / v), 4) for d, v in zip(distance, speed, strict=True)
    ]
    brake = [round(float(b), 3) for b in (np.diff(speed, append=speed[-1]) < -1e-3)]
    walk = -3 + t * 0.5
    rows = lambda values: [round(float(v), 4) for v in values]  # noqa: E731
    return {
        "t": rows(t),
        "series": {
            "speed": {"unit": "m/s", "v": rows(speed)},
            "distance": {"unit": "m", "v": rows(distance)},
            "ttc": {"unit": "s", "v": ttc},
            "brake": {"unit": "", "v": brake},
        },
        "actors": [
            {"name": "ego", "kind": "ego", "size": [4.5, 1.9, 1.5], "x": rows(x)}
            | {"y": rows(0 * x), "yaw": rows(0 * x)},
            {
                "name": "van",
                "kind": "car",
                "size": [5, 2, 2],
                "x": [van],
                "y": [0.3],
                "yaw": [0.05],
            },
            {"name": "walker", "kind": "pedestrian", "size": [0.5, 0.5, 1.8]}
            | {"x": rows(0 * x + van - 8), "y": rows(walk), "yaw": rows(0 * x + math.pi / 2)},
        ],
        "road": {
            "lines": [[[-20, side], [van + 60, side]] for side in (-5.25, -1.75, 1.75, 5.25)],
            "hulls": [
                {
                    "kind": "parked",
                    "x": van - 30 + 7 * n,
                    "y": -6.5,
                    "yaw": 0,
                    "size": [4.4, 1.8, 1.5],
                }
                for n in range(6)
            ],
        },
        "detections": [
            {"t": round(float(now), 3), "boxes": [_box(float(d))], "truth": [], "trigger": None}
            for now, d in zip(t[::2], distance[::2], strict=True)
        ],
    }


def _box(distance_m: float) -> dict[str, Any]:
    share = max(0.02, min(0.8, 6 / max(distance_m, 3)))
    width, height = share * PICTURE_SIZE[0], share * PICTURE_SIZE[1]
    left, top = (PICTURE_SIZE[0] - width) / 2, (PICTURE_SIZE[1] - height) / 2
    return {"x": left, "y": top, "w": width, "h": height, "label": "van 0.71"}


def draw(width: int, height: int, shade: float, near: float) -> Image.Image:
    """A street with a van that is ``near`` (0 to 1), under a sky of some ``shade`` (0 to 1)."""
    sky = tuple(int(60 + 150 * shade + c) for c in (0, 15, 30))
    picture = Image.new("RGB", (width, height), sky)
    pen = ImageDraw.Draw(picture)
    pen.rectangle((0, height // 2, width, height), fill=(70, 72, 74))
    pen.polygon(
        [
            (width * 0.48, height / 2),
            (width * 0.52, height / 2),
            (width * 0.7, height),
            (width * 0.3, height),
        ],
        fill=(96, 98, 100),
    )
    half = width * (0.03 + 0.22 * near)
    box = (
        width / 2 - half,
        height * 0.55 - half * 0.8,
        width / 2 + half,
        height * 0.55 + half * 0.6,
    )
    pen.rectangle(box, fill=(170, 40, 35))
    return picture


def write_site(
    folder: Path,
    count: int,
    *,
    run: str = "made-up",
    static: bool = True,
    dossiers: int = 12,
    running: int = 0,
) -> list[MadeCase]:
    """Write a console of ``count`` cases; the ``dossiers`` worst and first have a film.

    Args:
        folder: is made.
        count: cases.
        run: name of the run.
        static: as files for a disk; False: as a server gives them, with ``runs.json`` being live.
        dossiers: cases with a film and series: so many of the worst, and of the first.
        running: how many of the last cases still run.
    """
    cases = [made_case(index) for index in range(count)]
    for index in range(count - running, count):
        case = cases[index]
        cases[index] = MadeCase(case.name, case.axes, "", "", None, 0.0, None)
    write_page(folder, static=static)
    data = folder / "data"
    write = _writer(data, static=static)
    summary = summary_of(run, cases, running=running > 0)
    write(
        "runs.json",
        {"live": not static, "roles": "look", "runs": [summary], "verdict_words": VERDICTS},
    )
    axes = {**AXES, "repeat": sorted({case.axes["repeat"] for case in cases})}
    named = [{"name": name, "values": values} for name, values in axes.items()]
    info = {
        **summary,
        "axes": named,
        "columns": COLUMNS,
        "verdict_words": VERDICTS,
        "links": {},
        "fingerprint": "f" * 64,
    }
    write(f"runs/{run}/run.json", info)
    write(f"runs/{run}/table.json", table_of(cases))
    write(f"runs/{run}/workers.json", WORKERS)
    write(
        f"runs/{run}/pictures/atlas.json",
        {"sizes": SIZES, "per_atlas": PER_ATLAS, "has": [bool(c.verdict) for c in cases]},
    )
    _write_atlases(data / "runs" / run / "pictures", count)
    ranks = {kind["name"]: kind["rank"] for kind in VERDICTS}
    worst = sorted(
        range(count), key=lambda i: (ranks.get(cases[i].verdict, 99), -(cases[i].impact_mps or 0))
    )
    names = {case.name: index for index, case in enumerate(cases)}
    moments = [_webp(draw(320, 180, shade / 7, 0.6)) for shade in range(7)]
    films = {*worst[:dossiers], *range(min(dossiers, count))}
    for index in range(count) if count <= PAGES_MAX else sorted(films):
        case = cases[index]
        filmed = index in films and bool(case.verdict)
        write(
            f"runs/{run}/cases/{case.name}/case.json",
            case_of(case, index, names, recording=filmed),
        )
        write(f"runs/{run}/cases/{case.name}/series.json", series_of(case) if filmed else EMPTY)
        place = data / "runs" / run / "cases" / case.name
        (place / "moment.webp").write_bytes(moments[index % 7])
        if filmed:
            (place / "film").mkdir()
            _write_film(place / "film", index)
    return cases


def _webp(picture: Image.Image) -> bytes:
    file = io.BytesIO()
    picture.save(file, "WEBP", quality=60)
    return file.getvalue()


def write_page(folder: Path, *, static: bool) -> None:
    """The page itself, and the library of its plots."""
    folder.mkdir(parents=True)
    built = resources.files("viewer.console").joinpath("built")
    for name in ("index.html", "console.js", "console.css"):
        text = built.joinpath(name).read_text()
        if static and name == "index.html":
            text = text.replace('<html lang="en">', '<html lang="en" data-static>')
        (folder / name).write_text(text)
    package = Path(plotly.__file__).parent
    shutil.copy(package / "package_data" / "plotly.min.js", folder / "plotly.js")


def _writer(data: Path, *, static: bool) -> Any:
    def write(path: str, value: Any) -> None:
        place = data / path
        place.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(value, separators=(",", ":"))
        if static:
            call = f"consoleData({json.dumps(path)}, {json.dumps(text)});\n"
            place.with_name(f"{place.name}.js").write_text(call)
        else:
            place.write_text(text)

    return write


def _write_atlases(folder: Path, count: int) -> None:
    for width, height in SIZES:
        sheets = folder / f"{width}x{height}"
        sheets.mkdir(parents=True)
        for number in range(math.ceil(count / PER_ATLAS)):
            place = sheets / f"{number}.webp"
            if number >= DRAWN_ATLASES:
                shutil.copy(sheets / f"{number % DRAWN_ATLASES}.webp", place)
                continue
            sheet = Image.new("RGB", (width * SIDE, height * SIDE))
            for at in range(PER_ATLAS):
                picture = draw(width, height, (at + number) % 7 / 7, at % 5 / 5)
                sheet.paste(picture, (at % SIDE * width, at // SIDE * height))
            sheet.save(place, quality=60)


def _write_film(folder: Path, index: int) -> None:
    width, height = FILM_SIZE
    for number in range(math.ceil(FILM_FRAMES / PER_STRIP)):
        strip = Image.new("RGB", (width * PER_STRIP, height))
        for at in range(PER_STRIP):
            frame = number * PER_STRIP + at
            strip.paste(draw(width, height, index % 7 / 7, frame / FILM_FRAMES), (at * width, 0))
        strip.save(folder / f"{number}.webp", quality=60)
