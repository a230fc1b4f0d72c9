"""Import this first: Ctrl-C and SIGTERM while modules are still loading end the process, without a
traceback, and they load without being searched for garbage again and again.

:func:`twin.base.command.run` takes the signals over when everything is there.
"""

import atexit
import gc
import os
import signal

YOUNG_MAX = 10_000
"""Objects made before the young ones are looked at; Python's 700 are made for smaller programs."""

gc.set_threshold(YOUNG_MAX, 20, 20)
# The system takes all memory back at once: looking for cycles in it first takes 0.25 s of a report.
atexit.register(gc.freeze)

# CUDA and NVML must count the GPUs of a node alike: the device class names the GPU by NVML.
os.environ.setdefault("CUDA_DEVICE_ORDER", "PCI_BUS_ID")
signal.signal(signal.SIGINT, signal.SIG_DFL)


def _leave(*_: object) -> None:
    """75 is "unfinished": a job script takes it for a job that is to be queued again."""
    os.write(2, b"terminated; run the same command again to go on\n")
    os._exit(75)


signal.signal(signal.SIGTERM, _leave)
