"""A run's folder: its cases as a table, KPIs, camera frames, report and fingerprint."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivetwin.arguments import of_type
from twin.base.errors import UsageError

if TYPE_CHECKING:
    import numpy as np
    import pyarrow as pa
    from numpy.typing import NDArray

    from conductor.records.fingerprint import Fingerprint
    from conductor.records.outcomes import Outcomes
    from schemas.files.search_result import SearchAnswer, SearchFile
    from viewer.playback.frames import RecordedCase

CASES_SHOWN = 20
"""Cases that an error names, the one that is meant among them."""


def opened(place: str | Path, out: str | Path | None = None) -> Run:
    """The run of a folder, or of a result store; see :func:`drivetwin.open`.

    Raises:
        UsageError: there is none.
        InfrastructureError: it is damaged, or the store does not answer.
    """
    from conductor.stored.fetching import fetch_run
    from schemas.files.search_result import FILE_NAME
    from twin.stores.opening import is_url

    if is_url(str(of_type("open", place, str | Path))):
        folder = fetch_run(str(place), None if out is None else Path(out).expanduser())
    elif out is not None:
        raise UsageError(f"open: out belongs to stores; {place} is read where it is")
    else:
        folder = Path(place).expanduser()
    run = SearchRun(folder) if (folder / FILE_NAME).is_file() else Run(folder)
    run.outcomes()  # says what is wrong with it
    return run


class Run:
    """A run that was opened or has ended; everything is read from its folder when it is asked for,
    so that of a campaign that still runs it is what is known by then."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self._recording: RecordedCase | None = None

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r}): {self.summary()}"

    def _repr_html_(self) -> str:
        from html import escape

        return f"<code>{escape(str(self.folder))}</code>: {escape(self.summary())}"

    def outcomes(self) -> Outcomes:
        """Outcome, verdict and reasons of every case, as ``outcomes.json`` has them.

        Raises:
            UsageError: the folder holds no run.
            InfrastructureError: the file is damaged.
        """
        from conductor.records.outcomes import read_outcomes

        return read_outcomes(self.folder)

    def summary(self) -> str:
        """Passed cases and verdicts, in a line."""
        from conductor.records.outcomes import count_outcomes, count_verdicts

        outcomes = self.outcomes()
        counts = count_outcomes(outcomes)
        verdicts = sorted((name or "not ended", n) for name, n in count_verdicts(outcomes).items())
        shown = ", ".join(f"{n} {name}" for name, n in verdicts)
        return f"{counts['passed']} of {counts['cases']} passed ({shown})"

    @property
    def exit_code(self) -> int:
        """What `conductor run` exits with: 0 all passed, 1 a verdict is not a pass, 3 a case is
        unresolved, 75 cases have not ended."""
        return self.outcomes().exit_code

    def cases(self) -> pa.Table:
        """One row per case: axes, outcome, verdict, reasons, every scalar KPI, where it came from.

        A KPI's unit and meaning are in the metadata of its field, ``unit`` and ``doc``. What is
        missing is null; ``passed`` is null without a verdict.

        Raises:
            UsageError: nothing was simulated here.
            InfrastructureError: files are damaged, or not what was signed.
        """
        from conductor.report.pages.summary import summary_table
        from conductor.report.reading.dossier import open_dossier
        from conductor.trust.sign_run import require_fit

        self.outcomes()
        require_fit(self.folder)
        return _described(summary_table(open_dossier(self.folder)))

    def kpis(self, case: str) -> pa.Table:
        """KPIs of a case over time: one row per control tick.

        Units and meanings are in the metadata of the fields.

        Raises:
            UsageError: there is no such case, or it has no result.
            InfrastructureError: the file is missing, damaged, or not the one that was committed.
        """
        from difflib import get_close_matches

        from conductor.records.fingerprint import committed_rows
        from conductor.trust.sign_run import require_fit
        from schemas.validation import suggest

        cases = self.outcomes().cases
        if case not in cases:
            close = get_close_matches(case, cases, n=1)
            shown = sorted(cases, key=lambda name: (name not in close, name))[:CASES_SHOWN]
            raise UsageError(f"{self.folder}: no case '{case}'; {suggest(case, shown)}")
        if not cases[case].kpi_sha256:
            why = "; ".join(cases[case].reasons) or cases[case].outcome or "it has not ended"
            raise UsageError(f"{self.folder}: case '{case}' has no KPIs: {why}")
        require_fit(self.folder)
        table, _ = committed_rows(self.folder, case, cases[case])
        return table

    def frame(self, case: str, t: float | str, camera: str = "") -> NDArray[np.uint8]:
        """What a camera of a case saw at a moment: the latest picture until then.

        Pixels are exact where the run has drive records (``record_drive=True``), which also have
        every camera; otherwise they went through JPEG (``view="record"``), of the main camera.

        Args:
            case: name of the case.
            t: sim time [s], or ``"aeb"`` (emergency braking begins), or ``"closest"``.
            camera: name of a camera in the vehicle file; default: the main one.

        Returns:
            RGB, uint8 [height, width, 3], row 0 at the top.

        Raises:
            UsageError: no such case, moment or camera, or it was not recorded.
        """
        from viewer.playback.pixels import pixels_at

        at = t if isinstance(t, str) else repr(float(t))
        pixels, _, self._recording = pixels_at(self.folder, case, at, camera, self._recording)
        return pixels

    def report(self, *, embed: bool = False) -> RunReport:
        """Write the report anew, as `conductor report` does without plots; its path.

        Args:
            embed: a notebook shows the whole page, and keeps it: some megabytes.

        Raises:
            UsageError: nothing was simulated here.
            InfrastructureError: files are damaged, or not what was signed.
        """
        from conductor.report import make_report
        from conductor.trust.sign_run import sign_derived

        self.outcomes()
        made = make_report(self.folder, plots=False)
        sign_derived(self.folder)
        return RunReport(made.page, self.summary(), embed=embed)

    @cached_property
    def fingerprint(self) -> Fingerprint:
        """Fingerprint of the run: its ``sha256`` is that of another run if and only if every KPI
        value of every case is the same, to the last bit.

        Raises:
            UnfinishedError: cases have not ended.
            InfrastructureError: files are damaged, or not what was signed.
        """
        from conductor.records.fingerprint import fingerprint
        from conductor.trust.sign_run import require_fit

        self.outcomes()
        require_fit(self.folder)
        return fingerprint(self.folder)


