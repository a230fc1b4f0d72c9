"""``conductor serve``: one state folder, served in the foreground."""

from __future__ import annotations

import logging
import signal
import threading
from pathlib import Path

from conductor.shell import Conductor
from conductor.state import Config
from twin.fabric.errors import EXIT_INTERRUPTED, EXIT_PASS, EXIT_UNFINISHED


def serve_folder(folder: Path, listen: str, namespace: str, *, by_batch: bool) -> int:
    """Serve until SIGINT, SIGTERM or ``conductor stop``; the exit code."""
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(message)s")
    conductor = Conductor(
        folder, listen=listen, namespace=namespace, config=Config(by_batch=by_batch)
    )
    received: list[int] = []

    def on_signal(number: int, _frame: object) -> None:
        received.append(number)
        conductor.stop()

    signal.signal(signal.SIGTERM, on_signal)
    signal.signal(signal.SIGINT, on_signal)
    threading.Thread(target=_announce, args=(conductor, namespace), daemon=True).start()
    conductor.serve()
    if signal.SIGINT in received:
        return EXIT_INTERRUPTED
    left = any(c["left"] for c in conductor.snapshot().get("campaigns", {}).values())
    return EXIT_UNFINISHED if left else EXIT_PASS


def _announce(conductor: Conductor, namespace: str) -> None:
    conductor.started.wait()
    option = "" if namespace == "twin" else f" --namespace {namespace}"
    where = f"--connect {conductor.endpoint}{option}"
    print(
        f"conductor serves {conductor.folder} at {conductor.endpoint}\n"
        f"  submit:  conductor submit aeb-demo {where}\n"
        f"  worker:  twin worker {where}\n"
        f"  status:  conductor status {where}",
        flush=True,
    )
