"""A user of a double of Kubernetes: a kubeconfig, a campaign file and the ``hpc`` command."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import yaml
from free_ports import free_port
from kube_cluster import IMAGE, KubeCluster
from processes import Marked
from waiting import wait_for

from hpc.kubernetes.objects import USER

CASES = 120
"""Some seconds for a few workers."""
NOOP = f"campaign: many\nsimulator: noop\nmatrix: {{repeat: {list(range(CASES))}}}\n"


def with_kernels(folder: Path) -> Path:
    """A copy of this machine's compiled kernels for pods, which may write there."""
    words = "prepare_kernels(); import warp; print(warp.config.kernel_cache_dir)"
    words = f"from twin.world.kernel_cache import prepare_kernels; {words}"
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=True)
    kept = Path(done.stdout.splitlines()[-1])
    # In a folder of Warp's version, where those who are told WARP_CACHE_PATH look.
    shutil.copytree(kept, folder / kept.name)
    subprocess.run(["chown", "-R", f"{USER}:{USER}", str(folder)], check=True)
    return folder


class Site:
    """One user, one run."""

    def __init__(self, marked: Marked, cluster: KubeCluster, folder: Path) -> None:
        self.marked, self.cluster, self.folder = marked, cluster, folder
        self.port = free_port()
        self.out = folder / "runs" / "many"
        (folder / "many.yaml").write_text(NOOP)
        self.kubeconfig()

    def kubeconfig(self, token: str = "admin", namespace: str = "robots") -> None:
        """Log in as the holder of a token."""
        text = yaml.safe_dump(self.cluster.api.kubeconfig(token, namespace))
        (self.folder / "kubeconfig").write_text(text)

    def hpc(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run ``hpc`` to its end."""
        return self.marked.run("hpc", *words, folder=self.folder)

    def submit(
        self, *words: str, workers: int = 2, image: str = IMAGE, campaign: str = "many.yaml"
    ) -> subprocess.CompletedProcess[str]:
        """Run ``hpc submit`` to its end."""
        return self.hpc(
            *("submit", campaign, "--scheduler", "kubernetes", "--workers", str(workers)),
            *("--time", "00:30", "--out", str(self.out), "--output", "json"),
            *(f"--directive=--image={image}", f"--directive=--port={self.port}", *words),
        )

    def submitted(self, *words: str, **values: Any) -> str:
        """The run's name, after a submission that was taken."""
        done = self.submit(*words, **values)
        assert done.returncode == 0, done.stderr
        job = str(json.loads(done.stdout)["job"])
        return job.partition("@")[0].rpartition("/")[2]

    def status(self) -> dict[str, Any]:
        """What ``hpc status`` says."""
        done = self.hpc("status", str(self.out), "--output", "json")
        assert done.returncode == 0, done.stderr
        said: dict[str, Any] = json.loads(done.stdout)
        return said

    def ended(self) -> dict[str, Any]:
        """What ``hpc status`` says when all pods have gone."""
        wait_for(lambda: not self.cluster.live(), "the end of all pods")
        said = self.status()
        assert said["state"] == "ended", (said, self.cluster.logs().decode())
        return said

    def pulled(self, target: Path) -> Path:
        """The run folder, copied out of its claim."""
        done = self.hpc("pull", str(self.out), str(target))
        assert done.returncode == 0, done.stderr
        assert done.stdout == f"{target}\n"
        return target
