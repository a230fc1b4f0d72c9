"""The result page of a campaign: Markdown with pictures beside it, to be published and read.

What people have written into it is kept when it is made again
(:mod:`conductor.report.pages.prose`).
"""

from __future__ import annotations

import re
import shlex
import urllib.parse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from conductor.report.analysis.losses import (
    LostLine,
    counts_by,
    extremes,
    lost_lines,
    page_axes,
)
from conductor.report.analysis.perception_cost import perception_costs
from conductor.report.analysis.statistics import wilson
from conductor.report.pages.content import Content, first_screen, read_content
from conductor.report.pages.prose import SUMMARY, block, check_known, model_block, read_texts
from conductor.report.pages.shown_cases import Shown, shown_cases
from conductor.report.pages.tables import statuses, verdict_table
from conductor.report.pages.templates import environment
from conductor.report.plots.files import plot_picture
from conductor.report.plots.heat_picture import heat_picture
from conductor.report.plots.palette import status_symbol
from conductor.report.reading.axes import axis_label, axis_values, varied_axes
from conductor.report.reading.curves import time_label
from conductor.report.reading.dossier import Dossier, open_dossier
from conductor.report.reading.evidence import commands, versions
from conductor.report.reading.provenance import file_digests, text_digest
from conductor.report.reading.systems import system_name, system_names, system_text
from conductor.report.rulebook.shown import RULE, rulebook_shown
from conductor.report.searching.section import search_shown
from conductor.serve.folders import CAMPAIGN_FILE
from schemas.files.proposals import FILE_NAME as PROPOSED_FILE
from schemas.files.yaml_file import dump_yaml
from schemas.kinds.kpi import scalars_by_name
from twin.base.errors import UsageError, storage_error
from twin.base.files import write_atomic

HEAT_FILE, SEARCH_FILE = "heat.png", "search.png"
"""Plots in the folder of a page."""
_MARKDOWN = re.compile(r"([\\`*_{}\[\]<>|~#$&])")


@dataclass(frozen=True, slots=True)
class ModelSection:
    """What the page says about one model."""

    model: str
    name: str
    perception: str
    passed: int
    no_collision: int
    ended: int
    total: int
    text_name: str
    statuses: list[str]
    lost: list[LostLine]
    shown: list[Shown]


def write_result_page(folder: Path, page: Path, *, films: bool = False) -> Path:
    """Write the page of the campaign in ``folder`` to ``page`` (.md), its pictures into a folder
    beside it that is named like the page; returns ``page``.

    Pictures, and with ``films`` ends of films, are taken from the recordings of cases that were run
    with ``--view record``.

    Raises:
        UsageError: no campaign was run in ``folder``, or ``page`` is something else; one line.
        InfrastructureError: files are damaged, or the disk lets us down.
    """
    if page.suffix.lower() != ".md":
        raise UsageError(f"--markdown {page}: expected a file name that ends in .md")
    content = read_content(open_dossier(folder))
    dossier = content.dossier
    models = [str(model) for model in axis_values(dossier, "model")]
    texts = read_texts(page)
    check_known(page, texts, [SUMMARY, *map(model_block, models)])
    beside = page.with_suffix("")
    try:
        beside.mkdir(parents=True, exist_ok=True)
        shown = shown_cases(content, models, beside, films=films)
        plots = _write_plots(content, beside)
        text = _render(content, _sections(dossier, shown), texts, beside.name, plots)
        for name in (PROPOSED_FILE, CAMPAIGN_FILE):
            if (folder / name).exists():
                write_atomic(beside / name, (folder / name).read_bytes())
        write_atomic(page, text.encode())
    except OSError as error:
        raise storage_error(error, str(error.filename or page)) from None
    return page


def _write_plots(content: Content, beside: Path) -> set[str]:
    """Write the maps, where they have more than one cell, and the plot of a search; names of the
    files that are there now."""
    dossier = content.dossier
    cells = any(len(axis_values(dossier, axis)) > 1 for axis in page_axes(dossier))
    plots = {
        HEAT_FILE: heat_picture(dossier) if cells else None,
        SEARCH_FILE: plot_picture(content, "search"),
    }
    for name, data in plots.items():
        if data is None:
            (beside / name).unlink(missing_ok=True)
        else:
            write_atomic(beside / name, data)
    return {name for name, data in plots.items() if data is not None}


