"""A :class:`JobRequest` as a Slurm job script. Pure text, to be read before it is submitted.

One allocation holds everything. The batch script starts the conductor as its own child, which
takes no task and no GPU, then one worker per task with a single ``srun``. Slurm's signal before the
end of the time reaches only the batch script, which forwards it to the conductor; that exits with
75 (unfinished), and the job queues itself again. The exit code of the job is that of
``conductor serve`` otherwise.

Where the conductor listens:

1. on ``address`` if the request names one;
2. on 127.0.0.1 if the job has one node for certain (``nodes=1``, or a single worker);
3. on the address of the first node at ``interface`` if the request names one;
4. else on the address by which Slurm itself reaches the first node (``NodeAddr`` of
   ``SLURMD_NODENAME``). A name is looked up; if it means the loopback, as a host's own name does
   on Debian, the first address of ``hostname -I`` is taken.
"""

from __future__ import annotations

from hpc import script
from hpc.request import JobRequest, hours_minutes


def render(request: JobRequest) -> str:
    """The whole job script, ending with a line break."""
    device = "cuda:0" if request.gpus else "cpu"
    if request.join:
        signal = _SIGNAL.format(request=request).replace(_AGAIN, _NOT_AGAIN)
        return "\n\n".join(
            (
                _head(request) + "\n" + asked_for(request) + "\n" + signal,
                script.names(request, _ENDS.format(request=request)),
                script.on_each_node(request, _NODE_ADDRESS, device),
                _joining(request),
                script.WAIT_FOR_WORKERS,
            )
        )
    return "\n\n".join(
        (
            _head(request) + "\n" + asked_for(request) + "\n" + _SIGNAL.format(request=request),
            script.names(request, _ENDS.format(request=request)),
            script.on_each_node(request, _NODE_ADDRESS, device),
            script.conductor(request).replace("{TRAPS}", _TRAPS),
            _workers(request),
            script.WAIT + (_END_STACKS if request.remote_stacks else ""),
            script.VERDICT + "\n" + _END,
        )
    )


def _head(request: JobRequest) -> str:
    return f"""\
#!/bin/bash
# A Slurm job script, written by `hpc`: {script.who(request)}.
# Submit it with `sbatch FILE`, watch it with `squeue --me`; its log is slurm-JOBID.out.
{script.AFTER_JOIN if request.join else script.AFTER}
"""


def options(request: JobRequest) -> list[str]:
    """The resources as options of ``sbatch`` and ``salloc``."""
    lines = [
        f"--job-name={script.title(request)}",
        f"--time={hours_minutes(request.walltime_min)}:00",
    ]
    if request.partition:
        lines.append(f"--partition={request.partition}")
    if request.account:
        lines.append(f"--account={request.account}")
    if request.constraint:
        lines.append(f"--constraint={request.constraint}")
    if request.nodes is not None:
        lines.append(f"--nodes={request.nodes}")
    lines += [f"--ntasks={request.tasks}", f"--cpus-per-task={request.cpus}"]
    if request.gpus:
        lines.append("--gpus-per-task=1")
    return [*lines, *request.directives]


def asked_for(request: JobRequest) -> str:
    """The resources as lines of a job script."""
    lines = [f"#SBATCH {option}" for option in options(request)]
    where = next(i for i, line in enumerate(lines) if "--ntasks=" in line)
    note = "# One task is one worker."
    if request.remote_stacks:
        note = "# One task is one worker, or the host of one worker's stack."
    lines.insert(where, note)
    first = "# --- What the job asks for; options given to sbatch itself win over these lines."
    return "\n".join([first, *lines])


_AGAIN = """\
# The job may be queued again; a node that fails does not end it.
#SBATCH --requeue"""
_NOT_AGAIN = """\
# Whoever submitted it submits another one; a node that fails does not end it.
#SBATCH --no-requeue"""

_SIGNAL = """\
# This script, and nothing else, gets SIGTERM so many seconds before the time is over,
# or up to a minute earlier.
#SBATCH --signal=B:TERM@{request.signal_lead_s}
# The job may be queued again; a node that fails does not end it.
#SBATCH --requeue
#SBATCH --no-kill
# A later start adds to the log of the first.
#SBATCH --open-mode=append"""

