"""``conductor serve``: one state folder, served in the foreground."""

from __future__ import annotations

import contextlib
import logging
import os
import shlex
import signal
import socket
import sys
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from conductor.core.state import Config
from conductor.records.outcomes import exit_code, read_outcomes
from conductor.run.case_lengths import earlier_lengths
from conductor.serve.shell import Conductor
from conductor.stored.link import StoreOptions
from conductor.trust.manifest import RUN_FILE
from conductor.trust.sign_run import require_agreement, sign_run
from schemas.sections.view_mode import ViewMode
from schemas.wire.status import counts_of
from schemas.words import counted
from twin.base.errors import EXIT_INTERRUPTED, InfrastructureError, TwinError
from twin.base.process import end, give_freed_memory_back, how_it_ended, raised_in, spawn
from twin.fabric.endpoint import is_loopback, is_tls
from twin.fabric.keys.key_file import MemberKey, shared

SIGN_PERIOD_S = 1.0
"""How often it is looked whether a campaign has come to its end [s]."""

_log = logging.getLogger(__name__)


def serve_folder(
    folder: Path,
    listen: str,
    namespace: str,
    *,
    key: MemberKey | None = None,
    by_batch: bool = False,
    ttl_s: float | None = None,
    view: ViewMode | None = None,
    metrics: str = "",
    allow_unprotected: bool = False,
    store: StoreOptions | None = None,
    history: Path | None = None,
) -> int:
    """Serve until SIGINT, SIGTERM or ``conductor stop``; the exit code.

    Args:
        folder: state folder.
        listen: endpoint.
        namespace: prefix of every key.
        key: the conductor's key, if one was given.
        by_batch: run a campaign's batches one after the other.
        ttl_s: how long a lease outlives its worker's last word [s]; None: as usual.
        view: what is shown of cases submitted from now on; None: what their campaign says.
        metrics: ``HOST:PORT`` of a Prometheus endpoint, or empty.
        allow_unprotected: stacks may run without a sandbox also if others can reach this conductor.
        store: result store beside the folder; None: there is none.
        history: folder of an earlier run, whose longest cases begin first; None: of none.
    """
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(message)s")
    give_freed_memory_back()
    # Workers that join from anywhere have a device each, as a rule.
    config = Config(by_batch=by_batch, view=view, spread=True, lengths_s=_lengths(history))
    if not (is_loopback(listen) or allow_unprotected):
        config = replace(config, protected=True)
    if ttl_s is not None:
        config = replace(config, ttl_ns=int(ttl_s * 1e9))
    conductor = Conductor(
        folder,
        listen=listen,
        namespace=namespace,
        key=key,
        config=config,
        store=store,
        history=history,
    )
    received: list[int] = []

    def on_signal(number: int, _frame: object) -> None:
        received.append(number)
        conductor.stop()

    signal.signal(signal.SIGTERM, on_signal)
    signal.signal(signal.SIGINT, on_signal)
    threading.Thread(target=_announce, args=(conductor, namespace), daemon=True).start()
    over = threading.Event()
    signing = threading.Thread(target=_sign_ended, args=(conductor, over), name="signing")
    signing.start()
    try:
        with metrics_of(conductor, metrics):
            conductor.serve()
    finally:
        over.set()
        signing.join()
        if conductor.link is not None and conductor.started.is_set():
            conductor.link.keep_runs(conductor.campaign_folders())
    if signal.SIGINT in received:
        return EXIT_INTERRUPTED
    rows = [counts_of(row) for row in conductor.snapshot().get("campaigns", {}).values()]
    counts = ("cases", "passed", "unresolved", "left")
    return exit_code(**{name: sum(row[name] for row in rows) for name in counts})


def _lengths(history: Path | None) -> dict[str, float]:
    """Simulated time of the cases of an earlier run by name [s], and a line about it."""
    lengths_s = earlier_lengths(history)
    if history is not None:
        known = counted(len(lengths_s), "case")
        _log.info("history: %s knows %s; the longest begin first", history, known)
    return lengths_s


def _sign_ended(conductor: Conductor, over: threading.Event) -> None:
    """Sign campaigns as they come to their end, also those that end with the conductor."""
    failed: set[Path] = set()
    said = ""
    last = False
    while not last:
        last = over.wait(SIGN_PERIOD_S)
        try:
            due = conductor.to_sign(last=last)
        except Exception as error:  # a mistake of ours; it may not come again
            if last or repr(error) != said:
                said = repr(error)
                _log.error("nothing is signed now: %s", said)
            continue
        said = ""
        for path, before in due.items():
            if path in failed and not last:
                continue
            try:
                if path == conductor.folder and not last:
                    continue  # the journal in it is signed when it is closed
                require_agreement(path)
                values = _fingerprint(path)
                sign_run(path, read_outcomes(path), values, None if last else conductor.chain())
                if conductor.additions(path) != before:  # the next pass signs it with them
                    (path / RUN_FILE).unlink(missing_ok=True)
            except Exception as error:  # also a mistake of ours: others are signed
                failed.add(path)
                why = error if isinstance(error, TwinError) else repr(error)
                _log.error("%s is not signed: %s", path, why)


_FINGERPRINT = (
    "import sys; from pathlib import Path; from twin.base.process import bind_to_parent; "
    "bind_to_parent(); from conductor.records.fingerprint import fingerprint; "
    "print(fingerprint(Path(sys.argv[1])).sha256)"
)


def _fingerprint(folder: Path) -> str:
    """Fingerprint, computed by a process of its own: a thousand cases keep a core busy for
    seconds."""
    with tempfile.TemporaryFile() as log:
        words = [sys.executable, "-c", _FINGERPRINT, str(folder)]
        child = spawn(words, log=log, pipe_output=True)
        try:
            assert child.stdout is not None
            output = child.stdout.read().decode().strip()
            code = child.wait()
        finally:
            end(child)
        if code or not output:
            raise InfrastructureError(f"no fingerprint: {raised_in(log) or how_it_ended(code)}")
    return output


@contextlib.contextmanager
def metrics_of(conductor: Conductor, address: str) -> Iterator[None]:
    """Serve, for the block, Prometheus metrics of ``conductor`` at ``HOST:PORT``; empty: none."""
    if not address:
        yield
        return
    from conductor.serve.metrics import serving_metrics

    with serving_metrics(address, conductor.snapshot) as url:
        print(f"metrics at {url}", flush=True)
        yield


def _announce(conductor: Conductor, namespace: str) -> None:
    conductor.started.wait()
    option = "" if namespace == "twin" else f" --namespace {namespace}"
    key = f" --key {shlex.quote(str(shared(conductor.key)))}" if conductor.key else ""
    here = f"{os.environ.get('USER', 'me')}@{socket.gethostname()}"
    folder = shlex.quote(str(Path(conductor.folder).absolute()))
    typed = "" if is_tls(conductor.endpoint) else " --insecure"
    where = look = f"--connect {conductor.endpoint}{option}{key}{typed}"
    if conductor.fabric:  # the folder says everything else, and whose keys to take
        where, look = f"--state {folder}", f"--run {folder}"
    print(
        f"conductor serves {conductor.folder} at {conductor.endpoint}\n"
        f"  submit:  conductor submit aeb-demo {where}\n"
        f"  worker:  twin worker {where}\n"
        f"  status:  conductor status {where}\n"
        f"  look:    viewer live {look}\n"
        f"  from a laptop: viewer live --ssh {here} --run {folder}",
        flush=True,
    )
