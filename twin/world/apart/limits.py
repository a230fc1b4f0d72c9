"""How much a process may use that parses files: of a scene, if nothing else is said."""

from __future__ import annotations

import resource

MEMORY_BYTES_MAX = 16 << 30
"""Address space [bytes]."""

CPU_S = 60
"""Processor time [s]."""

WALL_S = 600
"""Time until it is given up, however busy the machine is [s]."""

ANSWER_BYTES_MAX = 4 << 30
"""What it may answer, for all files together [bytes]."""

LIMITS = {
    resource.RLIMIT_CORE: 0,
    resource.RLIMIT_FSIZE: 0,
    resource.RLIMIT_NPROC: 0,
    resource.RLIMIT_NOFILE: 64,
}
"""Limits of the kernel beside processor time and memory: it writes no file, and starts no process
or thread."""
