"""Two conductors, each with its own folder and its own way to one S3 server, and who goes on."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import msgspec
import pytest
from conductor_bench import hello, next_of, result, secret, submit
from object_store import Wire, broken_wire, reached_by
from waiting import PATIENCE_S, wait_for

from conductor.core.state import Config
from conductor.journal.owner import TakenOverError
from conductor.journal.store import FILE_NAME as JOURNAL_NAME
from conductor.journal.store import Journal
from conductor.serve.engine import ConductorEngine, IncomingRequest
from conductor.stored import link as link_module
from conductor.stored import replicator as replicator_module
from conductor.stored.link import StoreLink, StoreOptions
from conductor.stored.replica import head_name
from conductor.stored.seals import OtherKeyError
from conductor.stored.successor import AHEAD_FOLDER
from schemas.wire.codec import decode, encode
from schemas.wire.control import Lease, Reply, Request, Result, Sealed
from twin.base.errors import TwinError, UsageError
from twin.fabric.keys.key_file import MemberKey
from twin.fabric.keys.roles import Role
from twin.fabric.session import seal
from twin.stores import url as url_module
from twin.stores.objects import put_pack
from twin.stores.opening import open_store
from twin.stores.protocol import ResultStore


def key_of(words: bytes) -> MemberKey:
    return MemberKey(Path("/k"), b"", b"", words, "fabric", Role.conductor)


class Node:
    """A conductor's parts that decide, without its bus."""

    def __init__(
        self,
        folder: Path,
        wire: Wire,
        *,
        durable: bool = False,
        stale_s: float = 0.3,
        key: MemberKey | None = None,
        snapshot_facts: int = 50_000,
    ) -> None:
        with reached_by(wire.port) as base:
            options = StoreOptions(f"{base}/{folder.parent.name}", durable, stale_s)
            self.link = StoreLink(options, folder, key)
            self.link.before_journal()
        self.store: ResultStore = open_on(wire, options.url)
        folder.mkdir(exist_ok=True)
        self.journal = Journal(folder)
        self.engine = ConductorEngine(
            self.journal,
            Config(folder=str(folder), store=options.url, snapshot_facts=snapshot_facts),
            0,
            claim=self.link.claim,
        )
        self.replicator = self.link.begin(self.journal.rows)
        self.journal.mirror = self.replicator
        self.engine.take_found(self.link.found(self.engine.state), 0)

    def ask(self, request: Request) -> Reply:
        """Decide and commit."""
        (answer,) = self.engine.turn([IncomingRequest(encode(request), 0)]).replies
        assert answer is not None
        reply: Reply = decode(answer, Reply)
        assert not reply.error
        return reply

    def kept(self) -> bool:
        """Whether all that was committed is in the store within a while."""
        reached = threading.Event()
        self.replicator.when_kept(reached.set)
        return reached.wait(PATIENCE_S)

    def leased(self, count: int, worker: str = "w1", seq: int = 1) -> list[Lease]:
        """Leases for a worker that has joined."""
        self.ask(hello(worker))
        return self.ask(next_of(worker=worker, seq=seq, k=count)).leases

    def ended(self) -> dict[str, str]:
        """Case -> digest of its committed KPIs."""
        cases = self.engine.state.campaigns["alpha"].cases
        return {
            name: case.end.result.kpi_sha256  # type: ignore[union-attr]
            for name, case in cases.items()
            if case.end is not None
        }

    def close(self) -> None:
        """As if the process had died, but for its threads and the end of its replica."""
        self.link.close(released=False)
        self.journal.close()


def open_on(wire: Wire, url: str) -> ResultStore:
    with reached_by(wire.port):
        store = open_store(url)
        store.names("nothing/")  # the library looks at the environment with the first request
        return store


class Site:
    """Nodes of one test."""

    def __init__(self, folder: Path, port: int) -> None:
        self._folder, self._port = folder, port
        self._stack = ExitStack()
        self.wires: list[Wire] = []

    def node(self, name: str, **options: object) -> Node:
        wire = self._stack.enter_context(broken_wire(self._port))
        self.wires.append(wire)
        node = Node(self._folder / name, wire, **options)  # type: ignore[arg-type]
        self._stack.callback(node.close)
        return node

    def close(self) -> None:
        for wire in self.wires:
            wire.down = False
        self._stack.close()


