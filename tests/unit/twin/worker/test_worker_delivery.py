"""A worker that does not share the conductor's disk: what it delivers, and when it may commit."""

import hashlib
import os
import tempfile
from pathlib import Path

import msgspec
import pytest
from case_changes import changed

from conductor.serve.deliveries import Deliveries
from schemas import SCHEMA_VERSION
from schemas.campaign import Campaign
from schemas.plan import expand
from schemas.wire import topics
from schemas.wire.codec import encode
from schemas.wire.control import Ended, Lease, Result
from schemas.wire.delivery import Delivered
from twin.base.errors import InfrastructureError
from twin.fabric.memory_bus import MemoryHub
from twin.worker.delivery import PREFIX, Delivery

CASE = expand(msgspec.convert({"campaign": "demo", "matrix": {"repeat": [0]}}, Campaign))[0]


@pytest.fixture(autouse=True)
def scratch(tmp_path, monkeypatch):
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.fixture
def bus():
    hub = MemoryHub()
    thread = hub.run()
    yield hub.open()
    hub.stop()
    thread.join()


@pytest.fixture
def there(bus, tmp_path):
    """The conductor's folder, which it serves."""
    folder = tmp_path / "there"
    folder.mkdir()
    (folder / "conductor.json").write_bytes(b"{}")
    deliveries = Deliveries(lambda told: (str(folder), "") if told.worker == "w1" else ("", "no"))
    bus.serve(topics.FILES.key, deliveries.receive)
    yield folder
    deliveries.close()


def lease(out, token=1):
    return Lease(token=token, attempt=1, out=str(out), case=CASE)


def simulate(found):
    """What the simulator does: write the attempt where the lease says."""
    attempt = f"cases/{CASE.id}/attempt-1"
    folder = Path(found.out) / attempt
    folder.mkdir(parents=True)
    (folder / "kpi.parquet").write_bytes(b"kpi")
    (folder / "log.txt").write_bytes(b"log")
    return Result("demo", CASE.id, found.token, "verdict", "pass", attempt_dir=attempt)


def test_a_shared_folder_is_written_directly(bus, there, scratch):
    delivery = Delivery(bus, "w1", bytes(32))
    assert delivery.look([lease(there)]) == []
    assert delivery.localized(lease(there)) == lease(there)
    assert not delivery.holds(1)
    assert delivery.deliver([simulate(lease(there))], [], lambda: None)
    assert list(scratch.iterdir()) == []


@pytest.mark.parametrize("stale", [False, True], ids=["no folder", "a copy of an older run"])
def test_another_folder_is_delivered_to_the_conductor(bus, there, scratch, tmp_path, stale):
    here = tmp_path / "here"
    if stale:
        here.mkdir()
        (here / "conductor.json").write_bytes(b"{'pid': 1}")
    delivery = Delivery(bus, "w1", bytes(32))
    assert "is not the conductor's folder here" in delivery.look([lease(here)])[0]
    assert delivery.look([lease(here, 2)]) == [], "said once"
    recorded = msgspec.structs.replace(lease(here), case=changed(CASE, drive="all"))
    found = delivery.localized(recorded)
    assert found == msgspec.structs.replace(lease(here), out=found.out), (
        "nobody would see the record"
    )
    assert Path(found.out).is_relative_to(scratch)
    assert delivery.holds(1)
    result = simulate(found)
    sent = []
    assert delivery.deliver([result], [], lambda: sent.append(1))
    attempt = there / "cases" / CASE.id / "attempt-1"
    assert (attempt / "kpi.parquet").read_bytes() == b"kpi"
    assert (attempt / "log.txt").read_bytes() == b"log"
    assert sent == [1]
    assert delivery.deliver([result], [], lambda: None), "the commit is asked for again"
    delivery.forget([result.token])
    assert not delivery.holds(1)
    assert not list(scratch.rglob("kpi.parquet"))
    delivery.close()
    assert list(scratch.iterdir()) == []


