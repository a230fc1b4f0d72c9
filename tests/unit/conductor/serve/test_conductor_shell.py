"""The process around the engine: start, serve, stop, start again; over the in-memory bus."""

from __future__ import annotations

import contextlib
import json
import logging
import math
import shutil
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

import msgspec
import pytest
from conductor_bench import hello, next_of, result, submit
from waiting import PATIENCE_S

import conductor.core.decisions
import conductor.serve.folders
import conductor.serve.inbox
import conductor.serve.shell
from conductor.core.facts import EpochRaised
from conductor.core.state import Config
from conductor.records.outcomes import read_outcomes
from conductor.report.reading.leases import read_leases
from conductor.serve.shell import Conductor
from schemas import SCHEMA_VERSION as V
from schemas.campaign import Campaign
from schemas.files.yaml_file import load_yaml
from schemas.wire import topics
from schemas.wire.codec import decode, encode
from schemas.wire.control import Reply, StatusRequest, Stop
from schemas.wire.rpc_routes import route_key
from twin.base.errors import InfrastructureError, UsageError
from twin.fabric.bus import Bus, Sample
from twin.fabric.discovery import find_conductor
from twin.fabric.memory_bus import MemoryHub


@contextlib.contextmanager
def serving(folder: Path, hub: MemoryHub, **options: object) -> Iterator[Conductor]:
    conductor = Conductor(folder, bus_factory=lambda *_: hub.open(), **options)  # type: ignore[arg-type]
    thread = threading.Thread(target=conductor.serve)
    thread.start()
    assert conductor.started.wait(PATIENCE_S)
    try:
        yield conductor
    finally:
        conductor.stop()
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


def _run_all(conductor: Conductor, worker: str = "w1") -> None:
    conductor.request(hello(worker))
    leases = conductor.request(next_of(worker=worker, seq=1, k=99)).leases
    done = [result(lease, kpi="0") for lease in leases]
    assert not conductor.request(next_of(worker=worker, seq=2, k=0, results=done)).error
    conductor.request(StatusRequest(v=V))  # a turn later all of it has been written


def test_a_campaign_from_submission_to_outcomes(tmp_path: Path, hub: MemoryHub) -> None:
    with serving(tmp_path / "state", hub) as conductor:
        assert conductor.snapshot()["left"] == 0
        assert find_conductor(tmp_path / "state").endpoint == "memory"
        out = tmp_path / "results"
        reply = conductor.request(submit(out=str(out)))
        assert (reply.error, reply.status["out"]) == ("", str(out))
        assert find_conductor(out).epoch == 1
        text = (out / "campaign.yaml").read_text()
        assert "# campaign digest: " in text
        again = msgspec.convert(load_yaml(out / "campaign.yaml"), Campaign)
        assert again.campaign == "alpha"
        found = read_outcomes(out)
        assert (found.complete, [end.outcome for end in found.cases.values()]) == (False, [""] * 4)
        _run_all(conductor)
        outcomes = read_outcomes(out)
        assert (outcomes.complete, len(outcomes.cases)) == (True, 4)
        assert outcomes.cases["repeat_0"].attempt_dir == "cases/repeat_0/attempt-1"
        assert "# software digest: f00d" in (out / "campaign.yaml").read_text()
        assert conductor.snapshot()["campaigns"]["alpha"]["passed"] == 4
    assert not (tmp_path / "state/conductor.json").exists()
    assert not (out / "conductor.json").exists()


def test_it_says_what_an_earlier_run_knows_of_a_campaign(
    tmp_path: Path, hub: MemoryHub, caplog: pytest.LogCaptureFixture
) -> None:
    config = Config(lengths_s={"repeat_0": 4.0, "repeat_2": 9.0, "of another": 1.0})
    old = tmp_path / "old"
    with caplog.at_level(logging.INFO, "conductor.serve.shell"):
        with serving(tmp_path / "served", hub, config=config, history=old) as served:
            assert not served.request(submit()).error
            assert not served.request(submit("beta", cases=1)).error
        with serving(tmp_path / "other", hub) as served:
            assert not served.request(submit("gamma")).error
    said = [line for line in caplog.messages if "history" in line]
    assert said == [
        f"alpha: history: {old} knows 2 of 4 cases; the others begin as in the file",
        f"beta: history: {old} knows 1 of 1 case",
    ]


