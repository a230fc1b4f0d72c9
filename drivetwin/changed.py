"""What changed between two runs, for programs and for notebooks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from conductor.report.compare.comparison import Comparison, Flip
from conductor.report.compare.folders import compare_folders
from conductor.report.compare.page import as_html, as_json, as_markdown, told
from drivetwin.arguments import of_type
from drivetwin.finished import Run


def compared(before: Run | str | Path, after: Run | str | Path) -> RunComparison:
    """Compare two runs, see :func:`drivetwin.compare`.

    Raises:
        TwinError: they cannot be compared.
    """
    folders = [
        run.folder
        if isinstance(run, Run)
        else Path(of_type("compare", run, Run | str | Path)).expanduser()
        for run in (before, after)
    ]
    return RunComparison(compare_folders(*folders))


class RunComparison:
    """Changes from one run to another."""

    def __init__(self, comparison: Comparison) -> None:
        self.details = comparison
        """All that was found, in numbers."""

    def __repr__(self) -> str:
        words = told(self.details)
        return "\n".join([f"RunComparison: {words.title}", words.result, *words.lines])

    def _repr_markdown_(self) -> str:
        return self.to_markdown()

    @property
    def identical(self) -> bool:
        """Whether every KPI value of every case is the same, to the last bit."""
        return self.details.identical

    @property
    def regressions(self) -> list[Flip]:
        """Cases whose verdict has become worse."""
        return self.details.regressions

    @property
    def exit_code(self) -> int:
        """What `conductor compare` exits with: 1 on a regression, else 0."""
        return int(bool(self.regressions))

    def to_markdown(self) -> str:
        """The comparison for a pull request."""
        return as_markdown(self.details)

    def to_html(self) -> str:
        """The comparison as a page of its own."""
        return as_html(self.details)

    def to_dict(self) -> dict[str, Any]:
        """The comparison as plain data."""
        return as_json(self.details)
