"""`conductor stop`, whose conductor may be gone before its answer has arrived."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from conductor.commands import client
from conductor.commands.client import ConductorClient
from schemas.wire import topics
from twin.base.errors import InfrastructureError
from twin.fabric.bus import Bus, Respond
from twin.fabric.keys.authority import make_keys
from twin.fabric.keys.key_file import load_key
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import open_bus


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    return make_keys(tmp_path / "keys")


@pytest.fixture
def router(keys: Path) -> Iterator[Bus]:
    """What a conductor listens with."""
    bus = open_bus("router", listen=["tls/127.0.0.1:0"], key=load_key(keys, Role.conductor))
    yield bus
    bus.close()


def stop_at(router: Bus, keys: Path, heard: Callable[[], None]) -> None:
    """Ask to stop where whoever hears it never answers."""

    def hear(_payload: bytes, _respond: Respond) -> None:
        heard()

    router.serve(topics.RPC_ADMIN.key, hear)
    with ConductorClient(router.endpoints[0], None, "twin", keys / "admin.key") as asking:
        asking.stop()


def test_one_that_has_gone_has_heard_it(router: Bus, keys: Path) -> None:
    gone = threading.Event()
    ending = threading.Thread(target=lambda: (gone.wait(), router.close()))
    ending.start()
    stop_at(router, keys, gone.set)
    ending.join()
    assert gone.is_set()


def test_one_that_is_there_and_silent_has_not(
    router: Bus, keys: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client, "TRIES", 1)
    heard = threading.Event()
    with pytest.raises(InfrastructureError, match="no conductor answers"):
        stop_at(router, keys, heard.set)
    assert heard.is_set()
