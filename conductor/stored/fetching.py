"""What a report reads of a run in a store, brought into a folder.

These are the small files of the campaign and the KPI files of committed attempts, and not their
logs. Recordings are fetched where it is asked for. What is there already is not fetched again.

Whoever may write the bucket may put any bytes there. So a KPI file is read by a process in the
sandbox of stacks, as are other files of others, and what lies in the folder is written anew from
its values; reports hold those against the digests of the outcomes. Recordings are read by viewers,
without a sandbox: they are fetched for a signed run alone, whose manifest covers their digests.
"""

from __future__ import annotations

import contextlib
import fcntl
import logging
import re
import shutil
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec
from msgspec import UNSET

from conductor.records.attempts import attempt_folder
from conductor.records.outcomes import FILE_NAME as OUTCOMES_FILE
from conductor.records.outcomes import CaseOutcome, Outcomes, read_outcomes
from conductor.serve.folders import CAMPAIGN_FILE
from conductor.stored.run_files import NAMES
from conductor.stored.successor import READERS
from conductor.trust.manifest import RUN_FILE
from conductor.trust.sign_run import require_fit
from schemas.escape import escape
from schemas.files.recording import (
    RECORDING_FILE,
    RECORDING_NOTE,
    RecordingNote,
    RecordingObject,
)
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from schemas.words import counted
from twin.base.errors import EXIT_USAGE, InfrastructureError, UsageError, storage_error
from twin.base.files import write_atomic
from twin.records.kpi_apart import written_anew
from twin.stores.objects import get_attempt, get_object, sha256_of
from twin.stores.opening import PROBE, is_url, open_store
from twin.stores.protocol import (
    DamagedObjectError,
    MissingObjectError,
    ResultStore,
    StoreError,
    StoreRefusedError,
)

SOURCE_FILE = "store.url"
"""Says from which store a folder was fetched."""
KPI_NAME = "kpi.parquet"
KPI_SOURCE_FILE = "kpi.object"
"""Beside a KPI file: digest of the object from which it was written."""
RAW_PREFIX = ".fetched-"
"""Begins the names of folders in which files lie as they came, until they are written anew."""
LOCK_FILE = ".fetching"
"""Held by the commands that fetch into a folder."""
TOLD_MAX = 20
"""Most campaigns of a store that are named in a message."""

RECORDING_READERS = 2
"""Recordings that are fetched at a time; each is held in memory as a whole."""

WhichRecordings = Literal["none", "failed", "all"]
"""Cases whose recordings are fetched; ``failed``: those that did not pass."""

_log = logging.getLogger(__name__)
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,199}")


@dataclass(frozen=True, slots=True)
class _Fetched:
    """A KPI file as it lay in the store."""

    raw: Path
    attempt: Path
    """Folder of the attempt to which it belongs."""
    digest: str


def fetch_run(
    url: str,
    out: Path | None = None,
    recordings: WhichRecordings = "none",
    *,
    hint: str = "",
) -> Path:
    """Fetch what a report reads; the folder.

    Args:
        url: store, or ``URL/runs/CAMPAIGN`` where it holds several.
        out: folder; None: ``runs/CAMPAIGN``.
        recordings: those that are fetched as well. One that does not come is told, and no error.
        hint: told with their number if there are some and none is fetched; empty: nothing is.

    Raises:
        UsageError: there is no such run, or the folder is another one's.
        TwinError: the store does not answer, or what it holds is damaged.
    """
    store, wanted = _store_of(url.rstrip("/"))
    campaign = _campaign(store, wanted)
    folder = out or Path("runs") / campaign
    _own(folder, f"{store.url}/runs/{campaign}")
    for name in NAMES:
        try:
            data = store.get(f"runs/{campaign}/{name}", RUN_FILE_BYTES_MAX)
        except MissingObjectError:
            if name in (CAMPAIGN_FILE, OUTCOMES_FILE):
                raise UsageError(
                    f"{store.url}: campaign {campaign} has no {name} yet; try again when a case "
                    "has ended"
                ) from None
            if name == RUN_FILE:  # that of an earlier fetch: something came later, so it goes
                (folder / name).unlink(missing_ok=True)
            continue
        _write(folder / name, data)
    outcomes = read_outcomes(folder)
    committed = [(case, row) for case, row in outcomes.cases.items() if row.kpi_sha256]
    with _raw_folder(folder) as raw:
        with ThreadPoolExecutor(READERS) as pool:
            fetched = list(
                pool.map(lambda item: _fetch(store, campaign, folder, raw, *item), committed)
            )
        _write_anew([item for item in fetched if item is not None])
    _fetch_recordings(store, folder, outcomes, recordings, hint)
    return folder


