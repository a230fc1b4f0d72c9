"""A run is signed when all of it is on disk, and anew when something comes to it later."""

from __future__ import annotations

import errno
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conductor_bench import V, hello, next_of, result, secret, submit
from msgspec import UNSET
from waiting import PATIENCE_S, wait_for

import conductor.serve.shell
from conductor.records.outcomes import read_outcomes
from conductor.serve import command
from conductor.serve.command import _sign_ended
from conductor.serve.folders import Folders
from conductor.serve.shell import Conductor
from conductor.stored.link import StoreOptions
from conductor.trust.manifest import RUN_FILE
from conductor.trust.sign_run import require_agreement, require_fit, sign_run
from schemas.files.recording import RecordingObject
from schemas.wire.control import Control, Lease, Recorded
from twin.base.software import software_digest
from twin.fabric.memory_bus import MemoryHub

STORED = RecordingObject("ab" * 32, 4711, True)


@pytest.fixture
def served(tmp_path: Path, hub: MemoryHub, monkeypatch: pytest.MonkeyPatch) -> Iterator[Conductor]:
    """A conductor with a store and no wait for recordings."""
    monkeypatch.setattr(conductor.serve.shell, "RECORDINGS_S", 0.0)
    monkeypatch.setattr(conductor.serve.folders, "REFRESH_S", 0.0)
    monkeypatch.setattr(command, "SIGN_PERIOD_S", 0.01)
    monkeypatch.setattr(command, "_fingerprint", lambda folder: "0" * 64)
    made = Conductor(
        tmp_path / "state",
        bus_factory=lambda *_: hub.open(),
        store=StoreOptions(str(tmp_path / "store")),
    )
    thread = threading.Thread(target=made.serve)
    thread.start()
    assert made.started.wait(PATIENCE_S)
    yield made
    made.stop()
    thread.join(PATIENCE_S)
    assert not thread.is_alive()


def ended(served: Conductor, folder: Path) -> list[Lease]:
    """The leases of a recorded campaign whose cases have all ended."""
    reply = served.request(submit(cases=2, out=str(folder), view="record", simulator="noop"))
    assert not reply.error
    served.request(hello("w1", software=software_digest()))
    leases = served.request(next_of(worker="w1", seq=1, k=9)).leases
    done = [result(lease, kpi="0") for lease in leases]
    assert not served.request(next_of(worker="w1", seq=2, k=0, results=done)).error
    return leases


def recorded(lease: Lease) -> Recorded:
    return Recorded(V, "w1", "alpha", lease.case.id, lease.token, STORED, secret("w1"))


@pytest.fixture
def signing(served: Conductor) -> Iterator[None]:
    """What signs beside a conductor."""
    over = threading.Event()
    thread = threading.Thread(target=_sign_ended, args=(served, over))
    thread.start()
    yield
    served.stop()
    over.set()
    thread.join(PATIENCE_S)
    assert not thread.is_alive()


@pytest.mark.usefixtures("signing")
def test_a_recording_that_comes_late_is_signed_along(served: Conductor, tmp_path: Path) -> None:
    folder = tmp_path / "results"
    one, _ = ended(served, folder)
    wait_for((folder / RUN_FILE).exists, "the signature")
    assert not served.request(recorded(one)).error
    name = one.case.id

    def both() -> bool:
        known = read_outcomes(folder).cases[name].recording == STORED
        return known and (folder / RUN_FILE).exists()

    wait_for(both, "the signature with the recording")
    assert require_fit(folder).manifest is not None
    # Again, as the answer was lost: nothing is added, and the signature stays.
    before = (folder / RUN_FILE).stat().st_mtime_ns
    assert not served.request(recorded(one)).error
    assert served.additions(folder) == 3
    assert (folder / RUN_FILE).stat().st_mtime_ns == before


