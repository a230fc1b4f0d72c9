"""A store each of whose calls fails in turn, and a conductor that is not the owner any more."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest
from conductor_bench import Bench, hello, next_of, result, submit

from conductor.core.facts import Committed, EpochRaised, Snapshot
from conductor.core.snapshot import take
from conductor.journal.owner import this_process
from conductor.journal.store import Journal
from conductor.serve.folders import CAMPAIGN_FILE
from conductor.stored import replicator as replicator_module
from conductor.stored import successor
from conductor.stored.link import StoreLink, StoreOptions
from conductor.stored.owner import StoreClaims
from conductor.stored.replicator import Replicator
from conductor.stored.run_files import RunFiles
from conductor.stored.seals import StoreSeal
from conductor.stored.successor import bring_back_all, bring_journal
from conductor.trust.manifest import RUN_FILE
from twin.base.errors import TwinError
from twin.stores.folder import FolderStore
from twin.stores.protocol import MissingObjectError, StoreError


class Failing(FolderStore):
    """Fails at the call with the number ``fails_at``, from 1."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.calls = 0
        self.fails_at = 0

    def _count(self) -> None:
        self.calls += 1
        if self.calls == self.fails_at:
            raise StoreError("no answer")

    def put(self, name: str, data: bytes) -> None:
        self._count()
        super().put(name, data)

    def get(self, name: str, *more: Any) -> bytes:
        self._count()
        return super().get(name, *more)

    def delete(self, name: str) -> None:
        self._count()
        super().delete(name)


def rounds_of(store: Failing, folder: Path) -> tuple[int, bytes]:
    """Three turns of a journal, each brought until it has reached the store; how many rounds
    failed, and the journal that a successor reads."""
    seal = StoreSeal(store, None)
    own = StoreClaims(store, seal).claim(1, 1, this_process(), "ab" * 16)
    folder.mkdir()
    journal = Journal(folder)
    made = Replicator(store, seal, own, journal.rows)
    journal.mirror = made
    failed = 0
    store.calls = 0
    for facts in ([EpochRaised(1)], [EpochRaised(2)], [snapshot(), EpochRaised(3)], [snapshot()]):
        journal.append(facts)
        while True:
            try:
                made.round()
                break
            except TwinError:
                failed += 1
    store.fails_at = 0
    brought = folder / "brought"
    brought.mkdir()
    assert bring_journal(store, seal, 1, brought)
    expected, again = list(journal.fold()), Journal(brought)
    assert list(again.fold()) == expected, "the chain fits, and so does what it holds"
    head = again.chain.head
    again.close()
    journal.close()
    return failed, head


def snapshot() -> Snapshot:
    state = Bench().state
    state.epoch = 7
    return take(state)


def test_a_round_that_fails_anywhere_is_repeated_without_a_trace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("conductor.journal.store.time.time", lambda: 1.0)
    store = Failing(tmp_path / "whole")
    failed, expected = rounds_of(store, tmp_path / "journal")
    assert failed == 0
    left = len(store.names("objects/"))
    calls, failures = store.calls, 0
    for fails_at in range(1, calls + 1):
        other = Failing(tmp_path / str(fails_at))
        other.fails_at = fails_at
        failed, found = rounds_of(other, tmp_path / f"journal-{fails_at}")
        failures += failed
        assert found == expected, f"call {fails_at} of {calls}"
        assert len(other.names("objects/")) <= left + 1, "what counts for nothing is removed"
    assert failures > 8, "puts and looks for a successor fail a round, deletes do not"


def test_a_part_that_somebody_has_removed_is_put_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replicator_module, "TAIL_MAX", 2)
    store = FolderStore(tmp_path / "store")
    seal = StoreSeal(store, None)
    own = StoreClaims(store, seal).claim(1, 1, this_process(), "ab" * 16)
    journal = Journal(tmp_path)
    made = Replicator(store, seal, own, journal.rows)
    journal.mirror = made
    for epoch in (1, 2):
        journal.append([EpochRaised(epoch)])
        made.round()
    for name in store.names("objects/"):
        store.delete(name)
    journal.append([EpochRaised(3)])
    with pytest.raises(MissingObjectError):
        made.round()
    made.round()
    brought = tmp_path / "brought"
    brought.mkdir()
    assert bring_journal(store, seal, 1, brought)
    expected, again = list(journal.fold()), Journal(brought)
    assert list(again.fold()) == expected
    again.close()
    journal.close()


# --- the owner alone keeps the files of a run ---------------------------------------------------


