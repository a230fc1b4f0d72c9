"""A worker puts what it commits before it commits it; a loss in between costs a repetition."""

from __future__ import annotations

import threading
from pathlib import Path

import msgspec
import pytest
from conductor_bench import Bench, hello, next_of, result, submit

from schemas.files.judging import attempt_digest
from schemas.wire.codec import decode
from schemas.wire.control import Lease, Result
from twin.fabric.session import is_sealed, seal, signer_of
from twin.stores.folder import FolderStore
from twin.stores.objects import EMPTY, LostFilesError, get_attempt, get_object, get_pack, pack_of
from twin.stores.protocol import StoreError
from twin.stores.putting import Storing, meanwhile


@pytest.fixture
def lease(tmp_path: Path) -> Lease:
    """A lease whose attempt has left its files."""
    bench = Bench()
    bench.ask(submit(out=str(tmp_path / "out")))
    bench.ask(hello("w1"))
    (lease,) = bench.ask(next_of("w1", 1, 1)).leases
    folder = tmp_path / "out" / "cases" / lease.case.id / "attempt-1"
    folder.mkdir(parents=True)
    (folder / "kpi.parquet").write_bytes(b"rows")
    (folder / "log.txt").write_bytes(b"")
    (folder / "recording.rrd").write_bytes(b"large")
    return lease


@pytest.fixture
def done(lease: Lease) -> Result:
    """Its result."""
    made = result(lease)
    return msgspec.structs.replace(made, manifest_sha256=attempt_digest(made.kpi_sha256, b"", b""))


def joined(url: Path, lease: Lease) -> Storing:
    storing = Storing(seal)
    storing.look(lease)
    storing.join(str(url))
    return storing


def test_files_their_list_and_the_sealed_result(tmp_path: Path, lease: Lease, done: Result) -> None:
    storing, store = joined(tmp_path / "s", lease), FolderStore(tmp_path / "s")
    request = next_of("w1", 2, 1, results=[done])
    told: list[str] = []
    storing.put(request, lambda: told.append("put"))
    stored = get_attempt(store, "alpha", lease.case.id, done.manifest_sha256)
    assert (stored.attempt, stored.token) == (1, lease.token)
    assert {n: get_object(store, f.sha256) for n, f in stored.files.items()} == {
        "kpi.parquet": b"rows",
        "log.txt": b"",
    }
    assert stored.files["log.txt"].sha256 == EMPTY
    (name,) = store.names("results/")
    assert pack_of(name) == ("w1", 2)
    (sealed,) = get_pack(store, name)
    assert decode(sealed.result, Result) == done
    assert is_sealed(signer_of(request.session), sealed.result, sealed.seal)
    assert told == ["put"]
    before = store.names("")
    storing.put(request, lambda: None)  # the conductor did not answer
    assert store.names("") == before


def test_nothing_is_packed_before_its_files_are_there(
    tmp_path: Path, lease: Lease, done: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    storing = joined(tmp_path / "s", lease)
    real = FolderStore.put

    def put(self: FolderStore, name: str, data: bytes) -> None:
        if name.startswith("attempts/"):
            raise StoreError("away")
        real(self, name, data)

    monkeypatch.setattr(FolderStore, "put", put)
    request = next_of("w1", 2, 1, results=[done])
    with pytest.raises(StoreError, match="away"):
        storing.put(request, lambda: None)
    store = FolderStore(tmp_path / "s")
    assert store.names("results/") == []
    monkeypatch.undo()
    storing.put(request, lambda: None)
    assert len(store.names("results/")) == 1


@pytest.mark.parametrize(
    ("name", "content"), [("kpi.parquet", None), ("log.txt", None), ("log.txt", b"another")]
)
def test_a_result_whose_files_are_lost_is_not_committed(
    tmp_path: Path, lease: Lease, done: Result, name: str, content: bytes | None
) -> None:
    path = tmp_path / "out" / done.attempt_dir / name
    if name == "log.txt":
        made = attempt_digest(done.kpi_sha256, b"a log", b"")
        done = msgspec.structs.replace(done, manifest_sha256=made)
    if content is None:
        path.unlink()
    else:
        path.write_bytes(content)
    storing = joined(tmp_path / "s", lease)
    with pytest.raises(LostFilesError, match="files are missing or changed since case"):
        storing.put(next_of("w1", 2, 1, results=[done]), lambda: None)
    store = FolderStore(tmp_path / "s")
    assert store.names("attempts/") == store.names("results/") == []


def test_inherited_results_without_files_are_left_out(
    tmp_path: Path, lease: Lease, done: Result
) -> None:
    storing, store = joined(tmp_path / "s", lease), FolderStore(tmp_path / "s")
    storing.put(next_of("w1", 2, 1, results=[done]), lambda: None)
    (kept,) = get_pack(store, store.names("results/")[0])
    lost = msgspec.structs.replace(
        kept,
        result=msgspec.msgpack.encode(msgspec.structs.replace(done, manifest_sha256="cd" * 32)),
    )
    assert storing.with_files([kept, lost]) == [kept]
    assert Storing(seal).with_files([kept, lost]) == [kept, lost]


def test_without_a_store_nothing_is_read(lease: Lease, done: Result) -> None:
    storing = Storing(seal)
    told: list[str] = []
    missing = msgspec.structs.replace(done, attempt_dir="cases/none/attempt-9")
    storing.put(next_of("w1", 2, 1, results=[missing]), lambda: told.append("put"))
    assert told == []


def test_beats_go_on_while_a_store_does_not_answer() -> None:
    beats, enough = [], threading.Event()

    def beat() -> None:
        beats.append(threading.current_thread())
        if len(beats) == 3:
            enough.set()

    def work() -> str:
        enough.wait()
        return "put"

    assert meanwhile(work, beat, 0.0) == "put"
    assert len(beats) >= 3
    assert {*beats} == {threading.current_thread()}, "requests are asked by one thread"

    def refused() -> None:
        raise StoreError("no answer")

    with pytest.raises(StoreError, match="no answer"):
        meanwhile(refused, lambda: None, 1.0)
