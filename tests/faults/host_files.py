"""What the processes of a fabric see of the machine: a small disk, shared memory, names, a clock.

Every process runs in a mount namespace of its own, with file systems that a fault can fill, and
without the right to write where file modes forbid it, which root would have.
"""

from __future__ import annotations

import os
import struct
import subprocess
from contextlib import suppress
from pathlib import Path

DISK_MB = 256
SHM_MB = 8
_ENTER = (
    'mount --bind "$0" /dev/shm && mount --bind "$1" /etc/resolv.conf && '
    'if [ -n "$2" ]; then mount -t tmpfs none "$2"; fi && shift 2 && exec "$@"'
)


class HostFiles:
    """File systems and files below ``folder``; :meth:`close` unmounts them."""

    def __init__(self, folder: Path) -> None:
        self.disk = folder / "disk"
        self.shm = folder / "shm"
        self.resolver = folder / "resolv.conf"
        self._folder = folder
        self._mounted: list[Path] = []
        self.resolver.write_text("")
        for path, size_mb in ((self.disk, DISK_MB), (self.shm, SHM_MB)):
            path.mkdir()
            options = f"size={size_mb}m,mode=1777"
            subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", path], check=True)
            self._mounted.append(path)

    def close(self) -> None:
        """Unmount; what lay there is gone."""
        for path in self._mounted:
            subprocess.run(["umount", "--lazy", path], check=True)
        self._mounted.clear()

    def inside(self, hidden: Path | None) -> tuple[str, ...]:
        """Words before a command: what it sees; ``hidden``: a folder that is empty for it."""
        rights = ("setpriv", "--bounding-set=-dac_override,-dac_read_search")
        enter = (_ENTER, str(self.shm), str(self.resolver), str(hidden or ""))
        return ("sh", "-c", *enter, *rights)

    def step_clock(self, host: str, offset_s: int) -> None:
        """From now on, the wall clock of a host is off by so much [s]; other clocks go on."""
        path = self._folder / f"clock-{host}"
        with path.open("r+b" if path.exists() else "wb", buffering=0) as file:
            file.write(struct.pack("=q", offset_s))

    def with_clock(self, host: str) -> tuple[str, ...]:
        """Words before a command whose wall clock can be stepped."""
        library, offset = self._folder / "clock.so", self._folder / f"clock-{host}"
        if not library.exists():
            source = Path(__file__).with_name("clock.c")
            subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", library, source], check=True)
        if not offset.exists():
            self.step_clock(host, 0)
        return ("env", f"LD_PRELOAD={library}", f"CLOCK_OFFSET_FILE={offset}")


def fill(folder: Path) -> Path:
    """Leave no byte free on the file system of ``folder``; the file to be removed."""
    ballast = folder / "ballast"
    with ballast.open("wb", buffering=0) as file, suppress(OSError):
        while True:
            free = os.statvfs(folder)
            file.write(bytes(max(4096, min(1 << 20, free.f_bavail * free.f_frsize))))
    return ballast