def _fetch_recordings(
    store: ResultStore, folder: Path, outcomes: Outcomes, which: WhichRecordings, hint: str
) -> None:
    """Fetch recordings into the folders of their attempts; those that are there stay.

    Raises:
        UnfitRunError: the run is not as it was signed.
        TwinError: the disk lets us down.
    """
    stored = {name: row for name, row in outcomes.cases.items() if row.recording is not UNSET}
    chosen = {name: row for name, row in stored.items() if which == "all" or not row.passed}
    if which == "none":
        if stored and hint:
            _log.warning("%s: has %s; %s", store.url, counted(len(stored), "recording"), hint)
        return
    if chosen and require_fit(folder).manifest is None:
        _log.warning(
            "%s: no recording is fetched, because the run is not signed: nothing says who made "
            "them; ask again when it has ended",
            store.url,
        )
        return

    def one(item: tuple[str, CaseOutcome]) -> None:
        case, row = item
        assert row.recording is not UNSET
        try:
            _fetch_recording(store, attempt_folder(folder, row.attempt_dir), row.recording)
        except (StoreError, StoreRefusedError) as error:  # no verdict depends on it
            _log.warning("case %s: its recording is not fetched: %s", case, error)

    with ThreadPoolExecutor(RECORDING_READERS) as pool:
        list(pool.map(one, chosen.items()))


def _fetch_recording(store: ResultStore, attempt: Path, stored: RecordingObject) -> None:
    path = attempt / RECORDING_FILE
    if not _is(path, stored.sha256, stored.size):
        data = get_object(store, stored.sha256, stored.size)
        if len(data) != stored.size:
            raise DamagedObjectError(f"it has {len(data)} bytes, its run names {stored.size}")
        _write(path, data)
    note = RecordingNote(complete=stored.complete, sha256=stored.sha256)
    _write(attempt / RECORDING_NOTE, msgspec.json.encode(note) + b"\n")


@contextlib.contextmanager
def _raw_folder(folder: Path) -> Iterator[Path]:
    """A folder in ``folder`` for files as they come, which goes with the block.

    Those of commands that were killed are removed, unless another command fetches now, whose they
    may be.
    """
    with contextlib.ExitStack() as held:
        try:
            lock = held.enter_context((folder / LOCK_FILE).open("ab"))
            with contextlib.suppress(OSError):  # in use, or a file system without locks
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                for left in folder.glob(f"{RAW_PREFIX}*"):
                    shutil.rmtree(left, ignore_errors=True)
            with contextlib.suppress(OSError):
                fcntl.flock(lock, fcntl.LOCK_SH)  # waits for one that removes
            raw = tempfile.TemporaryDirectory(
                prefix=RAW_PREFIX, dir=folder, ignore_cleanup_errors=True
            )
        except OSError as error:
            raise storage_error(error, str(folder)) from None
        yield Path(held.enter_context(raw))


def _store_of(url: str) -> tuple[ResultStore, str]:
    """The store that a URL names, and the campaign; empty: it names none.

    A store's own path may have ``/runs/`` in it, too.
    """
    base, _, wanted = url.rpartition("/runs/")
    place = base.partition("://")[2] if is_url(url) else base
    if not place or not _NAME.fullmatch(wanted):
        return open_store(url), ""
    if Path(url.removeprefix("file://")).is_dir() or (
        is_url(url) and not url.startswith("file://")
    ):
        whole = open_store(url)
        if whole.names("runs/"):
            return whole, ""
    return open_store(base), wanted


