"""A search in one allocation of Slurm proposes what it proposes on one worker at home."""

from __future__ import annotations

from pathlib import Path

import pytest
import slurm_cluster
import yaml
from processes import PATIENCE_S, Marked
from slurm_job import Job

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(bool(slurm_cluster.missing()), reason=slurm_cluster.missing()),
]
CAMPAIGN = {
    "campaign": "searched",
    "seed": 4,
    "scenario": {
        "type": "jump_scare",
        "ego_start_m": 30,
        "ego_speed_mps": 8.0,
        "duration_s": 4,
        "standstill_s": 0.5,
    },
    "matrix": {"weather": ["clear"]},
    "autonomy": {"perception": {"eyes": {"type": "ground_truth"}}},
    "camera": {"width": 64, "height": 64},
    "search": {
        "parameters": {
            "autonomy.latency_ms": {
                "distribution": "uniform",
                "low": 0,
                "high": 400,
                "whole": True,
            },
            "scenario.ego_speed_mps": {"distribution": "uniform", "low": 6.0, "high": 12.0},
        },
        "objective": {"kpi": "dtc_min_m", "goal": "least"},
        "sampler": "cma_es",
        "chains": 2,
        "budget": {"cases": 24, "generation": 4},
    },
}
"""Cases of small pictures; every generation but the first follows from results."""


def test_two_workers_of_an_allocation_leave_the_trace_of_one(
    marked: Marked, cluster: slurm_cluster.SlurmCluster, tmp_path: Path
) -> None:
    file = tmp_path / "searched.yaml"
    file.write_text(yaml.safe_dump(CAMPAIGN, sort_keys=False))
    here = tmp_path / "here"
    asked = ("conductor", "run", str(file), "--out", str(here), "--workers", "1", "--slots", "1")
    local = marked.start(*asked)
    _, said = local.communicate(timeout=PATIENCE_S)
    assert local.returncode in (0, 1), said
    job = Job(marked, cluster, tmp_path, str(file), "--workers", "2", "--nodes", "2")
    assert job.end()["ExitCode"] == f"{local.returncode}:0", job.text
    prints = [marked.run("conductor", "fingerprint", str(out)).stdout for out in (here, job.out)]
    assert prints[0] == prints[1] != ""
    for name in ("search.json", "campaign.yaml"):
        assert (here / name).read_bytes() == (job.out / name).read_bytes(), name
