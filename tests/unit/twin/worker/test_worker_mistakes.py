"""A worker whose own program fails says so and ends; it does not sit there without asking."""

import signal

import pytest

import twin.worker.shell
from twin.base.errors import InfrastructureError
from twin.fabric.memory_bus import MemoryBus
from twin.rig.pipe import Building
from twin.worker.held import Held
from twin.worker.options import WorkerOptions
from twin.worker.shell import Abilities, Worker

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1)


@pytest.fixture
def _own_signals():
    """The handlers of this process, which a worker replaces."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("_own_signals")
def test_a_mistake_beside_the_main_loop_ends_the_worker(hub, monkeypatch, capfd):
    class Mistaken(MemoryBus):
        def request(self, key, payload, timeout_s):
            raise ValueError("no such thing")

    monkeypatch.setattr(twin.worker.shell, "open_bus", lambda *_, **__: Mistaken(hub))
    worker = Worker(WorkerOptions("tcp/127.0.0.1:1"), abilities=Abilities("software", {}, {}))
    with pytest.raises(InfrastructureError) as caught:
        worker.serve()
    (line,) = str(caught.value).splitlines()
    assert "ended by a mistake of this program: ValueError('no such thing')" in line
    assert "Traceback" in capfd.readouterr().err


def test_while_a_rig_is_built_the_time_of_its_cases_stands_still():
    worker = Worker(WorkerOptions("tcp/127.0.0.1:1"), abilities=Abilities("software", {}, {}))
    rig = worker._rig = object()
    held = worker._core.held[1] = Held(None)
    worker._handle((rig, Building()), 7)
    assert held.moved_ns == 7
    worker._handle((object(), Building()), 9)  # of a rig that was stopped
    assert held.moved_ns == 7
