"""What runs an ONNX network: OpenCV, or ONNX Runtime if it is installed.

On the CPU both give every image of a batch the same bits whatever the batch and the number of
threads (``test_detector.py``); between them results differ by rounding, so the choice is part of
what a result depends on. Measured on one core, ONNX Runtime 1.31 takes 0.45 to
0.5 of the time of OpenCV 5.0 for the quarter-width networks.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, Protocol

import cv2
import numpy as np

from twin.base.errors import UsageError

RuntimeName = Literal["opencv", "onnxruntime"]


class ModelError(UsageError):
    """A model file cannot be used; one line that names the file."""


class Runtime(Protocol):
    """A loaded network."""

    name: str
    """Name for people."""
    outputs: list[str]
    """Names of all its outputs."""

    def forward(self, blob: np.ndarray) -> dict[str, np.ndarray]:
        """float32 [N, 3, height, width] -> name -> array."""
        ...


def open_runtime(name: RuntimeName, path: Path, model: Any, input_name: str) -> Runtime:
    """Load ``model``, an ``onnx.ModelProto``, that was read from ``path``.

    Raises:
        ModelError: the runtime cannot run it, or is not installed; one line naming the file.
    """
    kinds: dict[str, Callable[[Path, Any, str], Runtime]] = {
        "opencv": OpenCv,
        "onnxruntime": OnnxRuntime,
    }
    if name not in kinds:
        raise ModelError(f"{path}: runtime '{name}', allowed: {', '.join(kinds)}")
    return kinds[name](path, model, input_name)


class OpenCv:
    """``cv2.dnn``; threads by :func:`cv2.setNumThreads`."""

    name = "opencv"

    def __init__(self, path: Path, model: Any, input_name: str) -> None:
        """See :func:`open_runtime`."""
        self._path = path
        self._input = input_name
        self._operators = sorted({node.op_type for node in model.graph.node})
        with self._quiet():
            data = np.frombuffer(model.SerializeToString(), np.uint8)
            self._net = cv2.dnn.readNetFromONNX(data)
            self.outputs = list(self._net.getUnconnectedOutLayersNames())

    def forward(self, blob: np.ndarray) -> dict[str, np.ndarray]:
        """See :class:`Runtime`."""
        with self._quiet():
            self._net.setInput(blob, self._input)
            arrays = self._net.forward(self.outputs)
        return dict(zip(self.outputs, arrays, strict=True))

    @contextmanager
    def _quiet(self) -> Iterator[None]:
        """OpenCV's errors as one line about the file; its own log stays silent meanwhile."""
        level = cv2.utils.logging.getLogLevel()
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        try:
            yield
        except cv2.error as error:
            raise _refusal(self._path, "OpenCV", error.err or error, self._operators) from None
        finally:
            cv2.utils.logging.setLogLevel(level)


class OnnxRuntime:
    """ONNX Runtime's CPU provider."""

    name = "onnxruntime"

    def __init__(self, path: Path, model: Any, input_name: str) -> None:
        """See :func:`open_runtime`."""
        self._path = path
        self._model = model
        self._input = input_name
        self._session = open_session(path, model, "cpu")
        self.outputs = [output.name for output in self._session.get_outputs()]

    def forward(self, blob: np.ndarray) -> dict[str, np.ndarray]:
        """See :class:`Runtime`."""
        with refusals(self._path, "ONNX Runtime", self._model):
            arrays = self._session.run(self.outputs, {self._input: blob})
        return dict(zip(self.outputs, arrays, strict=True))


CPU, CUDA = "CPUExecutionProvider", "CUDAExecutionProvider"

CUDA_OPTIONS = {"cudnn_conv_algo_search": "HEURISTIC", "use_tf32": "0"}
"""cuDNN's rules choose the algorithms, by shapes and the kind of GPU; a search for the fastest
would end differently on another day. Whole float32. Both are what a result depends on."""


def provider_of(path: Path, device: str) -> str:
    """What of ONNX Runtime computes on ``device``.

    Raises:
        ModelError: not installed, or it has no such thing; one line.
    """
    try:
        import onnxruntime
    except ModuleNotFoundError:
        raise ModelError(
            f"{path}: onnxruntime is not installed; install it, or choose opencv"
        ) from None
    provider = CUDA if device.startswith("cuda") else CPU
    if provider not in onnxruntime.get_available_providers():
        raise ModelError(
            f"{path}: this onnxruntime has no {provider}; install onnxruntime-gpu in its place,"
            " or choose opencv"
        )
    return provider


def load_libraries() -> None:
    """Load CUDA's libraries for ONNX Runtime from where pip puts them; again: nothing happens."""
    import onnxruntime

    with contextlib.redirect_stdout(sys.stderr):  # it prints what it does not find
        onnxruntime.preload_dlls()


def open_session(path: Path, model: Any, device: str, queue: int = 0) -> Any:
    """An ONNX Runtime session on ``cpu`` or ``cuda:N``, with as many threads on the CPU as OpenCV
    has now.

    ``queue``: CUDA stream that it works in; 0: one of its own.

    Raises:
        ModelError: not installed, no such device for it, or it cannot run the model; one line.
    """
    provider = provider_of(path, device)
    import onnxruntime

    onnxruntime.set_default_logger_severity(4)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = cv2.getNumThreads()
    options.log_severity_level = 4
    providers: list[Any] = [CPU]
    if provider == CUDA:
        load_libraries()
        chosen = {"device_id": device.partition(":")[2], **CUDA_OPTIONS}
        if queue:
            chosen["user_compute_stream"] = str(queue)
        providers.insert(0, (CUDA, chosen))
    with refusals(path, "ONNX Runtime", model):
        session = onnxruntime.InferenceSession(
            model.SerializeToString(),
            options,
            providers=providers,
            # Never on by itself with another device, whose last bits are others.
            enable_fallback=0,
        )
    if session.get_providers()[0] != provider:
        raise ModelError(
            f"{path}: ONNX Runtime cannot use {device}: CUDA or cuDNN of the version that it needs"
            " is not here; install onnxruntime-gpu[cuda,cudnn], or choose opencv"
        )
    return session


@contextmanager
def refusals(path: Path, who: str, model: Any) -> Iterator[None]:
    """Errors of ``who``, a library whose exceptions have no common base, as one line."""
    try:
        yield
    except ModelError:
        raise
    except Exception as error:
        operators = sorted({node.op_type for node in model.graph.node})
        raise _refusal(path, who, error, operators) from None


def _refusal(path: Path, who: str, error: object, operators: Sequence[str]) -> ModelError:
    """An error in one line; the operators of the model that it speaks of come first."""
    text = str(error)
    blamed = [name for name in operators if name in text]
    about = f"operator {', '.join(blamed)}: " if blamed else ""
    # OpenCV says this of an operator that it does not have, amid four lines of its own innards.
    unknown = bool(blamed) and "Can't create layer" in text
    reason = "it has no such operator" if unknown else first_line(text)
    return ModelError(f"{path}: {who} cannot run it: {about}{reason}")


def first_line(error: object) -> str:
    """The first line that says something, cut to a readable length."""
    line = next((part.strip() for part in str(error).splitlines() if part.strip()), "")
    return line if len(line) <= 200 else f"{line[:197]}..."
