"""What job scripts of all schedulers share: names, one node's set-up, conductor, waiting, verdict.

Pure text. What a user may have chosen freely (paths, campaign) appears only in shell-quoted
assignments; everything else is a number or was checked by the request.
"""

from __future__ import annotations

import re
import shlex

from hpc.request import JobRequest
from hpc.software.container import shell_lines
from schemas.words import counted

JOB_NAME_CHARS_MAX = 64
"""Longest job name [characters]."""
JOIN_WAIT_S = 120
"""How long a worker waits for a conductor elsewhere that does not answer [s]."""
ALLOCATION_TAG = "allocation:"
"""Beginning of the tag by which the conductor's list of workers says of which job one is."""


AFTER = "# Submitted again after it has ended for whatever reason, it goes on where it stopped."
AFTER_JOIN = "# Results are with the conductor; submitted again it is as many workers again."
"""Last line of the head of a script: what comes of it when it is submitted again."""


def title(request: JobRequest) -> str:
    """The job's name in the queue: the campaign's, or the allocation's of a run over several."""
    return request.allocation or job_name(request.campaign)


def job_name(campaign: str) -> str:
    """A name for the queue: the campaign's, without folder, suffix and unusual characters."""
    stem = campaign.rpartition("/")[2]
    stem = stem.removesuffix(".yaml").removesuffix(".yml")
    return re.sub(r"[^A-Za-z0-9._-]+", "-", stem).strip("-.")[:JOB_NAME_CHARS_MAX] or "campaign"


def who(request: JobRequest) -> str:
    """``aeb-demo with 2 CPU workers``."""
    kind = "GPU" if request.gpus else "CPU"
    workers = counted(request.worker_count, f"{kind} worker")
    if request.join:
        return f"{workers} that join a conductor elsewhere, for {job_name(request.campaign)}"
    return f"{job_name(request.campaign)} with {workers}"


def names(request: JobRequest, ends: str = "") -> str:
    """Assignments; the only place with text that a user chose freely.

    ``ends``: lines that export ``TWIN_WALLTIME_S``, the time until the job is told to stop.
    """
    quote = shlex.quote
    kernels = "${WARP_CACHE_PATH:-${XDG_CACHE_HOME:-$HOME/.cache}/drivetwin-kernels}"
    if request.inside is not None:
        kernels = '"$out/kernels"'  # the home folder stays outside
    text = f"""\
# --- Names. All nodes must see these paths.
campaign={quote(request.campaign)}
out={quote(request.out)}
bin={quote(request.bin_folder)}
kernels={kernels}
restarts_max={request.restarts_max}
folder={quote(request.folder)}
cd "$folder" || exit 2"""
    if request.history:
        text += f"""
history={quote(request.history)} # an earlier run, whose longest cases begin first"""
    if request.join:
        text += f"""
# The key says where the conductor is, and lets workers commit results there, nothing else.
key={quote(request.join)}"""
    if request.home:
        text += f"""
# Keys of the conductor lie here, for you alone, and not among the results.
export DRIVETWIN_HOME={quote(request.home)}
(umask 077 && mkdir -p "$DRIVETWIN_HOME") || exit 2"""
    if ends:
        text += f"\n# Workers take only cases that end before the job is told to stop.\n{ends}"
    if request.inside is not None:
        text += """

# --- The container: "${inside[@]}" COMMAND runs a command in it.
"""
        text += "\n".join(shell_lines(request.inside))
    return text


def inside(request: JobRequest) -> str:
    """Words before a command of ours."""
    return "" if request.inside is None else '"${inside[@]}" '


def on_each_node(request: JobRequest, scheduler_address: str, device: str) -> str:
    """The functions that run on a node: its set-up, its address, a worker, a stack's host."""
    listen = functions = stack = ""
    if request.remote_stacks:
        listen = ' \\\n    --drive-listen "tcp/$(here):0" --join-dir "$out/rigs"'
        functions = " here stack"
        commands = " --commands" if request.remote_commands else ""
        stack = f"""
stack() {{ # serves simulators of other nodes (autonomy.placement: node)
  setup
  exec {inside(request)}"$bin/devkit" host --join "$out/rigs"{commands}
}}"""
    array = "" if request.inside is None else " inside"
    array += " DRIVETWIN_HOME" if request.home else ""
    array += " key" if request.join else ""
    slots = "" if request.slots is None else f"--slots {request.slots} "
    here = where = ""
    if request.join:
        marks = f"--site {request.site} " if request.site else ""
        marks += f"--tag {ALLOCATION_TAG}{request.allocation} " if request.allocation else ""
        where = f'--key "$key" {marks}\\\n    --wait {JOIN_WAIT_S} --started-again'
    else:
        where = '--state "$out" --wait 120'
        here = f"""
here() {{ # the address of this node that the others reach
{_here(request, scheduler_address)}
}}"""
    return f"""\
# --- What runs on a node, and what it needs there.
setup() {{
{_setup(request)}
}}{here}
worker() {{
  setup
  exec {inside(request)}"$bin/twin" worker {where} --until-done \\
    {slots}--device {device}{listen}
}}{stack}
# This text carries names and functions to another node; it needs no file there.
on_node="$(declare -p folder bin out kernels{array} ${{!TWIN_WALLTIME_S*}})
$(declare -f setup worker{functions})\""""


