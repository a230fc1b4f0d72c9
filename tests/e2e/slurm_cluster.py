"""A private Slurm of three nodes on this host: own ports, folder and munge key; no root needed.

Each "node" is a ``slurmd`` of its own at 127.0.0.1. Nodes n2 and n3 have two and four GPUs
that are links to devices like /dev/null: Slurm hands them out and sets CUDA_VISIBLE_DEVICES,
nothing more.
"""

from __future__ import annotations

import contextlib
import getpass
import os
import shutil
import socket
import subprocess
import tempfile
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import psutil
from free_ports import free_port
from kernel_folders import for_jobs

PACKAGES = {
    "slurmctld": "slurmctld",
    "slurmd": "slurmd",
    "sbatch": "slurm-client",
    "munged": "munge",
}
"""Program -> Debian package."""
MARK = "TWIN_TEST_SLURM"
"""Environment variable by which the daemons of a cluster are found again."""
PATIENCE_S = 60.0
JOB_PATIENCE_S = 500.0
"""Longest a job may take; it has to share two slow cores."""
T = TypeVar("T")
NODES = ("n1", "n2", "n3")
ENDED = ("COMPLETED", "FAILED", "CANCELLED", "TIMEOUT", "NODE_FAIL", "OUT_OF_MEMORY", "PREEMPTED")

_CONF = """\
ClusterName=twintest
SlurmctldHost={host}({address})
SlurmctldPort={ctld_port}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket={dir}/munge/sock,cred_expire=5
StateSaveLocation={dir}/state
SlurmdSpoolDir={dir}/spool/%n
SlurmctldPidFile={dir}/run/slurmctld.pid
SlurmdPidFile={dir}/run/slurmd.%n.pid
SlurmctldLogFile={dir}/log/slurmctld.log
SlurmdLogFile={dir}/log/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
GresTypes=gpu
SlurmdParameters=config_overrides
SchedulerParameters=batch_sched_delay=0,bf_interval=1,sched_interval=2,sched_min_interval=0
MpiDefault=none
ReturnToService=2
KillWait=20
TCPTimeout=2
SlurmdTimeout=30
NodeName=n1 {n1} CPUs=4 RealMemory=4000
NodeName=n2 {n2} CPUs=8 RealMemory=4000 \
Gres=gpu:a100:2
NodeName=n3 {n3} CPUs=16 RealMemory=4000 \
Gres=gpu:v100:4
PartitionName=main Nodes=n1,n2,n3 Default=YES MaxTime=24:00:00 State=UP
"""
_GRES = """\
NodeName=n2 Name=gpu Type=a100 File={dir}/run/gpu[0-1]
NodeName=n3 Name=gpu Type=v100 File={dir}/run/gpu[0-3]
"""
_DEVICES = {"gpu0": "/dev/null", "gpu1": "/dev/zero", "gpu2": "/dev/full", "gpu3": "/dev/random"}
_SPANK_PBS = Path("/usr/lib/x86_64-linux-gnu/slurm-wlm/spank_pbs.so")
"""Of slurm-wlm-torque: sets PBS_JOBID and the like."""


def missing() -> str:
    """Why there can be no cluster here, or nothing."""
    absent = [package for program, package in PACKAGES.items() if not _program(program)]
    return f"needs the Debian packages {' '.join(absent)}" if absent else ""


