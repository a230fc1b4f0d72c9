"""``viewer web RUN --static OUT``: the console of ended campaigns as files, for any web server or a
page that is opened from the disk."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

import msgspec

from schemas.files.regular_file import open_below
from twin.base.errors import TwinError, UsageError, storage_error
from viewer.browser.assets import PLOTLY, Asset, plotly_script
from viewer.console.shown_run import JSON, as_json, component
from viewer.console.site import ConsoleSite
from viewer.playback.folder import find_recording

DATA_FOLDER = "data"
SCRIPT_SUFFIX = ".js"
"""Of the script that JSON is written as: pages that come from a disk may load scripts, but fetch
nothing."""
REPORT_FILE = "report.html"


@dataclass(frozen=True, slots=True)
class WrittenSite:
    """What was written."""

    files: int
    size_bytes: int
    left_out: list[str]
    """A line for each address whose content could not be made."""


def write_static(
    site: ConsoleSite, pages: Mapping[str, Asset], out: Path, *, recordings: bool
) -> WrittenSite:
    """Write the console of campaigns into ``out``, which must be empty or new.

    Args:
        site: what is shown.
        pages: files of the page, by name.
        out: folder to write.
        recordings: copy the recordings, too.

    Raises:
        UsageError: ``out`` holds something already, or lies in a run; or the page is not built.
        InfrastructureError: the disk lets us down.
    """
    _check_out(site, out)
    if "index.html" not in pages:
        raise UsageError("the console's page is not built: run `make console`")
    writing = _Writing(out)
    try:
        for name, asset in {**pages, PLOTLY: plotly_script()}.items():
            data = asset.data
            if name == "index.html":
                data = data.replace(b"<html", b"<html data-static", 1)
            writing.write(name, data)
        writing.answer(site, "runs.json")
        for name, shown in site.runs.items():
            shown.portable = True
            try:
                addresses = list(site.addresses_of(shown))
            except (TwinError, OSError) as error:
                writing.left_out.append(f"{name}: {error}")
                continue
            if recordings:
                _recordings(writing, site, name)
            for address in addresses:
                writing.answer(site, address)
            _report(writing, site, name)
    except OSError as error:
        raise storage_error(error, str(error.filename or out)) from None
    return WrittenSite(writing.files, writing.size_bytes, writing.left_out)


class _Writing:
    """The folder that is written."""

    def __init__(self, out: Path) -> None:
        self.files, self.size_bytes = 0, 0
        self.left_out: list[str] = []
        self.recordings: set[str] = set()
        """Addresses of recordings that were copied."""
        self._out = out

    def path(self, address: str) -> Path:
        """Path of the file that web servers give for a quoted address; its folder is there
        afterwards.

        Raises:
            UsageError: a part of it is no name of a file.
        """
        parts = [unquote(part) for part in address.split("/")]
        if odd := [part for part in parts if part in ("", ".", "..") or "/" in part]:
            raise UsageError(f"{address}: '{odd[0]}' is no name of a file")
        path = self._out.joinpath(*parts)
        path.parent.mkdir(parents=True, exist_ok=True)
        self.files += 1
        return path

    def write(self, address: str, data: bytes) -> None:
        """Write one file."""
        self.path(address).write_bytes(data)
        self.size_bytes += len(data)

    def answer(self, site: ConsoleSite, address: str) -> None:
        """Write the content of an address below ``data/``; what cannot be made is left out."""
        name = f"{DATA_FOLDER}/{address}"
        try:
            answer = site.answer(address)
        except (TwinError, OSError) as error:
            self.left_out.append(f"{address}: {error}")
            return
        data = answer.data
        if address.endswith("/case.json"):
            data = self._without_dead_links(data)
        try:
            if answer.media_type == JSON:
                self.write(name + SCRIPT_SUFFIX, as_script(address, data))
            else:
                self.write(name, data)
        except TwinError as error:
            self.left_out.append(f"{address}: {error}")

    def _without_dead_links(self, data: bytes) -> bytes:
        page = json.loads(data)
        links = page["links"]
        links["in_full"] = None  # that view needs a server
        if links["recording"] not in self.recordings:
            links["recording"] = None
        return as_json(page).data


def as_script(address: str, data: bytes) -> bytes:
    """JSON as a script that hands its text to the page.

    A text, because JSON is no JavaScript: a key ``__proto__`` means another thing there. JSON of a
    text is JavaScript, once what ends lines in older scripts is escaped.
    """
    call = msgspec.json.encode([unquote(address), data.decode()])[1:-1]
    for mark, escaped in (("\u2028", b"\\u2028"), ("\u2029", b"\\u2029")):
        call = call.replace(mark.encode(), escaped)
    return b"consoleData(" + call + b");\n"


def _check_out(site: ConsoleSite, out: Path) -> None:
    for shown in site.runs.values():
        if out.resolve().is_relative_to(shown.run.folder.resolve()):
            raise UsageError(
                f"--static {out}: lies in the run {shown.run.folder}, which stays as it was "
                "signed; choose a folder elsewhere"
            )
    try:
        out.mkdir(parents=True, exist_ok=True)
        if any(out.iterdir()):
            raise UsageError(f"--static {out}: not empty; choose an empty or a new folder")
    except OSError as error:
        raise UsageError(f"--static {out}: {error.strerror or error}") from None


def _report(writing: _Writing, site: ConsoleSite, run: str) -> None:
    folder = site.run(run).folder
    try:
        with open_below(folder, REPORT_FILE) as file:
            writing.write(f"report/{component(run)}/{REPORT_FILE}", file.read())
    except FileNotFoundError:
        return
    except OSError as error:
        writing.left_out.append(f"{REPORT_FILE}: {error.strerror or error}")


def _recordings(writing: _Writing, site: ConsoleSite, run: str) -> None:
    shown = site.runs[run]
    for case, recorded in zip(shown.table().cases, shown.recorded(), strict=True):
        if not recorded:
            continue
        name = f"recording/{component(run)}/{component(case)}.rrd"
        try:
            path = find_recording(shown.run.folder, case).path
            file = open_below(shown.run.folder, str(path.relative_to(shown.run.folder)))
        except (TwinError, OSError) as error:
            writing.left_out.append(f"{name}: {error}")
            continue
        with file, writing.path(name).open("wb") as copy:
            shutil.copyfileobj(file, copy, 1 << 20)
            writing.size_bytes += os.fstat(copy.fileno()).st_size
        writing.recordings.add(name)
