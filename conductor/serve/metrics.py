"""A Prometheus endpoint, on request: ``conductor serve --metrics 127.0.0.1:9100``.

Nothing is counted here: every scrape reads the conductor's own status and counters. It is plain
HTTP, so beyond loopback somebody has to have typed ``--insecure``. A page of another site may reach
loopback under a name of its own (DNS rebinding), and is refused by that name.
"""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from prometheus_client import CollectorRegistry, Metric, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.registry import Collector

from schemas.escape import escape
from schemas.wire.status import ConductorStatus, counts_of
from twin.base.errors import UsageError
from twin.fabric.endpoint import is_loopback, plain_is_allowed
from twin.fabric.loopback import NAMES, is_own_name

PREFIX = "drivetwin_conductor"

CASE_STATES = (
    *("waiting", "leased", "passed", "not_passed", "failed", "unresolved", "cancelled"),
    "quarantined",
)

COUNTERS = {
    "requests": "Requests read",
    "refused": "Requests that were no valid message of this version",
    "turned_away": "Requests turned away unread: too large, or too many were waiting",
    "fenced": "Results that came without a live token",
    "faults": "Mistakes of the conductor itself, answered with an error",
    "storage_errors": "Writes that the storage refused",
    "facts": "Facts decided",
    "commits": "Groups of facts committed",
}

Application = Callable[[dict[str, Any], Any], Iterable[bytes]]
"""Application of WSGI."""

Snapshot = Callable[[], ConductorStatus]
"""Status and counters; empty before the conductor has started."""


class ConductorCollector(Collector):
    """Status and counters as metrics, read at each scrape."""

    def __init__(self, snapshot: Snapshot) -> None:
        self._snapshot = snapshot

    def collect(self) -> Iterable[Metric]:
        """See :class:`prometheus_client.registry.Collector`."""
        status = self._snapshot()
        if not status:
            return
        yield from self._gauges(status)
        counters = status["counters"]
        for name, text in COUNTERS.items():
            yield CounterMetricFamily(f"{PREFIX}_{name}", text, value=counters[name])
        yield CounterMetricFamily(
            f"{PREFIX}_journal_seconds",
            "Time spent writing the journal [s]",
            value=counters["journal_s"],
        )

    def _gauges(self, status: ConductorStatus) -> Iterator[Metric]:
        cases = GaugeMetricFamily(
            f"{PREFIX}_cases", "Cases by campaign and state", labels=("campaign", "state")
        )
        disagreements = GaugeMetricFamily(
            f"{PREFIX}_disagreements",
            "Late attempts that came to another result",
            labels=("campaign",),
        )
        for name, row in status["campaigns"].items():
            counts = counts_of(row)
            for state in CASE_STATES:
                cases.add_metric((name, state), counts.get(state, 0))
            disagreements.add_metric((name,), row["disagreements"])
        yield cases
        yield disagreements
        held = sum(worker["held"] for worker in status["workers"])
        yield GaugeMetricFamily(f"{PREFIX}_leases", "Live leases", value=held)
        workers = GaugeMetricFamily(
            f"{PREFIX}_workers", "Workers that joined and have not left", labels=("present",)
        )
        for present in (True, False):
            count = sum(worker["present"] is present for worker in status["workers"])
            workers.add_metric((str(present).lower(),), count)
        yield workers
        yield GaugeMetricFamily(f"{PREFIX}_epoch", "Starts on this folder", value=status["epoch"])


@contextlib.contextmanager
def serving_metrics(address: str, snapshot: Snapshot) -> Iterator[str]:
    """Serve ``http://ADDRESS/metrics`` for the block; yields the URL.

    Raises:
        UsageError: a bad address, one beyond loopback, or one that is in use.
    """
    host, port = checked_address(address)
    registry = CollectorRegistry()
    registry.register(ConductorCollector(snapshot))
    try:
        server, thread = start_http_server(port, addr=host, registry=registry)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise UsageError(
            f"--metrics {address}: {reason}; choose another port, or 0 for a free one"
        ) from None
    application = server.get_app()
    assert application is not None
    server.set_app(_for_own_names(application, host))
    try:
        yield f"http://{host}:{server.server_port}/metrics"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def checked_address(address: str) -> tuple[str, int]:
    """Parse, as :func:`parse_address` does, an address where metrics may be served.

    Raises:
        UsageError: it is none, or beyond loopback and nobody typed ``--insecure``.
    """
    host, port = parse_address(address)
    if not is_loopback(f"tcp/{host}:{port}") and not plain_is_allowed():
        raise UsageError(
            f"--metrics {address}: plain HTTP beyond this host's loopback; use 127.0.0.1:{port} "
            "and a tunnel (ssh -L), or type --insecure: whoever reaches the port may then read"
        )
    return host, port


def _for_own_names(application: Application, bound: str) -> Application:
    """Answers those alone who asked for this host by a name of its own."""
    names = [] if is_loopback(f"tcp/{bound}:0") else [bound, socket.gethostname()]

    def checked(environ: dict[str, Any], start_response: Any) -> Iterable[bytes]:
        host = environ.get("HTTP_HOST", "")
        # An address is no name that somebody could have led here.
        if is_own_name(host, *names) or (names and _is_address(host)):
            return application(environ, start_response)
        start_response("403 Forbidden", [("Content-Type", "text/plain")])
        allowed = ", ".join([*NAMES, *names])
        return [f"asked for {escape(host, 80)!r}; allowed: {allowed}\n".encode()]

    return checked


def _is_address(host: str) -> bool:
    """A numeric address, with or without a port."""
    for text in (host, host.rpartition(":")[0]):
        try:
            ipaddress.ip_address(text.strip("[]"))
        except ValueError:
            continue
        return True
    return False


def parse_address(address: str) -> tuple[str, int]:
    """``127.0.0.1:9100``, ``:9100`` or ``9100``; loopback unless a host is named.

    Raises:
        UsageError: anything else.
    """
    host, _, port = address.rpartition(":")
    if not port.isascii() or not port.isdecimal() or int(port) > 65535:
        raise UsageError(f"--metrics {address}: expected HOST:PORT, e.g. 127.0.0.1:9100")
    return host.strip("[]") or "127.0.0.1", int(port)
