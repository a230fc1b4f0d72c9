"""Recordings of committed attempts on their way into the store: none is worth a result."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest
from conductor_bench import CONFIG, Bench, hello, next_of, result, secret, submit
from object_store import Wire, reached_by
from waiting import PATIENCE_S, wait_for

from schemas.files.recording import RECORDING_FILE, RECORDING_NOTE, RecordingObject
from schemas.sections.view_mode import ViewMode
from schemas.wire.control import Lease, Recorded, Reply, Result
from twin.stores import recordings as recordings_module
from twin.stores.folder import FolderStore
from twin.stores.objects import object_name
from twin.stores.opening import open_store
from twin.stores.protocol import ResultStore, StoreError
from twin.stores.recordings import RecordingUploads

CONTENT = b"RRF2 and pictures"
NAME = object_name(hashlib.sha256(CONTENT).hexdigest())


class Side:
    """A worker's uploads, and a conductor that decides about them."""

    def __init__(self, folder: Path, store: ResultStore, cases: int = 2) -> None:
        self.bench = Bench(replace(CONFIG, store="a store"))
        self.bench.ask(submit(cases=cases, out=str(folder / "out"), view="record"))
        self.bench.ask(hello("w1", slots=cases))
        self.leases = self.bench.lease("w1", cases)
        self.lines: list[str] = []
        self.asked: list[Recorded] = []
        self.answering = threading.Event()
        self.answering.set()
        self.store = store
        self.uploads = self.made()

    def made(self, view: ViewMode | None = None) -> RecordingUploads:
        uploads = RecordingUploads("w1", secret("w1"), view, self.ask, self.lines.append)
        uploads.join(self.store)
        for lease in self.leases:
            uploads.look(lease)
        return uploads

    def ask(self, request: Recorded) -> Reply | None:
        self.asked.append(request)
        return self.bench.ask(request) if self.answering.is_set() else None

    def folder(self, lease: Lease) -> Path:
        made = Path(lease.out) / "cases" / lease.case.id / f"attempt-{lease.attempt}"
        made.mkdir(parents=True, exist_ok=True)
        return made

    def record(self, lease: Lease, content: bytes = CONTENT, **note: Any) -> None:
        """What a recorder leaves, the note last."""
        (self.folder(lease) / RECORDING_FILE).write_bytes(content)
        digest = hashlib.sha256(content).hexdigest()
        said = {"complete": True, "samples": 3, "lost": 0, "kept": True, "sha256": digest, **note}
        (self.folder(lease) / RECORDING_NOTE).write_text(json.dumps(said))

    def commit(self, *leases: Lease) -> list[int]:
        """The conductor takes results; tokens whose files are not needed any more."""
        results: list[Result] = [result(lease) for lease in leases]
        held = [lease.token for lease in self.leases if lease not in leases]
        reply = self.bench.next("w1", 0, results=results, held=held)
        return self.uploads.settle([r.token for r in results], results, reply.fenced)

    def named(self, lease: Lease) -> RecordingObject | None:
        return self.bench.state.campaigns["alpha"].cases[lease.case.id].recording


@pytest.fixture
def side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Side]:
    monkeypatch.setattr(recordings_module, "LOOK_S", 0.01)
    monkeypatch.setattr(recordings_module, "AGAIN_MAX_S", 0.02)
    made = Side(tmp_path, FolderStore(tmp_path / "store"))
    yield made
    made.uploads.finish(0.0)


def freed(side: Side, lease: Lease) -> Callable[[], bool]:
    """Whether the files of an attempt are not needed any more."""
    seen: list[int] = []

    def look() -> bool:
        seen.extend(side.uploads.settle([], [], []))
        return lease.token in seen

    return look


