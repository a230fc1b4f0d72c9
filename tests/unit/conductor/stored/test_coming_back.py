"""Files that come back from a store, into a successor's folder or for a report."""

from __future__ import annotations

import errno
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from conductor_bench import Bench, hello, next_of, result, submit

from conductor.records.outcomes import CaseOutcome, Outcomes, encode_outcomes
from conductor.stored import fetching
from conductor.stored.fetching import fetch_run
from conductor.stored.successor import bring_back
from schemas.files.judging import attempt_digest
from schemas.files.kpi import KPI_COLUMNS
from schemas.wire.control import Result
from twin.base.errors import TwinError, UsageError
from twin.records.kpi_file import kpi_sha256, kpi_table, read_kpi, write_kpi
from twin.stores.folder import FolderStore
from twin.stores.objects import attempt_name, mark_of, object_name, put_attempt, sha256_of
from twin.stores.protocol import DamagedObjectError, MissingObjectError

TYPES = {"bool": True, "int32": 1, "int64": 1, "float64": 0.5, "name": "one", "detections": []}
NOTHING = Outcomes(
    campaign="a",
    digest="0" * 64,
    seed=1,
    simulator="warp",
    software="0" * 64,
    device="same",
    device_classes=[],
    complete=False,
    cases={},
)


@pytest.fixture
def store(tmp_path: Path) -> FolderStore:
    """An empty one."""
    return FolderStore(tmp_path / "store")


@pytest.fixture
def done(tmp_path: Path, store: FolderStore) -> Result:
    """A result whose files are in the store."""
    bench = Bench()
    bench.ask(submit(out=str(tmp_path / "out")))
    bench.ask(hello("w1"))
    (lease,) = bench.ask(next_of("w1", 1, 1)).leases
    log, record = b"a log\n", b"{}"
    made = msgspec.structs.replace(
        result(lease), manifest_sha256=attempt_digest(f"kpi-{lease.case.id}", log, record)
    )
    folder = tmp_path / "worker" / made.attempt_dir
    folder.mkdir(parents=True)
    for name, data in (("kpi.parquet", b"rows"), ("log.txt", log), ("judge.json", record)):
        (folder / name).write_bytes(data)
    put_attempt(store, folder, made, 1)
    return made


def test_an_attempt_comes_back_as_it_was(tmp_path: Path, store: FolderStore, done: Result) -> None:
    bring_back(store, tmp_path / "out", done)
    folder = tmp_path / "out" / done.attempt_dir
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == {
        "kpi.parquet": b"rows",
        "log.txt": b"a log\n",
        "judge.json": b"{}",
    }


def test_another_log_than_the_committed_one_is_refused(
    tmp_path: Path, store: FolderStore, done: Result
) -> None:
    name = attempt_name(done.campaign, done.case, mark_of(done))
    text = store.get(name).decode()
    forged = sha256_of(b"another log\n")
    store.put(object_name(forged), b"another log\n")
    store.put(name, text.replace(sha256_of(b"a log\n"), forged).encode())
    with pytest.raises(DamagedObjectError, match="not the ones that were committed"):
        bring_back(store, tmp_path / "out", done)
    assert not (tmp_path / "out" / done.attempt_dir).exists()


def test_a_link_in_the_folder_is_not_followed(
    tmp_path: Path, store: FolderStore, done: Result
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "cases").symlink_to(elsewhere)
    with pytest.raises(TwinError, match="symbolic link"):
        bring_back(store, tmp_path / "out", done)
    assert list(elsewhere.iterdir()) == []


def test_what_is_not_there_is_said(tmp_path: Path, store: FolderStore, done: Result) -> None:
    other = msgspec.structs.replace(done, manifest_sha256="ab" * 32)
    with pytest.raises(MissingObjectError, match="is not there"):
        bring_back(store, tmp_path / "out", other)


@pytest.mark.parametrize(
    ("files", "url", "line"),
    [
        ((), "", "holds no run"),
        (("runs/a/campaign.yaml", "runs/b/campaign.yaml"), "", "holds runs of a, b; give one, as"),
        (("runs/a/campaign.yaml",), "/runs/c", "no run of a campaign c; there: a"),
        (("runs/a/campaign.yaml",), "", "campaign a has no outcomes.json yet"),
        (("runs/..x/campaign.yaml",), "", "holds no run"),
        # The store itself is below a folder of this name.
        (("runs/mine/runs/a/campaign.yaml",), "/runs/mine", "runs/mine: campaign a has no"),
        (("runs/mine/runs/a/campaign.yaml",), "/runs/mine/runs/a", "runs/mine: campaign a has no"),
    ],
)
def test_a_run_that_is_not_there_is_one_line(
    tmp_path: Path, store: FolderStore, files: tuple[str, ...], url: str, line: str
) -> None:
    for name in files:
        store.put(name, b"x")
    with pytest.raises(UsageError, match=line.replace("?", r"\?")):
        fetch_run(f"file://{tmp_path}/store{url}", tmp_path / "read")


