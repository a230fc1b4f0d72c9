"""Lost cases on a result page: what happened, the camera's picture, the end of the film."""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from conductor.report.analysis.losses import EXAMPLES_MAX, examples, kind_of
from conductor.report.pages.content import Content
from conductor.report.pages.templates import number, words
from conductor.report.reading.axes import axis_label, axis_value, varied_axes
from conductor.report.reading.dossier import CaseRow, Dossier
from conductor.report.reading.films import make_clips
from conductor.report.reading.recorded import ask_viewer
from conductor.report.searching.section import mildest, values_of
from twin.base.files import write_atomic

CLIPS_MAX = 3
"""Most ends of films on a page: each is half a megabyte, and pages are kept with the sources."""
_QUALITY = 88
"""Quality of the pictures: noise makes PNG files large."""


@dataclass(frozen=True, slots=True)
class Shown:
    """A lost case on the page."""

    kind: str
    where: str
    story: str
    picture: str
    """File in the folder of pictures; empty: there is none."""
    missing: str
    """Reason why there is no picture."""
    clip: str
    """File of the end of its film; empty: there is none."""


def shown_cases(
    content: Content, models: Sequence[str], beside: Path, *, films: bool
) -> dict[str, list[Shown]]:
    """Lost cases by model, their pictures written into the folder ``beside``: of a search the
    mildest of each cluster, else examples of every kind.

    ``films``: also the ends of the films of the first of them.
    """
    dossier = content.dossier
    named = mildest(content.search)
    chosen: dict[str, list[CaseRow]] = {}
    for model in models:
        model_rows = [row for row in dossier.rows if row.case.variation.model == model]
        by_name = {row.case.id: row for row in model_rows}
        clusters = [by_name[name] for name in named if name in by_name]
        chosen[model] = clusters[:EXAMPLES_MAX] or examples(dossier, model_rows)
    flat = [row for rows in chosen.values() for row in rows]
    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        missing = list(pool.map(lambda row: _take_picture(dossier, row, beside), flat))
    reasons = {row.case.id: reason for row, reason in zip(flat, missing, strict=True)}
    clips = make_clips(dossier, flat[:CLIPS_MAX], beside) if films else {}
    shown = {
        model: [_shown(content, row, reasons[row.case.id], clips) for row in rows]
        for model, rows in chosen.items()
    }
    _drop_old(beside, shown)
    return shown


def _drop_old(beside: Path, shown: dict[str, list[Shown]]) -> None:
    """Remove pictures that an earlier page had and this one has not."""
    kept = {
        name for cases in shown.values() for case in cases for name in (case.picture, case.clip)
    }
    for pattern in ("case-*.jpg", "film-*.webp"):
        for old in beside.glob(pattern):
            if old.name not in kept:
                old.unlink()


def _shown(content: Content, row: CaseRow, missing: str, clips: dict[str, str]) -> Shown:
    story = ". ".join(reason.rstrip(".") for reason in row.end.reasons)
    time, distance = row.scalar("aeb_time_s"), row.scalar("aeb_dtc_m")
    aeb = "No AEB."
    if time is not None:
        before = f", {number(distance)} m before it"
        where = before if content.dossier.scenario.stops_for_target else ""
        aeb = f"AEB at {time:.2f} s{where}."
    return Shown(
        kind=kind_of(row),
        where=_where(content, row),
        story=f"{story[:1].upper()}{story[1:]}. {aeb}" if story else aeb,
        picture="" if missing else _picture(row),
        missing=missing,
        clip=clips.get(row.case.id, ""),
    )


def _where(content: Content, row: CaseRow) -> str:
    """What tells a case from others: values of a search's parameters, or of the axes."""
    search = content.search
    values = None if search is None else values_of(search, row.case.id)
    if search is not None and values is not None:
        told = zip(map(axis_label, search.parameters), values, strict=True)
        return ", ".join(
            [
                row.case.id,
                *(f"{name} {number(v) if isinstance(v, float) else v}" for name, v in told),
            ]
        )
    axes = [axis for axis in reversed(varied_axes(content.dossier)) if axis != "model"]
    return ", ".join(
        words(axis_value(row.case, axis)) for axis in axes or ["weather", "time_of_day"]
    )


def _picture(row: CaseRow) -> str:
    return f"case-{row.case.id}.jpg"


def _take_picture(dossier: Dossier, row: CaseRow, beside: Path) -> str:
    """Write the picture of a case; empty, or why there is none."""
    with tempfile.TemporaryDirectory() as scratch:
        frame = Path(scratch) / "frame.png"
        missing = ask_viewer(dossier, row, "frame", frame)
        if missing:
            return missing
        data = io.BytesIO()
        with Image.open(frame) as picture:
            picture.convert("RGB").save(data, "JPEG", quality=_QUALITY)
    write_atomic(beside / _picture(row), data.getvalue())
    return ""
