"""A site whose nodes reach nobody but their login node, where a relay runs that dials out."""

from __future__ import annotations

import shutil

import pytest
import site_networks
import yaml
from free_ports import free_port
from processes import outcomes
from site_networks import SiteCluster, networks, own_bin
from waiting import PATIENCE_S, wait_for

from conductor.records.fingerprint import fingerprint
from schemas.wire.site_name import site_of
from twin.fabric.keys.own_keys import fabric_folder, fabric_name

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(site_networks.missing()), reason=site_networks.missing()),
]
RELAY = 7447
"""Port of the relay; its network is its own."""


def test_a_campaign_through_a_relay(marked, quiet, tmp_path, monkeypatch):
    """Nodes know the relay's address alone. It dies in mid-run, and another one takes its place."""
    monkeypatch.setenv("DRIVETWIN_HOME", str(tmp_path / "hub" / "home"))
    hub = tmp_path / "hub"
    hub.mkdir()
    out, port = hub / "runs" / "many", free_port()
    with networks(("south",), hub) as (south,):
        cluster = SiteCluster(south)
        south.nobody_in()
        try:
            cluster.start()
            entry = {"scheduler": "slurm", "dials_out": True, "connect": f"tls/127.0.0.1:{RELAY}"}
            sites = hub / "sites.yaml"
            data = {"listen": f"tls/0.0.0.0:{port}", "sites": {"south": entry}}
            sites.write_text(yaml.safe_dump(data))
            submit = ("hpc", "submit", "chaos-16", "--on", "slurm:south", "--out", str(out))
            done = marked.run(*submit, "--sites", str(sites), "--time", "00:30", folder=hub)
            assert done.returncode == 0, done.stderr
            # What the site gets: a worker's key for its scaler, the conductor's for the relay.
            there = tmp_path / "south"
            there.mkdir()
            shutil.copy(out / "sites" / "south.key", there)
            shutil.copy(fabric_folder(fabric_name(out)) / "conductor.key", there)
            own = {"scheduler": "slurm", "workers": 1, "time": "00:30", "bin": own_bin()}
            (there / "sites.yaml").write_text(yaml.safe_dump({"sites": {"south": own}}))
            slurm = f"SLURM_CONF={cluster.environment['SLURM_CONF']}"
            prefix = ("env", slurm, f"DRIVETWIN_HOME={there}", *south.apart)

            def relay():
                words = ("conductor", "relay", "--listen", f"tls/127.0.0.1:{RELAY}")
                where = ("--connect", f"tls/{south.here}:{port}", "--key", "conductor.key")
                child = marked.start(*words, *where, prefix=prefix, folder=there)
                line = child.stdout.readline()
                assert line.startswith("relay to "), child.communicate()
                return child

            first = relay()
            scale = ("hpc", "scale", "runs/many", "--key", "south.key", "--on", "slurm:south")
            with (there / "scale.out").open("w") as log:
                scaler = marked.start(
                    *(*scale, "--target", "1:1", "--period-s", "1", "--sites", "sites.yaml"),
                    prefix=prefix,
                    folder=there,
                    log=log,
                )
            wait_for(lambda: list(out.glob("cases/*/attempt-*/kpi.parquet")), "a case")
            first.kill()
            first.communicate()
            second = relay()
            wait_for((out / "report.html").exists, "the end of the campaign")
            second.terminate()
            assert second.wait(PATIENCE_S) == 0
            scaler.terminate()  # it may have seen the end, or no conductor
            scaler.wait(PATIENCE_S)
        finally:
            marked.end()
            cluster.stop()
    rows = outcomes(out)
    assert {row["outcome"] for row in rows.values()} == {"verdict"}
    assert {site_of(row["worker"]) for row in rows.values()} == {"south"}
    assert fingerprint(out).sha256 == quiet["fingerprint"]