_ENDS = """\
ends=$(squeue --noheader --jobs="$SLURM_JOB_ID" --format=%e)
if [[ $ends == 20* ]]; then
  export TWIN_WALLTIME_S=$(($(date --date="$ends" +%s) - $(date +%s) - {request.signal_lead_s}))
fi"""

_NODE_ADDRESS = """\
  # The one by which Slurm reaches it; `hpc --interface` and `--address` choose another.
  local found
  found=$(scontrol show node "$SLURMD_NODENAME" | sed -n 's/.*NodeAddr=\\([^ ]*\\).*/\\1/p')
  if [[ ! $found =~ ^[0-9]+(\\.[0-9]+){3}$ ]]; then
    # A name: look it up, but not as 127.*, which would be another machine on another node.
    found=$(getent ahostsv4 "$found" | awk '$1 !~ /^127[.]/ { print $1; exit }')
    [ -n "$found" ] || found=$(hostname -I | cut -d ' ' -f 1)
  fi
  echo "$found\""""

_TRAPS = """\
# bash runs a trap only between commands or during `wait`, so everything long is in the background.
signalled=no stopping=no lost=no
trap 'signalled=yes stopping=yes; kill -TERM "$conductor" 2>/dev/null' TERM
trap 'signalled=yes lost=yes; kill -TERM "$conductor" 2>/dev/null' USR1"""


_KEEP = "--no-kill --wait=0 --kill-on-bad-exit=0 --label"


def _per_task(request: JobRequest) -> str:
    gpu = " --gpus-per-task=1" if request.gpus else ""
    return f"--ntasks={request.worker_count} --cpus-per-task={request.cpus}{gpu}"


def _joining(request: JobRequest) -> str:
    """Workers without a conductor beside them."""
    return f"""\
# --- The workers, one per task. One that dies does not take the others with it.
end_workers() {{ scancel --signal="$1" "$SLURM_JOB_ID.0" 2>/dev/null; }}
signalled=no
trap 'signalled=yes; end_workers TERM' TERM
srun {_per_task(request)} \\
  {_KEEP} \\
  bash -c "$on_node; worker" &
workers=$!{script.EARLY_SIGNAL}"""


def _workers(request: JobRequest) -> str:
    per_task, keep = _per_task(request), _KEEP
    note = "# --- The workers, one per task."
    if request.gpus:
        note += " Each sees one GPU only (CUDA_VISIBLE_DEVICES), so that is cuda:0."
    end = 'scancel --signal="$1" "$SLURM_JOB_ID.0" 2>/dev/null'
    exact = stacks = ""
    if request.remote_stacks:
        end = 'for step in 0 1; do scancel --signal="$1" "$SLURM_JOB_ID.$step"; done 2>/dev/null'
        exact = " --exact"
        stacks = f"""
# --- The hosts of the stacks, on the tasks that the workers leave free.
srun --exact {per_task} \\
  {keep} \\
  bash -c "$on_node; stack" &
stacks=$!"""
    return f"""\
{note}
# --- One that dies does not take the others with it; its cases go to them.
end_workers() {{ {end}; }}
{{
  kill -0 "$conductor" 2>/dev/null || exit
  srun{exact} {per_task} \\
    {keep} \\
    bash -c "$on_node; worker"
{script.LOST}
}} &
workers=$!{stacks}"""


_END_STACKS = """
# The hosts of the stacks would wait for further simulators.
end_workers TERM
wait "$stacks\""""

_END = """\
if [ "$verdict" = 75 ] && [ "$(squeue --noheader --jobs="$SLURM_JOB_ID" --format=%T)" = RUNNING ]
then
  if [ "${SLURM_RESTART_COUNT:-0}" -lt "$restarts_max" ]; then
    echo "unfinished, queued again" >&2
    scontrol requeue "$SLURM_JOB_ID" && exit 75
    echo "not queued again; submit this script again to go on" >&2
    exit 75
  fi
  echo "unfinished after $restarts_max restarts; submit this script again to go on" >&2
fi
exit "$verdict"
"""
