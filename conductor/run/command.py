"""``conductor run``: serve, start local workers, wait, report.

Without local workers it is ``conductor serve --until-done``, see :mod:`conductor.serve.command`."""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import msgspec

from conductor.core.state import Config
from conductor.records.fingerprint import Fingerprint, fingerprint
from conductor.records.outcomes import Outcomes, read_outcomes
from conductor.run.case_lengths import all_ended, earlier_lengths, history_line
from conductor.run.console import again, listener_here, print_results
from conductor.run.listener import RunListener, RunProgress
from conductor.run.local_workers import LocalWorkers
from conductor.run.places import WorkerPlace, WorkersOption, cpu_slots, gpu_slots, on_cpu, on_gpus
from conductor.run.report_preload import ReportPreload
from conductor.run.stopping import Interrupted, Signals, heeded
from conductor.serve.command import metrics_of
from conductor.serve.shell import Conductor
from conductor.stored.link import StoreOptions
from conductor.trust.sign_run import (
    UnfitRunError,
    require_agreement,
    sign_again,
    sign_derived,
    sign_run,
)
from schemas import SCHEMA_VERSION
from schemas.campaign import Campaign
from schemas.plan import Plan
from schemas.sections.autonomy import UNPROTECTED, open_by_nature
from schemas.sections.view_mode import ViewMode
from schemas.wire.control import Stop, Submit
from schemas.wire.status import CampaignStatus
from schemas.words import counted
from twin.base.errors import (
    EXIT_INTERRUPTED,
    EXIT_UNFINISHED,
    InfrastructureError,
    TwinError,
    UnfinishedError,
    UsageError,
)
from twin.base.gpu.slot_count import MemoryCount
from twin.base.software import device_class, software_digest
from twin.base.worker_start import LocalWorker, WorkerStart
from twin.fabric.endpoint import LOOPBACK, is_tls
from twin.fabric.keys.key_file import MemberKey, shared
from twin.sandbox.possible import why_not

POLL_S = 0.1
"""How often progress is looked at [s]."""
DISMISS_S = 10.0
"""Longest wait for workers of other hosts to leave [s]."""
RESTARTS_MAX = 5
"""Workers that died without a case ending in between, before the run gives up."""


@dataclass(frozen=True, slots=True)
class RunOptions:
    """Options of the command line."""

    out: Path
    workers: WorkersOption = field(default_factory=WorkersOption)
    """Local workers; none: workers that join from elsewhere do it all."""
    slots: int | None = None
    """Slots per worker; None: as many as are useful, on GPUs as many as fit."""
    device: str = "cpu"
    by_batch: bool = False
    listen: str = LOOPBACK
    namespace: str = "twin"
    key: MemberKey | None = None
    ttl_s: float | None = None
    """How long a lease outlives its worker's last word [s]; None: as usual."""
    history: Path | None = None
    """Folder of an earlier run, whose cases say how long these will be."""
    view: ViewMode | None = None
    """View of the simulators; None: what the campaign says."""
    memory_gb: float | None = None
    metrics: str = ""
    """``HOST:PORT`` of a Prometheus endpoint, or empty."""
    store: StoreOptions | None = None  # beside the folder
    json: bool = False
    report: bool = True
    """Report, sign and print results at the end; False: who asked reads the outcomes."""


def local_workers(plan: Plan, options: RunOptions) -> LocalWorkers:
    """The workers of a run. Those of a new one are started here: they, and simulators if there are
    any, load while the rest of the campaign is checked, and leave nothing behind if it is
    refused."""
    campaign, folder = plan.campaign, options.out.absolute()
    loads = campaign.simulator != "noop" and campaign.autonomy.placement != "inline"
    worker = LocalWorker(
        load_simulator=loads,
        view=options.view,
        memory_gb=options.memory_gb,
        join_dir=str(folder / "rigs"),
        spool=str(folder / "spool"),
    )
    places = _places(options, len(plan.cases))
    workers = LocalWorkers(worker, folder, places, _memory_count(campaign, options))
    if _is_new(folder):
        workers.start()
    return workers


def _is_new(folder: Path) -> bool:
    try:
        return not folder.exists()
    except OSError:
        return False  # the conductor says what is wrong with it


@dataclass(frozen=True, slots=True)
class RunResult:
    """What a run came to."""

    outcomes: Outcomes
    fingerprint: Fingerprint
    wall_s: float
    """Duration of this start of the run [s]."""