def test_outcomes_and_leases_can_be_read_while_a_campaign_runs(
    tmp_path: Path, hub: MemoryHub, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conductor.serve.folders, "REFRESH_S", 0.0)
    monkeypatch.setattr(conductor.serve.folders, "REFRESH_SHARE", math.inf)  # at every turn
    with serving(tmp_path, hub) as served:
        served.request(submit())
        served.request(hello())
        leases = served.request(next_of(worker="w1", seq=1, k=3)).leases
        done = [result(lease, kpi="0") for lease in leases[:2]]
        # The third lease is in no hand any more: it is given back.
        served.request(next_of(worker="w1", seq=2, k=0, results=done))
        served.request(StatusRequest(v=V))  # a turn later all of it has been written
        found = read_outcomes(tmp_path / "alpha")
        assert not found.complete
        assert sorted(end.outcome for end in found.cases.values()) == ["", "", "verdict", "verdict"]
        seen = read_leases(tmp_path / "alpha")
        assert sorted(span.how for span in seen.spans) == ["committed", "committed", "released"]
        assert {span.worker for span in seen.spans} == {"w1"}
        assert len(seen.commits_s) == 2


def test_a_timeline_that_cannot_be_written_stops_nothing(tmp_path: Path, hub: MemoryHub) -> None:
    with serving(tmp_path, hub) as served:
        served.request(submit())
        (tmp_path / "alpha" / "timeline.jsonl").mkdir()
        _run_all(served)
        assert read_outcomes(tmp_path / "alpha").complete
    assert read_leases(tmp_path / "alpha").spans == []


def test_a_start_is_in_the_timeline_and_a_torn_line_takes_no_event_with_it(
    tmp_path: Path, hub: MemoryHub
) -> None:
    path = tmp_path / "alpha" / "timeline.jsonl"
    with serving(tmp_path, hub) as served:
        served.request(submit())
        served.request(hello("w1"))
        served.request(next_of(worker="w1", seq=1, k=1))
        served.request(StatusRequest(v=V))  # a turn later all of it has been written
        assert b"started" not in path.read_bytes(), "the first start has nothing before it"
    path.write_bytes(path.read_bytes() + b'{"at_s": 1e9, "ev')
    with serving(tmp_path, hub):
        lines = path.read_bytes().splitlines()
    assert json.loads(lines[-1])["event"] == "started"
    assert [json.loads(line)["event"] for line in lines[:-2]] == ["leased"]


def test_requests_and_events_over_the_bus(tmp_path: Path, hub: MemoryHub) -> None:
    heard: list[str] = []
    done = threading.Event()

    def hear(sample: Sample) -> None:
        fact = decode(sample.payload, dict)
        heard.append(fact["fact"])
        assert not fact.get("cases")
        if heard[-1] == "worker_joined":
            done.set()

    with serving(tmp_path, hub):
        client = hub.open()
        client.subscribe(topics.EVENT.key, hear)

        def ask(message: msgspec.Struct) -> Reply:
            return decode(
                client.request(route_key(message), encode(message), PATIENCE_S) or b"", Reply
            )

        assert not ask(submit()).error
        assert not ask(hello()).error
        assert done.wait(PATIENCE_S)
        assert heard == ["submitted", "worker_joined"]
        rubbish = client.request(topics.RPC_STATUS.key, b"\xc1", PATIENCE_S)
        assert "not MessagePack" in decode(rubbish or b"", Reply).error
        assert ask(StatusRequest(v=V)).status["left"] == 4


def test_a_second_conductor_names_the_first(tmp_path: Path, hub: MemoryHub) -> None:
    with (
        serving(tmp_path, hub),
        pytest.raises(UsageError, match=r"conductor \(pid \d+ on ") as caught,
    ):
        Conductor(tmp_path, bus_factory=lambda *_: hub.open()).serve()
    assert "\n" not in str(caught.value)


def test_a_restart_resumes_and_keeps_leases(tmp_path: Path, hub: MemoryHub) -> None:
    with serving(tmp_path, hub) as conductor:
        conductor.request(submit())
        conductor.request(hello())
        leases = conductor.request(next_of(worker="w1", seq=1, k=2)).leases
    assert not read_outcomes(tmp_path / "alpha").complete
    with serving(tmp_path, hub) as conductor:
        assert conductor.request(submit()).status["resumed"]
        done = next_of(worker="w1", seq=2, k=2, results=[result(x, kpi="0") for x in leases])
        reply = conductor.request(done)
        assert (reply.fenced, len(reply.leases), reply.epoch) == ([], 2, 2)