@pytest.mark.usefixtures("signing")
def test_what_comes_while_it_is_signed_is_not_left_out(
    served: Conductor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The outcomes change between the moment in which they are read and that of the signature."""
    folder = tmp_path / "results"
    begun, go_on, signed = threading.Event(), threading.Event(), []

    def sign(*arguments: object) -> object:
        if not signed:
            begun.set()
            assert go_on.wait(PATIENCE_S)
        made = sign_run(*arguments)  # type: ignore[arg-type]
        signed.append(made)
        return made

    monkeypatch.setattr(command, "sign_run", sign)
    one, _ = ended(served, folder)
    assert begun.wait(PATIENCE_S)
    assert not served.request(recorded(one)).error
    go_on.set()
    wait_for(lambda: len(signed) > 1, "another signature")
    wait_for((folder / RUN_FILE).exists, "the signature")
    assert read_outcomes(folder).cases[one.case.id].recording == STORED
    assert require_fit(folder).manifest is not None


@pytest.mark.usefixtures("signing")
def test_what_comes_before_the_outcomes_are_read_is_not_left_out(
    served: Conductor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The conductor knows it when the run is signed, and the outcomes on disk lack it."""
    folder = tmp_path / "results"
    begun, go_on, signed = threading.Event(), threading.Event(), []

    def agree(path: Path) -> None:
        begun.set()
        assert go_on.wait(PATIENCE_S)
        require_agreement(path)

    def sign(*arguments: object) -> object:
        made = sign_run(*arguments)  # type: ignore[arg-type]
        signed.append(made)
        return made

    monkeypatch.setattr(command, "require_agreement", agree)
    monkeypatch.setattr(command, "sign_run", sign)
    one, _ = ended(served, folder)
    assert begun.wait(PATIENCE_S)
    with monkeypatch.context() as late:
        late.setattr(Folders, "refresh", lambda *_: None)  # the outcomes are written later
        assert not served.request(recorded(one)).error
        go_on.set()
        wait_for(lambda: signed, "the signature without it")
        assert read_outcomes(folder).cases[one.case.id].recording is UNSET
    wait_for(lambda: len(signed) > 1, "another signature")
    wait_for((folder / RUN_FILE).exists, "the signature")
    assert read_outcomes(folder).cases[one.case.id].recording == STORED
    assert require_fit(folder).manifest is not None


def test_outcomes_that_the_disk_refuses_are_not_signed(
    served: Conductor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "results"
    one, _ = ended(served, folder)
    wait_for(lambda: list(served.to_sign()) == [folder], "the outcomes on disk")
    refused = threading.Event()

    def refuse(path: Path, data: bytes) -> None:
        refused.set()
        raise OSError(errno.ENOSPC, "disk full")

    with monkeypatch.context() as full:
        full.setattr(conductor.serve.folders, "write_atomic", refuse)
        assert not served.request(recorded(one)).error
        assert refused.wait(PATIENCE_S)
        assert served.to_sign() == {}
    wait_for(lambda: list(served.to_sign()) == [folder], "the outcomes on disk")
    assert read_outcomes(folder).cases[one.case.id].recording == STORED


@pytest.mark.usefixtures("signing")
def test_a_late_result_is_signed_along(served: Conductor, tmp_path: Path) -> None:
    folder = tmp_path / "results"
    software = software_digest()
    served.request(submit(cases=1, out=str(folder), simulator="noop"))
    for worker in ("w1", "w2"):
        served.request(hello(worker, software=software))
    (lost,) = served.request(next_of(worker="w1", seq=1, k=1)).leases
    served.request(next_of(worker="w1", seq=2, k=0))  # it holds nothing: the reply was lost
    (again,) = served.request(next_of(worker="w2", seq=1, k=1)).leases
    done = [result(again, kpi="0")]
    assert not served.request(next_of(worker="w2", seq=2, k=0, results=done)).fenced
    wait_for((folder / RUN_FILE).exists, "the signature")
    late = [result(lost, kpi="0")]
    assert served.request(next_of(worker="w1", seq=3, k=0, results=late)).fenced == [lost.token]

    def both() -> bool:
        known = len(read_outcomes(folder).cases[lost.case.id].late) == 1
        return known and (folder / RUN_FILE).exists()

    wait_for(both, "the signature with the late result")
    assert require_fit(folder).manifest is not None


@pytest.mark.usefixtures("signing")
def test_a_mistake_while_one_is_signed_leaves_the_others(
    served: Conductor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: Any
) -> None:
    """Neither an error that nobody foresaw, nor one of looking what is due, ends the thread."""
    to_sign, looked = served.to_sign, []

    def look(*, last: bool = False) -> dict[Path, int]:
        looked.append(last)
        if len(looked) <= 3:
            raise RuntimeError("nobody foresaw this")
        return to_sign(last=last)

    def sign(path: Path, *arguments: Any) -> object:
        if path.name == "first":
            raise ValueError("nor this")
        return sign_run(path, *arguments)

    monkeypatch.setattr(served, "to_sign", look)
    monkeypatch.setattr(command, "sign_run", sign)
    reply = served.request(submit("first", cases=1, out=str(tmp_path / "first"), simulator="noop"))
    assert not reply.error
    assert not served.request(
        submit("second", cases=1, out=str(tmp_path / "second"), simulator="noop")
    ).error
    served.request(hello("w1", software=software_digest()))
    leases = served.request(next_of(worker="w1", seq=1, k=9)).leases
    done = [result(lease, kpi="0") for lease in leases]
    assert not served.request(next_of(worker="w1", seq=2, k=0, results=done)).error
    wait_for((tmp_path / "second" / RUN_FILE).exists, "the signature of the other")
    line = f"{tmp_path / 'first'} is not signed: ValueError('nor this')"
    wait_for(lambda: line in caplog.messages, "the mistake")
    assert caplog.messages.count("nothing is signed now: RuntimeError('nobody foresaw this')") == 1
    assert not (tmp_path / "first" / RUN_FILE).exists()


def test_it_is_not_signed_before_recordings_have_had_their_time(
    served: Conductor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conductor.serve.shell, "RECORDINGS_S", 2 * PATIENCE_S)
    folder = tmp_path / "results"
    ended(served, folder)
    wait_for(lambda: list(served.to_sign(last=True)) == [folder], "the judge")
    assert served.to_sign() == {}
    monkeypatch.setattr(conductor.serve.shell, "RECORDINGS_S", 0.0)
    wait_for(lambda: list(served.to_sign()) == [folder], "the outcomes on disk")


def test_a_case_that_was_just_cancelled_is_on_disk_before_its_run_is_signed(
    served: Conductor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever cancels is answered first: nobody signs what was written before."""
    folder = tmp_path / "results"
    reply = served.request(submit(cases=1, out=str(folder), simulator="noop"))
    assert not reply.error
    with monkeypatch.context() as later:
        later.setattr(Conductor, "_bring_up_to_date", lambda *_: None)
        assert not served.request(Control(v=V, action="cancel", campaign="alpha")).error
        assert served.to_sign() == {}
        assert not read_outcomes(folder).complete
    wait_for(lambda: list(served.to_sign()) == [folder], "the outcomes on disk")
    assert read_outcomes(folder).complete


class Mistaken:
    """A conductor that cannot say what is to be signed, but for some passes in between."""

    def __init__(self, passes: list[bool], over: threading.Event) -> None:
        self.passes, self.over = passes, over

    def to_sign(self, *, last: bool) -> dict[Path, int]:
        """Fails where the list says so; before the last one it is over."""
        fails = self.passes.pop(0)
        if len(self.passes) == 1:
            self.over.set()
        if fails:
            raise RuntimeError("a mistake")
        return {}


@pytest.mark.parametrize(
    ("passes", "said"),
    [
        ([True, True, True, False], 1),  # the same again is no news
        ([True, False, True, False], 2),  # it had passed meanwhile
        ([True, True, True], 2),  # after the last pass nothing is signed any more
    ],
)
def test_a_mistake_is_said_when_it_comes_and_in_the_last_pass(
    passes: list[bool],
    said: int,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(command, "SIGN_PERIOD_S", 0.0)
    over = threading.Event()
    _sign_ended(Mistaken([*passes], over), over)  # type: ignore[arg-type]
    assert caplog.text.count("nothing is signed now: RuntimeError('a mistake')") == said
