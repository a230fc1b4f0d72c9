"""A case that a rig died with computes apart from others on its GPU: processes that NVIDIA's
service serves together end together. What the real service does, ``tests/device/trouble_check.py``
shows; a library that answers as the driver does stands for it here."""

import json
import os
import queue
import subprocess
import sys
from pathlib import Path

import pynvml
import pytest
from c_library import compiled
from msgspec import structs
from waiting import PATIENCE_S

from conductor.run.source import load
from schemas.sections.view_mode import ViewMode
from schemas.wire.control import Lease
from twin.base.gpu.first_use import PIPES_VARIABLE, apart
from twin.rig.pipe import Built, Listening
from twin.worker.options import WorkerOptions
from twin.worker.preload import begin_loading
from twin.worker.rig_process import RigProcess

OPTIONS = WorkerOptions(connect="", slots=1, view=ViewMode.none)

DRIVER = """
#include <stdlib.h>
int nvmlInitWithFlags(unsigned flags) { return 0; }
int nvmlShutdown(void) { return 0; }
int nvmlDeviceGetHandleByIndex_v2(unsigned index, void **device) {
    *device = (void *)1;
    return index < 2 ? 0 : 6; /* not found */
}
int nvmlDeviceGetComputeMode(void *device, int *mode) { *mode = atoi(getenv("MODE")); return 0; }
const char *nvmlErrorString(int error) { return "no"; }
"""


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    return compiled(tmp_path_factory.mktemp("driver"), "libnvidia-ml.so.1", DRIVER)


@pytest.mark.parametrize(
    ("device", "mode", "expected"),
    [
        ("cuda:1", "0", {PIPES_VARIABLE: "/nonexistent"}),
        ("cuda:1", "3", {}),  # exclusive: one process, the service
        ("cuda:2", "0", {}),  # not here
        ("cpu", "0", {}),
    ],
)
def test_where_a_process_can_be_apart(driver, device, mode, expected):
    code = "import json, sys; from twin.base.gpu.first_use import apart; " + (
        "print(json.dumps(apart(sys.argv[1])))"
    )
    environment = {**os.environ, "LD_LIBRARY_PATH": str(driver), "MODE": mode}
    environment.pop("CUDA_VISIBLE_DEVICES", None)
    said = subprocess.check_output([sys.executable, "-c", code, device], env=environment, text=True)
    assert json.loads(said) == expected


def test_without_a_driver_nobody_is_apart(monkeypatch):
    def refuse():
        raise pynvml.NVMLError(pynvml.NVML_ERROR_LIBRARY_NOT_FOUND)

    monkeypatch.setattr(pynvml, "nvmlInit", refuse)
    assert apart("cuda:0") == {}


@pytest.mark.parametrize("alone", [pytest.param(False, marks=pytest.mark.slow), True])
def test_processes_of_a_case_that_runs_alone_are_apart(tmp_path, monkeypatch, alone):
    """And those that load for the next rig are of no use to it."""
    monkeypatch.setattr(
        "twin.worker.rig_process.apart", lambda device: {PIPES_VARIABLE: f"/no/{device}"}
    )
    monkeypatch.setenv(PIPES_VARIABLE, "/service")
    case = load("chaos-16").cases[0]
    lease = Lease(token=1, attempt=1, out=str(tmp_path), case=case)
    inbox = queue.SimpleQueue()
    loading = begin_loading("cpu")
    rig = RigProcess(OPTIONS, structs.replace(lease, alone=alone), 1, inbox, loading)
    try:
        message = None
        while not isinstance(message, Built):
            _, message = inbox.get(timeout=PATIENCE_S)
            if isinstance(message, Listening):
                rig.start_stack(message.endpoint)
        expected = "/no/cpu" if alone else "/service"
        for child in (rig._simulator, rig._stack):
            variables = Path(f"/proc/{child.pid}/environ").read_bytes().split(b"\0")
            assert f"{PIPES_VARIABLE}={expected}".encode() in variables
        for loaded in (loading.simulator, loading.stack):
            assert (loaded.process.poll() is None) != alone
    finally:
        rig.stop()