class SearchRun(Run):
    """A search that was run."""

    def search(self) -> SearchFile:
        """Everything that was proposed, what came of it, and the answer: ``search.json``.

        Raises:
            UsageError: no search was run here.
            InfrastructureError: its file is damaged.
        """
        from conductor.records.search import read_search

        return read_search(self.folder)

    @property
    def answer(self) -> SearchAnswer | None:
        """Answer of the search; None: no generation has ended yet."""
        return self.search().answer

    def summary(self) -> str:
        """The answer, or how many cases passed so far."""
        answer = self.answer
        return super().summary() if answer is None else answer.line()

    def proposed(self) -> pa.Table:
        """One row per proposed case: name, generation, its parameters, and its KPI, the objective.

        The KPI is null where it is missing or the generation still runs.
        """
        import pyarrow as pa

        found = self.search()
        rows = [
            (name, number, *values, result)
            for number, generation in enumerate(found.generations)
            for name, values, result in zip(
                generation.cases,
                generation.values,
                generation.results or [None] * len(generation.cases),
                strict=True,
            )
        ]
        names = ["case", "generation", *found.parameters, found.kpi or "objective"]
        columns = list(zip(*rows, strict=True)) if rows else [()] * len(names)
        return pa.table([pa.array(list(column)) for column in columns], names=names)


class RunReport(os.PathLike[str]):
    """A report that was written: a path, and in a notebook what to open."""

    def __init__(self, path: Path, summary: str, *, embed: bool) -> None:
        self.path = path
        self._summary = summary
        self._embed = embed

    def __fspath__(self) -> str:
        return str(self.path)

    def __str__(self) -> str:
        return str(self.path)

    def __repr__(self) -> str:
        return f"RunReport({str(self.path)!r}): {self._summary}"

    def _repr_html_(self) -> str:
        from html import escape
        from urllib.parse import quote

        if self._embed:
            page = escape(self.path.read_text(encoding="utf-8"))
            # Its scripts see neither the notebook nor the network.
            return (
                f'<iframe srcdoc="{page}" sandbox="allow-scripts" '
                'style="width: 100%; height: 600px; border: 0"></iframe>'
            )
        place = os.path.relpath(self.path)
        link = f'<a href="{escape(quote(place))}" target="_blank">{escape(place)}</a>'
        return f"{escape(self._summary)}: {link}"


def _described(table: pa.Table) -> pa.Table:
    """The table with unit and meaning of every KPI in the metadata of its field."""
    from schemas.kinds.kpi import kpi_kinds

    kinds: dict[str, Any] = {k.name: k for k in kpi_kinds().declared if k.place != "column"}
    schema = table.schema
    for index, column in enumerate(schema):
        if kind := kinds.get(column.name):
            about = {"unit": kind.unit, "doc": kind.doc}
            schema = schema.set(index, column.with_metadata(about))
    return table.cast(schema)
