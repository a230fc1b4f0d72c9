"""A :class:`JobRequest` as a PBS Pro (OpenPBS) job script. Pure text, the same shape as for Slurm.

What PBS does not have is in the script:

- **A signal before the end of the time.** A timer in the script sends itself SIGUSR2; ``qsig -s
  SIGUSR2`` does the same by hand. SIGTERM always means ``qdel``: that job does not come back.
- **Queueing itself again.** ``qrerun`` needs operator privilege (qrerun(1B)), so the script submits
  itself once more, to start after this job has ended (``depend=afterany``), from the node or, where
  nodes may not submit, from the host it was submitted on. The next job has another id.
- **One task per GPU.** Each chunk of ``select`` is one worker. ``$PBS_NODEFILE`` has one line per
  worker; those of other nodes are started by ``pbs_tmrsh``, or by ssh where there is none, and each
  takes its own of the node's ``CUDA_VISIBLE_DEVICES``, or its own number if the site sets none
  (then ask for whole nodes: ``directives: ["-l place=scatter:exclhost"]``).

Checked against the manual pages of OpenPBS and by :mod:`hpc.pbs.lint`; never run on a real PBS.
"""

from __future__ import annotations

from hpc import script
from hpc.request import JobRequest, hours_minutes


def render(request: JobRequest) -> str:
    """The whole job script, ending with a line break."""
    device = "cuda:0" if request.gpus else "cpu"
    if request.join:
        return "\n\n".join(
            (
                _head(request) + "\n" + _asked_for(request) + "\n" + _NOT_AGAIN,
                script.names(request, _ends(request)),
                script.on_each_node(request, _NODE_ADDRESS, device),
                _workers(request),
                script.WAIT_FOR_WORKERS,
            )
        )
    return "\n\n".join(
        (
            _head(request) + "\n" + _asked_for(request) + "\n" + _BEHAVIOUR,
            script.names(request, _ends(request)),
            _SELF,
            script.on_each_node(request, _NODE_ADDRESS, device),
            script.conductor(request).replace("{TRAPS}", _TRAPS),
            _workers(request),
            _timer(request),
            script.WAIT,
            _NO_TIMER + script.VERDICT + "\n" + _END,
        )
    )


def _head(request: JobRequest) -> str:
    return f"""\
#!/bin/bash
# A PBS job script, written by `hpc`: {script.who(request)}.
# Submit it with `qsub FILE`, watch it with `qstat -u $USER`; its log is NAME.oNUMBER.
{script.AFTER_JOIN if request.join else script.AFTER}
"""


def options(request: JobRequest) -> list[str]:
    """The resources as options of ``qsub``, one string each, as they stand after ``#PBS``."""
    lines = [
        f"-N {script.title(request)}",
        f"-l walltime={hours_minutes(request.walltime_min)}:00",
        f"-l select={_select(request)}",
    ]
    if not any(line.startswith("-l place=") for line in request.directives):
        lines.append(f"-l place={'scatter' if request.nodes else 'free'}")
    if request.partition:
        lines.append(f"-q {request.partition}")
    if request.account:
        lines.append(f"-A {request.account}")
    return [*lines, *request.directives]


def _select(request: JobRequest) -> str:
    """Chunks: one per worker, or one per node with that node's share of the workers."""
    if request.nodes is None:
        return _chunk(request, request.tasks, 1)
    least, more = divmod(request.tasks, request.nodes)
    chunks = [(request.nodes - more, least), (more, least + 1)]
    return "+".join(_chunk(request, count, tasks) for count, tasks in chunks if count)


def _chunk(request: JobRequest, count: int, tasks: int) -> str:
    parts = [f"{count}:ncpus={request.cpus * tasks}"]
    if request.gpus:
        parts.append(f"ngpus={tasks}")
    parts.append(f"mpiprocs={tasks}")
    if request.constraint:
        parts.append(request.constraint)
    return ":".join(parts)


def _asked_for(request: JobRequest) -> str:
    lines = [f"#PBS {option}" for option in options(request)]
    lines.insert(2, "# One MPI process is one worker; nothing here uses MPI.")
    first = "# --- What the job asks for; options given to qsub itself are not repeated when it"
    return "\n".join([first, "# --- submits itself again, so change these lines instead.", *lines])


_BEHAVIOUR = """\
# A node that fails does not end the job for good; one log for both streams.
#PBS -r y
#PBS -j oe"""

_NOT_AGAIN = """\
# Whoever submitted it submits another one; one log for both streams.
#PBS -r n
#PBS -j oe"""

_SELF = """\
# --- This text is what is submitted again later; PBS runs a copy that only this node sees.
mkdir -p "$out" || exit 2
cmp -s "$0" "$out/job.sh" || cp "$0" "$out/job.sh"
restarts=${DRIVETWIN_RESTARTS:-0}
# The signal before the end is for this script alone; its children inherit that they ignore it.
trap '' USR2"""

_NODE_ADDRESS = """\
  # Of its own name, but not as 127.*, which would be another machine on another node.
  local found
  found=$(getent ahostsv4 "$(hostname)" | awk '$1 !~ /^127[.]/ { print $1; exit }')
  [ -n "$found" ] || found=$(hostname -I | cut -d ' ' -f 1)
  echo "$found\""""

_TRAPS = """\
# bash runs a trap only between commands or during `wait`, so everything long is in the background.
signalled=no stopping=no lost=no deleted=no
trap 'signalled=yes stopping=yes deleted=yes; kill -TERM "$conductor" 2>/dev/null' TERM
trap 'signalled=yes lost=yes; kill -TERM "$conductor" 2>/dev/null' USR1"""


