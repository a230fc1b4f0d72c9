"""What every result store does, and what an S3 server's breaks come to."""

from __future__ import annotations

import threading
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import pytest
from object_store import FAULTS, Wire, environment, objects_asked, reached_by, reply

from schemas.wire.control import Sealed
from twin.base.errors import EXIT_USAGE, UsageError
from twin.stores import url as url_module
from twin.stores.objects import (
    EMPTY,
    get_object,
    get_pack,
    object_name,
    pack_of,
    put_object,
    put_pack,
    sha256_of,
)
from twin.stores.opening import checked_url, has_winners, open_store
from twin.stores.protocol import (
    DamagedObjectError,
    MissingObjectError,
    ResultStore,
    StoreError,
    StoreRefusedError,
)


def test_what_was_put_is_there(store: ResultStore) -> None:
    store.put("a/one", b"1")
    store.put("a/b/two", b"22")
    store.put("a/one", b"one")
    assert store.get("a/one") == b"one"
    assert store.names("a/") == ["a/b/two", "a/one"]
    assert store.names("elsewhere/") == []
    store.delete("a/one")
    store.delete("a/one")
    with pytest.raises(MissingObjectError, match="is not there"):
        store.get("a/one")


def test_an_object_larger_than_allowed_is_not_taken(store: ResultStore) -> None:
    store.put("large", b"12345")
    assert store.get("large", 5) == b"12345"
    with pytest.raises(DamagedObjectError, match="more than 4 bytes"):
        store.get("large", 4)


def test_one_of_many_creates(store: ResultStore) -> None:
    won = []
    go = threading.Barrier(8)

    def create(number: int) -> None:
        go.wait()
        if store.create("owner/1", b"%d" % number):
            won.append(number)

    threads = [threading.Thread(target=create, args=(n,)) for n in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(won) == 1
    assert store.get("owner/1") == b"%d" % won[0]
    assert has_winners(store)


def test_contents_are_named_by_their_digest_and_held_against_it(store: ResultStore) -> None:
    digest = put_object(store, b"rows")
    assert digest == sha256_of(b"rows")
    assert get_object(store, digest) == b"rows"
    assert get_object(store, put_object(store, b"")) == b""
    assert put_object(store, b"") == EMPTY
    store.put(object_name(digest), b"rowS")  # somebody who may write the bucket
    with pytest.raises(DamagedObjectError, match="another one than its name"):
        get_object(store, digest)
    with pytest.raises(DamagedObjectError, match="64 hexadecimal"):
        object_name("../../owner/1")


def test_a_pack_that_was_changed_has_no_results(store: ResultStore) -> None:
    sealed = [Sealed(4711, "w", b"result", b"seal")]
    put_pack(store, "w", 3, sealed)
    (name,) = store.names("results/")
    assert pack_of(name) == ("w", 3)
    assert get_pack(store, name) == sealed
    data = store.get(name)
    store.put(name, data.replace(b"result", b"Result"))
    assert get_pack(store, name) == []
    assert pack_of("results/w/3") is None


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wire_that_breaks_now_and_then_loses_nothing(
    wire: Wire, fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(url_module, "TRIES", 12)
    wire.faults = {fault: 0.3}
    with reached_by(wire.port) as url:
        store = open_store(f"{url}/{tmp_path.name}")
        digests = [put_object(store, b"content %d" % n * 50) for n in range(30)]
        # One that arrived by halves is nobody's; the next name is free.
        name = next(name for name in map(str, range(50)) if store.create(name, b"mine"))
        assert not store.create(name, b"yours")
        store.names("objects/")
        listed = [store.names("objects/") for _ in range(9)]
        wire.faults, befallen = {}, wire.done[fault]
        assert befallen > 0
        assert [get_object(store, each) for each in digests] == [
            b"content %d" % n * 50 for n in range(30)
        ]
        assert store.get(name) == b"mine"
        assert all(set(names) <= {object_name(each) for each in digests} for names in listed)


def test_a_store_that_is_away_is_one_line(wire: Wire, tmp_path: Path) -> None:
    with reached_by(wire.port) as url:
        store = open_store(f"{url}/{tmp_path.name}")
        wire.down = True
        with pytest.raises(StoreError, match="tried 5 times; it will be tried again") as raised:
            store.put("a", b"1")
        assert "\n" not in str(raised.value)
        wire.down = False
        store.put("a", b"1")
        # The HTTP library asks once more where a connection was closed.
        asked = objects_asked(wire, "PUT").count(f"{tmp_path.name}/a")
        assert url_module.TRIES < asked <= 2 * url_module.TRIES + 2


def test_a_bucket_that_is_not_there_is_refused(s3_port: int) -> None:
    with reached_by(s3_port):
        store = open_store("s3://no-such-bucket/run")
        with pytest.raises(StoreRefusedError, match="no such bucket; check the bucket") as raised:
            store.put("a", b"1")
    assert raised.value.exit_code == EXIT_USAGE


def test_without_rights_it_is_refused(wire: Wire, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(handler: BaseHTTPRequestHandler) -> None:
        handler.rfile.read(int(handler.headers.get("Content-Length") or 0))
        reply(handler, 403, [], b"<Error><Code>AccessDenied</Code></Error>")

    monkeypatch.setattr(wire, "pass_on", denied)
    with reached_by(wire.port) as url:
        store = open_store(url)
        for operation in (lambda: store.put("a", b"1"), lambda: store.get("a")):
            with pytest.raises(StoreRefusedError, match="check the bucket and the credentials"):
                operation()


def test_no_credentials_is_one_line(s3_port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    with reached_by(s3_port) as url:
        for name in environment(s3_port):
            if "KEY" in name:
                monkeypatch.delenv(name)
        monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", "/nonexistent")
        monkeypatch.setenv("AWS_CONFIG_FILE", "/nonexistent")
        monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
        with pytest.raises((StoreRefusedError, StoreError)) as raised:
            open_store(url).put("a", b"1")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("url", "line"),
    [
        ("ftp://host/x", "no store of this scheme; there: "),
        ("s3://", "names no bucket"),
        ("s3://AKIA:secret@bucket/x", "credentials in a URL are seen by everybody"),
        ("s3://AKIA:sec/secret@bucket/x", "credentials in a URL are seen by everybody"),
        ("s3://bucket/x?key=secret", "options in a URL are not read"),
    ],
)
def test_a_url_that_cannot_be_used_is_one_line(url: str, line: str) -> None:
    with pytest.raises(UsageError) as raised:
        checked_url(url)
    assert line in str(raised.value)
    assert "secret" not in str(raised.value)


def test_a_missing_package_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(UsageError, match=r"pip install 'drivetwin\[store\]'"):
        open_store("s3://bucket/run")
