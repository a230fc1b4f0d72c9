"""A :class:`JobRequest` as a Slurm job script. Pure text, to be read before it is submitted.

One allocation holds everything. The batch script starts the conductor as its own child, which
takes no task and no GPU, then one worker per task with a single ``srun``. Slurm's signal before the
end of the time reaches only the batch script, which forwards it to the conductor; that exits with
75 (unfinished), and the job queues itself again. The exit code of the job is that of
``conductor run`` otherwise.

Where the conductor listens:

1. on ``address`` if the request names one;
2. on 127.0.0.1 if the job has one node for certain (``nodes=1``, or a single worker);
3. else on the address by which Slurm itself reaches the first node (``NodeAddr`` of
   ``SLURMD_NODENAME``). A name is looked up; if it means the loopback, as a host's own name does
   on Debian, the first address of ``hostname -I`` is taken.

What a user may have chosen freely (paths, campaign) appears only in shell-quoted assignments;
everything else is a number or was checked by the request.
"""

from __future__ import annotations

import re
import shlex

from hpc.request import JobRequest, hours_minutes

JOB_NAME_CHARS_MAX = 64
"""Longest job name [characters]."""


def render(request: JobRequest) -> str:
    """The whole job script, ending with a line break."""
    return "\n\n".join(
        (
            _head(request) + "\n" + _asked_for(request),
            _names(request),
            _address(request),
            _CONDUCTOR,
            _workers(request),
            _WAIT,
            _END,
        )
    )


def job_name(campaign: str) -> str:
    """A name for ``squeue``: the campaign's, without folder, suffix and unusual characters."""
    stem = campaign.rpartition("/")[2]
    stem = stem.removesuffix(".yaml").removesuffix(".yml")
    return re.sub(r"[^A-Za-z0-9._-]+", "-", stem).strip("-.")[:JOB_NAME_CHARS_MAX] or "campaign"


def _head(request: JobRequest) -> str:
    kind = "GPU" if request.gpus else "CPU"
    plural = "s" if request.tasks > 1 else ""
    return f"""\
#!/bin/bash
# A Slurm job script, written by `hpc render`: {job_name(request.campaign)} with \
{request.tasks} {kind} worker{plural}.
# Submit it with `sbatch FILE`, watch it with `squeue --me`; its log is slurm-JOBID.out.
# Submitted again after it has ended for whatever reason, it goes on where it stopped.
"""


def _asked_for(request: JobRequest) -> str:
    lines = [
        "# --- What the job asks for; options given to sbatch itself win over these lines.",
        f"#SBATCH --job-name={job_name(request.campaign)}",
        f"#SBATCH --time={hours_minutes(request.walltime_min)}:00",
    ]
    if request.partition:
        lines.append(f"#SBATCH --partition={request.partition}")
    if request.account:
        lines.append(f"#SBATCH --account={request.account}")
    if request.nodes is not None:
        lines.append(f"#SBATCH --nodes={request.nodes}")
    lines += ["# One task is one worker.", f"#SBATCH --ntasks={request.tasks}"]
    lines.append(f"#SBATCH --cpus-per-task={request.cpus}")
    if request.gpus:
        lines.append("#SBATCH --gpus-per-task=1")
    lines += [
        "# This script, and nothing else, gets SIGTERM so many seconds before the time is over,",
        "# or up to a minute earlier.",
        f"#SBATCH --signal=B:TERM@{request.signal_lead_s}",
        "# The job may be queued again; a node that fails does not end it.",
        "#SBATCH --requeue",
        "#SBATCH --no-kill",
        "# A later start adds to the log of the first.",
        "#SBATCH --open-mode=append",
    ]
    return "\n".join(lines)


def _names(request: JobRequest) -> str:
    quote = shlex.quote
    return f"""\
# --- Names. All nodes must see these paths.
campaign={quote(request.campaign)}
out={quote(request.out)}
bin={quote(request.bin_folder)}
restarts_max={request.restarts_max}
cd {quote(request.folder)} || exit 2"""


