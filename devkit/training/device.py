"""Device of a training, set up so that it does the same every time there."""

from __future__ import annotations

import contextlib
import os
import warnings
from collections.abc import Iterator

import torch

from twin.base.errors import UsageError
from twin.base.software import device_class


def prepare_device(name: str, threads: int) -> torch.device:
    """``cpu`` or ``cuda:N``; settings are of the whole process.

    Raises:
        UsageError: no such device here, or torch cannot use it.
    """
    device_class(name)  # refuses other names, and GPUs that are not there
    if name != "cpu" and not torch.cuda.is_available():
        raise UsageError(f"device '{name}': this torch has no CUDA; install one that has, or cpu")
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")
    torch.set_num_threads(threads)
    torch.backends.cudnn.benchmark = False
    # Only a warning: what torch has no fixed order for is used here where any order gives the same
    # (the largest of whole numbers, windows that do not overlap).
    torch.use_deterministic_algorithms(True, warn_only=True)
    torch.utils.deterministic.fill_uninitialized_memory = False  # type: ignore[attr-defined]
    warnings.filterwarnings("ignore", message=".*does not have a deterministic implementation.*")
    return torch.device(name)


@contextlib.contextmanager
def memory_errors() -> Iterator[None]:
    """Too little memory as one line; torch says it by a RuntimeError of many."""
    try:
        yield
    except RuntimeError as error:
        if "memory" not in str(error):
            raise
        words = str(error).splitlines()[0][:200]
        raise UsageError(
            f"training: not enough memory ({words}); give a smaller --batch or --size"
        ) from None
