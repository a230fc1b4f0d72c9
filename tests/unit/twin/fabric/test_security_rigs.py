"""A stack is let into its own rig: by the simulator's handshake, not by good manners."""

import os
import stat
import threading
from contextlib import ExitStack

import pytest
import zenoh
from unit.twin.fabric.test_security_roles import lawless

from schemas.wire import topics
from twin.base.errors import UsageError
from twin.fabric.keys.authority import load_authority, make_keys
from twin.fabric.keys.key_file import UnfitKeyError, load_key
from twin.fabric.keys.rig_keys import RigKeys
from twin.fabric.keys.roles import MEMBERS, Role, rig_of
from twin.fabric.zenoh_bus import open_bus

LISTEN = ["tls/127.0.0.1:0"]


class Rig:
    """A simulator's session, what it hears, and the keys that its worker made."""

    def __init__(self, name, opened):
        self.name, self.space = name, f"twin/{name}"
        self.keys = RigKeys(name)
        opened.callback(self.keys.close)
        key = load_key(self.keys.simulator, Role.worker)
        self.bus = open_bus("peer", listen=LISTEN, key=key, namespace=self.space)
        opened.callback(self.bus.close)
        self.endpoint = self.bus.endpoints[0]
        self.heard = []
        self.commanded = threading.Event()
        for topic in (topics.COMMAND, topics.READY):
            self.bus.subscribe(topic.key.format(rig=name, side="stack"), self._hear)

    def _hear(self, sample):
        self.heard.append((sample.key, sample.payload))
        self.commanded.set()

    def key(self, topic):
        return topic.key.format(rig=self.name)


@pytest.fixture
def opened():
    with ExitStack() as found:
        yield found


def test_two_rigs_and_one_stacks_key(opened, tmp_path):
    """With its own key it reads and commands its rig; the other takes no session from it, and it
    takes none from any key of the conductor's fabric."""
    mine, others = Rig("a" * 16, opened), Rig("b" * 16, opened)
    stack = load_key(mine.keys.stack, Role.stack)
    bus = open_bus("peer", connect=[mine.endpoint], key=stack, namespace=mine.space)
    opened.callback(bus.close)
    ticked = threading.Event()
    bus.subscribe(mine.key(topics.TICK), lambda _: ticked.set())
    while not ticked.wait(0.05):
        mine.bus.publish(mine.key(topics.TICK), b"tick", block=True)
    while not mine.commanded.wait(0.05):
        bus.publish(mine.key(topics.COMMAND), b"go", block=True)
    assert mine.heard[0] == (mine.key(topics.COMMAND), b"go")
    # The same key at the other rig: ours say why, and a program without manners gets no session.
    with pytest.raises(UnfitKeyError, match=f"not the simulator of rig {'a' * 16}, and .* alone"):
        open_bus("peer", connect=[others.endpoint], key=stack, namespace=others.space)
    with pytest.raises(zenoh.ZError):
        lawless(others.endpoint, stack, others.space)
    keys = make_keys(tmp_path / "keys")
    old = tmp_path / "stack.key"
    old.touch(0o600)
    old.write_bytes(load_authority(keys).issue(Role.stack, 1))
    for path in (*(keys / f"{role}.key" for role in MEMBERS), old):
        key = load_key(path, Role.stack)
        with pytest.raises(UnfitKeyError, match="takes only the key that it gave its stack"):
            open_bus("peer", connect=[others.endpoint], key=key, namespace=others.space)
        with pytest.raises(zenoh.ZError):
            lawless(others.endpoint, key, others.space)
    assert others.heard == []


def test_a_rigs_stack_is_nobody_at_the_conductor(opened, tmp_path):
    keys = make_keys(tmp_path / "keys")
    router = open_bus("router", listen=LISTEN, key=load_key(keys, Role.conductor))
    opened.callback(router.close)
    rig = RigKeys("c" * 16)
    opened.callback(rig.close)
    for path in (rig.stack, rig.simulator):
        key = load_key(path, Role.stack)
        with pytest.raises(UnfitKeyError, match=f"not the simulator of rig {'c' * 16}"):
            open_bus("client", connect=router.endpoints, key=key)
        with pytest.raises(zenoh.ZError):
            lawless(router.endpoints[0], key)


def test_the_keys_of_a_rig_are_private_and_end_with_it(tmp_path):
    rig = RigKeys("d" * 16)
    found = {path: load_key(path, Role.stack) for path in (rig.simulator, rig.stack)}
    assert [key.role for key in found.values()] == [Role.worker, Role.stack]
    assert {rig_of(key.fabric) for key in found.values()} == {"d" * 16}
    assert len({key.private for key in found.values()}) == 2
    assert {stat.S_IMODE(path.stat().st_mode) for path in found} == {0o600}
    before = os.umask(0)
    try:
        rig.hand_over(tmp_path / "rig.key")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "rig.key").stat().st_mode) == 0o600
    assert load_key(tmp_path / "rig.key", Role.stack).certificate == found[rig.stack].certificate
    again = RigKeys("d" * 16)
    twin = load_key(again.stack, Role.stack)
    assert twin.authority != found[rig.stack].authority, "a name opens nothing"
    again.close()
    rig.close()
    for path in found:
        with pytest.raises(UsageError, match="no such key file"):
            load_key(path, Role.stack)
