"""The job-array way of running a campaign, as the paper did it: one index, one case, fixed time.

For comparison only: every index pays for its own start, what has not ended with its wall time is
lost, and nobody puts the results together. ``tests/array_bench.py`` measures it beside leasing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from hpc import script
from hpc.request import JobRequest
from hpc.slurm.job_script import asked_for
from twin.base.errors import UsageError

INDICES_MAX = 10_000
"""Longest array; sites allow fewer (``MaxArraySize``, often 1001)."""


def one_task(request: JobRequest) -> JobRequest:
    """The request of one index."""
    return replace(request, nodes=None, gpus=min(request.gpus, 1), workers=min(request.workers, 1))


def render(request: JobRequest, cases: Sequence[str]) -> str:
    """A Slurm job array over ``cases``; ``request.worker_count`` of them run at once.

    Raises:
        UsageError: too many cases, or stacks on other nodes.
    """
    if len(cases) > INDICES_MAX:
        raise UsageError(f"--array: {len(cases)} cases, at most {INDICES_MAX} indices are allowed")
    if request.remote_stacks:
        raise UsageError("--array: each index is one task; autonomy.placement node needs two")
    device = "cuda:0" if request.gpus else "cpu"
    listed = "\n".join(cases)
    return f"""\
#!/bin/bash
# A Slurm job array, written by `hpc render --array`: one index runs one case of
# {script.job_name(request.campaign)}. What has not ended when its time is over is lost.

{asked_for(one_task(request))}
#SBATCH --array=1-{len(cases)}%{request.worker_count}

{script.names(request)}
{script.on_each_node(one_task(request), "  echo 127.0.0.1", device)}
setup

# --- The case of this index; its exit code is the verdict.
case=$(sed -n "${{SLURM_ARRAY_TASK_ID}}p" <<'CASES'
{listed}
CASES
)
{script.inside(request)}"$bin/conductor" run "$campaign" --case "$case" \\
  --workers 1 --device {device} --out "$out/$case"
"""