def folder_of_run(path: Path, text: str) -> Path:
    path.mkdir(exist_ok=True)
    (path / CAMPAIGN_FILE).write_text(f"campaign: one\n# {text}\n")
    return path


def test_a_conductor_that_was_taken_over_leaves_the_files_alone(tmp_path: Path) -> None:
    store = FolderStore(tmp_path / "store")
    link = StoreLink(StoreOptions(str(tmp_path / "store")), tmp_path / "a", None)
    mine = folder_of_run(tmp_path / "mine", "mine")
    name = f"runs/one/{CAMPAIGN_FILE}"
    link.before_journal()
    link.keep_runs([mine])
    with pytest.raises(MissingObjectError):
        store.get(name)
    bench = Bench()
    link.claim(bench.state)
    journal = Journal(tmp_path / "a")
    link.begin(journal.rows).close(released=False)
    journal.close()
    link.keep_runs([mine])
    assert store.get(name).endswith(b"# mine\n")
    StoreClaims(store, StoreSeal(store, None)).claim(2, 9, this_process(), "cd" * 16)
    store.put(name, b"of the successor")
    folder_of_run(mine, "changed")
    link.keep_runs([mine])
    assert store.get(name) == b"of the successor"


def test_it_is_asked_before_each_pass_who_owns_the_store(tmp_path: Path) -> None:
    store = FolderStore(tmp_path / "store")
    mine = folder_of_run(tmp_path / "mine", "mine")
    answers = [True, False, True]
    files = RunFiles(store, lambda: [mine], lambda: answers.pop(0))
    name = f"runs/one/{CAMPAIGN_FILE}"
    for text, kept in (("first", b"# first\n"), ("second", b"# first\n"), ("third", b"# third\n")):
        folder_of_run(mine, text)
        files.put_changed()
        assert store.get(name).endswith(kept)


@pytest.mark.parametrize("restarted", [False, True])
def test_a_manifest_leaves_the_store_before_outcomes_come_that_it_does_not_fit(
    tmp_path: Path, restarted: bool
) -> None:
    store = FolderStore(tmp_path / "store")
    mine = folder_of_run(tmp_path / "mine", "signed")
    manifest = f"runs/one/{RUN_FILE}"
    (mine / RUN_FILE).write_text("of the first outcomes")
    files = RunFiles(store, lambda: [mine], lambda: True)
    files.put_changed()
    assert store.get(manifest) == b"of the first outcomes"
    (mine / RUN_FILE).unlink()
    if restarted:
        files = RunFiles(store, lambda: [mine], lambda: True)
    files.put_changed()
    with pytest.raises(MissingObjectError):
        store.get(manifest)
    (mine / RUN_FILE).write_text("of the later ones")
    files.put_changed()
    assert store.get(manifest) == b"of the later ones"


# --- files that come later ----------------------------------------------------------------------


def committed(tmp_path: Path) -> Committed:
    bench = Bench()
    bench.ask(submit(out=str(tmp_path)))
    bench.ask(hello("w1"))
    (lease,) = bench.ask(next_of("w1", 1, 1)).leases
    return Committed(result(lease), "w1", "cpu", 1)


@pytest.mark.parametrize(
    ("errors", "tries"),
    [
        ([StoreError("away"), StoreError("away"), None], 3),
        ([MissingObjectError("gone")], 1),
        ([None], 1),
    ],
)
def test_files_are_asked_for_until_they_come(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    errors: list[TwinError | None],
    tries: int,
) -> None:
    fact, told, seen = committed(tmp_path), [], []

    def one(*_: object) -> None:
        assert not told
        error = errors[len(seen)]
        seen.append(error)
        if error is not None:
            raise error

    monkeypatch.setattr(successor, "bring_back", one)
    store = FolderStore(tmp_path / "store")
    due = [(tmp_path, fact)]
    bring_back_all(store, due, threading.Event(), threading.Event(), told.append, pause_s=0.0)
    assert (len(seen), told) == (tries, [fact])


def test_the_end_waits_for_no_store_that_is_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fact, told = committed(tmp_path), []
    stopped, last = threading.Event(), threading.Event()

    def one(*_: object) -> None:
        stopped.set()
        raise StoreError("away")

    monkeypatch.setattr(successor, "bring_back", one)
    store = FolderStore(tmp_path / "store")
    bring_back_all(store, [(tmp_path, fact)], stopped, last, told.append, pause_s=0.0)
    assert told == [], "the same folder goes on later, and asks again"
    stopped.clear()
    last.set()
    bring_back_all(store, [(tmp_path, fact)], stopped, last, told.append, pause_s=0.0)
    assert told == [fact], "its judge says that files are missing"
