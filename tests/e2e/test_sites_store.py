"""Workers of a site share no disk with the conductor, and a store takes their recordings."""

from __future__ import annotations

import re

import pytest
import yaml
from changed_campaigns import changed
from kube_cluster import IMAGE
from kube_site import with_kernels
from object_store import reached_by, s3_server
from test_kubernetes_store import (
    CREDENTIALS,
    assert_recordings_are_here,
    give_secret,
    recorded,
)
from waiting import wait_for

from twin.fabric.discovery import OUTCOMES_NAME

pytest.importorskip("s3fs")


@pytest.mark.slow
def test_recordings_of_a_site_are_in_the_store(site, kube, marked, tmp_path, monkeypatch):
    monkeypatch.setenv("DRIVETWIN_HOME", str(tmp_path / "own"))
    kube.variables["WARP_CACHE_PATH"] = "/kernels"
    kube.image_folders["/kernels"] = with_kernels(kube.folder / "kernels")
    campaign = changed(tmp_path, "chaos-16", recorded)
    endpoint = f"tls/127.0.0.1:{site.port}"
    give_secret(site, credentials=CREDENTIALS, config="[default]\nregion = us-east-1\n")

    def submit(port, **more):
        directives = [f"--image={IMAGE}", "--store-secret=bucket"]
        pool = {
            "scheduler": "kubernetes",
            "kubeconfig": str(tmp_path / "kubeconfig"),
            "directives": [*directives, f"--store-endpoint=http://127.0.0.1:{port}"],
            "connect": endpoint,
            "workers": 1,
            "slots": 2,
        }
        if not more:
            pool["directives"] = directives[:1]
        text = yaml.safe_dump({"listen": endpoint, "sites": {"pool": pool}, **more})
        (tmp_path / "sites.yaml").write_text(text)
        words = ("--on", "k8s:pool", "--sites", "sites.yaml", "--out", str(site.out))
        return marked.run("hpc", "submit", campaign, *words, "--time", "01:00", folder=tmp_path)

    done = submit(9)
    assert (done.returncode, done.stdout) == (2, "")
    (line,) = done.stderr.splitlines()
    assert "recordings (view: record): workers of other sites share no disk" in line
    assert "name a store in the sites file (store: s3://BUCKET/PREFIX)" in line
    assert not site.out.exists()
    with s3_server(tmp_path / "s3.log") as port, reached_by(port):
        done = submit(port, store="s3://results/sites")
        assert done.returncode == 0, done.stderr
        (url,) = re.findall(r"results also in (s3://results/sites/\S+): ", done.stdout)
        wait_for(lambda: (site.out / OUTCOMES_NAME).exists(), "the outcomes")
        wait_for(lambda: not kube.live(), "the end of the pods")
        wait_for(lambda: not (site.out / "conductor.json").exists(), "the end of the conductor")
        asked = ("conductor", "report", url, "--out", "read", "--recordings", "all")
        read = marked.run(*asked, folder=tmp_path)
        assert read.returncode == 1, read.stderr
    assert_recordings_are_here(tmp_path / "read", kube)
    # Credentials of pods are in their Secret and nowhere else.
    others = [found for _, plural, found in kube.store.history if plural != "secrets"]
    assert "not-to-be-told" not in f"{others} {kube.logs().decode()}"
