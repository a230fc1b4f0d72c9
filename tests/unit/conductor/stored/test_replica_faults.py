"""A round of the replica that fails by a mistake of the program, not of the store."""

from __future__ import annotations

import contextlib
import threading
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import pytest
from conductor_bench import Bench, hello, next_of, result, submit
from waiting import PATIENCE_S, wait_for

from conductor.core.facts import Committed
from conductor.journal.store import Journal
from conductor.serve.folders import CAMPAIGN_FILE
from conductor.serve.shell import Conductor
from conductor.stored import replicator as replicator_module
from conductor.stored import successor as successor_module
from conductor.stored.link import StoreOptions
from conductor.stored.replica import ReplicaHead, marked_head
from conductor.stored.replicator import CALL_BYTES, FAULTS_MAX
from conductor.stored.run_files import RunFiles
from conductor.stored.seals import StoreSeal
from conductor.stored.successor import bring_back_all, bring_journal
from schemas.wire.control import Reply, Result
from twin.base.errors import EXIT_INFRASTRUCTURE, InfrastructureError, TwinError
from twin.fabric.keys.key_file import MemberKey
from twin.fabric.memory_bus import MemoryHub
from twin.stores.folder import FolderStore
from twin.stores.protocol import StoreError


@dataclass
class Faults:
    """Heads that are not made."""

    left: int = 0
    """So many will not be."""
    error: Exception = field(default_factory=lambda: TypeError("an odd\nhead"))
    asked: int = 0
    """Heads that were asked for."""

    def made(self, seal: StoreSeal, head: ReplicaHead) -> bytes:
        self.asked += 1
        if self.left > 0:
            self.left -= 1
            raise self.error
        return marked_head(seal, head)


@pytest.fixture
def faults(monkeypatch: pytest.MonkeyPatch) -> Faults:
    """None yet; short pauses."""
    for name in ("FLUSH_S", "RETRY_S", "BEAT_S"):
        monkeypatch.setattr(replicator_module, name, 0.01)
    faults = Faults()
    monkeypatch.setattr(replicator_module, "marked_head", faults.made)
    return faults


class Served:
    """A conductor on a thread, and what ended it."""

    def __init__(self, folder: Path, hub: MemoryHub, *, durable: bool) -> None:
        self.options = StoreOptions(str(folder / "store"), durable)
        self.conductor = Conductor(
            folder / "state", bus_factory=lambda *_: hub.open(), store=self.options
        )
        self.error: TwinError | None = None
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.thread.start()
        assert self.conductor.started.wait(PATIENCE_S)

    def _serve(self) -> None:
        try:
            self.conductor.serve()
        except TwinError as error:
            self.error = error

    def ended(self) -> TwinError | None:
        self.thread.join(PATIENCE_S)
        assert not self.thread.is_alive()
        return self.error

    def stop(self) -> TwinError | None:
        self.conductor.stop()
        return self.ended()


@pytest.mark.parametrize("durable", [False, True])
def test_a_few_faults_mend_themselves(
    tmp_path: Path, hub: MemoryHub, faults: Faults, durable: bool
) -> None:
    served = Served(tmp_path, hub, durable=durable)
    link = served.conductor.link
    assert link is not None
    for _ in range(2):  # those before a good round do not count
        faults.left = FAULTS_MAX - 1
        wait_for(lambda: faults.left == 0, "the faults")
        wait_for(lambda before=link.rounds: link.rounds > before, "a good round after them")
    assert not served.conductor.request(submit(), PATIENCE_S).error
    assert served.stop() is None
    _is_whole(tmp_path, served.conductor.key)


@pytest.mark.parametrize("durable", [False, True])
def test_a_fault_that_stays_ends_the_conductor_and_the_folder_goes_on(
    tmp_path: Path, hub: MemoryHub, faults: Faults, durable: bool
) -> None:
    served = Served(tmp_path, hub, durable=durable)
    assert not served.conductor.request(submit(), PATIENCE_S).error
    faults.left = 10**9
    left: list[Reply] = []

    def ask() -> None:
        with contextlib.suppress(InfrastructureError):
            left.append(served.conductor.request(hello("w1"), PATIENCE_S))

    threading.Thread(target=ask, daemon=True).start()
    error = served.ended()
    assert error is not None
    assert error.exit_code == EXIT_INFRASTRUCTURE
    line = str(error)
    assert "the journal cannot be brought there: TypeError: an odd\\nhead; it is whole" in line
    assert "\n" not in line
    assert not (durable and left), "a reply that waits for the store never leaves without it"
    faults.left = 0
    again = Served(tmp_path, hub, durable=durable)
    assert again.conductor.snapshot()["left"] == 4
    assert again.stop() is None
    _is_whole(tmp_path, again.conductor.key)