def test_a_recording_goes_when_its_recorder_has_finished_it(side: Side) -> None:
    one, _ = side.leases
    (side.folder(one) / RECORDING_FILE).write_bytes(CONTENT[:4])
    assert side.commit(one) == [], "its files are still needed"
    assert side.store.names("") == []
    side.record(one, complete=False)
    wait_for(freed(side, one), "the recording")
    assert side.store.get(NAME) == CONTENT
    digest = hashlib.sha256(CONTENT).hexdigest()
    assert side.named(one) == RecordingObject(digest, len(CONTENT), False)
    assert side.lines == []


@pytest.mark.parametrize(
    ("view", "keep"), [(None, "none"), (ViewMode.none, "all"), (ViewMode.live, "all")]
)
def test_what_is_not_recorded_is_not_waited_for(
    side: Side, view: ViewMode | None, keep: str
) -> None:
    for number, lease in enumerate(side.leases):
        rig = msgspec.structs.replace(lease.case.rig, keep=keep)
        case = msgspec.structs.replace(lease.case, rig=rig)
        side.leases[number] = msgspec.structs.replace(lease, case=case)
    side.uploads = side.made(view)
    one, two = side.leases
    assert side.commit(one, two) == [one.token, two.token]


def test_of_a_fenced_or_lost_attempt_nothing_goes(side: Side) -> None:
    one, two = side.leases
    side.record(one)
    side.record(two)
    results = [result(one)]
    assert side.uploads.settle([one.token, two.token], results, [one.token]) == [
        one.token,
        two.token,
    ]
    side.uploads.finish()
    assert side.store.names("") == []


def test_what_was_not_kept_is_no_loss(side: Side) -> None:
    one, _ = side.leases
    side.record(one, kept=False)
    (side.folder(one) / RECORDING_FILE).unlink()
    side.commit(one)
    wait_for(freed(side, one), "the attempt")
    assert (side.lines, side.store.names("")) == ([], [])


