"""What a job is asked for, checked before any script is written. Pure: no file is looked at."""

from __future__ import annotations

import re
from dataclasses import dataclass

from hpc.software.container import Container, Runtime
from schemas.wire.site_name import SITE_PATTERN
from twin.base.errors import UsageError

WORKERS_MAX = 4096
"""Most workers of one job; each is one task of the scheduler."""
SLOTS_MAX = 4096
"""Most slots of one worker, the limit of ``twin worker``."""
CPUS_MAX = 1024
"""Most CPUs of one worker."""
WALLTIME_MAX_MIN = 366 * 24 * 60
"""Longest wall time that is believed [min]."""
LEAD_MIN_S = 30
"""Ending the conductor and the workers takes a few seconds, at worst twenty [s]."""
LEAD_MAX_S = 3600
"""Longest lead of the signal [s]."""
SIGNAL_SLACK_S = 90
"""Schedulers send the signal up to this much earlier than asked for [s]."""
CPUS_PER_GPU_WORKER = 4
"""Default: supervisor, simulator and stack of one rig, and what the stack computes."""
CPUS_PER_CPU_WORKER = 1
"""Default: a simulator on the CPU uses one core, and the stack waits for it in lockstep."""

_ENDPOINT = re.compile(r"tls/(\[[0-9A-Fa-f:.]{2,45}\]|[A-Za-z0-9][A-Za-z0-9.-]{0,252}):[0-9]{1,5}")
_ALLOCATION = re.compile(rf"{SITE_PATTERN}-[0-9]{{1,9}}")
_WALLTIME = re.compile(r"([0-9]{1,5}):([0-5][0-9])")
_SITE_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.,@+/:-]{0,199}")
_ADDRESS = re.compile(r"([A-Za-z0-9][A-Za-z0-9.-]{0,252}|\[[0-9A-Fa-f:.]{2,45}\])")
_CONTROL = re.compile(r"[\x00-\x1f\x7f]")
_MODULE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+/:=@-]{0,199}")
_CONSTRAINT = re.compile(r"[A-Za-z0-9_\[(][A-Za-z0-9_.,:=*&|()\[\]!/-]{0,199}")
_SCRATCH = re.compile(r"(\$[A-Za-z_]\w*|\$\{[A-Za-z_]\w*\}|/)[A-Za-z0-9_./${}+-]{0,400}")
_INTERFACE = re.compile(
    r"[A-Za-z][A-Za-z0-9_.@:-]{0,31}|[0-9]{1,3}(\.[0-9]{1,3}){3}(/([0-9]|[12][0-9]|3[0-2]))?"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class JobRequest:
    """One allocation that runs one campaign.

    Raises:
        UsageError: a value cannot be used; one line says what is allowed.
    """

    campaign: str
    """Shipped name, or absolute path of a campaign file that the compute nodes see."""
    out: str
    """Campaign folder; absolute, on a file system that all nodes share."""
    folder: str
    """Working folder of the job; absolute. Relative names in a campaign file start there."""
    bin_folder: str
    """Folder of the commands ``conductor`` and ``twin`` on the nodes; absolute."""
    walltime_min: int
    """Longest duration of one start of the job [min]."""
    gpus: int = 0
    """GPUs, one worker on each, 1-4096; or 0 and ``workers``."""
    workers: int = 0
    """Workers on the CPU, 1-4096; or 0 and ``gpus``."""
    nodes: int | None = None
    """Nodes to spread the workers over; None lets the scheduler choose."""
    partition: str = ""
    """Partition (queue); empty: the site's default."""
    account: str = ""
    """Account to charge; empty: the user's default."""
    slots: int | None = None
    """Cases that one worker simulates together, 1-4096; None: the worker chooses."""
    cpus_per_worker: int | None = None
    """CPUs of one worker, 1-1024; None: 4 beside a GPU, 1 without."""
    signal_lead_s: int = 60
    """Time before the end of the wall time at which the job is told to stop, 30-3600 [s]."""
    restarts_max: int = 20
    """Most times an unfinished job queues itself again, 0-1000."""
    address: str = ""
    """Address on which the conductor listens; empty: the address of the first node, see
    ``render``."""
    interface: str = ""
    """Network interface (``ib0``), network (``10.1.0.0/16``) or address; each node takes its own
    address there, at run time. Empty: the address by which the scheduler reaches the node."""
    constraint: str = ""
    """Kind of node. Slurm: features; PBS: resources added to every chunk, ``model=milan``."""
    modules: tuple[str, ...] = ()
    """Modules that ``module load`` loads on every node before anything is started."""
    scratch: str = ""
    """Folder for temporary files on each node, absolute or beginning with a variable."""
    directives: tuple[str, ...] = ()
    """Further options of the job, e.g. ``--qos=long`` or ``-W group_list=robots``."""
    container: str = ""
    """Image in which conductor, workers and stack run; absolute. Empty: none. ``bin_folder`` is a
    folder inside it."""
    container_runtime: Runtime = "apptainer"
    """Program that enters the image."""
    container_binds: tuple[str, ...] = ()
    """Further folders that are seen inside as outside, e.g. of data; absolute."""
    history: str = ""
    """Folder of an earlier run, whose longest cases begin first; absolute, as the nodes see it.
    Empty: none."""
    home: str = ""
    """The user's own folder, where the conductor's keys lie; absolute. Empty: as on each node."""
    remote_stacks: bool = False
    """``autonomy.placement: node``: as many tasks again run the stacks, on other nodes if the
    tasks of the workers fill theirs."""
    remote_commands: bool = False
    """Whether stacks on other nodes are commands."""
    records: bool = False
    """Whether the campaign leaves recordings."""
    drive_records: bool = False
    """Whether it leaves such of what the stack saw, which no result store has."""
    own_files: tuple[str, ...] = ()
    """Files beside the campaign file that it names."""
    own_paths: tuple[str, ...] = ()
    """Absolute paths of this machine that the campaign's stack or an option names."""
    join: str = ""
    """Key file with which workers join a conductor elsewhere, which it names; absolute, as the
    nodes see it. The job is workers then, and queues itself no more. Empty: the conductor runs in
    the job."""
    connect: str = ""
    """Endpoint that :attr:`join` names, ``tls/HOST:PORT``; for rules of networks."""
    store: str = ""
    """Result store that this conductor names to its workers; empty: it has none."""
    site: str = ""
    """Name of the cluster, where workers of several join; empty: none."""
    allocation: str = ""
    """Name of this job among those of the run; its workers carry it as a tag."""
    run: str = ""
    """Id of the run of an allocation: names made of it are none of an earlier run's."""

    def __post_init__(self) -> None:
        self._check_paths()
        if self.gpus and self.workers:
            raise UsageError(
                f"given {self.gpus} GPUs and {self.workers} workers; every GPU has one worker, "
                "so give --gpus, or --workers for workers on the CPU"
            )
        if not self.gpus and not self.workers:
            raise UsageError("no workers; give --gpus N, or --workers N for workers on the CPU")
        _within("--gpus", self.gpus, 0, WORKERS_MAX)
        _within("--workers", self.workers, 0, WORKERS_MAX)
        if self.slots is not None:
            _within("--slots", self.slots, 1, SLOTS_MAX)
        _within("--cpus-per-worker", self.cpus, 1, CPUS_MAX)
        _within("--restarts-max", self.restarts_max, 0, 1000)
        if self.nodes is not None:
            _within("--nodes", self.nodes, 1, self.tasks, why="every node needs a task")
        for option, name in (("--partition", self.partition), ("--account", self.account)):
            if name and not _SITE_NAME.fullmatch(name):
                raise UsageError(
                    f"{option} {name!r}: allowed are letters, digits and any of _ . , @ + / : -"
                )
        if self.address and not _ADDRESS.fullmatch(self.address):
            raise UsageError(
                f"--address {self.address!r}: expected a host name or an IP address without a "
                "port, e.g. 10.1.2.3 or [fd00::1]"
            )
        self._check_site()
        self._check_join()
        self._check_times()
        _ = self.inside  # checks it

    def _check_site(self) -> None:
        if self.interface and self.address:
            raise UsageError(
                f"given --address {self.address} and --interface {self.interface}; an address is "
                "one node's, an interface is looked up on each; give one of them"
            )
        if self.interface and not _INTERFACE.fullmatch(self.interface):
            raise UsageError(
                f"--interface {self.interface!r}: expected a name, an address or a network, "
                "e.g. ib0 or 10.1.0.0/16"
            )
        if self.constraint and not _CONSTRAINT.fullmatch(self.constraint):
            raise UsageError(
                f"--constraint {self.constraint!r}: allowed are letters, digits and any of "
                "_ . , : = * & | ( ) [ ] ! / -"
            )
        for module in self.modules:
            if not _MODULE.fullmatch(module):
                raise UsageError(f"module {module!r}: expected a name as for `module load`")
        if self.scratch and not _SCRATCH.fullmatch(self.scratch):
            raise UsageError(
                f"--scratch {self.scratch!r}: expected an absolute path or a variable, e.g. "
                "/local/scratch or $TMPDIR"
            )
        for line in self.directives:
            if not line.startswith("-") or _CONTROL.search(line):
                raise UsageError(
                    f"directive {line!r}: expected an option of the scheduler, e.g. --qos=long"
                )

    def _check_join(self) -> None:
        if not self.join:
            return
        if self.remote_stacks:
            raise UsageError(
                "autonomy.placement: node: stacks on other nodes are announced in a folder that "
                "the workers of other sites do not see; take it out of the campaign"
            )
        if not _ENDPOINT.fullmatch(self.connect):
            raise UsageError(f"conductor at {self.connect!r}: expected tls/HOST:PORT")
        if self.site and not re.fullmatch(SITE_PATTERN, self.site):
            raise UsageError(f"site {self.site!r}: allowed are 1 to 32 letters, digits and -")
        if self.allocation and not _ALLOCATION.fullmatch(self.allocation):
            raise UsageError(f"allocation {self.allocation!r}: expected SITE-NUMBER")

    def _check_paths(self) -> None:
        given = {"--out": self.out, "working folder": self.folder, "--bin": self.bin_folder}
        if self.join:
            given["key of the workers"] = self.join
        if self.history:
            given["--history"] = self.history
        for option, path in given.items():
            if not path.startswith("/"):
                raise UsageError(f"{option} {path!r}: give an absolute path")
        paths = (self.out, self.folder, self.bin_folder, self.home, self.join, self.history)
        for text in (self.campaign, *paths):
            if _CONTROL.search(text):
                raise UsageError(f"{text!r}: a name with a line break or control character")
        if not self.campaign or self.campaign.startswith("-"):
            raise UsageError(f"campaign {self.campaign!r}: give a shipped name or a file's path")

    def _check_times(self) -> None:
        _within("--signal-lead", self.signal_lead_s, LEAD_MIN_S, LEAD_MAX_S, unit=" s")
        least_min = -(-(self.signal_lead_s + SIGNAL_SLACK_S) // 60)
        if not least_min <= self.walltime_min <= WALLTIME_MAX_MIN:
            raise UsageError(
                f"--time {hours_minutes(self.walltime_min)}: allowed are "
                f"{hours_minutes(least_min)} to {hours_minutes(WALLTIME_MAX_MIN)}; the job is told "
                f"to stop {self.signal_lead_s} to {self.signal_lead_s + SIGNAL_SLACK_S} s "
                "before its end"
            )

    @property
    def worker_count(self) -> int:
        """Workers altogether."""
        return self.gpus or self.workers

    @property
    def tasks(self) -> int:
        """Workers, and hosts of stacks if those run on other nodes."""
        return 2 * self.worker_count if self.remote_stacks else self.worker_count

    @property
    def cpus(self) -> int:
        """CPUs of one worker."""
        if self.cpus_per_worker is not None:
            return self.cpus_per_worker
        return CPUS_PER_GPU_WORKER if self.gpus else CPUS_PER_CPU_WORKER

    @property
    def inside(self) -> Container | None:
        """The container; it sees working folder, results, campaign file, keys and history."""
        if not self.container:
            return None
        campaign = self.campaign.rpartition("/")[0]
        folders = (self.folder, self.out, campaign, self.home, self.history)
        return Container(
            image=self.container,
            runtime=self.container_runtime,
            binds=tuple(path for path in (*folders, *self.container_binds) if path),
            folder=self.folder,
            gpus=self.gpus > 0,
        )

    @property
    def one_node(self) -> bool:
        """Everything runs on one node for certain, so nobody else has to reach the conductor."""
        return self.nodes == 1 or self.tasks == 1


def parse_walltime(text: str) -> int:
    """``HH:MM`` as minutes; more than 24 hours are written as hours, e.g. 72:00.

    Raises:
        UsageError: it is something else.
    """
    match = _WALLTIME.fullmatch(text)
    if match is None:
        raise UsageError(f"--time {text!r}: expected HH:MM, e.g. 02:30 or 72:00")
    return 60 * int(match[1]) + int(match[2])


def hours_minutes(minutes: int) -> str:
    """Minutes as ``HH:MM``."""
    return f"{minutes // 60:02}:{minutes % 60:02}"


def _within(option: str, value: int, low: int, high: int, *, unit: str = "", why: str = "") -> None:
    if not low <= value <= high:
        reason = f"; {why}" if why else ""
        raise UsageError(f"{option} {value}{unit}: allowed are {low} to {high}{unit}{reason}")
