"""Long commands on a terminal: bars that come to their end on standard error, and results alone on
standard output. Without a terminal they say nothing of it: see test_every_command."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
import threading
from contextlib import suppress

import cv2
import numpy as np
import pytest
from dark_spots import write_dark_spots
from foreign_campaigns import campaign
from processes import END_S, outcomes, recorded_run
from tiny_networks import write_dark_spot_detector

from twin.base.gpu.vulkan import has_vulkan

BAR = "━"
BACKEND = """
from pathlib import Path
from zipfile import ZipFile

def build_wheel(folder, settings=None, metadata=None):
    name, about = "drivetwin-1-py3-none-any.whl", "drivetwin-1.dist-info"
    with ZipFile(Path(folder, name), "w") as wheel:
        wheel.writestr(f"{about}/METADATA", "Metadata-Version: 2.1\\nName: drivetwin\\nVersion: 1")
        wheel.writestr(f"{about}/WHEEL", "Wheel-Version: 1.0\\nTag: py3-none-any")
        wheel.writestr(f"{about}/RECORD", "")
    return name
"""
PROJECT = """
[project]
name = "drivetwin"
version = "1"

[build-system]
requires = []
build-backend = "backend"
backend-path = ["."]
"""
"""A project that is built without anything from elsewhere."""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A finished run of a short case that was recorded in every way, and what else is needed."""
    folder = tmp_path_factory.mktemp("progress")
    path = campaign(folder, "short", {})
    recorded_run(path, folder / "run")
    write_dark_spots(folder / "data")
    write_dark_spot_detector(folder / "spots.onnx")
    cv2.imwrite(str(folder / "spot.png"), np.full((32, 32, 3), 255, np.uint8))
    project = folder / "project"
    project.mkdir()
    (project / "pyproject.toml").write_text(PROJECT)
    (project / "backend.py").write_text(BACKEND)
    (project / "constraints.txt").touch()
    (folder / "wheels").mkdir()
    (folder / "wheels" / "drivetwin-1-py3-none-any.whl").write_bytes(b"wheel")
    return folder


def on_terminal(*words, codes=(0,)):
    """Run a command whose standard error is a terminal; its standard output, and the rows that
    the terminal showed."""
    master, slave = pty.openpty()
    shown = bytearray()

    def read():
        with suppress(OSError):  # nobody has the other end any more
            while part := os.read(master, 65536):
                shown.extend(part)

    variables = {**os.environ, "TERM": "xterm", "COLUMNS": "120"}
    for name in ("NO_COLOR", "FORCE_COLOR", "TTY_COMPATIBLE"):
        variables.pop(name, None)
    reader = threading.Thread(target=read)
    with subprocess.Popen(
        [sys.executable, "-m", *words], stdout=subprocess.PIPE, stderr=slave, env=variables
    ) as child:
        os.close(slave)
        reader.start()
        try:
            out, _ = child.communicate(timeout=END_S)
        finally:
            child.kill()  # nothing, if it has ended
    reader.join()
    os.close(master)
    text = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", shown.decode(errors="replace"))
    assert child.returncode in codes, text
    return out.decode(), re.split(r"[\r\n]+", text)


COMMANDS = {
    "conductor report {at}/run --anew": ("KPI files", "plots"),
    "conductor compare {at}/run {at}/run": ("KPI files",),
    "conductor export {at}/run --out {tmp}/study": ("cases",),
    "conductor export {at}/run --out {tmp}/csv --format csv": ("cases",),
    "conductor verify {at}/run": ("files",),
    "conductor bench --tasks 80 --rounds 1 --folder {tmp}/journals": ("runs",),
    "conductor fingerprint {at}/run": ("KPI files",),
    "conductor fingerprint {at}/run {at}/run": ("KPI files",),
    "twin validate vehicle opencav": ("manoeuvres",),
    "twin snapshot --out {tmp}/a.png --weather clear": ("pictures",),
    "twin judge {at}/run": ("attempts",),
    "twin memory": ("rigs",),
    "twin bench vehicle --vehicles 1": ("rounds",),
    "twin bench storyboard --quick": ("rounds",),
    "devkit evaluate {at}/spots.onnx {at}/data": ("scoring",),
    "devkit detect {at}/spots.onnx {at}/spot.png {at}/spot.png": ("images",),
    "viewer strip {at}/run {case} --out {tmp}/a.jpg --at 1": ("pictures",),
    "viewer shot {at}/run {case} --out {tmp}/a.png --at 1": ("steps",),
    "viewer export {at}/run {case} --mp4 {tmp}/a.mp4": ("frames",),
    "viewer export {at}/run {case} --mcap {tmp}/a.mcap": ("frames", "messages"),
    "viewer export {at}/run {case} --mcap {tmp}/a.mcap --ros2": ("bytes",),
    "viewer bench --cases 4 --seconds 1 --console 0 --ended 0 --rounds 0": ("parts",),
    "hpc bundle --no-kernels --source {at}/project --out {tmp}/bundle": ("pip runs",),
    "hpc image context {tmp}/image --wheels {at}/wheels --source {at}/project": ("bytes",),
}
"""Commands, and what they count."""


@pytest.mark.parametrize("line", COMMANDS)
def test_a_bar_comes_to_its_end(place, tmp_path, line):
    if " shot " in line and not has_vulkan():
        pytest.skip("no Vulkan driver; apt-get install mesa-vulkan-drivers")
    names = {"at": place, "tmp": tmp_path, "case": min(outcomes(place / "run"))}
    words = [word.format(**names) for word in line.split()]
    out, rows = on_terminal(*words, codes=(0, 1) if " report " in line else (0,))
    assert out.strip(), "its result"
    for what in COMMANDS[line]:
        mine = bars_of(what, rows)
        assert mine, rows
        assert "100%" in mine[-1]
        assert not bars_of(what, out.splitlines())


def bars_of(what, rows):
    """Rows that are bars of what is counted."""
    return [row for row in rows if row.startswith(f"{what} ") and BAR in row]