def test_a_file_that_is_too_large_or_has_changed_is_said_and_left_out(
    side: Side, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, two = side.leases
    with monkeypatch.context() as smaller:
        smaller.setattr(recordings_module, "RECORDING_BYTES_MAX", len(CONTENT) - 1)
        side.record(one)
        assert side.commit(one) == [one.token]
    side.record(two, sha256="ab" * 32)
    side.commit(two)
    wait_for(freed(side, two), "the second attempt")
    assert side.store.names("") == []
    large, changed = side.lines
    assert large == (
        f"{one.case.id}: its recording is not in the store: it has {len(CONTENT)} bytes, allowed: "
        f"1 to {len(CONTENT) - 1}"
    )
    assert changed.endswith("its file has changed since it was finished")


def test_a_mistake_of_a_library_costs_one_recording_and_not_the_next(side: Side) -> None:
    one, two = side.leases
    real = side.store.put

    def put(name: str, data: bytes) -> None:
        if name == NAME:
            raise ValueError("of a library")
        real(name, data)

    side.store.put = put  # type: ignore[method-assign]
    side.record(one)
    side.commit(one)
    wait_for(freed(side, one), "the first attempt")
    side.record(two, CONTENT + b" of the next one")
    side.commit(two)
    wait_for(freed(side, two), "the recording")
    assert (side.named(one) is None, side.named(two) is None) == (True, False)
    (line,) = side.lines
    assert line.endswith("not in the store: ValueError('of a library')")


def test_a_link_in_its_place_is_not_followed(side: Side, tmp_path: Path) -> None:
    one, _ = side.leases
    side.record(one)
    secret_file = tmp_path / "worker.key"
    secret_file.write_bytes(CONTENT)
    (side.folder(one) / RECORDING_FILE).unlink()
    (side.folder(one) / RECORDING_FILE).symlink_to(secret_file)
    side.commit(one)
    wait_for(freed(side, one), "the attempt")
    assert side.store.names("") == []
    assert "symbolic link" in side.lines[0]


def test_a_store_that_is_away_is_said_once_and_asked_again(
    tmp_path: Path, wire: Wire, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The real server, behind a wire that is cut."""
    monkeypatch.setattr(recordings_module, "LOOK_S", 0.01)
    monkeypatch.setattr(recordings_module, "AGAIN_MAX_S", 0.02)
    with reached_by(wire.port) as url:
        store = open_store(f"{url}/{tmp_path.name}")
        store.names("nothing/")
        side = Side(tmp_path, store)
        one, two = side.leases
        wire.down = True
        for lease in (one, two):
            side.record(lease, CONTENT + lease.case.id.encode())
        side.commit(one, two)
        wait_for(lambda: len(wire.asked) > 30, "tries")
        assert side.named(one) is side.named(two) is None
        wire.faults = {"partial write": 0.3, "503": 0.3}
        wire.down = False
        for lease in (one, two):
            wait_for(lambda done=lease: side.named(done), "the recording")  # type: ignore[misc]
        side.uploads.finish(PATIENCE_S)
        assert [line.endswith("recordings wait") for line in side.lines[:2]] == [True, False]
        assert side.lines[-1] == "the store takes recordings again"
        for lease in (one, two):
            stored = side.named(lease)
            assert stored is not None
            data = store.get(object_name(stored.sha256))
            assert data == CONTENT + lease.case.id.encode()
        side.uploads.finish(0.0)


def test_a_conductor_that_is_away_hears_of_it_when_it_is_back(side: Side) -> None:
    one, _ = side.leases
    side.answering.clear()
    side.record(one)
    side.commit(one)
    wait_for(lambda: len(side.asked) > 2, "questions without an answer")
    assert side.named(one) is None
    side.bench.restart()
    side.answering.set()
    wait_for(freed(side, one), "the recording")
    assert side.named(one) is not None


def test_a_conductor_that_refuses_is_not_asked_for_ever(side: Side) -> None:
    one, _ = side.leases
    side.bench.state.config = CONFIG  # it has no store any more
    side.bench.config = CONFIG
    side.record(one)
    side.commit(one)
    wait_for(freed(side, one), "the attempt")
    assert side.lines[0].endswith("the conductor says: this conductor has no result store")


def test_a_worker_that_leaves_waits_for_what_is_on_its_way(side: Side) -> None:
    one, two = side.leases
    side.record(one)
    side.commit(one, two)  # of the second there is no file: its recorder was killed
    side.uploads.finish(PATIENCE_S)
    assert side.named(one) is not None
    (line,) = side.lines
    assert line.endswith("its recorder has not finished it")


def test_a_worker_that_leaves_gives_up_what_does_not_come(side: Side) -> None:
    one, _ = side.leases
    side.answering.clear()
    side.record(one)
    side.commit(one)
    wait_for(lambda: side.asked, "a question")
    side.uploads.finish(0.0)
    # That the conductor does not answer may be said before it or after.
    assert any(line.startswith("1 recording not in the store: ") for line in side.lines)


class Away(FolderStore):
    """A store that takes nothing just now."""

    def put(self, name: str, data: bytes) -> None:
        """Not now."""
        raise StoreError("away")


@pytest.mark.parametrize(("more", "kept"), [(0, 2), (-1, 1)])
def test_only_so_many_bytes_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: int, kept: int
) -> None:
    """The limit is exact, and the latest stay."""
    limit = 2 * len(CONTENT) + more
    monkeypatch.setattr(recordings_module, "WAITING_BYTES_MAX", limit)
    side = Side(tmp_path, Away(tmp_path / "store"), cases=4)
    for lease in side.leases:
        side.record(lease)
    assert side.commit(side.leases[0]) == []
    free = side.commit(*side.leases[1:])
    assert len(free) == 4 - kept
    assert side.leases[0].token in free
    line = f"its recording is not in the store: more than {limit} bytes wait for the store"
    assert sum(line in said for said in side.lines) == 4 - kept
    side.uploads.finish(0.0)
    assert any(line.startswith(f"{kept} recording") for line in side.lines)


def test_bytes_that_a_recorder_writes_later_count_too(
    side: Side, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recordings_module, "WAITING_BYTES_MAX", len(CONTENT))
    one, two = side.leases
    assert side.commit(one, two) == [], "nothing is written yet"
    for lease in (one, two):
        (side.folder(lease) / RECORDING_FILE).write_bytes(CONTENT)
    wait_for(freed(side, one), "the end of the older one")
    side.record(two)
    wait_for(freed(side, two), "the recording")
    assert (side.named(one), side.store.get(NAME)) == (None, CONTENT)


def test_only_so_many_wait(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recordings_module, "WAITING_MAX", 2)
    side = Side(tmp_path, Away(tmp_path / "store"), cases=4)
    for lease in side.leases:
        side.record(lease, CONTENT + lease.case.id.encode())
    free = side.commit(*side.leases)
    assert len(free) == 2, "their files are not kept for ever"
    assert sum("more than 2 wait for the store" in line for line in side.lines) == 2
    side.uploads.finish(0.0)


def test_the_oldest_is_left_out_also_after_it_was_tried(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What failed lets others go first, and is the oldest all the same."""
    monkeypatch.setattr(recordings_module, "WAITING_MAX", 2)
    monkeypatch.setattr(recordings_module, "LOOK_S", 0.01)
    monkeypatch.setattr(recordings_module, "AGAIN_MAX_S", 0.02)
    tries: list[str] = []
    may = threading.Semaphore(0)

    class Gate(Away):
        def put(self, name: str, data: bytes) -> None:
            tries.append(name)
            assert may.acquire(timeout=PATIENCE_S)
            super().put(name, data)

    side = Side(tmp_path, Gate(tmp_path / "store"), cases=3)
    one, two, three = side.leases
    for lease in side.leases:
        side.record(lease, CONTENT + lease.case.id.encode())
    side.commit(one)
    wait_for(lambda: len(tries) == 1, "the first try")
    assert side.commit(two) == []
    may.release()  # the first one goes behind the second
    wait_for(lambda: len(tries) == 2, "the second try")
    assert tries[0] != tries[1]
    assert side.commit(three) == [one.token]
    may.release(99)
    side.uploads.finish(0.0)


def test_one_that_is_too_large_costs_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recordings_module, "RECORDING_BYTES_MAX", 2 * len(CONTENT))
    monkeypatch.setattr(recordings_module, "WAITING_BYTES_MAX", 2 * len(CONTENT))
    side = Side(tmp_path, Away(tmp_path / "store"))
    one, two = side.leases
    side.record(one)
    side.record(two, 2 * CONTENT + b".")
    assert side.commit(one, two) == [two.token]
    (line,) = (line for line in side.lines if line.startswith(two.case.id))
    assert f"it has {2 * len(CONTENT) + 1} bytes" in line
    side.uploads.finish(0.0)


def test_what_is_in_the_store_is_left_out_last(side: Side, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the conductor has to hear of it."""
    one, two = side.leases
    side.answering.clear()
    side.record(one)
    side.commit(one)
    wait_for(lambda: side.asked, "a question")
    monkeypatch.setattr(recordings_module, "WAITING_MAX", 1)
    assert side.commit(two) == [two.token]
    side.bench.restart()
    side.answering.set()
    wait_for(freed(side, one), "the recording")
    assert side.named(one) is not None


def test_results_are_settled_while_a_recording_is_put(side: Side) -> None:
    """Whoever settles results waits for no recording."""
    one, two = side.leases
    begun, go_on = threading.Event(), threading.Event()
    real = side.store.put

    def put(name: str, data: bytes) -> None:
        begun.set()
        assert go_on.wait(PATIENCE_S)
        real(name, data)

    side.store.put = put  # type: ignore[method-assign]
    side.record(one)
    side.commit(one)
    assert begun.wait(PATIENCE_S)
    assert side.commit(two) == []
    assert not side.bench.ask(next_of("w1", 9, 0)).error
    go_on.set()
    wait_for(freed(side, one), "the recording")