def _render(
    content: Content,
    sections: list[ModelSection],
    texts: dict[str, str],
    folder: str,
    plots: set[str],
) -> str:
    dossier = content.dossier
    report = dossier.scenario.report
    jinja = environment(autoescape=False)
    jinja.filters["md"] = escaped
    rows = dossier.rows
    unhurt = [row for row in rows if row.no_collision is True]
    autonomy = dump_yaml(msgspec.to_builtins(dossier.campaign.autonomy)).strip()
    text = jinja.get_template("result.md.j2").render(
        dossier=dossier,
        notices=first_screen(content.dossier),
        time_label=time_label(dossier).replace("S", "s", 1).replace("Time", "time"),
        outcomes=dossier.outcomes,
        evidence=content.evidence,
        versions=versions(),
        commands=_commands(dossier, folder),
        files=file_digests(dossier),
        autonomy=fenced(autonomy, "yaml"),
        autonomy_digest=text_digest(autonomy),
        costs=perception_costs(dossier),
        systems=verdict_table(dossier),
        other_statuses=[status for status in statuses(dossier) if status != "pass"],
        models=[section.model for section in sections],
        names=system_names(dossier),
        axes=[axis_label(axis) for axis in page_axes(dossier)],
        axis_names=[axis_label(axis).partition(" [")[0].lower() for axis in page_axes(dossier)],
        crowded=_crowded(dossier),
        mapped=HEAT_FILE in plots,
        search=search_shown(content.search),
        searched=SEARCH_FILE in plots,
        indices=content.search.indices if content.search else None,
        report=report,
        book=rulebook_shown(dossier, content.rulebook),
        RULE=RULE,
        symbol=status_symbol,
        digits={kind.name: kind.digits for kind in scalars_by_name().values()},
        lead_unit=scalars_by_name()[report.lead.scalar].unit,
        counted=[(table, _counted(dossier, table.verdict)) for table in report.counted],
        extremes={
            "hardest": extremes(rows, "impact_speed_mps", largest=True),
            "scenario": extremes(
                unhurt if report.extreme.of == "unhurt" else rows,
                report.extreme.scalar,
                largest=report.extreme.largest,
            ),
            "longest": extremes(rows, "sim_time_s", largest=True),
        },
        sections=sections,
        any_picture=any(shown.picture for section in sections for shown in section.shown),
        any_clip=any(shown.clip for section in sections for shown in section.shown),
        summary_name=SUMMARY,
        block=block,
        wilson=wilson,
        folder=urllib.parse.quote(folder),
    )
    text = re.sub(r"\n{3,}", "\n\n", text).strip() + "\n"
    # Only now: what people have written keeps its blank lines.
    for name, written in texts.items():
        text = text.replace(block(name, ""), block(name, written), 1)
    return text


def _commands(dossier: Dossier, folder: str) -> list[str]:
    if dossier.imported is not None:
        return commands(dossier)[:2]
    on_gpu = any(name.startswith("cuda") for name in dossier.outcomes.ran_on)
    device = " --device cuda:0" if on_gpu else ""
    return [
        f"conductor run {shlex.quote(f'{folder}/{CAMPAIGN_FILE}')} --out repeat{device}",
        "conductor fingerprint repeat",
    ]


def _crowded(dossier: Dossier) -> bool:
    """Whether cells of the heat map hold several cases."""
    x_axis, y_axis = page_axes(dossier)
    names = {x_axis, y_axis, "model"}
    return any(axis not in names for axis in varied_axes(dossier))


def _counted(dossier: Dossier, status: str) -> list[tuple[str, list[tuple[Any, dict[str, str]]]]]:
    tables = [
        (axis_label(axis), counts_by(dossier, axis, status))
        for axis in reversed(page_axes(dossier))
    ]
    return [table for table in tables if table[1]]


def _sections(dossier: Dossier, shown: dict[str, list[Shown]]) -> list[ModelSection]:
    sections = []
    for model, cases in shown.items():
        model_rows = [row for row in dossier.rows if row.case.variation.model == model]
        lines = lost_lines(dossier, model_rows)
        occurring = {status for line in lines for status in line.cells}
        sections.append(
            ModelSection(
                model=model,
                name=system_name(model_rows[0].case),
                perception=system_text(model_rows[0].case),
                passed=sum(row.passed is True for row in model_rows),
                no_collision=sum(row.no_collision is True for row in model_rows),
                ended=sum(bool(row.end.outcome) for row in model_rows),
                total=len(model_rows),
                text_name=model_block(model),
                statuses=[status for status in statuses(dossier) if status in occurring],
                lost=lines,
                shown=cases,
            )
        )
    return sections


def escaped(text: object) -> str:
    """``text`` as it is, in Markdown: on one line, nothing in it is markup."""
    return _MARKDOWN.sub(r"\\\1", " ".join(str(text).split()))


def fenced(text: str, language: str) -> str:
    """``text`` as a code block, whatever it holds."""
    longest = max((len(run) for run in re.findall(r"`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}{language}\n{text.rstrip()}\n{fence}"