def _address(request: JobRequest) -> str:
    if request.address:
        return f"""\
# --- Where the conductor listens: as given to `hpc render --address`.
address={shlex.quote(request.address)}"""
    if request.one_node:
        return """\
# --- Where the conductor listens: everything is on one node, so nobody else can connect.
address=127.0.0.1"""
    return """\
# --- Where the conductor listens: at the address by which Slurm reaches this node, so that the
# --- workers on other nodes reach it too. `hpc render --address` chooses another.
address=$(scontrol show node "$SLURMD_NODENAME" | sed -n 's/.*NodeAddr=\\([^ ]*\\).*/\\1/p')
if [[ ! $address =~ ^[0-9]+(\\.[0-9]+){3}$ ]]; then
  # A name: look it up, but not as 127.*, which would be another machine on another node.
  address=$(getent ahostsv4 "$address" | awk '$1 !~ /^127[.]/ { print $1; exit }')
  [ -n "$address" ] || address=$(hostname -I | cut -d ' ' -f 1)
fi"""


_CONDUCTOR = """\
# --- The conductor hands out cases and keeps the results. It runs beside the workers, here.
before=$(cat "$out/conductor.json" 2>/dev/null)
"$bin/conductor" run "$campaign" --workers 0 --listen "tcp/$address:0" --out "$out" &
conductor=$!
# bash runs a trap only between commands or during `wait`, so everything long is in the background.
signalled=no stopping=no lost=no
trap 'signalled=yes stopping=yes; kill -TERM "$conductor" 2>/dev/null' TERM
trap 'signalled=yes lost=yes; kill -TERM "$conductor" 2>/dev/null' USR1
# Once it listens, it says where in conductor.json. An older file may be there after a crash.
until [ -s "$out/conductor.json" ] && [ "$(cat "$out/conductor.json")" != "$before" ]; do
  kill -0 "$conductor" 2>/dev/null || break
  sleep 0.2
done"""


def _workers(request: JobRequest) -> str:
    gpu = " --gpus-per-task=1" if request.gpus else ""
    device = "cuda:0" if request.gpus else "cpu"
    note = "# --- The workers, one per task."
    if request.gpus:
        note += " Each sees one GPU only (CUDA_VISIBLE_DEVICES), so that is cuda:0."
    return f"""\
{note}
# --- One that dies does not take the others with it; its cases go to them.
{{
  kill -0 "$conductor" 2>/dev/null || exit
  srun --ntasks={request.tasks} --cpus-per-task={request.cpus}{gpu} \\
    --no-kill --wait=0 --kill-on-bad-exit=0 --label \\
    "$bin/twin" worker --state "$out" --wait 120 --until-done \\
    --slots {request.slots} --device {device}
  # They leave when no case is left. If the conductor still serves after that, they were lost.
  for _ in {{1..150}}; do
    kill -0 "$conductor" 2>/dev/null && [ -e "$out/conductor.json" ] || exit
    sleep 0.2
  done
  kill -USR1 $$
}} &
workers=$!"""


_WAIT = """\
# --- Wait for the conductor. A signal interrupts `wait`; then wait again for its real exit code.
while :; do
  signalled=no
  wait "$conductor"
  verdict=$?
  [ "$signalled" = yes ] && [ "$verdict" -gt 128 ] || break
done
# The workers leave by themselves. Those that do not can go: all that counts is in the journal.
for try in {1..40}; do
  kill -0 "$workers" 2>/dev/null || break
  case $try in
    3 | 10) scancel --signal=TERM "$SLURM_JOB_ID.0" 2>/dev/null ;;
    20 | 30) scancel --signal=KILL "$SLURM_JOB_ID.0" 2>/dev/null ;;
  esac
  sleep 0.5
done"""


_END = """\
# --- The verdict: 0 all passed, 1 a verdict is not a pass, 2 bad input, 3 infrastructure lost,
# --- 75 unfinished: queue again, unless somebody cancelled the job or it has had its restarts.
if [ "$lost" = yes ]; then
  echo "all workers are gone, see above; submit this script again to go on" >&2
  exit 3
fi
if [ "$verdict" -gt 125 ]; then
  # It was killed: by us before it could listen to signals, or by somebody else.
  [ "$stopping" = yes ] && verdict=75 || verdict=3
fi
if [ "$verdict" = 75 ] && [ "$(squeue --noheader --jobs="$SLURM_JOB_ID" --format=%T)" = RUNNING ]
then
  if [ "${SLURM_RESTART_COUNT:-0}" -lt "$restarts_max" ]; then
    echo "unfinished, queued again" >&2
    exec scontrol requeue "$SLURM_JOB_ID"
  fi
  echo "unfinished after $restarts_max restarts; submit this script again to go on" >&2
fi
exit "$verdict"
"""