def run_campaign(
    plan: Plan,
    options: RunOptions,
    workers: LocalWorkers,
    computed: Callable[[], None] = lambda: None,
) -> int:
    """Run ``plan`` to its end with ``workers`` of this machine, and print what it came to; the exit
    code.

    ``computed`` is called when they have ended.
    """
    listener = listener_here()
    with heeded() as signals:
        try:
            result = carry_out(plan, options, workers, computed, listener, signals)
        except Interrupted as stop:
            listener.say(f"stopped by {stop}; the same command goes on: {again()}")
            return EXIT_INTERRUPTED if stop.number == signal.SIGINT else EXIT_UNFINISHED
    if result is None:
        return read_outcomes(options.out).exit_code
    print_results(
        plan.campaign,
        options.out,
        result.outcomes,
        result.fingerprint,
        wall_s=result.wall_s,
        slots=workers.slots,
        as_json=options.json,
    )
    return result.outcomes.exit_code


def carry_out(
    plan: Plan,
    options: RunOptions,
    workers: LocalWorkers,
    computed: Callable[[], None],
    listener: RunListener,
    signals: Signals,
) -> RunResult | None:
    """Run ``plan`` to its end with ``workers`` of this machine; None: no report was asked for.

    Args:
        plan: the campaign with its cases.
        options: how, and where to.
        workers: see :func:`local_workers`.
        computed: called when they have ended.
        listener: hears what happens meanwhile.
        signals: may ask the run to stop.

    Raises:
        Interrupted: it was asked to stop; the same call goes on.
        TwinError: it could not go on.
    """
    if options.workers.count != 0 and not options.workers.gpus:
        device_class(options.device)  # refuses one that is not here before anything is written
    started = time.monotonic()
    campaign = plan.campaign
    if options.view is not None:
        campaign = msgspec.structs.replace(campaign, view=options.view.value)
    lengths_s = earlier_lengths(options.history)
    if line := history_line(options.history, lengths_s, (case.id for case in plan.cases)):
        listener.say(line)
    known_s = [lengths_s.get(case.id) for case in plan.cases]
    conductor = _conductor_of(options, workers, lengths_s)
    reported = False
    try:
        _execute(conductor, campaign, options, workers, known_s, listener, signals)
        computed()
        if not options.report:
            return None
        outcomes, kpi_fingerprint = _conclude(campaign, options)
        reported = True
    finally:
        with contextlib.suppress(TwinError):
            sign_again(options.out, reported=reported)
        if conductor.link is not None:
            conductor.link.keep_runs([options.out])
    return RunResult(outcomes, kpi_fingerprint, time.monotonic() - started)


def serve_until_done(plan: Plan, options: RunOptions) -> int:
    """Run ``plan`` to its end with workers that join from elsewhere; the exit code."""
    options = replace(options, workers=WorkersOption(count=0))
    return run_campaign(plan, options, LocalWorkers(LocalWorker(), options.out.absolute(), ()))


def _conductor_of(
    options: RunOptions, workers: LocalWorkers, lengths_s: Mapping[str, float]
) -> Conductor:
    """The conductor of a run, not started yet."""
    config = Config(by_batch=options.by_batch, spread=not workers.places, lengths_s=lengths_s)
    if options.ttl_s is not None:
        config = replace(config, ttl_ns=int(options.ttl_s * 1e9))
    return Conductor(
        options.out,
        listen=options.listen,
        namespace=options.namespace,
        key=options.key,
        config=config,
        store=options.store,
    )


def _execute(
    conductor: Conductor,
    campaign: Campaign,
    options: RunOptions,
    workers: LocalWorkers,
    known_s: Sequence[float | None],
    listener: RunListener,
    signals: Signals,
) -> None:
    """Serve and work until every case has ended."""
    serving = _Serving(conductor)
    # A signal that raised between the thread's start and `try`, or before the thread is asked to
    # stop, would leave it serving for ever. Only one ever raises, so the inner `finally` may be
    # where it hits.
    signals.held = True
    try:
        try:
            serving.start()
            signals.release()
            serving.await_start()
            with metrics_of(conductor, options.metrics):
                _work(conductor, campaign, options, workers, known_s, listener, signals)
        finally:
            signals.held = True
    finally:
        conductor.stop()
        serving.join()
    signals.release()


