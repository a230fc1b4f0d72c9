"""What a report reads of a run in a store, brought into a folder.

These are the small files of the campaign and the KPI files of committed attempts, and not their
logs and recordings. What is there already is not fetched again.
"""

from __future__ import annotations

import contextlib
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from conductor.records.attempts import attempt_folder
from conductor.records.outcomes import FILE_NAME as OUTCOMES_FILE
from conductor.records.outcomes import CaseOutcome, read_outcomes
from conductor.serve.folders import CAMPAIGN_FILE
from conductor.stored.run_files import NAMES
from conductor.stored.successor import READERS
from schemas.escape import escape
from schemas.files.regular_file import RUN_FILE_BYTES_MAX, read_regular
from twin.base.errors import UsageError, storage_error
from twin.base.files import write_atomic
from twin.stores.objects import get_attempt, get_object, sha256_of
from twin.stores.opening import PROBE, is_url, open_store
from twin.stores.protocol import MissingObjectError, ResultStore

SOURCE_FILE = "store.url"
"""Says from which store a folder was fetched."""
KPI_NAMES = ("kpi.parquet", "realtime.csv")
"""Files of an attempt that reports read."""
TOLD_MAX = 20
"""Most campaigns of a store that are named in a message."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,199}")


def fetch_run(url: str, out: Path | None = None) -> Path:
    """Fetch what a report reads; the folder.

    Args:
        url: store, or ``URL/runs/CAMPAIGN`` where it holds several.
        out: folder; None: ``runs/CAMPAIGN``.

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
            continue
        _write(folder / name, data)
    outcomes = read_outcomes(folder)
    committed = [(case, row) for case, row in outcomes.cases.items() if row.kpi_sha256]
    with ThreadPoolExecutor(READERS) as pool:
        list(pool.map(lambda item: _fetch(store, campaign, folder, *item), committed))
    return folder


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


def _fetch(store: ResultStore, campaign: str, folder: Path, case: str, row: CaseOutcome) -> None:
    attempt = attempt_folder(folder, row.attempt_dir)
    stored = get_attempt(store, campaign, case, row.manifest_sha256)
    for name in KPI_NAMES:
        if name not in stored.files:
            continue
        path = attempt / name
        digest = stored.files[name].sha256
        try:
            if path.is_file() and sha256_of(read_regular(path, RUN_FILE_BYTES_MAX)) == digest:
                continue
        except OSError:
            pass  # written anew
        _write(path, get_object(store, digest, RUN_FILE_BYTES_MAX))


def _write(path: Path, data: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, data, sync=False)
    except OSError as error:
        raise storage_error(error, str(path)) from None