def _campaign(store: ResultStore, wanted: str) -> str:
    names = {name.split("/")[1] for name in store.names("runs/")}
    campaigns = sorted(name for name in names if _NAME.fullmatch(name))
    told = ", ".join(campaigns[:TOLD_MAX])
    if wanted and wanted not in campaigns:
        there = f"there: {told}" if told else "there is none"
        raise UsageError(f"{store.url}: no run of a campaign {escape(wanted, 80)}; {there}")
    if wanted:
        return wanted
    if not campaigns:
        with contextlib.suppress(MissingObjectError):  # where there is no bucket, this says so
            store.get(f"{PROBE}/none")
        raise UsageError(f"{store.url}: holds no run; give the --store of a conductor")
    if len(campaigns) > 1:
        raise UsageError(
            f"{store.url}: holds runs of {told}; give one, as {store.url}/runs/{campaigns[0]}"
        )
    return campaigns[0]


def _own(folder: Path, source: str) -> None:
    """Make the folder, unless it is that of another run."""
    mark = folder / SOURCE_FILE
    try:
        if folder.exists() and any(folder.iterdir()):
            found = read_regular(mark, 4096).decode() if mark.exists() else ""
            if found.strip() != source:
                raise UsageError(
                    f"{folder}: holds something else than what is read from {source}; give another "
                    "--out"
                )
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, UnicodeDecodeError) as error:
        reason = error if isinstance(error, OSError) else OSError(0, "not text")
        raise storage_error(reason, str(folder)) from None
    _write(mark, source.encode() + b"\n")


def _fetch(
    store: ResultStore, campaign: str, folder: Path, raw: Path, case: str, row: CaseOutcome
) -> _Fetched | None:
    """Fetch what is not in the folder yet; the KPI file into ``raw``, None: it is there."""
    attempt = attempt_folder(folder, row.attempt_dir)
    stored = get_attempt(store, campaign, case, row.manifest_sha256)
    if times := stored.files.get("realtime.csv"):
        path = attempt / "realtime.csv"
        if not _is(path, times.sha256):
            _write(path, get_object(store, times.sha256, RUN_FILE_BYTES_MAX))
    if (kpi := stored.files.get(KPI_NAME)) is None or _is_from(attempt, kpi.sha256):
        return None
    path = raw / sha256_of(f"{case}".encode())
    _write(path, get_object(store, kpi.sha256, RUN_FILE_BYTES_MAX))
    return _Fetched(path, attempt, kpi.sha256)


def _is(path: Path, digest: str, size_max: int = RUN_FILE_BYTES_MAX) -> bool:
    try:
        return path.is_file() and sha256_of(read_regular(path, size_max)) == digest
    except OSError:
        return False  # written anew


def _is_from(attempt: Path, digest: str) -> bool:
    """Whether the KPI file was written from the object with this digest."""
    try:
        return (attempt / KPI_NAME).is_file() and read_regular(
            attempt / KPI_SOURCE_FILE, 100
        ) == digest.encode()
    except OSError:
        return False


def _write_anew(fetched: list[_Fetched]) -> None:
    """Write KPI files from the values that a process in a sandbox reads.

    Raises:
        UsageError: one is no KPI file.
        InfrastructureError: the process did not start, or the disk refuses.
    """
    if not fetched:
        return
    for item in fetched:
        item.attempt.mkdir(parents=True, exist_ok=True)
    done = written_anew([(item.raw, item.attempt / KPI_NAME) for item in fetched])
    if done.returncode:
        line = escape(done.stderr.decode(errors="replace").strip()[-500:])
        for item in fetched:  # its name here says nothing to anybody
            line = line.replace(str(item.raw), str(item.attempt / KPI_NAME))
        error = UsageError if done.returncode == EXIT_USAGE else InfrastructureError
        raise error(line or f"KPI files could not be read (exit code {done.returncode})")
    if done.stderr:
        _log.warning("%s", escape(done.stderr.decode(errors="replace").strip()[-500:]))
    for item in fetched:
        _write(item.attempt / KPI_SOURCE_FILE, item.digest.encode())


def _write(path: Path, data: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, data, sync=False)
    except OSError as error:
        raise storage_error(error, str(path)) from None