def _work(
    conductor: Conductor,
    campaign: Campaign,
    options: RunOptions,
    workers: LocalWorkers,
    known_s: Sequence[float | None],
    listener: RunListener,
    signals: Signals,
) -> None:
    """Submit the campaign to a conductor that serves, and wait until every case has ended.

    ``known_s``: length of each case in an earlier run [s of simulated time]; None: it knows none.
    """
    software = software_digest()  # reads all our files
    request = Submit(
        v=SCHEMA_VERSION,
        campaign=msgspec.to_builtins(campaign),
        software=software,
        out=str(conductor.folder),
    )
    reply = conductor.request(request)
    if reply.error:
        raise UsageError(reply.error)
    row = _row(conductor, campaign)
    if not row["left"]:
        listener.say(all_ended(options.out, len(known_s)))
        return
    cases = row["cases"]  # of a search, all that are proposed so far
    if row["left"] < cases:
        done = cases - row["left"]
        listener.say(f"{options.out}: going on, {done} of {counted(cases, 'case')} done")
    _check_software(row, options, software)
    places = _places(options, row["left"])
    slots = _slots(options, row["left"], len(places), workers.memory, known_s)
    if options.workers.per_gpu:
        devices = ", ".join(place.device for place in places)
        listener.say(f"workers on {devices} with {slots} slots each")
    try:
        (conductor.folder / "logs").mkdir(exist_ok=True)
    except OSError as error:
        raise UsageError(f"{conductor.folder}: {error.strerror}") from None
    if line := unprotected(campaign, local=bool(places)):
        listener.say(line)
    key = str(shared(conductor.key)) if conductor.key else ""
    insecure = [] if is_tls(conductor.endpoint) else ["--insecure"]
    if ViewMode(campaign.view).shows:
        look = ["look:", "viewer", "live", "--run", str(options.out), *insecure]
        listener.say(shlex.join(look))
    shown = options.report and campaign.simulator != "noop"
    report = ReportPreload(options.out) if shown else None
    try:
        told = WorkerStart(conductor.endpoint, slots, key)
        workers.serve(told, places, conductor.worker_socket)
        _wait(conductor, campaign, workers, report, listener, signals)
        workers.ask()
        if report is not None:
            report.finish()  # while they end
    finally:
        workers.stop()
        if report is not None:
            report.leave()
        if not places:
            _dismiss(conductor)


def unprotected(campaign: Campaign, *, local: bool) -> str:
    """The line about a stack that runs without a sandbox; empty: it has one, as far as known here.

    ``local``: it runs on this machine.
    """
    if campaign.simulator == "noop":
        return ""
    reason = open_by_nature(campaign.autonomy) or (why_not() if local else "")
    return f"{UNPROTECTED}: {reason}; the stack may do whatever you may" if reason else ""


def _dismiss(conductor: Conductor) -> None:
    """Workers that are not ours hear that they may leave, instead of a silence; bounded."""
    with contextlib.suppress(TwinError):
        conductor.request(Stop(v=SCHEMA_VERSION), DISMISS_S)
    until_s = time.monotonic() + DISMISS_S
    while conductor.alive and time.monotonic() < until_s:
        time.sleep(POLL_S)


def _wait(
    conductor: Conductor,
    campaign: Campaign,
    workers: LocalWorkers,
    report: ReportPreload | None,
    listener: RunListener,
    signals: Signals,
) -> None:
    if not workers.count:
        listener.say(f"waiting for workers: twin worker --state {conductor.folder}")
    storage = ""
    printed: list[str] = []
    with listener.watching():
        ended, said = -1, ""
        while True:
            signals.release()
            workers.start()
            snapshot = conductor.snapshot()
            row = snapshot["campaigns"][campaign.campaign]
            if ended != row["cases"] - row["left"]:
                ended = row["cases"] - row["left"]
                workers.died = 0
            name, cases = campaign.campaign, row["cases"]
            listener.progress(RunProgress(name, cases, ended, row["passed"], row["leased"]))
            if "search" in row and row["search"]["answer"] != said:
                said = row["search"]["answer"]
                from conductor.commands.tables import search_line

                listener.say(f"{name}: {search_line(row)}")
            if not row["left"]:
                return
            if row["leased"] and report is not None:
                report.begin()
            for line in snapshot["notes"]:
                if line not in printed:
                    printed.append(line)
                    listener.say(line)
            if (
                snapshot["notes"]
                and not row["leased"]
                and len(snapshot["notes"]) >= workers.count > 0
            ):
                raise UsageError("no worker may run what is left; see the lines above")
            for line in workers.look():
                listener.say(line)
            if workers.died > RESTARTS_MAX:
                raise InfrastructureError(
                    f"{workers.died} workers died one after the other; see {workers.folder}/logs"
                )
            if snapshot["storage_error"] and snapshot["storage_error"] != storage:
                raise InfrastructureError(f"{snapshot['storage_error']}")
            storage = snapshot["storage_error"]
            if not conductor.alive:
                raise UnfinishedError("the conductor was stopped; the same command goes on")
            conductor.ended.wait(POLL_S)
            conductor.ended.clear()


