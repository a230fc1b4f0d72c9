"""``hpc scale`` on the double of Kubernetes: 1, then 32, then 4 workers, each pod real processes.

``PYTHONPATH=tests:tests/e2e python tests/scale_pods.py`` (root, bubblewrap) prints how long each
step took, and exits with 1 if the number of workers that the conductor sees was another one.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from pathlib import Path

import kube_cluster
import yaml
from free_ports import free_port
from kube_cluster import IMAGE, KubeCluster
from processes import MARK, Marked
from test_scale import STUCK
from waiting import wait_for

STEPS = (1, 32, 4)


def main() -> int:
    """Print a line per step."""
    if reason := kube_cluster.missing():
        print(f"scale_pods: {reason}", file=sys.stderr)
        return 3
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["DRIVETWIN_HOME"] = str(folder / "home")
        marked = Marked()
        try:
            with KubeCluster(variables={MARK: marked.mark}) as kube:
                return steps(marked, kube, folder)
        finally:
            marked.end()


def steps(marked: Marked, kube: KubeCluster, folder: Path) -> int:
    """Scale a campaign whose cases nobody may run."""
    (folder / "stuck.yaml").write_text(STUCK.replace("7]", f"{', '.join(map(str, range(7, 64)))}]"))
    (folder / "kubeconfig").write_text(yaml.safe_dump(kube.api.kubeconfig("admin", "robots")))
    port = free_port()
    pool = {
        "scheduler": "kubernetes",
        "kubeconfig": str(folder / "kubeconfig"),
        "directives": [f"--image={IMAGE}"],
        "connect": f"tls/127.0.0.1:{port}",
        "time": "01:00",
        "workers": 1,
        "allocations": 64,
        "queued": 64,
    }
    sites = folder / "sites.yaml"
    sites.write_text(yaml.safe_dump({"listen": f"tls/127.0.0.1:{port}", "sites": {"pool": pool}}))
    out = folder / "runs" / "stuck"
    common = ("--on", "k8s:pool", "--sites", str(sites))

    def run(*words: str) -> str:
        done = marked.run(*words, folder=folder)
        assert done.returncode == 0, done.stderr + done.stdout
        return done.stdout

    def present() -> int:
        status = json.loads(run("conductor", "status", "--state", str(out), "--output", "json"))
        return sum(bool(worker["present"]) for worker in status["workers"])

    run("hpc", "submit", "stuck.yaml", *common, "--time", "01:00")
    right = True
    for count in STEPS:
        began_s = time.monotonic()
        run("hpc", "scale", str(out), *common, "--once", "--target", f"{count}:{count}")
        asked_s = time.monotonic() - began_s
        wait_for(lambda n=count: present() == n, f"{count} workers")
        pods = len(kube.pods("worker", "Running"))
        right = right and pods == count
        took_s = time.monotonic() - began_s
        print(f"{count} workers: asked in {asked_s:.1f} s, there in {took_s:.1f} s, {pods} pods")
    run("hpc", "cancel", str(out), "--sites", str(sites))
    wait_for(lambda: not kube.live(), "the end of all pods")
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main())
