"""Attempts with interventions, run again from their journal: the bytes must be the same."""

from __future__ import annotations

import queue
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from msgspec import structs

from schemas.sections.view_mode import ViewMode
from schemas.wire.control import Lease, Result
from schemas.wire.interventions import JournalEnd, JournalHead
from twin.base.errors import EXIT_FAILED, EXIT_PASS, InfrastructureError, UsageError
from twin.base.software import device_class, software_digest
from twin.rig.interventions.journal import read_journal
from twin.rig.pipe import Broken, Built, CaseDone, Listening, Progress
from twin.worker.options import WorkerOptions
from twin.worker.rig_process import RigDied, RigProcess


def reenact(attempt: Path, device: str, slots: int | None, out: Path | None) -> int:
    """Run the attempt of a journal again and compare; the exit code.

    Args:
        attempt: attempt folder, or its journal.
        device: where to simulate.
        slots: of the rig; None: as it was.
        out: folder for the new attempt's files; None: they are not kept.

    Raises:
        UsageError: no journal there, or a damaged one; or ``out`` has that attempt already.
        InfrastructureError: the rig died, or hangs.
    """
    head, entries, end = read_journal(attempt)
    if head.case.rig.clock == "realtime":
        raise UsageError(f"{attempt}: went by the wall clock (clock: realtime), it cannot repeat")
    if out is not None:
        _check_free(out / "cases" / head.case.id / f"attempt-{head.attempt}")
    for name, was, now in (
        ("software", head.software[:12], software_digest()[:12]),
        ("device class", head.device_class, device_class(device)),
    ):
        if was != now:
            print(f"twin: {name} is {now}, the attempt had {was}", file=sys.stderr)
    case = structs.replace(
        head.case,
        rig=structs.replace(head.case.rig, placement="worker"),
        variation=structs.replace(head.case.variation, drive="none"),
    )
    folder = Path(out or tempfile.mkdtemp(prefix="twin-reenact-")).absolute()
    try:
        lease = Lease(token=1, attempt=head.attempt, out=str(folder), case=case)
        slots = case.rig.slots_of(slots or head.slots)
        options = WorkerOptions(connect="", slots=slots, device=device, view=ViewMode.none)
        inbox: queue.SimpleQueue[Any] = queue.SimpleQueue()
        rig = RigProcess(options, lease, slots, inbox)
        try:
            result = _run(rig, inbox, lease, entries)
        finally:
            rig.stop()
    finally:
        if out is None:
            shutil.rmtree(folder, ignore_errors=True)
    return _compare(head, len(entries), end, result)


def _check_free(folder: Path) -> None:
    """Refuse a folder that exists: it may be the attempt itself."""
    if folder.exists():
        raise UsageError(f"{folder} exists, and nothing is overwritten; give another --out")


def _run(rig: RigProcess, inbox: queue.SimpleQueue[Any], lease: Lease, entries: Any) -> Result:
    deadline_s = lease.case.variation.deadline_s
    ticks, until_s = -1, time.monotonic() + deadline_s
    while True:
        try:
            _, message = inbox.get(timeout=max(0.0, until_s - time.monotonic()))
        except queue.Empty:
            raise InfrastructureError(
                f"the rig hangs: no progress for {deadline_s:g} s at tick {max(ticks, 0)}"
            ) from None
        if not isinstance(message, Progress) or message.ended or message.ticks != [ticks]:
            until_s = time.monotonic() + deadline_s
        match message:
            case Progress(_, [tick]):
                ticks = tick
            case Listening(endpoint):
                rig.start_stack(endpoint)
            case Built(_, notes):
                for note in notes:
                    print(f"twin: {note}", file=sys.stderr)
                rig.assign(lease, entries)
            case CaseDone(result):
                return result
            case Broken(reason, detail) | RigDied(reason, detail):
                raise InfrastructureError(f"the rig died ({reason}): {detail}")


def _compare(head: JournalHead, changes: int, end: JournalEnd | None, result: Result) -> int:
    name = f"{head.case.id}, attempt {head.attempt}, {changes} changes"
    print(f"{name}: {result.verdict or result.outcome}, kpi {result.kpi_sha256}")
    if end is None:
        print("the attempt was cut off before its end: nothing to compare with")
        return EXIT_PASS
    if end.kpi_sha256 == result.kpi_sha256:
        print("the same values, to the last bit")
        return EXIT_PASS
    print(f"other values: the attempt had {end.verdict or end.outcome}, kpi {end.kpi_sha256}")
    return EXIT_FAILED
