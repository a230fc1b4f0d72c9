"""Reference pages that are generated from the code when the site is built."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterable, Iterator
from pathlib import Path

from typer.main import get_command

from schemas.campaign import Campaign
from schemas.kinds.kpi import KpiKind, kpi_kinds
from schemas.kinds.sensor import SensorKind, sensor_kinds
from schemas.reference import keys_of, markdown
from schemas.wire.topics import TOPICS
from twin.base.cli import EXIT_CODES

PROGRAMS = ("drivetwin", "conductor", "twin", "devkit", "viewer", "hpc")
"""Packages whose commands are described, where they are there."""
MODULES = ("drivetwin", "devkit.stack", "devkit.perception", "schemas.messages")
"""Modules whose public names are described, where they are there."""


def write(folder: Path) -> None:
    """Write every page below ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    pages = {"fields": fields, "kpis": kpis, "sensors": sensors, "topics": topics}
    pages |= {"exit-codes": exit_codes, "python": python, "commands": commands}
    for name, page in pages.items():
        (folder / f"{name}.md").write_text(page())
    for program in filter(_there, PROGRAMS):
        if _app(program) is not None:
            (folder / f"command-{program}.md").write_text(command_page(program))


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A Markdown table; a pipe in a cell is escaped, line ends are spaces."""
    head = list(head)
    lines = [head, ["---"] * len(head), *([_cell(cell) for cell in row] for row in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def fields() -> str:
    """Page of the keys of a campaign file, a table per section."""
    keys = keys_of(Campaign)
    page = "# Campaign fields\n\nAll keys of a campaign file, as `conductor fields` prints them; "
    page += "[the campaign file](../campaign.md) explains how they work together.\n\n"
    sections = dict.fromkeys(key.path.partition(".")[0].partition("[")[0] for key in keys)
    alone = [key for key in keys if key.path in sections and key.allowed != "section"]
    page += "## Keys without a section\n\n" + markdown(alone) + "\n"
    for section in sections:
        part = [key for key in keys if key.path == section or key.path.startswith(section + ".")]
        part += [key for key in keys if key.path.startswith(section + "[")]
        if len(part) > 1:
            page += f"## Section `{section}`\n\n{markdown(part)}\n"
    return page


def kpis() -> str:
    """Page of the KPIs, by where they stand."""
    page = "# KPIs\n\nEvery file of results has these columns and values. A missing value is null, "
    page += "never 0. [Kinds of your own](../kinds.md) says how a package adds one; "
    page += "[reports](../report.md) say how they are shown.\n\n"
    heads = {
        "column": ("Per tick", "A row per control tick in `kpi.parquet`."),
        "scalar": ("Per case", "A value per case in `summary.parquet`."),
        "name": ("Names per case", "A text per case in `summary.parquet`."),
    }
    for place, (title, text) in heads.items():
        kinds = [kind for kind in kpi_kinds().declared if kind.place == place]
        page += f"## {title}\n\n{text}\n\n"
        page += table(("KPI", "type", "unit", "meaning", "given by"), map(_kpi, kinds))
    return page


def _kpi(kind: KpiKind) -> tuple[str, ...]:
    given = "the scenario's family" if kind.by_scenario else "every case"
    return f"`{kind.name}`", kind.type, kind.unit, kind.doc, given


def sensors() -> str:
    """Page of the vehicle's own sensors, with the keys of their sections."""
    page = "# Sensors\n\nThe section `sensors` of a campaign switches these on; their readings are "
    page += "arrays for all slots S of a rig. [Cameras and LiDARs](../sensors.md) have a page of "
    page += "their own.\n\n"
    for kind in sensor_kinds().declared:
        page += f"## {kind.name}\n\n{kind.doc}\n\n{_array(kind)}\n\n"
        page += table(("column", "place"), [(f"`{c}`", str(n)) for n, c in enumerate(kind.columns)])
        page += markdown(keys_of(kind.config)) + "\n"
    return page


