"""Recordings that are fetched with a run: of whom, and only as their run was signed."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import msgspec
import pytest

from conductor.records.outcomes import FILE_NAME as OUTCOMES_FILE
from conductor.records.outcomes import CaseOutcome, Outcomes, encode_outcomes
from conductor.stored.fetching import fetch_run
from conductor.trust.manifest import RUN_FILE
from conductor.trust.sign_run import UnfitRunError, sign_run
from schemas.files.recording import RecordingObject
from twin.base.errors import InfrastructureError
from twin.stores.folder import FolderStore
from twin.stores.objects import object_name, put_object, sha256_of
from twin.stores.protocol import ResultStore, StoreRefusedError
from viewer.playback.folder import find_recording

CONTENT = {"bad": b"RRF2 of a collision", "good": b"RRF2 of a pass"}
FILES = ("campaign.yaml", OUTCOMES_FILE, RUN_FILE)


def outcomes_of(**recordings: RecordingObject) -> Outcomes:
    """Two cases without KPIs, as of a run that was cut short before the first tick."""
    cases = {
        name: CaseOutcome(
            outcome="verdict",
            verdict="pass" if name == "good" else "collision",
            attempt_dir=f"cases/{name}/attempt-1",
            recording=stored,
        )
        for name, stored in recordings.items()
    }
    return Outcomes(
        campaign="a",
        digest="0" * 64,
        seed=1,
        simulator="twin",
        software="",
        device="same",
        device_classes=[],
        complete=True,
        cases=cases,
    )


def object_of(name: str, **fields: Any) -> RecordingObject:
    data = CONTENT[name]
    made = RecordingObject(sha256_of(data), len(data), name == "good")
    return msgspec.structs.replace(made, **fields)


def run_in(store: ResultStore, folder: Path, *, signed: bool = True, **fields: Any) -> None:
    """A run whose recordings are in the store; ``fields``: of what it says of the bad one."""
    recordings = {"bad": object_of("bad", **fields), "good": object_of("good")}
    outcomes = outcomes_of(**recordings)
    folder.mkdir()
    (folder / "campaign.yaml").write_bytes(b"campaign: a\n")
    (folder / OUTCOMES_FILE).write_bytes(encode_outcomes(outcomes))
    if signed:
        sign_run(folder, outcomes, "0" * 64)
    for name in FILES if signed else FILES[:-1]:
        store.put(f"runs/a/{name}", (folder / name).read_bytes())
    for data in CONTENT.values():
        put_object(store, data)


def files_of(folder: Path) -> dict[str, bytes]:
    paths = folder.glob("cases/*/attempt-1/recording.rrd")
    return {path.parts[-3]: path.read_bytes() for path in paths}


@pytest.fixture
def made(tmp_path: Path) -> FolderStore:
    return FolderStore(tmp_path / "store")


@pytest.mark.parametrize(
    ("which", "names"), [("none", ()), ("failed", ("bad",)), ("all", ("bad", "good"))]
)
def test_those_that_are_asked_for_come(
    tmp_path: Path, store: ResultStore, which: Any, names: tuple[str, ...]
) -> None:
    """Folders, the real S3 server, and a store that runs apart."""
    run_in(store, tmp_path / "run")
    folder = fetch_run(store.url, tmp_path / "read", which)
    assert files_of(folder) == {name: CONTENT[name] for name in names}
    for name in names:
        found = find_recording(folder, name)
        assert (found.complete, found.committed) == (name == "good", "attempt-1")


def test_that_there_are_some_is_told_to_whom_it_helps(
    tmp_path: Path, made: FolderStore, caplog: pytest.LogCaptureFixture
) -> None:
    run_in(made, tmp_path / "run")
    with caplog.at_level(logging.WARNING):
        fetch_run(made.url, tmp_path / "read")
        assert caplog.messages == []
        fetch_run(made.url, tmp_path / "read", hint="ask for them")
    assert caplog.messages == [f"{made.url}: has 2 recordings; ask for them"]


def test_they_are_not_fetched_again(
    tmp_path: Path, made: FolderStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_in(made, tmp_path / "run")
    fetch_run(made.url, tmp_path / "read", "all")
    asked: list[str] = []
    real = FolderStore.get

    def get(self: FolderStore, name: str, size_max: int) -> bytes:
        asked.append(name)
        return real(self, name, size_max)

    monkeypatch.setattr(FolderStore, "get", get)
    folder = fetch_run(made.url, tmp_path / "read", "all")
    assert not [name for name in asked if name.startswith("objects/")]
    (folder / "cases/bad/attempt-1/recording.rrd").write_bytes(b"damaged")
    fetch_run(made.url, tmp_path / "read", "failed")
    assert files_of(folder) == CONTENT


def test_a_run_that_is_signed_no_longer_is_not_signed_here_either(
    tmp_path: Path, made: FolderStore
) -> None:
    """Something came after its signature; the next one will be in the store later."""
    run_in(made, tmp_path / "run")
    folder = fetch_run(made.url, tmp_path / "read")
    assert (folder / RUN_FILE).exists()
    (folder / "judgement.json").write_text("made here")
    made.delete(f"runs/a/{RUN_FILE}")
    fetch_run(made.url, tmp_path / "read")
    assert not (folder / RUN_FILE).exists()
    assert (folder / "judgement.json").read_text() == "made here"


def test_of_a_run_that_is_not_signed_none_comes(
    tmp_path: Path, made: FolderStore, caplog: pytest.LogCaptureFixture
) -> None:
    run_in(made, tmp_path / "run", signed=False)
    with caplog.at_level(logging.WARNING):
        folder = fetch_run(made.url, tmp_path / "read", "all")
    assert files_of(folder) == {}
    assert "no recording is fetched, because the run is not signed" in caplog.text


def test_whoever_changes_the_outcomes_brings_no_file_to_a_viewer(
    tmp_path: Path, made: FolderStore
) -> None:
    run_in(made, tmp_path / "run")
    forged = put_object(made, b"RRF2 and code")
    text = made.get(f"runs/a/{OUTCOMES_FILE}").decode()
    made.put(f"runs/a/{OUTCOMES_FILE}", text.replace(object_of("bad").sha256, forged).encode())
    with pytest.raises(UnfitRunError, match=r"outcomes.json is not what was signed"):
        fetch_run(made.url, tmp_path / "read", "failed")
    assert files_of(tmp_path / "read") == {}


@pytest.mark.parametrize(
    ("data", "line"),
    [
        pytest.param(b"RRF2 and code", "its content is another one than its name", id="swapped"),
        pytest.param(None, "is not there", id="removed"),
        pytest.param(1 << 36, "more than 19 bytes", id="huge"),
    ],
)
def test_an_object_that_was_changed_is_told_and_the_others_come(
    tmp_path: Path,
    made: FolderStore,
    caplog: pytest.LogCaptureFixture,
    data: bytes | int | None,
    line: str,
) -> None:
    run_in(made, tmp_path / "run")
    name = object_name(object_of("bad").sha256)
    if isinstance(data, int):
        with (Path(made.url) / name).open("wb") as file:
            file.truncate(data)
    elif data is None:
        made.delete(name)
    else:
        made.put(name, data)
    with caplog.at_level(logging.WARNING):
        folder = fetch_run(made.url, tmp_path / "read", "all")
    assert files_of(folder) == {"good": CONTENT["good"]}
    assert f"case bad: its recording is not fetched: {made.url}" in caplog.text
    assert line in caplog.text


def test_what_the_store_refuses_is_told_and_the_others_come(
    tmp_path: Path,
    made: FolderStore,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    run_in(made, tmp_path / "run")
    real = FolderStore.get

    def get(self: FolderStore, name: str, size_max: int) -> bytes:
        if name == object_name(object_of("bad").sha256):
            raise StoreRefusedError("no rights")
        return real(self, name, size_max)

    monkeypatch.setattr(FolderStore, "get", get)
    with caplog.at_level(logging.WARNING):
        folder = fetch_run(made.url, tmp_path / "read", "all")
    assert files_of(folder) == {"good": CONTENT["good"]}
    assert "case bad: its recording is not fetched: no rights" in caplog.text


@pytest.mark.parametrize("size", [1, len(CONTENT["bad"]) + 1])
def test_a_worker_that_lied_about_the_size_brings_nothing(
    tmp_path: Path, made: FolderStore, caplog: pytest.LogCaptureFixture, size: int
) -> None:
    run_in(made, tmp_path / "run", size=size)
    with caplog.at_level(logging.WARNING):
        folder = fetch_run(made.url, tmp_path / "read", "failed")
    assert files_of(folder) == {}
    assert "case bad: its recording is not fetched" in caplog.text


@pytest.mark.parametrize("value", ["../../../x" + "a" * 54, "AB" * 32])
def test_a_digest_that_is_none_is_a_damaged_file(
    tmp_path: Path, made: FolderStore, value: str
) -> None:
    run_in(made, tmp_path / "run", sha256=value)
    with pytest.raises(InfrastructureError, match=r"outcomes.json: damaged"):
        fetch_run(made.url, tmp_path / "read", "all")


def test_a_link_in_the_folder_is_not_followed(tmp_path: Path, made: FolderStore) -> None:
    run_in(made, tmp_path / "run")
    folder = fetch_run(made.url, tmp_path / "read")
    (tmp_path / "elsewhere").mkdir()
    (folder / "cases").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(InfrastructureError, match="symbolic link"):
        fetch_run(made.url, tmp_path / "read", "all")
    assert list((tmp_path / "elsewhere").iterdir()) == []
