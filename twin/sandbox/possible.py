"""Whether a sandbox works on this machine; asked once per process."""

from __future__ import annotations

import functools
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor

from twin.sandbox.start import PROGRAM, Sandboxed
from twin.sandbox.view import SCRATCH, SandboxView

TRIAL_S = 10.0
"""Longest time for a trial [s]."""

INSTALL = "install the package bubblewrap"
"""What to do where it is missing."""


@functools.cache
def why_not() -> str:
    """Why there is no sandbox on this machine, and what to do, in half a line; empty: it works."""
    if shutil.which(PROGRAM) is None:
        return f"no {PROGRAM} on this machine; {INSTALL}"
    with Sandboxed(["true"], SandboxView(folder=SCRATCH)) as trial:
        try:
            done = _tried(trial)
        except (OSError, subprocess.TimeoutExpired) as error:
            return f"{PROGRAM} does not start: {str(error)[:200]}"
    if done.returncode == 0:
        return ""
    said = done.stderr.decode(errors="replace").strip().splitlines()
    return f"{PROGRAM}: {said[-1][:200] if said else f'exit code {done.returncode}'}; {ALLOW}"


def _tried(trial: Sandboxed) -> subprocess.CompletedProcess[bytes]:
    """Run a trial on a thread, where no signal's handler interrupts it, and wait for its end.

    Of a bubblewrap that is killed in its first milliseconds, as ``subprocess.run`` does when it is
    interrupted, one half stays behind and waits for the other for ever.
    """
    with ThreadPoolExecutor(1) as apart:
        return apart.submit(
            subprocess.run,
            trial.words,
            env=trial.environment,
            pass_fds=trial.descriptors,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=TRIAL_S,
            check=False,
        ).result()


ALLOW = "user namespaces have to be allowed (sysctl kernel.unprivileged_userns_clone, AppArmor)"
"""What to do where the kernel refuses it."""