def _array(kind: SensorKind) -> str:
    shape = ", ".join(map(str, ("S", *kind.shape)))
    many = f" At most {kind.rows_max} rows per slot." if kind.rows_max else ""
    part = f" It is made of the readings of `{kind.part_of}`." if kind.part_of else ""
    return f"An array `[{shape}]` of type `{kind.dtype}`, little-endian.{many}{part}"


def topics() -> str:
    """Page of the topic table."""
    page = "# Topics\n\nAll keys of the fabric, below the session's namespace. "
    page += "[The drive plane](../drive-plane.md) describes the messages between simulator and "
    page += "stack; [Python clients](../client.md) describe the rest.\n\n"
    rows = ((f"`{t.key}`", t.payload, t.type, "waits" if t.block else "is dropped") for t in TOPICS)
    return page + table(("key", "payload", "type", "on congestion"), rows)


def exit_codes() -> str:
    """Page of the exit codes."""
    codes = EXIT_CODES.partition(": ")[2].rstrip(".").split(", ")
    page = "# Exit codes\n\nEvery command ends with one of these codes.\n\n"
    return page + table(("code", "meaning"), (code.split(" ", 1) for code in codes))


def python() -> str:
    """Page of the Python modules that users import."""
    page = "# Python\n\nThese modules are what a stack or a script imports.\n\n"
    page += "```{toctree}\n:maxdepth: 1\n\n../client\n```\n\n"
    for module in filter(_there, MODULES):
        page += f"## `{module}`\n\n```{{eval-rst}}\n.. automodule:: {module}\n```\n\n"
    return page


def commands() -> str:
    """Page that lists the programs."""
    page = (
        "# Commands\n\nEvery command explains itself with `--help`; these pages show the same.\n\n"
    )
    page += "```{toctree}\n:maxdepth: 2\n\n"
    page += "".join(f"command-{p}\n" for p in PROGRAMS if _there(p) and _app(p) is not None)
    return page + "```\n"


def command_page(program: str) -> str:
    """Page of all commands of ``program``."""
    group = get_command(_app(program))
    page = f"# {program}\n\n{_paragraphs(group.help)}\n\n{EXIT_CODES}\n\n"
    return page + "".join(_commands(program, group, 2))


def _commands(name: str, group: object, level: int) -> Iterator[str]:
    for word, command in group.commands.items():
        if command.hidden:
            continue
        whole = f"{name} {word}"
        yield f"{'#' * level} {whole}\n\n{_paragraphs(command.help)}\n\n"
        if hasattr(command, "commands"):
            yield from _commands(whole, command, level + 1)
            continue
        context = command.make_context(whole, [], resilient_parsing=True)
        records = [parameter.get_help_record(context) for parameter in command.params]
        rows = [(f"`{names}`", _plain(text)) for names, text in filter(None, records)]
        yield table(("argument or option", "meaning"), rows)


def _paragraphs(text: str | None) -> str:
    """The help text as Markdown: no indentation, no form feeds."""
    parts = (text or "").replace("\f", "").replace("\b", "").split("\n\n")
    return "\n\n".join(_plain(part) for part in parts)


def _plain(text: str) -> str:
    """``text`` on one line; brackets and asterisks are no Markdown."""
    shown = " ".join(text.split())
    for sign in ("\\", "*", "[", "]", "<"):
        shown = shown.replace(sign, "\\" + sign)
    parts = shown.split("`")
    return "`".join(p.replace("\\", "") if n % 2 else p for n, p in enumerate(parts))


def _app(program: str) -> object | None:
    try:
        return importlib.import_module(f"{program}.cli").app
    except ModuleNotFoundError as error:
        if error.name is not None and error.name.startswith(program):
            return None
        raise


def _there(name: str) -> bool:
    top = name.partition(".")[0]
    return importlib.util.find_spec(top) is not None and importlib.util.find_spec(name) is not None
