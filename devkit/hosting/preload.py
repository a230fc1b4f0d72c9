"""The wait of a stack's host that was started before there is a rig for it: it loads meanwhile what
shipped stacks need, and reads the rest of its command line on standard input."""

from __future__ import annotations

import contextlib
import importlib
import os
import queue
import threading

from schemas.files.json_text import JsonError, decode_json
from twin.base.errors import UsageError
from twin.base.gpu.first_use import begin, begun
from twin.base.pauses import loading
from twin.base.process import PARENT_VARIABLE, die_with_parent, leave_signals_to_the_parent

LOADED = ("devkit.hosting.host", "devkit.aeb", "devkit.detector.detector", "onnx")
"""Modules that are loaded meanwhile, what every stack needs first."""


def await_arguments(device: str) -> list[str]:
    """Load what a rig that computes on ``device`` needs until there is word of it; its options.

    Raises:
        UsageError: standard input says something else.
    """
    parent = os.environ.get(PARENT_VARIABLE, "")
    if parent:
        die_with_parent(parent)
        leave_signals_to_the_parent()
    begin(device)
    lines: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_read, args=(lines,), name="arguments", daemon=True).start()
    waking = threading.Thread(target=_wake, args=(device,), name="wake", daemon=True)
    waking.start()
    with loading():
        for name in LOADED:
            if not lines.empty():
                break
            with contextlib.suppress(Exception):  # whoever needs it says what is wrong with it
                importlib.import_module(name)
        waking.join()
    try:
        arguments: list[str] = decode_json(lines.get(), list[str])
    except JsonError as error:
        raise UsageError(f"--connect -: standard input: {error}") from None
    return arguments


def _wake(device: str) -> None:
    """What networks on a GPU need; half of it is waiting for the driver. On a CPU few are run by
    ONNX Runtime, whose import leaves a file in the temporary folder."""
    if device.startswith("cuda"):
        with contextlib.suppress(Exception):
            resize = importlib.import_module("devkit.detector.resize")
            importlib.import_module("devkit.detector.runtime").load_libraries()
            begun(device)
            resize.wake(device)


def _read(lines: queue.SimpleQueue[bytes]) -> None:
    """One line, and no byte behind it: what comes then is the lifeline's end."""
    line = b""
    while not line.endswith(b"\n"):
        data = os.read(0, 65536)
        if not data:
            os._exit(0)  # nobody needs us
        line += data
    lines.put(line)
