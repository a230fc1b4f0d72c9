"""Rerun's web viewer as it lies in its own binary; nothing is fetched from outside."""

from __future__ import annotations

import gzip
import importlib.metadata
import importlib.util
import threading
import time
import urllib.error
import urllib.request
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from twin.base.errors import InfrastructureError
from twin.base.process import end, spawn
from viewer.playback import native

NAMES = {"re_viewer.js": "text/javascript", "re_viewer_bg.wasm": "application/wasm"}
"""Files of the web viewer, and their types."""

PLOTLY = "plotly.js"
"""Name under which pages ask for Plotly."""

READY_TIMEOUT_S = 30.0
"""Longest time the binary may take to serve the assets [s]."""
POLL_S = 0.1
"""Time between two questions whether it serves [s]."""


@dataclass(frozen=True)
class Asset:
    """A file of a page."""

    data: bytes
    media_type: str
    tag: str
    """Changes when the data do: what browsers keep is asked for by this."""

    @cached_property
    def packed(self) -> bytes:
        """Compressed with gzip; 43 MB of WebAssembly become 16 in a second."""
        return gzip.compress(self.data, compresslevel=1, mtime=0)


class WebViewer:
    """The files, taken out of the binary when the first of them is asked for, which takes seconds:
    the console needs none."""

    def __init__(self) -> None:
        self._files: dict[str, Asset] | None = None
        self._lock = threading.Lock()

    def get(self, name: str) -> Asset | None:
        """The file of that name; None: there is none.

        Raises:
            InfrastructureError: the binary is missing or does not serve them.
        """
        if name not in NAMES:
            return None
        with self._lock:
            if self._files is None:
                self._files = web_viewer()
            return self._files[name]


def plotly_script() -> Asset:
    """Plotly, as it lies in its package, which is not loaded for it.

    Raises:
        InfrastructureError: it is not there.
    """
    spec = importlib.util.find_spec("plotly")
    folders = spec.submodule_search_locations if spec is not None else None
    try:
        data = Path(next(iter(folders or [])), "package_data", "plotly.min.js").read_bytes()
    except (StopIteration, OSError) as error:
        raise InfrastructureError(f"the package plotly has no script: {error}") from None
    return Asset(data, "text/javascript", importlib.metadata.version("plotly"))


def web_viewer() -> dict[str, Asset]:
    """The files, by name.

    Raises:
        InfrastructureError: the binary is missing or does not serve them.
    """
    version = importlib.metadata.version("rerun-sdk")
    hub_port, port = native.free_port(), native.free_port()
    child = spawn(
        [
            *(str(native.binary()), "--serve-web", "--bind", "127.0.0.1"),
            *("--port", str(hub_port), "--web-viewer-port", str(port)),
        ],
        environment={"RUST_LOG": "error"},
    )
    try:
        until_s = time.monotonic() + READY_TIMEOUT_S
        return {
            name: Asset(_get(f"http://127.0.0.1:{port}/{name}", until_s), kind, version)
            for name, kind in NAMES.items()
        }
    finally:
        end(child, 0.5)


def _get(url: str, until_s: float) -> bytes:
    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    while True:
        try:
            with direct.open(url, timeout=READY_TIMEOUT_S) as answer:
                data: bytes = answer.read()
                return data
        except (urllib.error.URLError, OSError) as error:
            if time.monotonic() > until_s:
                raise InfrastructureError(f"the rerun web viewer does not start: {error}") from None
            time.sleep(POLL_S)
