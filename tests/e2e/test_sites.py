"""One campaign on three sites that share nothing: a Slurm, a Slurm behind qsub that dials out only,
and a double of Kubernetes, each in a network of its own."""

from __future__ import annotations

import json
import shutil
import signal
import socket

import kube_cluster
import pytest
import site_networks
import yaml
from kube_cluster import IMAGE, KubeCluster, send
from kube_site import free_port, with_kernels
from processes import MARK, complete, outcomes
from site_networks import SiteCluster, networks, own_bin
from waiting import PATIENCE_S, wait_for

from conductor.records.fingerprint import fingerprint
from schemas.wire.site_name import site_of

CASES = 400
NOOP = f"campaign: many\nsimulator: noop\nmatrix: {{repeat: {list(range(CASES))}}}\n"
MISSING = site_networks.missing() or kube_cluster.missing()
pytestmark = pytest.mark.skipif(bool(MISSING), reason=MISSING)


class Sites:
    """Three sites, and a user at the host of the conductor."""

    def __init__(self, marked, folder, found, port):
        self.marked, self.folder, self.port = marked, folder, port
        self.networks = {network.site: network for network in found}
        self.north, self.south, self.pool = found
        own = {"WARP_CACHE_PATH": "/kernels", MARK: marked.mark}
        self.kube = KubeCluster(variables=own)
        self.kube.image_folders["/kernels"] = with_kernels(folder / "kernels")
        self.kube.prefix = self.pool.inside
        self.slurm, self.pbs = SiteCluster(self.north), SiteCluster(self.south)
        self.hub = self.north.hidden
        self.out = self.hub / "runs" / "many"
        self.file = self.hub / "sites.yaml"

    def write(self):
        """The sites file and the campaign."""
        (self.hub / "many.yaml").write_text(NOOP)
        pool_config = self.hub / "kubeconfig"
        pool_config.write_text(yaml.safe_dump(self.kube.api.kubeconfig("admin", "robots")))
        common = {"bin": own_bin(), "workers": 1, "time": "00:30"}

        def connect(network):
            return f"tls/{network.here}:{self.port}"

        sites = {
            "north": {
                **common,
                "scheduler": "slurm",
                "reach": self.slurm.reach(**{MARK: self.marked.mark}),
                "folder": str(self.slurm.folder / "jobs"),
                "connect": connect(self.north),
                "cost": 2.5,
            },
            "south": {
                **common,
                "scheduler": "pbs",
                "dials_out": True,
                "connect": connect(self.south),
            },
            "pool": {
                "scheduler": "kubernetes",
                "workers": 1,
                "time": "00:30",
                "kubeconfig": str(pool_config),
                "directives": [f"--image={IMAGE}"],
                "connect": connect(self.pool),
            },
        }
        text = yaml.safe_dump({"listen": f"tls/0.0.0.0:{self.port}", "sites": sites})
        self.file.write_text(text)

    def run(self, *words):
        """A command of the user, to its end."""
        done = self.marked.run(*words, folder=self.hub)
        assert done.returncode == 0, done.stderr + done.stdout
        return done.stdout

    def hpc(self, *words):
        """``hpc``, which knows the sites."""
        return self.run("hpc", *words, "--sites", str(self.file))

    def present(self):
        """Sites of the workers that the conductor sees."""
        text = self.run("conductor", "status", "--state", str(self.out), "--output", "json")
        return {site_of(each["id"]) for each in json.loads(text)["workers"] if each["present"]}

    def commits(self, site):
        """Cases that a site has brought."""
        rows = [json.loads(line) for line in (self.out / "timeline.jsonl").open()]
        return sum(r["event"] == "committed" and site_of(r["worker"]) == site for r in rows)

    def signal(self, site, number):
        """Send a signal to the workers of a site; there must be some."""
        if site == "pool":
            sent = [send(pod.pid, number) for pod in [*self.kube.running.values()] if pod.pid]
        else:
            sent = [send(pid, number) for pid in self.networks[site].processes("worker")]
        assert any(sent)

    def vanish(self, site):
        """The cable first, so that nobody hears of it; then its workers."""
        self.networks[site].cut()
        self.signal(site, signal.SIGKILL)

    def scale_from_here(self):
        """The scaler of the sites that are reached from here."""
        return self.marked.start(
            *("hpc", "scale", str(self.out), "--on", "slurm:north", "--on", "k8s:pool"),
            *("--target", "2:2", "--period-s", "1", "--sites", str(self.file)),
            folder=self.hub,
            log=(self.hub / "scale.out").open("a"),
        )

    def scale_from_south(self, folder):
        """The scaler of the site that dials out: it has a key, and nothing else of this host."""
        folder.mkdir()
        shutil.copy(self.out / "sites" / "south.key", folder / "south.key")
        entry = {"scheduler": "pbs", "workers": 1, "time": "00:30", "bin": own_bin()}
        (folder / "sites.yaml").write_text(yaml.safe_dump({"sites": {"south": entry}}))
        words = ("hpc", "scale", "runs/many", "--key", "south.key", "--on", "pbs:south")
        conf = f"SLURM_CONF={self.pbs.environment['SLURM_CONF']}"
        return self.marked.start(
            *(*words, "--target", "1:1", "--period-s", "1", "--sites", "sites.yaml"),
            prefix=("env", conf, f"DRIVETWIN_HOME={folder}", *self.south.apart),
            folder=folder,
            log=(folder / "scale.out").open("a"),
        )