def test_a_store_that_is_away_for_long_ends_nothing(
    tmp_path: Path, hub: MemoryHub, faults: Faults
) -> None:
    served = Served(tmp_path, hub, durable=True)
    faults.error = StoreError("no answer")
    faults.left = 3 * FAULTS_MAX
    assert not served.conductor.request(submit(), PATIENCE_S).error
    assert faults.left == 0, "its reply has waited for them"
    assert served.stop() is None
    _is_whole(tmp_path, served.conductor.key)


def test_replies_that_wait_for_a_store_take_so_much_and_no_more(
    tmp_path: Path, hub: MemoryHub, faults: Faults, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who asks again and again while it is away leaves a reply each time."""
    size = 1 << 20
    monkeypatch.setattr(replicator_module, "WAITING_BYTES_MAX", 2 * size + 8 * CALL_BYTES)
    served = Served(tmp_path, hub, durable=True)
    link = served.conductor.link
    assert link is not None
    faults.error, faults.left = StoreError("no answer"), 10**9
    with pytest.raises(InfrastructureError, match="did not answer"):
        served.conductor.request(submit(), 0.001)
    wait_for(lambda: "alpha" in served.conductor.snapshot()["campaigns"], "the campaign")
    called: list[int] = []
    for number in range(5):
        link.when_kept(partial(called.append, number), size)
    assert called == []
    faults.left = 0
    wait_for(lambda: 4 in called, "the store")
    for number in range(5, 9):  # what has left counts no more
        link.when_kept(partial(called.append, number), size)
        wait_for(lambda last=number: last in called, "it")
    assert called == [3, 4, 5, 6, 7, 8]
    assert served.stop() is None


def _is_whole(folder: Path, key: MemberKey | None) -> None:
    """What a successor reads is the journal of the state folder."""
    store = FolderStore(folder / "store")
    claims = [int(name.rpartition("/")[2]) for name in store.names("owner/")]
    brought = folder / "brought"
    brought.mkdir()
    assert bring_journal(store, StoreSeal(store, key), max(claims), brought)
    mine, theirs = Journal(folder / "state"), Journal(brought)
    assert list(mine.fold()) == list(theirs.fold())
    mine.close()
    theirs.close()


# --- the other threads of a store ---------------------------------------------------------------


def test_files_of_a_run_are_put_after_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("conductor.stored.run_files.PERIOD_S", 0.01)
    store = FolderStore(tmp_path / "store")
    (tmp_path / CAMPAIGN_FILE).write_text("campaign: one\n")
    passes: list[int] = []

    def owns() -> bool:
        passes.append(1)
        if len(passes) == 1:
            raise TypeError("odd")
        return True

    files = RunFiles(store, lambda: [tmp_path], owns)
    files.start()
    wait_for(lambda: store.names("runs/one/"), "the campaign file")
    files.close()


def test_an_attempt_that_cannot_be_read_keeps_no_other_from_coming(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench()
    bench.ask(submit(out=str(tmp_path)))
    bench.ask(hello("w1"))
    leases = bench.ask(next_of("w1", 1, 2)).leases
    facts = [Committed(result(lease), "w1", "cpu", 1) for lease in leases]

    def one(_: object, __: object, done: Result) -> None:
        if done.case == leases[0].case.id:
            raise TypeError("odd")

    monkeypatch.setattr(successor_module, "bring_back", one)
    store = FolderStore(tmp_path / "store")
    due, told = [(tmp_path, fact) for fact in facts], []
    bring_back_all(store, due, threading.Event(), threading.Event(), told.append, pause_s=0.0)
    assert sorted(fact.result.token for fact in told) == [lease.token for lease in leases]
