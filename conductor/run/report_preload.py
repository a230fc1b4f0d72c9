"""What a report needs, made ready while its campaign still runs: nobody waits for it then.

A thread of `conductor run` imports what pages are made of, which takes half a second, and reads KPI
files as their cases end. What is wrong with any of it the report tells.
"""

from __future__ import annotations

import contextlib
import threading
from pathlib import Path
from typing import TYPE_CHECKING

from conductor.records.outcomes import FILE_NAME, read_outcomes
from twin.base.errors import TwinError

if TYPE_CHECKING:
    from conductor.report.reading.cache import Entry

ROWS_BYTES_MAX = 64 << 20
"""KPI values that are held, of about a thousand cases; the rest is read at the end [bytes]."""
LOOK_PERIOD_S = 1.0
"""How often it is looked whether the outcomes, which tell of cases that have ended, are new [s]."""


class ReportPreload:
    """The report of one campaign folder, as far as it can be made."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._known: dict[str, tuple[Entry, bytes]] = {}
        self._bytes = 0
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def begin(self) -> None:
        """Begin, as cases are running; called again, nothing happens."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="report", daemon=True)
            self._thread.start()

    def leave(self) -> None:
        """Read no more, and wait until nothing is read: a process that ends while a thread of it is
        inside a library is aborted by the interpreter."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    def finish(self) -> None:
        """All cases have ended: read what is left."""
        self.leave()
        from conductor.report.pages.content import read_shown
        from conductor.report.reading.dossier import open_dossier

        with contextlib.suppress(TwinError):
            read_shown(open_dossier(self._folder), known=self._known)

    def look(self) -> None:
        """Read what has ended since the last look, as long as there is room for it."""
        from conductor.report.pages.content import points_of
        from conductor.report.reading.kpi_files import read_case

        try:
            outcomes = read_outcomes(self._folder)
        except TwinError:
            return
        points = points_of(len(outcomes.cases))
        for name, end in outcomes.cases.items():
            if self._over.is_set() or self._bytes >= ROWS_BYTES_MAX:
                return
            if end.kpi_sha256 and name not in self._known:
                with contextlib.suppress(TwinError):
                    self._known[name] = read_case(self._folder, name, end, points)
                    self._bytes += len(self._known[name][1])

    def _run(self) -> None:
        with contextlib.suppress(Exception):
            from conductor.report.pages.page import prepare

            prepare()
        path, seen = self._folder / FILE_NAME, (0, 0, 0)
        while self._bytes < ROWS_BYTES_MAX and not self._over.wait(LOOK_PERIOD_S):
            with contextlib.suppress(OSError):
                status = path.stat()
                # A time alone is not enough: a file system's clock stands still for milliseconds.
                now = status.st_mtime_ns, status.st_ino, status.st_size
                if now != seen:
                    seen = now
                    self.look()
