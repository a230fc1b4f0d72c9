"""What clusters say, and files that say which clusters there are."""

from __future__ import annotations

import atexit
import tempfile
import threading
from functools import cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import yaml
from fuzz_target import BrokenTargetError, Target, of_file

from hpc.backends import backend
from hpc.commands import Place, ProgramEnd, at
from hpc.kubernetes.api import Namespace
from hpc.kubernetes.standing import standing
from hpc.pbs import commands as pbs_commands
from hpc.scheduler import WORDS_CHARS_MAX, JobStatus, Partition, job_id
from hpc.sites.allocations import Allocations, book_of
from hpc.sites.file import chosen_sites, load_sites
from hpc.sites.requests import CommonOptions, request_of
from hpc.slurm import commands as slurm_commands
from schemas.validation import MISTAKES_MAX
from twin.base.errors import TwinError, UsageError


def _sites(path: Path) -> None:
    """Read the file, and write the script of an allocation at each of its sites."""
    file = load_sites(path)
    for name, entry in file.sites.items():
        (site,) = chosen_sites([f"{entry.scheduler}:{name}"], file)
        place = {"campaign": "aeb-demo", "out": Path("/o"), "connect": "tls/a:1"}
        common = CommonOptions(time="01:00", workers=0 if entry.gpus or entry.workers else 1)
        backend(site.scheduler).render(request_of(site, f"{name}-1", common=common, **place))


def _book(path: Path) -> None:
    """Read the book of a run, and check what becomes words of commands."""
    if (book := book_of(path.parent)) is not None:
        Allocations(path.parent, book.campaign, {}, lambda *_: None, lambda _: b"")


def _batch_answer(data: bytes) -> None:
    """Everything that is made of what a program of a batch system says."""
    text = data.decode("utf-8", "replace")
    found: list[JobStatus | Partition] = [
        slurm_commands.parse_job(text),
        slurm_commands.parse_account(text),
        pbs_commands.parse_job(text),
        *slurm_commands.parse_sinfo(text),
        *pbs_commands.parse_queues(text),
    ]
    slurm_commands.minutes(text.strip())
    words = [str(getattr(each, name)) for each in found for name in each.__dataclass_fields__]
    words.append(ProgramEnd(1, "", text).last_words)
    for word in words:
        if not word.isprintable() or len(word) > 2 * WORDS_CHARS_MAX:
            raise BrokenTargetError(f"told as it came: {word[:500]!r}")
    for system in ("slurm", "pbs"):
        job_id(system, text.strip())


class _Server(ThreadingHTTPServer):
    """Answers everything with the same bytes."""

    daemon_threads = True
    status = 200
    body = b""


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def log_message(self, *_: object) -> None:
        """Quiet."""

    def do_GET(self) -> None:
        self.send_response(self.server.status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(self.server.body)))
        self.end_headers()
        self.wfile.write(self.server.body)


@cache
def _server() -> tuple[_Server, str]:
    """A server, and the kubeconfig that leads to it."""
    server = _Server(("127.0.0.1", 0), _Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    atexit.register(server.shutdown)
    cluster = {"server": f"http://127.0.0.1:{server.server_port}"}
    content: dict[str, Any] = {
        "apiVersion": "v1",
        "kind": "Config",
        "current-context": "c",
        "clusters": [{"name": "c", "cluster": cluster}],
        "users": [{"name": "c", "user": {"token": "t"}}],
        "contexts": [{"name": "c", "context": {"cluster": "c", "user": "c"}}],
    }
    folder = tempfile.TemporaryDirectory(prefix="fuzz-kube-")
    atexit.register(folder.cleanup)
    path = Path(folder.name) / "config"
    path.write_text(yaml.safe_dump(content))
    return server, str(path)


def _kube_answer(data: bytes) -> None:
    """The status of a run whose API server answers the bytes after the first line, with the status
    code of the first line; over HTTP and through the official client."""
    server, config = _server()
    code, _, server.body = data.partition(b"\n")
    server.status = int(code) if code in (b"200", b"403", b"404", b"500") else 200
    with at(Place(kubeconfig=config)):
        found = standing(Namespace(), "dt-x")
    if not f"{found.native}{found.reason}{found.nodes}".isprintable():
        raise BrokenTargetError("told as it came")


TARGETS = {
    "yaml-sites": Target(
        of_file("sites.yaml", _sites), (UsageError,), lines_max=MISTAKES_MAX, cost=5
    ),
    "allocations": Target(of_file("allocations.json", _book), (UsageError,)),
    "batch-answer": Target(_batch_answer, (TwinError,)),
    "kube-answer": Target(_kube_answer, (TwinError,), cost=10),
}
