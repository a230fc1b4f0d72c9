"""``conductor serve``: one state folder, served in the foreground."""

from __future__ import annotations

import contextlib
import logging
import os
import shlex
import signal
import socket
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from conductor.fingerprint import fingerprint
from conductor.manifest import RUN_FILE
from conductor.outcomes import exit_code, read_outcomes
from conductor.shell import Conductor
from conductor.sign_run import require_agreement, sign_run
from conductor.state import Config
from schemas.view_mode import ViewMode
from twin.fabric.endpoint import is_loopback, is_tls
from twin.fabric.errors import EXIT_INTERRUPTED, TwinError
from twin.fabric.key_file import Key, shared


def serve_folder(
    folder: Path,
    listen: str,
    namespace: str,
    *,
    key: Key | None = None,
    by_batch: bool = False,
    ttl_s: float | None = None,
    view: ViewMode | None = None,
    metrics: str = "",
    allow_unprotected: bool = False,
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
    """
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(message)s")
    # Workers that join from anywhere have a device each, as a rule.
    config = Config(by_batch=by_batch, view=view, spread=True)
    if not (is_loopback(listen) or allow_unprotected):
        config = replace(config, protected=True)
    if ttl_s is not None:
        config = replace(config, ttl_ns=int(ttl_s * 1e9))
    conductor = Conductor(folder, listen=listen, namespace=namespace, key=key, config=config)
    received: list[int] = []

    def on_signal(number: int, _frame: object) -> None:
        received.append(number)
        conductor.stop()

    signal.signal(signal.SIGTERM, on_signal)
    signal.signal(signal.SIGINT, on_signal)
    threading.Thread(target=_announce, args=(conductor, namespace), daemon=True).start()
    with metrics_of(conductor, metrics):
        conductor.serve()
    for path in conductor.complete_folders():
        sign_served(path)
    if signal.SIGINT in received:
        return EXIT_INTERRUPTED
    rows = conductor.snapshot().get("campaigns", {}).values()
    counts = ("cases", "passed", "unresolved", "left")
    return exit_code(**{name: sum(row[name] for row in rows) for name in counts})


def sign_served(folder: Path) -> None:
    """Sign a campaign that has come to its end; why it is not is told."""
    try:
        require_agreement(folder)
        if not (folder / RUN_FILE).exists():
            sign_run(folder, read_outcomes(folder), fingerprint(folder).sha256)
    except TwinError as error:
        logging.getLogger(__name__).error("%s is not signed: %s", folder, error)


@contextlib.contextmanager
def metrics_of(conductor: Conductor, address: str) -> Iterator[None]:
    """For the block, Prometheus metrics of ``conductor`` at ``HOST:PORT``; empty: none."""
    if not address:
        yield
        return
    from conductor.metrics import serving_metrics

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