def _conclude(campaign: Campaign, options: RunOptions) -> tuple[Outcomes, Fingerprint]:
    """Report and fingerprint; a report needs a simulator that simulates."""
    outcomes = read_outcomes(options.out)
    require_agreement(options.out)
    if campaign.simulator == "noop":
        kpi_fingerprint = fingerprint(options.out)
        _sign(options.out, outcomes, kpi_fingerprint)
        return outcomes, kpi_fingerprint
    from conductor.report import make_report
    from conductor.report.pages.content import read_shown
    from conductor.report.reading.dossier import open_dossier

    # Before the report, which says so. The fingerprint is known: every file has just been read.
    read = read_shown(open_dossier(options.out))
    if early := read[1].fingerprint:
        _sign(options.out, outcomes, early)
    # Plots wait for `conductor report`.
    late = make_report(options.out, plots=False, read=read).content.evidence.fingerprint
    with contextlib.suppress(TwinError):  # the reason is told already
        sign_derived(options.out)
    return outcomes, late or fingerprint(options.out)


def _sign(folder: Path, outcomes: Outcomes, kpi_fingerprint: Fingerprint) -> None:
    """Sign a run that has ended; where there is no key it stays as it is, which is told."""
    if outcomes.software and outcomes.software != software_digest():
        return  # it was run, and judged or not, by another version
    try:
        sign_run(folder, outcomes, kpi_fingerprint.sha256)
    except UnfitRunError:
        raise
    except TwinError as error:
        print(f"conductor: {folder} is not signed: {error}", file=sys.stderr)


def _row(conductor: Conductor, campaign: Campaign) -> CampaignStatus:
    return conductor.snapshot()["campaigns"][campaign.campaign]


def _check_software(row: CampaignStatus, options: RunOptions, ours: str) -> None:
    """A campaign is finished by the software that began it: results must be comparable."""
    if row["software"] and row["software"] != ours:
        raise UsageError(
            f"{options.out}: begun with software {row['software'][:12]}, this is {ours[:12]}; "
            "finish it with that version, or start anew in another folder with --out"
        )


def _places(options: RunOptions, left: int) -> list[WorkerPlace]:
    """Where workers compute."""
    if options.workers.per_gpu:
        gpus = options.workers.gpus
        return on_gpus([g.device for g in gpus], [g.cores for g in gpus], options.workers.per_gpu)
    cores = len(os.sched_getaffinity(0))
    return on_cpu(options.device, options.workers.count, cores, left, options.slots or 1)


def _memory_count(campaign: Campaign, options: RunOptions) -> MemoryCount | None:
    """Begin to count how many slots fit on the GPUs; None where that does not matter."""
    if options.slots or not options.workers.per_gpu:
        return None
    free = min(gpu.free_bytes for gpu in options.workers.gpus) // options.workers.per_gpu
    asked = ("--campaign", "-", "--free-gb", str(free / 1e9))
    return MemoryCount(msgspec.json.encode(campaign), asked)


def _slots(
    options: RunOptions,
    left: int,
    workers: int,
    count: MemoryCount | None,
    known_s: Sequence[float | None],
) -> int:
    """Slots per worker."""
    if count is None:
        return options.slots or cpu_slots(left, workers)
    return gpu_slots(left, workers, count.slots(), known_s)


class _Serving(threading.Thread):
    """The conductor on a thread of its own."""

    def __init__(self, conductor: Conductor) -> None:
        super().__init__(name="conductor")
        self._conductor = conductor
        self._failure: TwinError | None = None

    def run(self) -> None:
        """Serve; for the thread."""
        try:
            self._conductor.serve()
        except TwinError as error:
            self._failure = error

    def await_start(self) -> None:
        """Return once it serves.

        Raises:
            TwinError: it cannot.
        """
        while not self._conductor.started.wait(0.02):
            if not self.is_alive():
                raise self._failure or InfrastructureError("the conductor did not start")

    def join(self, timeout: float | None = None) -> None:
        """Wait for its end.

        Raises:
            TwinError: what ended it.
        """
        super().join(timeout)
        if self._failure is not None:
            raise self._failure
