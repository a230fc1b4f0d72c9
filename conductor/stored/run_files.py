"""Files of campaigns in a store, beside the attempts: what a report reads first.

```
runs/CAMPAIGN/campaign.yaml, outcomes.json, timeline.jsonl, manifest.json, ...
```

They are the files of the campaign folder, put again when they have changed. Nothing is decided
from them; when a run has ended, its signed manifest is one of them.
"""

from __future__ import annotations

import contextlib
import logging
import re
import threading
import time
from collections.abc import Callable
from pathlib import Path

from conductor.records.outcomes import FILE_NAME as OUTCOMES_FILE
from conductor.records.software_file import FILE_NAME as SOFTWARE_FILE
from conductor.records.timeline import FILE_NAME as TIMELINE_FILE
from conductor.serve.folders import CAMPAIGN_FILE
from conductor.trust.judge_feed import FILE_NAME as JUDGEMENT_FILE
from conductor.trust.manifest import RUN_FILE
from schemas.files.proposals import FILE_NAME as PROPOSED_FILE
from schemas.files.regular_file import RUN_FILE_BYTES_MAX
from schemas.files.search_result import FILE_NAME as SEARCH_FILE
from twin.base.errors import TwinError
from twin.stores.apart import put_file
from twin.stores.protocol import ResultStore

NAMES = (
    *(CAMPAIGN_FILE, PROPOSED_FILE, OUTCOMES_FILE, TIMELINE_FILE, SEARCH_FILE),
    *(JUDGEMENT_FILE, SOFTWARE_FILE, RUN_FILE),
)
"""Files that are kept, in the order in which they are put."""
PERIOD_S = 10.0
"""They are looked at this often [s]."""
SHARE = 0.02
"""Share of the time that putting them takes at most."""
_NONE = (0, 0)
"""Mark of a file of which the store has none."""

_log = logging.getLogger(__name__)


class RunFiles:
    """Puts what has changed, on a thread.

    Args:
        store: the store.
        folders: the campaign folders.
        owns: whether the store is ours now; asked before each pass, and raises a TwinError if
            the store does not answer.
    """

    def __init__(
        self,
        store: ResultStore,
        folders: Callable[[], list[Path]],
        owns: Callable[[], bool],
    ) -> None:
        self._store, self._folders, self._owns = store, folders, owns
        self._put: dict[Path, tuple[int, int]] = {}
        """Path -> time of change [ns] and size when it was put."""
        self._names: dict[Path, str] = {}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="run files", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self) -> None:
        """End, with what has changed last."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()

    def put_changed(self) -> None:
        """Put what has changed since it was put, unless another conductor owns the store.

        Raises:
            TwinError: the store does not answer.
        """
        if not self._owns():
            return
        for folder in self._folders():
            self._withdraw(folder)
            for name in NAMES:
                path = folder / name
                try:
                    status = path.stat()
                    mark = (status.st_mtime_ns, status.st_size)
                    if self._put.get(path) == mark:
                        continue
                    if campaign := self._campaign(folder):
                        put_file(self._store, f"runs/{campaign}/{name}", path, RUN_FILE_BYTES_MAX)
                        self._put[path] = mark
                except OSError:
                    continue  # it is not there, or just replaced

    def _withdraw(self, folder: Path) -> None:
        """Remove the manifest of a run that is signed no longer, since something came later: before
        the outcomes are put that it does not fit."""
        path = folder / RUN_FILE
        if self._put.get(path) == _NONE or path.exists():
            return
        if campaign := self._campaign(folder):
            self._store.delete(f"runs/{campaign}/{RUN_FILE}")
            self._put[path] = _NONE

    def _campaign(self, folder: Path) -> str:
        if folder not in self._names:
            with contextlib.suppress(OSError, TwinError, KeyError, TypeError):
                self._names[folder] = campaign_name(folder / CAMPAIGN_FILE)
        return self._names.get(folder, "")

    def _run(self) -> None:
        pause_s = PERIOD_S
        while True:
            last = self._over.wait(pause_s)
            began_s = time.monotonic()
            try:
                self.put_changed()
            except TwinError as error:
                _log.debug("%s", error)  # the journal's replica says it
            except Exception:  # the next pass puts them
                _log.exception("files of a run were not put")
            if last:
                return
            pause_s = max(PERIOD_S, (time.monotonic() - began_s) / SHARE)


def campaign_name(path: Path) -> str:
    """Name of the campaign in a campaign file."""
    with path.open("rb") as file:
        for line in file:
            if match := re.match(rb"campaign: *['\"]?([A-Za-z0-9_.-]+)", line):
                return match[1].decode()
    raise KeyError("campaign")
