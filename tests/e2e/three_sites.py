"""Three sites that share nothing, for tests and a bench: a Slurm, a Slurm behind qsub that dials
out only, and a double of Kubernetes, each in a network of its own; and a user at the conductor's
host."""

from __future__ import annotations

import contextlib
import json
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path

import kube_cluster
import site_networks
import yaml
from free_ports import free_port
from kube_cluster import IMAGE, KubeCluster, send
from kube_site import with_kernels
from processes import MARK, Child, Marked
from site_networks import SiteCluster, SiteNetwork, networks, own_bin

import conductor
from schemas.wire.site_name import site_of

MISSING = site_networks.missing() or kube_cluster.missing()
"""Why there can be no such sites here, or nothing."""
ON = ("--on", "slurm:north", "--on", "pbs:south", "--on", "k8s:pool")


def repeated_chaos(folder: Path, repeats: int) -> Path:
    """The campaign chaos-16, several times, in a file."""
    source = Path(conductor.__file__).parent / "campaigns" / "chaos-16.yaml"
    data = yaml.safe_load(source.read_text())
    data["campaign"] = "bench"
    data["matrix"]["repeat"] = list(range(repeats))
    path = folder / "bench.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


class ThreeSites:
    """Three sites, and a user at the host of the conductor."""

    def __init__(self, marked: Marked, folder: Path, found: list[SiteNetwork], port: int) -> None:
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

    def write(self) -> None:
        """The sites file."""
        pool_config = self.hub / "kubeconfig"
        pool_config.write_text(yaml.safe_dump(self.kube.api.kubeconfig("admin", "robots")))
        common = {"bin": own_bin(), "workers": 1, "time": "00:30"}

        def connect(network: SiteNetwork) -> str:
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

    def run(self, *words: str) -> str:
        """A command of the user, to its end."""
        done = self.marked.run(*words, folder=self.hub)
        assert done.returncode == 0, done.stderr + done.stdout
        return done.stdout

    def hpc(self, *words: str) -> str:
        """``hpc``, which knows the sites."""
        return self.run("hpc", *words, "--sites", str(self.file))

    def present(self) -> set[str]:
        """Sites of the workers that the conductor sees."""
        text = self.run("conductor", "status", "--state", str(self.out), "--output", "json")
        return {site_of(each["id"]) for each in json.loads(text)["workers"] if each["present"]}

    def commits(self, site: str) -> int:
        """Cases that a site has brought."""
        lines = (self.out / "timeline.jsonl").read_text().splitlines()
        rows = [json.loads(line) for line in lines]
        return sum(r["event"] == "committed" and site_of(r["worker"]) == site for r in rows)

    def signal(self, site: str, number: signal.Signals) -> None:
        """Send a signal to the workers of a site; there must be some."""
        if site == "pool":
            sent = [send(pod.pid, number) for pod in [*self.kube.running.values()] if pod.pid]
        else:
            sent = [send(pid, number) for pid in self.networks[site].processes("worker")]
        assert any(sent)

    def vanish(self, site: str) -> None:
        """The cable first, so that nobody hears of it; then its workers."""
        self.networks[site].cut()
        self.signal(site, signal.SIGKILL)

    def scale_from_here(self) -> Child:
        """The scaler of the sites that are reached from here."""
        words = ("hpc", "scale", str(self.out), "--on", "slurm:north", "--on", "k8s:pool")
        with (self.hub / "scale.out").open("a") as log:
            return self.marked.start(
                *(*words, "--target", "2:2", "--period-s", "1", "--sites", str(self.file)),
                folder=self.hub,
                log=log,
            )

    def scale_from_south(self, folder: Path) -> Child:
        """The scaler of the site that dials out: it has a key, and nothing else of this host."""
        folder.mkdir()
        shutil.copy(self.out / "sites" / "south.key", folder / "south.key")
        entry = {"scheduler": "pbs", "workers": 1, "time": "00:30", "bin": own_bin()}
        (folder / "sites.yaml").write_text(yaml.safe_dump({"sites": {"south": entry}}))
        words = ("hpc", "scale", "runs/many", "--key", "south.key", "--on", "pbs:south")
        conf = f"SLURM_CONF={self.pbs.environment['SLURM_CONF']}"
        with (folder / "scale.out").open("a") as log:
            return self.marked.start(
                *(*words, "--target", "1:1", "--period-s", "1", "--sites", "sites.yaml"),
                prefix=("env", conf, f"DRIVETWIN_HOME={folder}", *self.south.apart),
                folder=folder,
                log=log,
            )


@contextlib.contextmanager
def three_sites(marked: Marked, folder: Path) -> Iterator[ThreeSites]:
    """All of them, in ``folder``; the user's own folder must be ``folder/hub/home``."""
    hub = folder / "hub"
    hub.mkdir()
    with networks(("north", "south", "pool"), hub) as found:
        made = ThreeSites(marked, folder, found, free_port())
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