@pytest.fixture
def site(tmp_path: Path, s3_port: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    monkeypatch.setattr(url_module, "PAUSE_S", 0.001)
    monkeypatch.setattr(replicator_module, "FLUSH_S", 0.01)
    monkeypatch.setattr(replicator_module, "RETRY_S", 0.02)
    monkeypatch.setattr(replicator_module, "BEAT_S", 0.05)
    monkeypatch.setattr("conductor.stored.owner.LOOK_S", 0.02)
    # A wire to each node, in this process; test_stores_apart.py has the other.
    monkeypatch.setattr(link_module, "open_apart", open_store)
    made = Site(tmp_path, s3_port)
    yield made
    made.close()


def sealed(worker: str, done: Result) -> Sealed:
    data = encode(done)
    return Sealed(done.token, worker, data, seal(secret(worker), data))


def test_a_successor_takes_what_is_in_the_store_and_runs_the_rest_again(site: Site) -> None:
    first = site.node("a")
    first.ask(submit(cases=6))
    leases = first.leased(4)
    done = [result(lease) for lease in leases]
    first.ask(
        next_of(worker="w1", seq=2, k=0, results=done[:1], held=[x.token for x in leases[1:]])
    )
    assert first.kept()
    site.wires[0].down = True
    # Two more are committed here alone; the worker had put one of them before.
    worker = open_on_second(site, first)
    put_pack(worker, "w1", 3, [sealed("w1", done[1])])
    first.ask(next_of(worker="w1", seq=3, k=0, results=done[1:3], held=[leases[3].token]))
    assert len(first.ended()) == 3

    second = site.node("b")
    assert second.link.taken_over_s is not None
    assert second.ended() == {x.case: x.kpi_sha256 for x in done[:2]}
    state = second.engine.state
    assert state.left == 4
    assert state.epoch > first.engine.state.epoch
    # The worker goes on with its next request; what it does not hold any more waits again.
    reply = second.ask(next_of(worker="w1", seq=4, k=9, held=[leases[3].token]))
    assert {x.case.id for x in reply.leases} == {lease.case.id for lease in (leases[2],)} | set(
        state.campaigns["alpha"].cases
    ) - {x.case for x in done} - {leases[3].case.id}
    assert all(lease.token > leases[3].token for lease in reply.leases)
    again = [result(lease) for lease in reply.leases] + [done[3]]
    second.ask(next_of(worker="w1", seq=5, k=0, results=again))
    assert state.left == 0

    # Who was cut off finds its successor and commits nothing more.
    site.wires[0].down = False
    with pytest.raises(TakenOverError, match="taken over by the conductor"):
        wait_for(lambda: first.leased(1, worker="w2") and False, "the end of the first")


def open_on_second(site: Site, node: Node) -> ResultStore:
    """The store by a way that is not cut."""
    wire = site._stack.enter_context(broken_wire(site._port))
    return open_on(wire, node.store.url)


def test_a_journal_is_fetched_while_its_owner_is_watched(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = site.node("a")
    first.ask(submit())
    assert first.kept()
    first.close()
    asked = []

    def silence(*_: object) -> None:
        wait_for(lambda: (site._folder / "b" / AHEAD_FOLDER / JOURNAL_NAME).exists(), "it")
        asked.append(len(site.wires[1].asked))

    monkeypatch.setattr(link_module, "await_silence", silence)
    second = site.node("b")
    assert second.engine.state.left == 4
    later = [path for method, path in site.wires[1].asked[asked[0] :] if method == "GET"]
    assert not [path for path in later if "/objects/" in path]
    assert not (site._folder / "b" / AHEAD_FOLDER).exists()


def test_a_journal_that_was_fetched_too_early_is_fetched_again(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = site.node("a")
    first.ask(submit())
    assert first.kept()

    def silence(*_: object) -> None:
        wait_for(lambda: (site._folder / "b" / AHEAD_FOLDER / JOURNAL_NAME).exists(), "it")
        first.leased(3)
        assert first.kept()
        first.close()

    monkeypatch.setattr(link_module, "await_silence", silence)
    assert len(site.node("b").engine.state.leases) == 3
    assert not (site._folder / "b" / AHEAD_FOLDER).exists()


def test_a_reply_that_waits_for_the_store_never_leaves_without_it(site: Site) -> None:
    first = site.node("a", durable=True)
    first.ask(submit())
    assert first.kept()
    site.wires[0].down = True
    leases = first.leased(1)
    left: list[str] = []
    first.link.when_kept(lambda: left.append("lease"))
    second = site.node("b", durable=True)
    assert not second.engine.state.leases, "nobody was told of this lease"
    site.wires[0].down = False
    wait_for(lambda: first.replicator.is_over, "the successor to be found")
    assert (left, len(leases)) == ([], 1)
    second.leased(1)
    second.link.when_kept(lambda: left.append("second"))
    wait_for(lambda: left == ["second"], "the reply")


def test_a_conductor_that_lives_is_left_alone(site: Site) -> None:
    site.node("a").ask(submit())
    with pytest.raises(UsageError, match="in use by another conductor"):
        site.node("b", stale_s=PATIENCE_S)
    assert not (site._folder / "b" / "conductor.db").exists()
    assert not (site._folder / "b" / AHEAD_FOLDER).exists(), "what was fetched meanwhile"


def test_after_an_end_in_good_order_nobody_waits(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = site.node("a")
    first.ask(submit())
    first.link.close(released=True)
    first.journal.close()

    def watched(*_: object) -> None:
        raise AssertionError("it was watched")

    monkeypatch.setattr(link_module, "await_silence", watched)
    assert site.node("b").engine.state.left == 4


def test_the_same_folder_goes_on_at_once_and_another_is_refused(site: Site) -> None:
    first = site.node("a")
    first.ask(submit())
    first.leased(2)
    first.close()
    again = site.node("a")
    assert again.link.taken_over_s is None
    assert len(again.engine.state.leases) == 2
    assert again.kept()
    again.close()
    site.node("b").close()
    with pytest.raises(UsageError, match=r"was taken over by the conductor .* give an empty"):
        site.node("a")


def test_another_key_is_refused_and_so_is_a_changed_head(site: Site) -> None:
    first = site.node("a", key=key_of(b"one"))
    first.ask(submit())
    assert first.kept()
    first.close()
    with pytest.raises(OtherKeyError, match="another key, or changed"):
        site.node("b", key=key_of(b"two"))
    data = first.store.get(head_name(1))
    first.store.put(head_name(1), data[:-1] + bytes([data[-1] ^ 1]))
    with pytest.raises(OtherKeyError, match="another key, or changed"):
        site.node("c", key=key_of(b"one"))


def test_an_object_of_the_journal_that_was_changed_is_refused(site: Site) -> None:
    first = site.node("a")
    first.ask(submit())
    assert first.kept()
    first.close()
    for name in first.store.names("objects/"):
        first.store.put(name, first.store.get(name)[:-1] + b"\0")
    with pytest.raises(TwinError, match="another one than its name"):
        site.node("b")
    assert not (site._folder / "b" / "conductor.db").exists()


def test_results_that_no_session_of_the_journal_has_sealed_do_not_count(site: Site) -> None:
    first = site.node("a")
    first.ask(submit())
    (lease,) = first.leased(1)
    assert first.kept()
    first.close()
    done = result(lease)
    forged = msgspec.structs.replace(sealed("w1", done), seal=b"\0" * 64)
    put_pack(first.store, "w1", 7, [forged, sealed("w2", done), sealed("stranger", done)])
    # Of a token that this worker never got:
    other = msgspec.structs.replace(done, case="repeat_3", token=lease.token + 5, attempt_dir="")
    put_pack(first.store, "w1", 8, [sealed("w1", other)])
    assert site.node("b").ended() == {}


def test_results_that_the_journal_has_are_not_read_again(site: Site) -> None:
    first = site.node("a")
    first.ask(submit())
    leases = first.leased(2)
    done = [result(lease) for lease in leases]
    put_pack(first.store, "w1", 2, [sealed("w1", done[0])])
    first.ask(next_of(worker="w1", seq=2, k=0, results=done[:1], held=[leases[1].token]))
    put_pack(first.store, "w1", 3, [sealed("w1", done[1])])
    assert first.kept()
    first.close()
    second = site.node("b")
    assert len(second.ended()) == 2
    read = [path for method, path in site.wires[1].asked if "/results/w1/" in path]
    assert [path.partition("/w1/")[2][:12] for path in read] == ["000000000003"]


@pytest.mark.parametrize("snapshot_facts", [50_000, 7])
def test_a_replica_is_the_journal(
    site: Site, snapshot_facts: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replicator_module, "TAIL_MAX", 3)
    first = site.node("a", snapshot_facts=snapshot_facts)
    first.ask(submit(cases=40))
    held: list[Lease] = []
    for turn in range(20):
        worker = f"w{turn % 3}"
        held = first.leased(2, worker, seq=2 * turn + 1)
        done = [result(lease) for lease in held[:1]]
        first.ask(next_of(worker, 2 * turn + 2, 0, results=done))
        assert first.kept()
    first.close()
    before = first.engine.state
    second = site.node("b")
    after = second.engine.state
    assert {n: c.end for n, c in after.campaigns["alpha"].cases.items()} == {
        n: c.end for n, c in before.campaigns["alpha"].cases.items()
    }
    assert {n: w.replied for n, w in after.workers.items()} == {
        n: w.replied for n, w in before.workers.items()
    }
    # Parts that a head no longer needs are gone.
    head = len(second.store.names("objects/"))
    assert head < 25


def test_while_the_store_is_away_nothing_is_kept_but_where_it_stands(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(replicator_module, "PIECE_BYTES", 500)
    first = site.node("a", snapshot_facts=30)
    first.ask(submit(cases=40))
    assert first.kept()
    site.wires[0].down = True
    for turn in range(9):
        (lease,) = first.leased(1, "w1", seq=2 * turn + 1)
        first.ask(next_of("w1", 2 * turn + 2, 0, results=[result(lease)]))
    rows = sum(1 for _ in first.journal.rows.facts(first.journal.rows.point(None), 0, 1))
    site.wires[0].down = False
    assert first.kept()
    parts = len(first.store.names("objects/"))
    first.close()
    assert rows < 30, "a snapshot was taken meanwhile"
    assert parts > 3, "a piece at a time"
    assert site.node("b").ended() == first.ended()


def test_a_snapshot_in_the_midst_of_a_round_begins_it_anew(site: Site) -> None:
    first = site.node("a", snapshot_facts=12)
    first.ask(submit(cases=40))
    assert first.kept()
    turns = list(range(9, 0, -1))

    def another(method: str, path: str) -> None:
        """A case ends while a piece is put."""
        if method == "PUT" and "/objects/" in path and turns:
            turn = turns.pop()
            (lease,) = first.leased(1, "w1", seq=2 * turn + 1)
            first.ask(next_of("w1", 2 * turn + 2, 0, results=[result(lease)]))

    cuts = first.journal.rows.cuts
    site.wires[0].before = another
    first.leased(1, "w2")
    wait_for(lambda: not turns, "cases that end")
    assert first.kept()
    first.close()
    assert first.journal.rows.cuts > cuts
    assert site.node("b").ended() == first.ended()


def test_a_store_in_which_nobody_wins_is_refused(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    def create(self: ResultStore, name: str, data: bytes) -> bool:
        self.put(name, data)
        return True

    monkeypatch.setattr(url_module.UrlStore, "create", create)
    with pytest.raises(UsageError, match="cannot say who owns a journal"):
        site.node("a")


def test_a_listing_that_is_stale_costs_work_and_no_claim(site: Site) -> None:
    first = site.node("a")
    first.ask(submit())
    (lease,) = first.leased(1)
    assert first.kept()
    first.close()
    put_pack(first.store, "w1", 2, [sealed("w1", result(lease))])
    wire = site._stack.enter_context(broken_wire(site._port))
    wire.faults = {"stale listing": 1.0}
    # What it lists was listed before there was anything.
    empty = b'<?xml version="1.0"?><ListBucketResult><KeyCount>0</KeyCount></ListBucketResult>'
    wire.stale = (200, [("Content-Type", "application/xml")], empty)
    second = Node(site._folder / "b", wire)
    site._stack.callback(second.close)
    assert second.link.taken_over_s is not None
    assert second.ended() == {}
    assert second.store.get("owner/000002")