class SlurmCluster:
    """Three idle nodes between :meth:`start` and :meth:`stop`."""

    address = "127.0.0.1"
    """Of the controller."""
    prefix: tuple[str, ...] = ()
    """Words before each daemon and each command."""

    def __init__(self) -> None:
        # Unix sockets have short names, so not below pytest's folder.
        self.folder = Path(tempfile.mkdtemp(prefix="slurm-", dir="/tmp"))
        self.mark = uuid.uuid4().hex
        self.environment = {
            **{
                k: v for k, v in os.environ.items() if not k.startswith(("SLURM", "SBATCH", "SRUN"))
            },
            "SLURM_CONF": str(self.folder / "slurm.conf"),
            "WARP_CACHE_PATH": str(for_jobs(self.folder / "kernels")),
        }
        self._daemons: list[subprocess.Popen[bytes]] = []

    def start(self) -> None:
        """Configure, start, and wait until all nodes are idle."""
        self._configure()
        munge = self.folder / "munge"
        self._daemon(
            *("munged", "--foreground", f"--socket={munge}/sock", f"--key-file={munge}/key"),
            *(f"--pid-file={munge}/pid", f"--seed-file={munge}/seed", f"--log-file={munge}/log"),
        )
        self._wait(lambda: (munge / "sock").exists(), "munged")
        self._daemon("slurmctld", "-D")
        self._nodes = {node: self._daemon(*self.node_command(node)) for node in NODES}
        states = ("sinfo", "--noheader", "--Node", "--format=%T")
        self._wait(
            lambda: self.call(*states, check=False).stdout.split() == ["idle"] * 3, "idle nodes"
        )

    def stop(self) -> None:
        """End every job, then every daemon, then whatever they started; remove the folder."""
        if len(self._daemons) > 1:
            self.call("scancel", f"--user={getpass.getuser()}", check=False)
            queue = ("squeue", "--noheader", "--format=%i")
            with contextlib.suppress(AssertionError):  # what hangs is killed below
                self._wait(lambda: not self.call(*queue, check=False).stdout.split(), "empty queue")
        for daemon in reversed(self._daemons):
            self.end_daemon(daemon)
        for daemon in reversed(self._daemons):
            try:
                daemon.wait(10)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()
        for process in psutil.process_iter():
            try:
                if process.environ().get(MARK) == self.mark:
                    process.kill()
            except (psutil.NoSuchProcess, psutil.AccessDenied):
                continue
        shutil.rmtree(self.folder)

    def call(
        self,
        *arguments: str,
        check: bool = True,
        folder: Path | None = None,
        environment: dict[str, str] | None = None,
    ) -> subprocess.CompletedProcess[str]:
        """Run a Slurm command against this cluster."""
        done = subprocess.run(
            [*self.prefix, *arguments],
            env={**self.environment, **(environment or {})},
            cwd=folder or self.folder,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert not check or done.returncode == 0, f"{arguments}: {done.stdout}{done.stderr}"
        return done

    def submit(self, script: Path, **environment: str) -> str:
        """``sbatch`` in the script's folder; the job's id."""
        done = self.call(
            "sbatch", "--parsable", str(script), folder=script.parent, environment=environment
        )
        return done.stdout.strip()

    def job(self, job: str) -> dict[str, str]:
        """What ``scontrol show job`` says."""
        text = self.call("scontrol", "--oneliner", "show", "job", job).stdout
        return dict(word.split("=", 1) for word in text.split() if "=" in word)

    def ended(self, job: str) -> dict[str, str] | None:
        """The job's description once it has ended and its nodes are free, else None."""
        found = self.job(job)
        return found if found["JobState"] in ENDED else None

    def wait(self, look: Callable[[], T], what: str) -> T:
        """Poll until ``look`` returns something true."""
        until = time.monotonic() + JOB_PATIENCE_S
        while time.monotonic() < until:
            if found := look():
                return found
            time.sleep(0.1)
        raise AssertionError(f"in vain: {what}\n{self.logs()}")

    def logs(self) -> str:
        """The daemons' logs, for the message of a failure."""
        return "\n".join(
            f"{path.name}: {path.read_text(errors='replace')[-2000:]}"
            for path in sorted((self.folder / "log").iterdir())
        )

    def _configure(self) -> None:
        for name in ("munge", "state", "spool", "run", "log", *(f"spool/{n}" for n in NODES)):
            (self.folder / name).mkdir(mode=0o755)
        self.folder.chmod(0o755)
        key = self.folder / "munge" / "key"
        key.write_bytes(os.urandom(128))
        key.chmod(0o600)
        for name, device in _DEVICES.items():
            (self.folder / "run" / name).symlink_to(device)
        ctld_port = free_port()
        ports = [ctld_port]
        for _ in NODES:
            ports.append(free_port(*ports))
        values = {
            "dir": str(self.folder),
            "host": socket.gethostname().split(".")[0],
            "address": self.address,
            "user": getpass.getuser(),
            "ctld_port": ctld_port,
            **{node: self.place(node, port) for node, port in zip(NODES, ports[1:], strict=True)},
        }
        (self.folder / "slurm.conf").write_text(_CONF.format(**values))
        (self.folder / "gres.conf").write_text(_GRES.format(**values))
        if _SPANK_PBS.exists():
            (self.folder / "plugstack.conf").write_text(f"optional {_SPANK_PBS}\n")
        (self.folder / "cgroup.conf").write_text("CgroupPlugin=cgroup/v1\n")

    def place(self, node: str, port: int) -> str:
        """Where a node is, in the words of slurm.conf."""
        return f"NodeHostname=localhost NodeAddr={self.address} Port={port}"

    def end_daemon(self, daemon: subprocess.Popen[bytes]) -> None:
        """Tell it to end."""
        daemon.terminate()

    def node_command(self, node: str) -> tuple[str, ...]:
        """The command line that is a node."""
        return ("slurmd", "-D", "-N", node)

    def _daemon(self, program: str, *arguments: str) -> subprocess.Popen[bytes]:
        log = (self.folder / "log" / f"{program}-{len(self._daemons)}.out").open("wb")
        with log:
            self._daemons.append(
                subprocess.Popen(
                    [*self.prefix, _program(program), *arguments],
                    env={**self.environment, MARK: self.mark},
                    cwd=self.folder,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    start_new_session=True,
                )
            )
        return self._daemons[-1]

    def _wait(self, look: Callable[[], bool], what: str) -> None:
        until = time.monotonic() + PATIENCE_S
        while not look():
            dead = [daemon.args for daemon in self._daemons if daemon.poll() is not None]
            if dead or time.monotonic() > until:
                raise AssertionError(f"no {what}; ended: {dead}\n{self.logs()}")
            time.sleep(0.05)


def _program(name: str) -> str:
    """Its path; daemons are not on every user's PATH."""
    return shutil.which(name, path=f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin") or ""
