"""Import this first: Ctrl-C while modules are still loading ends the process, without a traceback.

:func:`twin.fabric.cli.run` takes the signal over when everything is there.
"""

import os
import signal

# CUDA and NVML must count the GPUs of a node alike: the device class names the GPU by NVML.
os.environ.setdefault("CUDA_DEVICE_ORDER", "PCI_BUS_ID")
signal.signal(signal.SIGINT, signal.SIG_DFL)
