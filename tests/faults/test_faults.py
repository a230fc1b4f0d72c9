"""Every fault once, and a storm; `make faults` injects more than a thousand."""

import subprocess
import sys
from pathlib import Path

import pytest
import rows
import table
from fabric import fabric
from injection import Injector, Plan
from kinds import FAULTS
from ledger import count, run_in_peace
from namespaces import hosts_in_a_row
from processes import nothing_left
from run import missing
from wire import Weather, Wire

pytestmark = [pytest.mark.network, pytest.mark.slow]

PAGE = Path(__file__).parents[2] / "docs" / "reliability.md"
EVERYTHING = frozenset({"viewer", "relay", "recorder", "names"})
STORE = frozenset({"store"})


@pytest.fixture(autouse=True)
def capable():
    """Root and a few programs."""
    if problem := missing():
        pytest.skip(problem)


@pytest.fixture(scope="module")
def peace(tmp_path_factory):
    """The campaign of the faults, run once without any."""
    return run_in_peace(tmp_path_factory.mktemp("peace") / "quiet")


def check(folder, extras, plan, peace, workers=1):
    """Carry out a plan; its cases are all committed, once, with the quiet run's values."""
    with fabric(folder, extras, workers) as made, nothing_left(made.marked):
        with (folder / "faults.jsonl").open("w") as journal:
            injector = Injector(made, plan, journal)
            assert injector.run(), f"no end after {injector.injected}"
        made.end()
        found = count(made.state, len(made.campaigns), peace)
        assert (found.lost, found.doubled, found.wrong) == (0, 0, 0), injector.injected
    assert sum(injector.injected.values()) == plan.times
    return injector


@pytest.mark.parametrize(
    "extras", [frozenset({"clock"}), EVERYTHING, STORE], ids=["least", "all", "store"]
)
def test_every_fault_once(tmp_path, peace, extras):
    """First what needs nothing special, then what needs a relay, a viewer, names or a recorder,
    then what needs an object store."""
    if extras != frozenset({"clock"}):
        faults = tuple(f for f in FAULTS.values() if f.extras and f.extras <= extras)
    else:
        faults = tuple(f for f in FAULTS.values() if f.extras <= extras)
    plan = Plan(faults, len(faults), seed=1)
    injector = check(tmp_path / "fabric", extras, plan, peace)
    assert set(injector.injected) == {fault.name for fault in faults}


def test_every_fault_is_in_one_of_the_runs():
    runs = (EVERYTHING, STORE, {"clock"})
    assert all(any(f.extras <= run for run in runs) for f in FAULTS.values())


def test_a_storm(tmp_path, peace):
    stormy = tuple(fault for fault in FAULTS.values() if fault.stormy)
    plan = Plan(stormy, 15, seed=1, pause_s=rows.STORM_PAUSE_S)
    check(tmp_path / "fabric", frozenset(), plan, peace, rows.STORM_WORKERS)


ECHO = (
    "import socket, sys\n"
    "with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:\n"
    "    s.bind((sys.argv[1], 9)); print('ready', flush=True)\n"
    "    while True: s.sendto(*s.recvfrom(99))\n"
)
ASK = (
    "import socket, sys, time\n"
    "with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:\n"
    "    s.settimeout(float(sys.argv[3])); heard = []\n"
    "    for number in range(int(sys.argv[2])):\n"
    "        began_s = time.monotonic(); s.sendto(b'%d' % number, (sys.argv[1], 9))\n"
    "        try:\n"
    "            while s.recv(99) != b'%d' % number: pass\n"
    "            heard.append(time.monotonic() - began_s)\n"
    "        except TimeoutError: pass\n"
    "print(len(heard), min(heard, default=0.0))\n"
)


def ask(host, address, times, patience_s):
    """Datagrams that were answered, and the quickest answer [s]."""
    command = [*host.inside, sys.executable, "-c", ASK, address, str(times), str(patience_s)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    heard, quickest_s = done.stdout.split()
    return int(heard), float(quickest_s)


def test_the_wire_loses_and_delays():
    """So that a network fault is one."""
    with hosts_in_a_row(1) as (one,), hosts_in_a_row(1) as (two,):
        wire = Wire(one, two, "10.79.1")
        server = subprocess.Popen(
            [*two.inside, sys.executable, "-c", ECHO, two.addresses[0]],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert server.stdout.readline() == "ready\n"
            there = two.addresses[0]
            assert ask(one, there, 20, 60.0)[0] == 20
            wire.set(Weather(delay_s=0.1))
            assert ask(one, there, 2, 60.0)[1] >= 0.2
            for weather in (Weather(loss_there=1.0), Weather(loss_back=1.0)):
                wire.set(weather)
                assert ask(one, there, 3, 0.1)[0] == 0
            wire.set(Weather(loss_there=0.5))
            assert 0 < ask(one, there, 40, 0.05)[0] < 40
            wire.set(Weather())
            assert ask(one, there, 20, 60.0)[0] == 20
        finally:
            server.kill()
            server.communicate()
            wire.close()


def test_the_page_names_every_fault():
    """What happens is documented, and the table of the page has all rows."""
    text = PAGE.read_text()
    described, _, measured = text.partition(table.BEGIN)
    missing_words = [name for name in FAULTS if f"| {name} |" not in described]
    assert missing_words == []
    assert [n for n in (*FAULTS, rows.STORM) if f"| {n} |" not in measured] == []
