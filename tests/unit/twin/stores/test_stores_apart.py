"""A store in a process of its own, which dies, freezes and is started again."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import psutil
import pytest
from waiting import wait_for

from twin.stores import apart
from twin.stores.apart import StoreApart, end_process, open_apart, put_content, put_file
from twin.stores.folder import FolderStore
from twin.stores.objects import get_object, sha256_of
from twin.stores.protocol import MissingObjectError, StoreError


@pytest.fixture
def store(tmp_path: Path) -> Iterator[StoreApart]:
    made = StoreApart(str(tmp_path / "store"))
    yield made
    made.close()


@pytest.mark.parametrize("odd", [MemoryError(), [["odd"], ""]])
def test_an_answer_that_cannot_be_taken_ends_the_process_and_the_next_call_has_another(
    store: StoreApart, monkeypatch: pytest.MonkeyPatch, odd: MemoryError | list[Any]
) -> None:
    """Also one that is for a call, but says nothing."""
    store.put("o/1", b"one")
    pid = store.pid
    read = msgspec.msgpack.decode

    def taken(*words: Any, **options: Any) -> list[Any]:
        if isinstance(odd, MemoryError):
            raise odd
        return [read(*words, **options)[0], *odd]

    with monkeypatch.context() as patched:
        patched.setattr(msgspec.msgpack, "decode", taken)
        with pytest.raises(StoreError, match="has ended; it will be tried again"):
            store.get("o/1")
    assert store.get("o/1") == b"one"
    assert store.pid not in (0, pid)


def test_large_objects_and_many_calls_at_once(store: StoreApart) -> None:
    size = 3 * apart.RECEIVE_BYTES + 1
    threads = [
        threading.Thread(target=lambda n=n: store.put(f"o/{n}", bytes([n]) * size))
        for n in range(2 * apart.CALLS_MAX)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(store.names("o/")) == len(threads)
    assert store.get("o/63", size) == bytes([63]) * size


def test_a_process_that_is_killed_fails_its_calls_and_the_next_one_starts_another(
    store: StoreApart,
) -> None:
    store.put("one", b"1")
    first = store.pid
    assert first != os.getpid()
    errors: list[str] = []

    def ask() -> None:
        try:
            store.get("one")
        except StoreError as error:
            errors.append(str(error))

    os.kill(first, signal.SIGSTOP)
    asking = threading.Thread(target=ask)
    asking.start()
    wait_for(lambda: store.under_way == 1, "a call under way")
    os.kill(first, signal.SIGKILL)
    asking.join()
    assert "has ended; it will be tried again" in errors[0]
    assert store.get("one") == b"1"
    assert store.pid not in (0, first)
    assert not psutil.pid_exists(first), "it was waited for"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda store: store.get("one"), r"no answer in 0.1 s; it will be tried again"),
        # Larger than what fits into the socket: who sends it does not wait for ever.
        (lambda store: store.put("large", bytes(16 << 20)), "it will be tried again"),
    ],
)
def test_a_process_that_freezes_is_ended(
    store: StoreApart,
    monkeypatch: pytest.MonkeyPatch,
    call: Callable[[StoreApart], object],
    words: str,
) -> None:
    store.put("one", b"1")
    first = store.pid
    os.kill(first, signal.SIGSTOP)
    with monkeypatch.context() as patch:
        patch.setattr(apart, "ANSWER_S_MAX", 0.1)
        with pytest.raises(StoreError, match=words):
            call(store)
    wait_for(lambda: not psutil.pid_exists(first), "its end")
    assert store.get("one") == b"1"


def test_it_ends_and_a_later_call_starts_another(store: StoreApart) -> None:
    first = store.pid
    end_process(store)
    wait_for(lambda: not psutil.pid_exists(first), "its end")
    with pytest.raises(MissingObjectError):
        store.get("none")
    assert store.pid not in (0, first)


HOLD = """
import sys
from twin.stores.apart import StoreApart
store = StoreApart(sys.argv[1])
print(store.pid, flush=True)
sys.stdin.read()
"""
"""A program that has a store apart."""


def test_it_ends_with_the_process_that_started_it(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLD, str(tmp_path / "store")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        process = psutil.Process(int(holder.stdout.readline()))
        holder.kill()
        wait_for(lambda: is_over(process), "its end")


def is_over(process: psutil.Process) -> bool:
    """Whether it has ended; nobody may have asked how yet."""
    return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE


def test_a_file_is_read_by_the_process(store: StoreApart, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"12345")
    for made in (store, FolderStore(tmp_path / "plain")):
        put_file(made, "file", path, 5)
        assert made.get("file") == b"12345"
        with pytest.raises(OSError, match=r"file"):
            put_file(made, "file", path, 4)
        with pytest.raises(OSError, match=r"file"):
            put_file(made, "file", tmp_path / "no file", 5)


def test_contents_are_named_by_the_process(store: StoreApart, tmp_path: Path) -> None:
    plain = FolderStore(tmp_path / "plain")
    for data in (b"", b"12345"):
        assert put_content(store, data) == put_content(plain, data) == sha256_of(data)
        assert get_object(store, sha256_of(data)) == data
    assert len(store.names("objects/")) == 1


def test_only_what_is_large_runs_apart(tmp_path: Path) -> None:
    assert isinstance(open_apart(str(tmp_path / "store")), FolderStore)
