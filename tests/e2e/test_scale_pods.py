"""1, then 32, then 4 workers on a double of Kubernetes, asked for by ``hpc scale``."""

from __future__ import annotations

import kube_cluster
import pytest
import scale_pods
from kube_cluster import KubeCluster
from processes import MARK


@pytest.mark.slow
def test_as_many_pods_as_were_asked_for(marked, tmp_path, monkeypatch, capsys):
    if kube_cluster.missing():
        pytest.skip(kube_cluster.missing())
    monkeypatch.setenv("DRIVETWIN_HOME", str(tmp_path / "home"))
    with KubeCluster(variables={MARK: marked.mark}) as kube:
        assert scale_pods.steps(marked, kube, tmp_path) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["1 workers", "32 workers", "4 workers"]