def test_attempts_without_a_result_are_delivered_with_what_they_left(bus, there, tmp_path):
    delivery = Delivery(bus, "w1", bytes(32))
    folders = {}
    for token in (1, 2, 3):
        own = msgspec.structs.replace(lease(tmp_path / "here", token), attempt=token)
        delivery.look([own])
        folders[token] = Path(delivery.localized(own).out) / f"cases/{CASE.id}/attempt-{token}"
        folders[token].mkdir(parents=True)
        if token != 3:  # the rig died under its hands before it had written anything
            (folders[token] / "kpi.parquet").write_bytes(b"kpi")
            (folders[token] / "log.txt").write_bytes(b"log")
            (folders[token] / "interventions.jsonl").write_bytes(b"{}\n")
    ended = [
        Ended("demo", CASE.id, 1, "intervened"),
        Ended("demo", CASE.id, 2, "released"),
        Ended("demo", CASE.id, 3, "intervened"),
        Ended("demo", CASE.id, 4, "intervened"),
        Ended("demo", CASE.id, 5, "crash"),
    ]
    own = msgspec.structs.replace(lease(tmp_path / "here", 5), attempt=5)
    delivery.look([own])
    folders[5] = Path(delivery.localized(own).out) / f"cases/{CASE.id}/attempt-5"
    folders[5].mkdir()
    (folders[5] / "log.txt").write_bytes(b"said")  # all that a rig leaves that dies
    sent = []
    assert delivery.deliver([], ended, lambda: sent.append(1))
    assert sent == [1, 1, 1]
    attempts = there / "cases" / CASE.id
    assert {path.name for path in attempts.iterdir()} == {"attempt-1", "attempt-2", "attempt-5"}
    assert [path.name for path in (attempts / "attempt-5").iterdir()] == ["log.txt"]
    assert (attempts / "attempt-1/interventions.jsonl").read_bytes() == b"{}\n"
    delivery.forget(end.token for end in ended)
    assert not any(folder.exists() for folder in folders.values())
    delivery.close()


def answering(bus, *answers):
    """A conductor that answers as told."""
    left = list(answers)
    bus.serve(topics.FILES.key, lambda _, respond: respond(left.pop(0)))


def test_no_commit_before_the_files_are_safe(bus, tmp_path):
    full = Delivered(SCHEMA_VERSION, ok=False, error="disk full", retry=True)
    good = Delivered(SCHEMA_VERSION, ok=True)
    answering(bus, encode(full), b"\xc1", encode(good))
    delivery = Delivery(bus, "w1", bytes(32))
    delivery.look([lease(tmp_path / "here")])
    result = simulate(delivery.localized(lease(tmp_path / "here")))
    assert [delivery.deliver([result], [], lambda: None) for _ in range(3)] == [False, False, True]
    delivery.close()


def test_what_will_never_be_taken_ends_the_worker(bus, tmp_path):
    never = Delivered(SCHEMA_VERSION, ok=False, error="has no case 'x'")
    answering(bus, encode(never))
    delivery = Delivery(bus, "w1", bytes(32))
    delivery.look([lease(tmp_path / "here")])
    result = simulate(delivery.localized(lease(tmp_path / "here")))
    with pytest.raises(InfrastructureError, match="cannot be delivered: has no case 'x'"):
        delivery.deliver([result], [], lambda: None)
    delivery.close()


def test_what_is_not_ours_any_more_ends_nobody(bus, tmp_path):
    """The conductor fences such a result as well; its files stay where they are until then."""
    fenced = Delivered(SCHEMA_VERSION, ok=False, error="not yours", fenced=True)
    answering(bus, encode(fenced), encode(Delivered(SCHEMA_VERSION, ok=True)))
    delivery = Delivery(bus, "w1", bytes(32))
    delivery.look([lease(tmp_path / "here")])
    result = simulate(delivery.localized(lease(tmp_path / "here")))
    assert delivery.deliver([result], [], lambda: None)
    assert delivery.fenced == {result.token}
    assert delivery.deliver([result], [], lambda: None), "nothing is sent again"
    assert delivery.holds(result.token)
    delivery.fenced.clear()
    assert delivery.deliver([result], [], lambda: None), "it was a mistake"
    assert delivery.fenced == set()
    delivery.forget([result.token])
    assert not delivery.holds(result.token)
    delivery.close()


def test_noop_cases_have_no_files(bus, tmp_path):
    noop = changed(CASE, simulator="noop")
    delivery = Delivery(bus, "w1", bytes(32))
    assert delivery.look([msgspec.structs.replace(lease(tmp_path), case=noop)]) == []
    assert not delivery.holds(1)


def test_what_a_killed_worker_left_is_removed_and_a_living_one_kept(bus, scratch, tmp_path):
    dead = scratch / f"{PREFIX}dead"
    dead.mkdir()
    (dead / "kpi.parquet").write_bytes(hashlib.sha256(os.urandom(8)).digest())
    living = Delivery(bus, "w1", bytes(32))
    living.look([lease(tmp_path / "here")])
    kept = Path(living.localized(lease(tmp_path / "here")).out).parent
    assert not dead.exists()
    other = Delivery(bus, "w1", bytes(32))
    other.look([lease(tmp_path / "here")])
    assert kept.exists()
    other.close()
    living.close()
    assert list(scratch.iterdir()) == []