def _workers(request: JobRequest) -> str:
    count = request.worker_count
    role = "worker"
    if request.remote_stacks:
        role = f"$([ $task -lt {count} ] && echo worker || echo stack)"
    stacks = pick = ""
    if request.remote_stacks:
        stacks = f"""
  kill -TERM "${{started[@]:{count}}}" 2>/dev/null # they would wait for further simulators"""
    if request.gpus:
        pick = """
one_gpu() { # RANK: of the GPUs that PBS gives this job on the node, or simply by number
  local gpus
  IFS=, read -ra gpus <<< "${CUDA_VISIBLE_DEVICES:-}"
  export CUDA_VISIBLE_DEVICES=${gpus[$1]:-$1}
}
on_node="$on_node; $(declare -f one_gpu)\""""
    pin = "one_gpu $rank; " if request.gpus else ""
    traps, begin, waiting, early = "", _WITH_CONDUCTOR, _until_all_ended(count, stacks), ""
    if request.join:
        traps, begin, waiting, early = _JOIN_TRAPS, "", _WORST_CODE, script.EARLY_SIGNAL
    note = "# --- The workers, one per line of the node file."
    if request.gpus:
        note += " Each sees one GPU only, so that is cuda:0."
    return f"""\
{note}
# --- One that dies does not take the others with it; its cases go to them.{pick}
launch() {{ # HOST TEXT: run TEXT there instead of this shell
  case $1 in
    "$(hostname)" | "$(hostname -s)") exec bash -c "$2" ;;
  esac
  ! command -v pbs_tmrsh >/dev/null || exec pbs_tmrsh "$1" /bin/bash -c "$2"
  exec ssh -o BatchMode=yes "$1" /bin/bash -s <<< "$2"
}}
mapfile -t hosts < "${{PBS_NODEFILE:-/dev/null}}"
[ ${{#hosts[@]}} -gt 0 ] || hosts=("$(hostname)") # not told: everything runs here
end_workers() {{ kill -s "$1" "$workers" 2>/dev/null; }}
{traps}{{
{begin}  declare -A used
  started=() told=no
  trap 'told=yes; kill -TERM "${{started[@]}}" 2>/dev/null' TERM
  for ((task = 0; task < {request.tasks}; task++)); do
    host=${{hosts[task % ${{#hosts[@]}}]}}
    rank=${{used[$host]:-0}}
    used[$host]=$((rank + 1))
    (launch "$host" "trap '' USR2; $on_node; {pin}{role}") > >(sed -u "s/^/$task: /") 2>&1 &
    started+=($!)
  done
  [ $told = no ] || kill -TERM "${{started[@]}}" 2>/dev/null # some began after the signal
{waiting}
}} &
workers=$!{early}"""


_WITH_CONDUCTOR = """\
  kill -0 "$conductor" 2>/dev/null || exit
"""

_JOIN_TRAPS = """\
signalled=no
trap 'signalled=yes; end_workers TERM' TERM
"""

_WORST_CODE = """\
  worst=0
  for pid in "${started[@]}"; do
    while :; do
      told=no
      wait "$pid"
      code=$?
      [ $told = yes ] && [ $code -gt 128 ] || break
    done
    [ $code -le $worst ] || worst=$code
  done
  exit $worst"""


def _until_all_ended(count: int, stacks: str) -> str:
    """Lines that wait for workers of a conductor that is in this job."""
    return f"""\
  while :; do
    ended=yes
    for ((task = 0; task < {count}; task++)); do
      kill -0 "${{started[task]}}" 2>/dev/null && ended=no && wait "${{started[task]}}"
    done
    [ $ended = no ] || break
  done{stacks}
{script.LOST}"""


def _seconds(request: JobRequest) -> int:
    """Time from the start of the script until it is told to stop [s]."""
    return 60 * request.walltime_min - request.signal_lead_s


def _ends(request: JobRequest) -> str:
    return f"export TWIN_WALLTIME_S={_seconds(request)}"


def _timer(request: JobRequest) -> str:
    return f"""\
# --- PBS sends no signal before the end of the time. This does, {request.signal_lead_s} s before.
trap 'signalled=yes stopping=yes; kill -TERM "$conductor" 2>/dev/null' USR2
{{
  sleep $(({_seconds(request)} - SECONDS)) &
  trap 'kill $!; exit' TERM
  wait $!
  kill -USR2 $$
}} &
timer=$!"""


_NO_TIMER = """\
kill "$timer" 2>/dev/null

"""

_END = """\
if [ "$verdict" = 75 ] && [ "$deleted" = no ]; then
  if [ "$restarts" -lt "$restarts_max" ]; then
    printf -v again 'cd %q && qsub -W depend=afterany:%q -v DRIVETWIN_RESTARTS=%q job.sh' \\
      "$out" "$PBS_JOBID" $((restarts + 1))
    # Nodes of some sites may not submit; then ask the host that this job came from.
    if next=$(eval "$again") || next=$(ssh -o BatchMode=yes "$PBS_O_HOST" "$again"); then
      echo "pbs $next" > "$out/job.id"
      echo "unfinished, queued again as $next" >&2
      exit 75
    fi
    echo "unfinished, and neither this node nor $PBS_O_HOST may submit jobs" >&2
  else
    echo "unfinished after $restarts_max restarts" >&2
  fi
  echo "submit this script again to go on" >&2
fi
exit "$verdict"
"""