def run_in(store: FolderStore, content: bytes, kpi_sha256: str = "0" * 64) -> None:
    """A run of one case whose KPI file is ``content``."""
    result = Result("a", "one", 1, "verdict", "pass", attempt_dir="cases/one/attempt-1")
    digest = attempt_digest("", b"", b"")
    done = msgspec.structs.replace(result, manifest_sha256=digest)
    folder = Path(store.url).with_name("made") / done.attempt_dir
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "kpi.parquet").write_bytes(content)
    put_attempt(store, folder, done, 1)
    store.put("runs/a/campaign.yaml", b"campaign: a\n")
    ended = CaseOutcome(
        outcome="verdict",
        verdict="pass",
        attempt_dir=done.attempt_dir,
        kpi_sha256=kpi_sha256,
        manifest_sha256=done.manifest_sha256,
    )
    outcomes = msgspec.structs.replace(NOTHING, cases={"one": ended})
    store.put("runs/a/outcomes.json", encode_outcomes(outcomes))


def test_a_kpi_file_is_written_anew_once(
    tmp_path: Path, store: FolderStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = {c.name: [None] if c.nullable else [TYPES[c.type]] for c in KPI_COLUMNS}
    write_kpi(table := kpi_table(rows), tmp_path / "kpi.parquet")
    content = (tmp_path / "kpi.parquet").read_bytes()
    run_in(store, content)
    folder = fetch_run(store.url, tmp_path / "read") / "cases/one/attempt-1"
    assert kpi_sha256(read_kpi(folder / "kpi.parquet")) == kpi_sha256(table)
    assert not list((tmp_path / "read").glob(".fetched-*"))
    monkeypatch.setattr(fetching, "written_anew", None)
    fetch_run(store.url, tmp_path / "read")


def test_what_is_no_kpi_file_is_one_line_and_written_nowhere(
    tmp_path: Path, store: FolderStore
) -> None:
    run_in(store, b"PAR1, and code")
    with pytest.raises(UsageError, match=r"read/cases/one/attempt-1/kpi.parquet: .*Parquet"):
        fetch_run(store.url, tmp_path / "read")
    assert not (tmp_path / "read/cases/one/attempt-1/kpi.parquet").exists()


KILLED = """
import sys
from pathlib import Path
from conductor.stored import fetching

def wait(*_):
    print("fetched", flush=True)
    sys.stdin.read()

fetching._write_anew = wait
fetching.fetch_run(sys.argv[1], Path(sys.argv[2]))
"""
"""Stands still when the files have come."""


def test_what_a_killed_command_has_fetched_is_removed_and_that_of_a_living_one_is_not(
    tmp_path: Path, store: FolderStore
) -> None:
    run_in(store, b"PAR1, and code")
    out = tmp_path / "read"
    command = [sys.executable, "-c", KILLED, store.url, str(out)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, **pipes) as other:  # type: ignore[call-overload]
        assert other.stdout.readline() == b"fetched\n"
        (theirs,) = out.glob(".fetched-*/*")
        with pytest.raises(UsageError, match="Parquet"):
            fetch_run(store.url, out)
        assert theirs.read_bytes() == b"PAR1, and code"
        other.kill()
    assert theirs.exists()
    with pytest.raises(UsageError, match="Parquet"):
        fetch_run(store.url, out)
    assert not list(out.glob(".fetched-*"))
    assert not list(out.glob("**/kpi.parquet")), "nothing of it became a result"


def test_a_file_system_without_locks_keeps_leftovers(
    tmp_path: Path, store: FolderStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_in(store, b"PAR1, and code")
    out = tmp_path / "read"
    (out / ".fetched-x").mkdir(parents=True)
    (out / fetching.SOURCE_FILE).write_text(f"{store.url}/runs/a\n")

    def refuse(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fetching.fcntl, "flock", refuse)
    with pytest.raises(UsageError, match="Parquet"):
        fetch_run(store.url, out)
    assert [path.name for path in out.glob(".fetched-*")] == [".fetched-x"]


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path, store: FolderStore) -> None:
    store.put("runs/a/campaign.yaml", b"x")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "conductor.db").write_bytes(b"journal")
    with pytest.raises(UsageError, match="holds something else than what is read from"):
        fetch_run(f"file://{tmp_path}/store", tmp_path / "mine")
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["conductor.db"]
