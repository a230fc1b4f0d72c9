#!/bin/bash
# A Slurm job script, written by `hpc`: night-campaign with 8 GPU workers.
# Submit it with `sbatch FILE`, watch it with `squeue --me`; its log is slurm-JOBID.out.
# Submitted again after it has ended for whatever reason, it goes on where it stopped.

# --- What the job asks for; options given to sbatch itself win over these lines.
#SBATCH --job-name=night-campaign
#SBATCH --time=01:00:00
#SBATCH --partition=gpu
#SBATCH --account=proj@a100
#SBATCH --nodes=2
# One task is one worker.
#SBATCH --ntasks=8
#SBATCH --cpus-per-task=8
#SBATCH --gpus-per-task=1
# This script, and nothing else, gets SIGTERM so many seconds before the time is over,
# or up to a minute earlier.
#SBATCH --signal=B:TERM@120
# The job may be queued again; a node that fails does not end it.
#SBATCH --requeue
#SBATCH --no-kill
# A later start adds to the log of the first.
#SBATCH --open-mode=append

# --- Names. All nodes must see these paths.
campaign='/home/me/night campaign.yaml'
out='/scratch/me/night'"'"'s'
bin=/opt/drivetwin/bin
kernels=${WARP_CACHE_PATH:-${XDG_CACHE_HOME:-$HOME/.cache}/drivetwin-kernels}
restarts_max=3
folder=/work
cd "$folder" || exit 2
# Keys of the conductor lie here, for you alone, and not among the results.
export DRIVETWIN_HOME='/home/me/my config'
(umask 077 && mkdir -p "$DRIVETWIN_HOME") || exit 2
# Workers take only cases that end before the job is told to stop.
ends=$(squeue --noheader --jobs="$SLURM_JOB_ID" --format=%e)
if [[ $ends == 20* ]]; then
  export TWIN_WALLTIME_S=$(($(date --date="$ends" +%s) - $(date +%s) - 120))
fi

# --- What runs on a node, and what it needs there.
setup() {
  cd "$folder" || exit 2
  # Compiled kernels are kept per kind of processor: not every node runs those of another.
  local features
  features=$(grep -E -m 1 '^(flags|Features)' /proc/cpuinfo | cksum | cut -d ' ' -f 1)
  export WARP_CACHE_PATH=$kernels/$(uname -m)-$features
}
here() { # the address of this node that the others reach
  # The one by which Slurm reaches it; `hpc --interface` and `--address` choose another.
  local found
  found=$(scontrol show node "$SLURMD_NODENAME" | sed -n 's/.*NodeAddr=\([^ ]*\).*/\1/p')
  if [[ ! $found =~ ^[0-9]+(\.[0-9]+){3}$ ]]; then
    # A name: look it up, but not as 127.*, which would be another machine on another node.
    found=$(getent ahostsv4 "$found" | awk '$1 !~ /^127[.]/ { print $1; exit }')
    [ -n "$found" ] || found=$(hostname -I | cut -d ' ' -f 1)
  fi
  echo "$found"
}
worker() {
  setup
  exec "$bin/twin" worker --state "$out" --wait 120 --until-done \
    --slots 64 --device cuda:0
}
# This text carries names and functions to another node; it needs no file there.
on_node="$(declare -p folder bin out kernels DRIVETWIN_HOME ${!TWIN_WALLTIME_S*})
$(declare -f setup worker)"

# --- The conductor hands out cases and keeps the results. It runs beside the workers, here.
setup
address=10.1.2.3
[ -n "$address" ] || exit 2
before=$(cat "$out/conductor.json" 2>/dev/null)
"$bin/conductor" serve --campaign "$campaign" --until-done \
  --listen "tls/$address:0" --state "$out" &
conductor=$!
# bash runs a trap only between commands or during `wait`, so everything long is in the background.
signalled=no stopping=no lost=no
trap 'signalled=yes stopping=yes; kill -TERM "$conductor" 2>/dev/null' TERM
trap 'signalled=yes lost=yes; kill -TERM "$conductor" 2>/dev/null' USR1
# Once it listens, it says where in conductor.json. An older file may be there after a crash.
until [ -s "$out/conductor.json" ] && [ "$(cat "$out/conductor.json")" != "$before" ]; do
  kill -0 "$conductor" 2>/dev/null || break
  sleep 0.2
done

# --- The workers, one per task. Each sees one GPU only (CUDA_VISIBLE_DEVICES), so that is cuda:0.
# --- One that dies does not take the others with it; its cases go to them.
end_workers() { scancel --signal="$1" "$SLURM_JOB_ID.0" 2>/dev/null; }
{
  kill -0 "$conductor" 2>/dev/null || exit
  srun --ntasks=8 --cpus-per-task=8 --gpus-per-task=1 \
    --no-kill --wait=0 --kill-on-bad-exit=0 --label \
    bash -c "$on_node; worker"
  # They leave when no case is left. If the conductor still serves after that, they were lost.
  for _ in {1..150}; do
    kill -0 "$conductor" 2>/dev/null && [ -e "$out/conductor.json" ] || exit
    sleep 0.2
  done
  kill -USR1 $$
} &
workers=$!

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
done

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
    scontrol requeue "$SLURM_JOB_ID" && exit 75
    echo "not queued again; submit this script again to go on" >&2
    exit 75
  fi
  echo "unfinished after $restarts_max restarts; submit this script again to go on" >&2
fi
exit "$verdict"
