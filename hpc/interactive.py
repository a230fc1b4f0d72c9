"""An interactive allocation with the set-up that jobs have. Pure text."""

from __future__ import annotations

import shlex

from hpc.request import JobRequest


def shell_command(request: JobRequest, command: list[str]) -> list[str]:
    """A bash with modules, our commands first on the PATH, then ``command`` or a prompt."""
    lines = []
    if request.modules:
        lines += [
            "command -v module >/dev/null || . /etc/profile",
            f"module load {' '.join(request.modules)}",
        ]
    lines += [
        f"cd {shlex.quote(request.folder)}",
        f"export PATH={shlex.quote(request.bin_folder)}:$PATH",
        f"exec {shlex.join(command) if command else 'bash -i'}",
    ]
    return ["bash", "-c", "; ".join(lines)]
