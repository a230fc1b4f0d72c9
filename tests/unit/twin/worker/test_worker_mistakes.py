"""A worker whose own program fails says so and ends; it does not sit there without asking."""

import signal

import msgspec
import pytest
from test_worker_core import lease, result

import twin.worker.shell
from schemas.files.recording import RECORDING_FILE
from schemas.sections.view_mode import ViewMode
from twin.base.errors import InfrastructureError, UsageError
from twin.fabric.memory_bus import MemoryBus
from twin.rig.pipe import Building
from twin.stores.folder import FolderStore
from twin.worker.held import Held
from twin.worker.options import WorkerOptions
from twin.worker.shell import Abilities, Worker
from twin.worker.spool import unpack
from twin.worker.spool_folder import SpoolFolder

SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGUSR1)


@pytest.fixture
def _own_signals():
    """The handlers of this process, which a worker replaces."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def mistaken(hub, monkeypatch, error, **options):
    """A worker none of whose requests leaves its program."""

    class Mistaken(MemoryBus):
        def request(self, key, payload, timeout_s):
            raise error

    monkeypatch.setattr(twin.worker.shell, "open_bus", lambda *_, **__: Mistaken(hub))
    chosen = WorkerOptions("tcp/127.0.0.1:1", **options)
    return Worker(chosen, abilities=Abilities("software", {}, {}))


@pytest.mark.usefixtures("_own_signals")
def test_a_mistake_beside_the_main_loop_ends_the_worker(hub, monkeypatch, capfd):
    worker = mistaken(hub, monkeypatch, ValueError("no such thing"))
    with pytest.raises(InfrastructureError) as caught:
        worker.serve()
    (line,) = str(caught.value).splitlines()
    assert "ended by a mistake of this program: ValueError('no such thing')" in line
    assert "Traceback" in capfd.readouterr().err


def test_while_a_rig_is_built_the_time_of_its_cases_stands_still():
    worker = Worker(WorkerOptions("tcp/127.0.0.1:1"), abilities=Abilities("software", {}, {}))
    rig = worker.rig = object()
    held = worker.core.held[1] = Held(None)
    worker.handle((rig, Building()), 7)
    assert held.moved_ns == 7
    worker.handle((object(), Building()), 9)  # of a rig that was stopped
    assert held.moved_ns == 7


@pytest.mark.usefixtures("_own_signals")
@pytest.mark.parametrize(
    ("error", "raised"),
    [(ValueError("no such thing"), InfrastructureError), (UsageError("too large"), UsageError)],
)
def test_what_it_has_in_hand_lies_in_the_spool(hub, monkeypatch, tmp_path, error, raised):
    worker = mistaken(hub, monkeypatch, error, spool=tmp_path / "spool")
    worker.core.results.append(result(7))
    with pytest.raises(raised):
        worker.serve()
    (sealed,) = map(unpack, SpoolFolder(tmp_path / "spool").read())
    assert sealed.token == 7


@pytest.mark.usefixtures("_own_signals")
def test_a_worker_that_leaves_without_a_goodbye_counts_its_recordings(
    hub, monkeypatch, tmp_path, capfd
):
    worker = mistaken(hub, monkeypatch, ValueError("no such thing"), view=ViewMode.record)
    granted = msgspec.structs.replace(lease(7), out=str(tmp_path))
    folder = tmp_path / "cases" / granted.case.id / f"attempt-{granted.attempt}"
    folder.mkdir(parents=True)
    (folder / RECORDING_FILE).write_bytes(b"a recorder writes it")
    worker.recordings.join(FolderStore(tmp_path / "store"))
    worker.recordings.look(granted)
    done = msgspec.structs.replace(result(7), attempt_dir="cases/a/attempt-0")
    worker.recordings.settle([7], [done], [])
    with pytest.raises(InfrastructureError):
        worker.serve()
    assert "1 recording not in the store: the worker leaves" in capfd.readouterr().err