@pytest.fixture
def sites(marked, tmp_path, monkeypatch):
    hub = tmp_path / "hub"
    hub.mkdir()
    monkeypatch.setenv("DRIVETWIN_HOME", str(hub / "home"))
    with networks(("north", "south", "pool"), hub) as found:
        made = Sites(marked, tmp_path, found, free_port())
        made.south.nobody_in()
        with made.kube:
            try:
                made.slurm.start()
                made.pbs.start()
                made.write()
                yield made
            finally:
                marked.end()
                made.slurm.stop()
                made.pbs.stop()


def test_each_site_goes_in_turn(sites, quiet, tmp_path):
    """Each is cut off and killed in mid-run, one after the other; nothing is lost or differs."""
    out = sites.out
    said = sites.hpc("submit", "chaos-16", *ON, "--out", str(out), "--time", "00:30")
    sites.run("conductor", "pause", "chaos-16", "--state", str(out))
    assert "south: copy" in said
    assert not reached(sites.south.there, sites.pbs.port)
    wait_for(lambda: sites.present() == {"north", "pool"}, "workers of two sites")
    sites.signal("north", signal.SIGSTOP)
    sites.signal("pool", signal.SIGSTOP)
    sites.run("conductor", "resume", "chaos-16", "--state", str(out))
    from_south, here = sites.scale_from_south(tmp_path / "south"), sites.scale_from_here()
    wait_for(lambda: sites.commits("south"), "a case of the south")
    sites.vanish("south")
    sites.signal("north", signal.SIGCONT)
    wait_for(lambda: sites.commits("north"), "a case of the north")
    sites.vanish("north")
    sites.south.mend()
    sites.signal("pool", signal.SIGCONT)
    wait_for(lambda: sites.commits("pool"), "a case of the pool")
    sites.vanish("pool")
    assert not complete(out), "all three have vanished in mid-run"
    sites.north.mend()
    sites.pool.mend()
    wait_for(lambda: (out / "report.html").exists(), "the end")
    assert here.wait(PATIENCE_S) == 0
    from_south.terminate()  # it may have seen the end, or wait for another conductor
    assert from_south.wait(PATIENCE_S) in (0, 75)
    rows = outcomes(out)
    assert {row["outcome"] for row in rows.values()} == {"verdict"}
    assert {site_of(row["worker"]) for row in rows.values()} == {"north", "south", "pool"}
    assert fingerprint(out).sha256 == quiet["fingerprint"]
    print((sites.hub / "scale.out").read_text())
    print((tmp_path / "south" / "scale.out").read_text())


def reached(host, port):
    """Whether somebody answers there."""
    try:
        socket.create_connection((host, port), 5).close()
    except OSError:
        return False
    return True


ON = ("--on", "slurm:north", "--on", "pbs:south", "--on", "k8s:pool")
