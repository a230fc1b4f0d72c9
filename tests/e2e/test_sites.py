"""One campaign on three sites that share nothing, each cut off and killed in mid-run."""

from __future__ import annotations

import signal
import socket

import pytest
from processes import complete, outcomes
from three_sites import MISSING, ON, repeated_chaos, three_sites
from waiting import PATIENCE_S, wait_for

from conductor.records.fingerprint import fingerprint
from schemas.wire.site_name import site_of

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(MISSING), reason=MISSING),
]


REPEATS = 4
"""Of 16 cases: a site that brings its first one while this process waits for a processor has many
left when it vanishes."""


@pytest.fixture
def sites(marked, tmp_path, monkeypatch):
    monkeypatch.setenv("DRIVETWIN_HOME", str(tmp_path / "hub" / "home"))
    with three_sites(marked, tmp_path) as made:
        yield made


def test_each_site_goes_in_turn(sites, marked, tmp_path):
    """Each is cut off and killed in mid-run, one after the other; nothing is lost or differs."""
    out = sites.out
    file = repeated_chaos(sites.hub, REPEATS)
    said = sites.hpc("submit", str(file), *ON, "--out", str(out), "--time", "00:30")
    sites.run("conductor", "pause", "bench", "--state", str(out))
    assert "south: copy" in said
    assert not reached(sites.south.there, sites.pbs.port)
    wait_for(lambda: sites.present() == {"north", "pool"}, "workers of two sites")
    sites.signal("north", signal.SIGSTOP)
    sites.signal("pool", signal.SIGSTOP)
    sites.run("conductor", "resume", "bench", "--state", str(out))
    from_south, here = sites.scale_from_south(tmp_path / "south"), sites.scale_from_here()
    wait_for(lambda: sites.commits("south"), "a case of the south")
    sites.vanish("south")
    sites.signal("north", signal.SIGCONT)
    wait_for(lambda: sites.commits("north"), "a case of the north")
    sites.vanish("north")
    sites.signal("pool", signal.SIGCONT)
    wait_for(lambda: sites.commits("pool"), "a case of the pool")
    sites.vanish("pool")
    assert not complete(out), "all three have vanished in mid-run"
    for network in sites.networks.values():
        network.mend()
    wait_for(lambda: (out / "report.html").exists(), "the end")
    assert here.wait(PATIENCE_S) == 0
    from_south.terminate()  # it may have seen the end, or wait for another conductor
    assert from_south.wait(PATIENCE_S) in (0, 75)
    rows = outcomes(out)
    assert {row["outcome"] for row in rows.values()} == {"verdict"}
    assert {site_of(row["worker"]) for row in rows.values()} == {"north", "south", "pool"}
    one = marked.run(
        "conductor", "run", str(file), "--workers", "2", "--out", "here", folder=tmp_path
    )
    assert one.returncode == 1, one.stderr
    assert fingerprint(out).sha256 == fingerprint(tmp_path / "here").sha256


def reached(host, port):
    """Whether somebody answers there."""
    try:
        socket.create_connection((host, port), 5).close()
    except OSError:
        return False
    return True
