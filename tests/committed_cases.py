"""A real conductor in memory that has committed one of two cases, whose files lie in its folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

from conductor_bench import hello, next_of, result, submit
from unit.viewer.console.console_runs import kpi
from waiting import PATIENCE_S

from conductor.serve.shell import Conductor
from schemas import SCHEMA_VERSION as V
from schemas.wire import topics
from schemas.wire.case_files import CaseFilePiece, CaseFileRequest
from schemas.wire.codec import decode, encode
from twin.fabric.memory_bus import MemoryHub
from twin.records.kpi_file import kpi_sha256, read_kpi

COMMITTED, LEASED = "repeat_0", "repeat_1"
LOG = b"".join(b"line %d\n" % number for number in range(40_000))
"""A log of more than one piece."""


@dataclass
class CommittedCase:
    """The conductor, a viewer's session with it, and the folder of the committed attempt."""

    conductor: Conductor
    hub: MemoryHub
    attempt: Path

    def __post_init__(self) -> None:
        self.bus = self.hub.open()

    def ask(self, request: CaseFileRequest) -> CaseFilePiece | None:
        """One question over the bus, as a console asks it."""
        data = self.bus.request(topics.CASE_FILES.key, encode(request), PATIENCE_S)
        return None if data is None else decode(data, CaseFilePiece)

    def piece(
        self, file: str, first: int = 0, case: str = COMMITTED, **asked: str
    ) -> CaseFilePiece:
        """The answer to a question about a file of campaign ``demo``."""
        asked = {"campaign": "demo", **asked}
        request = CaseFileRequest(v=V, case=case, file=file, first=first, **asked)  # type: ignore[arg-type]
        answer = self.ask(request)
        assert answer is not None
        return answer


@contextmanager
def one_committed(state: Path, hub: MemoryHub, *, sha256: str = "") -> Iterator[CommittedCase]:
    """Serve ``state``, with campaign ``demo`` in it.

    ``sha256``: of the values in the KPI file, as committed; by default what is true.
    """
    conductor = Conductor(state, bus_factory=lambda *_: hub.open())
    thread = Thread(target=conductor.serve)
    thread.start()
    assert conductor.started.wait(PATIENCE_S)
    try:
        assert not conductor.request(submit("demo", 2)).error
        assert not conductor.request(hello()).error
        leases = conductor.request(next_of("w1", seq=1, k=2)).leases
        (lease,) = [lease for lease in leases if lease.case.id == COMMITTED]
        attempt = Path(lease.out) / "cases" / COMMITTED / f"attempt-{lease.attempt}"
        attempt.mkdir(parents=True)
        kpi(attempt)
        (attempt / "log.txt").write_bytes(LOG)
        values = sha256 or kpi_sha256(read_kpi(attempt / "kpi.parquet"))
        done = next_of("w1", seq=2, k=0, results=[result(lease, kpi=values)])
        assert not conductor.request(done).error
        yield CommittedCase(conductor, hub, attempt)
    finally:
        conductor.stop()
        thread.join(PATIENCE_S)
        assert not thread.is_alive()
