"""A campaign submitted to a private cluster by ``hpc submit``, as a user does it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from processes import MARK, Marked
from slurm_cluster import SlurmCluster

T = TypeVar("T")


def hpc(
    cluster: SlurmCluster, *arguments: str, folder: Path, **environment: str
) -> subprocess.CompletedProcess[str]:
    """``hpc ARGUMENTS`` on the "login node" of a cluster."""
    return cluster.call(
        *(sys.executable, "-m", "hpc", *arguments),
        folder=folder,
        environment=environment,
        check=False,
    )


class Job:
    """Submitted from ``folder`` into its run folder ``a folder``."""

    def __init__(
        self,
        marked: Marked,
        cluster: SlurmCluster,
        folder: Path,
        campaign: str,
        *options: str,
        **environment: str,
    ) -> None:
        self.cluster = cluster
        self.folder = folder
        self.out = folder / "a folder"
        arguments = ("submit", campaign, "--output", "json", "--out", str(self.out), *options)
        if "--time" not in options:
            arguments += ("--time", "00:30")
        done = hpc(cluster, *arguments, folder=folder, **{MARK: marked.mark}, **environment)
        assert done.returncode == 0, done.stderr
        self.said = json.loads(done.stdout)
        self.id = self.said["job"]
        self.log = Path(self.said["log"])

    def hpc(self, command: str) -> str:
        """``hpc COMMAND`` on the run folder."""
        done = hpc(self.cluster, command, str(self.out), folder=self.folder)
        assert done.returncode == 0, done.stderr
        return done.stdout

    def wait(self, look: Callable[[], T], what: str) -> T:
        """Poll until ``look`` returns something true."""
        try:
            return self.cluster.wait(look, what)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.text}") from None

    def end(self) -> dict[str, str]:
        """Wait until it has ended; what Slurm knows of it."""
        found = self.wait(lambda: self.cluster.ended(self.id), "the end of the job")
        assert found is not None
        return found

    @property
    def text(self) -> str:
        """Its log."""
        return self.log.read_text() if self.log.exists() else "(no log)"


def wrapped_commands(folder: Path, twin: str) -> Path:
    """A folder for ``--bin``: the real commands, but ``twin`` runs the bash lines ``twin`` first.

    They may end with ``exec "$real" ...``; otherwise the real one runs with the same arguments.
    """
    real = Path(sys.executable).parent
    made = folder / "commands"
    made.mkdir()
    for name in ("conductor", "devkit"):
        (made / name).symlink_to(real / name)
    (made / "twin").write_text(f'#!/bin/bash\nreal="{real}/twin"\n{twin}\nexec "$real" "$@"\n')
    (made / "twin").chmod(0o755)
    return made
