#!/bin/bash
# A Slurm job script, written by `hpc`: 4 GPU workers that join a conductor elsewhere, for aeb-demo.
# Submit it with `sbatch FILE`, watch it with `squeue --me`; its log is slurm-JOBID.out.
# Results are with the conductor; submitted again it is as many workers again.

# --- What the job asks for; options given to sbatch itself win over these lines.
#SBATCH --job-name=north-3
#SBATCH --time=01:00:00
# One task is one worker.
#SBATCH --ntasks=4
#SBATCH --cpus-per-task=4
#SBATCH --gpus-per-task=1
# This script, and nothing else, gets SIGTERM so many seconds before the time is over,
# or up to a minute earlier.
#SBATCH --signal=B:TERM@60
# Whoever submitted it submits another one; a node that fails does not end it.
#SBATCH --no-requeue
#SBATCH --no-kill
# A later start adds to the log of the first.
#SBATCH --open-mode=append

# --- Names. All nodes must see these paths.
campaign=aeb-demo
out=/home/me/dt/aeb-demo-1a/north-3
bin=/opt/drivetwin/bin
kernels=${WARP_CACHE_PATH:-${XDG_CACHE_HOME:-$HOME/.cache}/drivetwin-kernels}
restarts_max=20
folder=/work
cd "$folder" || exit 2
# The key says where the conductor is, and lets workers commit results there, nothing else.
key=/home/me/dt/aeb-demo-1a/north-3/worker.key
# Workers take only cases that end before the job is told to stop.
ends=$(squeue --noheader --jobs="$SLURM_JOB_ID" --format=%e)
if [[ $ends == 20* ]]; then
  export TWIN_WALLTIME_S=$(($(date --date="$ends" +%s) - $(date +%s) - 60))
fi

# --- What runs on a node, and what it needs there.
setup() {
  cd "$folder" || exit 2
  # Compiled kernels are kept per kind of processor: not every node runs those of another.
  local features
  features=$(grep -E -m 1 '^(flags|Features)' /proc/cpuinfo | cksum | cut -d ' ' -f 1)
  export WARP_CACHE_PATH=$kernels/$(uname -m)-$features
}
worker() {
  setup
  exec "$bin/twin" worker --key "$key" --site north --tag allocation:north-3 \
    --wait 120 --started-again --until-done \
    --device cuda:0
}
# This text carries names and functions to another node; it needs no file there.
on_node="$(declare -p folder bin out kernels key ${!TWIN_WALLTIME_S*})
$(declare -f setup worker)"

# --- The workers, one per task. One that dies does not take the others with it.
end_workers() { scancel --signal="$1" "$SLURM_JOB_ID.0" 2>/dev/null; }
signalled=no
trap 'signalled=yes; end_workers TERM' TERM
srun --ntasks=4 --cpus-per-task=4 --gpus-per-task=1 \
  --no-kill --wait=0 --kill-on-bad-exit=0 --label \
  bash -c "$on_node; worker" &
workers=$!
[ "$signalled" = no ] || end_workers TERM # it came before they could be named

# --- Wait for the workers. They leave when no case is left (0), or before the time is over (75).
while :; do
  signalled=no
  wait "$workers"
  code=$?
  [ "$signalled" = yes ] && [ "$code" -gt 128 ] || break
done
exit "$code"