def _setup(request: JobRequest) -> str:
    # Other ways than srun to another node begin in the home folder.
    lines = ['cd "$folder" || exit 2']
    if request.modules:
        loaded = " ".join(request.modules)
        lines += [
            "command -v module >/dev/null || . /etc/profile",
            f"module load {loaded} || exit 2",
        ]
    if request.scratch:
        lines += [
            f'export TMPDIR="{request.scratch}/drivetwin-$UID"',
            'mkdir -p "$TMPDIR" || exit 2',
        ]
    lines += [
        "# Compiled kernels are kept per kind of processor: not every node runs those of another.",
        "local features",
        "features=$(grep -E -m 1 '^(flags|Features)' /proc/cpuinfo | cksum | cut -d ' ' -f 1)",
        "export WARP_CACHE_PATH=$kernels/$(uname -m)-$features",
    ]
    if request.inside is not None:
        lines.append('mkdir -p "$WARP_CACHE_PATH" || exit 2')
    return "\n".join(f"  {line}" for line in lines)


def _here(request: JobRequest, scheduler_address: str) -> str:
    if request.one_node:
        return "  echo 127.0.0.1 # everything is on one node, nobody else can connect"
    if not request.interface:
        return scheduler_address
    selector = "to" if request.interface[0].isdigit() else "dev"
    return f"""\
  local found # as given to `hpc --interface`
  found=$(PATH=$PATH:/usr/sbin:/sbin ip -4 -oneline address show {selector} {request.interface} \\
    | awk '{{ sub("/.*", "", $4); print $4; exit }}')
  [ -n "$found" ] || echo "$(hostname) has no address at {request.interface}, see 'ip address'" >&2
  echo "$found\""""


def conductor(request: JobRequest) -> str:
    """The conductor as a child in the background, and the wait until it listens."""
    address = shlex.quote(request.address) if request.address else "$(here)"
    history = ' \\\n  --history "$history"' if request.history else ""
    return f"""\
# --- The conductor hands out cases and keeps the results. It runs beside the workers, here.
setup
address={address}
[ -n "$address" ] || exit 2
before=$(cat "$out/conductor.json" 2>/dev/null)
{inside(request)}"$bin/conductor" serve --campaign "$campaign" --until-done \\
  --listen "tls/$address:0" --state "$out"{history} &
conductor=$!
{{TRAPS}}
# Once it listens, it says where in conductor.json. An older file may be there after a crash.
until [ -s "$out/conductor.json" ] && [ "$(cat "$out/conductor.json")" != "$before" ]; do
  kill -0 "$conductor" 2>/dev/null || break
  sleep 0.2
done"""


EARLY_SIGNAL = """
[ "$signalled" = no ] || end_workers TERM # it came before they could be named"""
"""Line after the start of workers whose trap may have run already."""

WAIT_FOR_WORKERS = """\
# --- Wait for the workers. They leave when no case is left (0), or before the time is over (75).
while :; do
  signalled=no
  wait "$workers"
  code=$?
  [ "$signalled" = yes ] && [ "$code" -gt 128 ] || break
done
exit "$code"
"""
"""Lines that end a job of workers alone; the trap of a signal says ``signalled=yes``. What a signal
interrupts is waited for again, also when it has ended by then: bash keeps its exit code."""

WAIT = """\
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
    3 | 10) end_workers TERM ;;
    20 | 30) end_workers KILL ;;
  esac
  sleep 0.5
done"""
"""Lines that wait for the conductor to end; they need ``end_workers SIGNAL``."""

LOST = """\
  # They leave when no case is left. If the conductor still serves after that, they were lost.
  for _ in {1..150}; do
    kill -0 "$conductor" 2>/dev/null && [ -e "$out/conductor.json" ] || exit
    sleep 0.2
  done
  kill -USR1 $$"""
"""Lines at the end of the block that runs the workers."""

VERDICT = """\
# --- The verdict: 0 all passed, 1 a verdict is not a pass, 2 bad input, 3 infrastructure lost,
# --- 75 unfinished: queue again, unless somebody cancelled the job or it has had its restarts.
if [ "$lost" = yes ]; then
  echo "all workers are gone, see above; submit this script again to go on" >&2
  exit 3
fi
if [ "$verdict" -gt 125 ]; then
  # It was killed: by us before it could listen to signals, or by somebody else.
  [ "$stopping" = yes ] && verdict=75 || verdict=3
fi"""