def test_outcomes_that_a_crash_lost_are_written_at_the_next_start(
    tmp_path: Path, hub: MemoryHub
) -> None:
    with serving(tmp_path, hub) as conductor:
        conductor.request(submit())
        _run_all(conductor)
    (tmp_path / "alpha/outcomes.json").unlink()
    with serving(tmp_path, hub):
        assert read_outcomes(tmp_path / "alpha").complete


def test_stop_request_drains(
    tmp_path: Path, hub: MemoryHub, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(conductor.serve.shell, "LINGER_S", 0.0)
    served = Conductor(tmp_path, bus_factory=lambda *_: hub.open())
    thread = threading.Thread(target=served.serve)
    thread.start()
    assert served.started.wait(PATIENCE_S)
    served.request(submit())
    served.request(hello())
    (lease,) = served.request(next_of(worker="w1", seq=1, k=1)).leases
    assert served.request(Stop(v=V)).drain
    assert thread.is_alive()
    served.request(next_of(worker="w1", seq=2, k=1, results=[result(lease)]))
    thread.join(PATIENCE_S)
    assert not thread.is_alive()


def test_a_vanished_worker_loses_its_leases_soon(tmp_path: Path, hub: MemoryHub) -> None:
    config = Config(ttl_ns=3_600_000_000_000, vanished_ns=1_000_000)
    lost = threading.Event()

    def hear(sample: Sample) -> None:
        if decode(sample.payload, dict)["fact"] == "attempt_ended":
            lost.set()

    with serving(tmp_path, hub, config=config) as conductor:
        hub.open().subscribe(topics.EVENT.key, hear)
        worker = hub.open()
        worker.announce(topics.WORKER_ALIVE.key.format(worker="w1"))
        conductor.request(submit())
        conductor.request(hello())
        conductor.request(next_of(worker="w1", seq=1, k=1))
        worker.close()
        assert lost.wait(PATIENCE_S)


@pytest.mark.parametrize("port_is_free", [True, False])
def test_the_port_of_a_crashed_predecessor_is_taken_if_free(
    tmp_path: Path, hub: MemoryHub, port_is_free: bool
) -> None:
    asked: list[str] = []

    def factory(listen: Sequence[str], *_: object) -> Bus:
        asked.extend(listen)
        if listen == ["tcp/127.0.0.1:4711"] and not port_is_free:
            raise UsageError("address already in use")
        bus = hub.open()
        bus.endpoints = [listen[0].replace(":0", ":4711" if len(asked) == 1 else ":4712")]
        return bus

    first = Conductor(tmp_path, bus_factory=factory)
    first.startup()
    left_behind = (tmp_path / "conductor.json").read_bytes()
    first.shutdown()
    (tmp_path / "conductor.json").write_bytes(left_behind)
    second = Conductor(tmp_path, bus_factory=factory)
    second.startup()
    second.shutdown()
    assert second.endpoint == f"tcp/127.0.0.1:{4711 if port_is_free else 4712}"


def test_an_address_for_all_interfaces_is_told_by_host_name(tmp_path: Path, hub: MemoryHub) -> None:
    def factory(listen: Sequence[str], *_: object) -> Bus:
        bus = hub.open()
        bus.endpoints = ["tcp/0.0.0.0:4711"]
        return bus

    served = Conductor(tmp_path, listen="tcp/0.0.0.0:0", bus_factory=factory)
    served.startup()
    found = json.loads((tmp_path / "conductor.json").read_text())
    served.shutdown()
    assert found["endpoint"] == f"tcp/{found['host']}:4711"


def _fail(*_: object) -> Bus:
    raise UsageError("tcp/127.0.0.1:1: address already in use")


def test_a_failing_start_releases_the_folder(tmp_path: Path, hub: MemoryHub) -> None:
    with pytest.raises(UsageError, match="already in use"):
        Conductor(tmp_path, bus_factory=_fail).serve()
    assert not (tmp_path / "conductor.json").exists()
    with serving(tmp_path, hub):
        pass


def test_a_folder_that_is_a_file_is_refused(tmp_path: Path, hub: MemoryHub) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises((UsageError, InfrastructureError), match="file"):
        Conductor(tmp_path / "file", bus_factory=lambda *_: hub.open()).serve()


def test_folders_of_others_are_refused(tmp_path: Path, hub: MemoryHub) -> None:
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken/campaign.yaml").write_text("campaign: other\n")
    (tmp_path / "file").write_text("")
    with serving(tmp_path / "state", hub) as conductor:
        for out, text in (
            (tmp_path / "taken", "holds a campaign of another conductor"),
            (tmp_path / "file/deep", "is not a folder"),
        ):
            error = conductor.request(submit(out=str(out))).error
            assert text in error
            assert "give another out folder" in error
        assert conductor.snapshot()["campaigns"] == {}
        assert not conductor.request(submit(out=str(tmp_path / "own"))).error
        error = conductor.request(submit("beta", out=str(tmp_path / "own"))).error
        assert "own holds campaign 'alpha'" in error


def test_a_request_to_a_dead_conductor_times_out(tmp_path: Path, hub: MemoryHub) -> None:
    served = Conductor(tmp_path, bus_factory=lambda *_: hub.open())
    assert served.snapshot() == {}
    with pytest.raises(InfrastructureError, match="did not answer"):
        served.request(StatusRequest(v=V), timeout_s=0.01)


def test_too_many_requests_are_refused_at_once(
    tmp_path: Path, hub: MemoryHub, monkeypatch: pytest.MonkeyPatch
) -> None:
    served = Conductor(tmp_path, bus_factory=lambda *_: hub.open())
    replies: list[bytes] = []
    for _ in range(conductor.serve.inbox.WAITING_MAX + 1):
        served._inbox.receive(b"", replies.append)
    assert len(replies) == 1
    assert "busy" in decode(replies[0], Reply).error
    assert served._inbox.turned_away == 1


def test_the_software_is_read_only_when_something_is_to_be_signed(
    tmp_path: Path, hub: MemoryHub, monkeypatch: pytest.MonkeyPatch
) -> None:
    digests: list[int] = []

    def digest() -> str:
        digests.append(1)
        return "of the software"

    monkeypatch.setattr(conductor.serve.shell, "software_digest", digest)
    with serving(tmp_path, hub) as served:
        assert not served.request(submit(cases=2)).error
        assert not served.to_sign()
        assert not digests, "it would be hashed every second"
        _run_all(served)
        for _ in range(2):
            served.to_sign()
        assert len(digests) == 1


def _bytes_of(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@pytest.mark.parametrize(
    ("ended", "knows"),
    [
        pytest.param(True, True, id="finished"),
        pytest.param(False, True, id="unfinished"),
        pytest.param(False, False, id="unfinished, a journal of an earlier version"),
        pytest.param(
            *(True, False),
            id="finished, a journal of an earlier version",
            marks=pytest.mark.slow,
        ),
    ],
)
@pytest.mark.parametrize("alone", [True, False], ids=["run", "served"])
def test_a_copy_of_a_state_folder_goes_on_by_itself(
    tmp_path: Path,
    hub: MemoryHub,
    monkeypatch: pytest.MonkeyPatch,
    knows: bool,
    ended: bool,
    alone: bool,
) -> None:
    state, copy, apart = tmp_path / "state", tmp_path / "copies" / "one", tmp_path / "apart"
    before = {"alpha": str(state if alone else state / "alpha"), "beta": str(apart)}
    with monkeypatch.context() as patch:
        if not knows:
            patch.setattr(conductor.core.decisions, "EpochRaised", _epoch_alone)
        with serving(state, hub) as served:
            assert not served.request(submit("alpha", out=before["alpha"])).error
            assert not served.request(submit("beta", out=before["beta"])).error
            if ended:
                _run_all(served)
                _run_all(served, "w2")
    shutil.copytree(state, copy)
    original = _bytes_of(state)
    after = before | {"alpha": str(copy if alone else copy / "alpha")}
    for _ in range(2):  # it is also remembered
        with serving(copy, hub) as served:
            assert {n: c["out"] for n, c in served.snapshot()["campaigns"].items()} == after
            leases = []
            if not ended:
                served.request(hello("w3"))
                leases = served.request(next_of(worker="w3", seq=1, k=1)).leases
            assert all(lease.out == after[lease.case.variation.campaign] for lease in leases)
    assert _bytes_of(state) == original
    assert (Path(after["alpha"]) / "outcomes.json").exists()
    with serving(state, hub) as served:
        assert {n: c["out"] for n, c in served.snapshot()["campaigns"].items()} == before


def _epoch_alone(epoch: int, **_: str) -> EpochRaised:
    return EpochRaised(epoch)
