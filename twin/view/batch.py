"""Samples for the recorder, gathered into few messages. No session, thread or clock."""

from __future__ import annotations

from schemas import SCHEMA_VERSION
from schemas.wire.codec import encode
from schemas.wire.view import RecorderBatch, RecorderSample

AGE_MAX_S = 0.25
"""How long a sample waits for others, at most; what a killed simulator's recordings lack [s]."""

BYTES_MAX = 256 << 10
"""Size from which on a batch waits no longer; below one that takes long to decode [bytes]."""

SAMPLE_BYTES = 512
"""Size that a sample counts for without its picture [bytes]."""
MOVER_BYTES = 64
"""Size that an object that moves adds to a sample [bytes]."""


class SampleBatch:
    """Samples that wait to be sent together."""

    def __init__(self) -> None:
        self._samples: list[RecorderSample] = []
        self._bytes = 0
        self._since_s = 0.0
        """Time at which the oldest sample came [s]."""

    def add(self, sample: RecorderSample, now_s: float) -> None:
        """Add a sample; ``now_s``: a clock that does not jump [s]."""
        if not self._samples:
            self._since_s = now_s
        self._samples.append(sample)
        movers = len(sample.state.movers) if sample.state is not None else 0
        self._bytes += SAMPLE_BYTES + MOVER_BYTES * movers + len(sample.jpeg)

    def left_s(self, now_s: float) -> float | None:
        """How long it may wait for more; 0: send it. None: there is nothing to be sent."""
        if not self._samples:
            return None
        if self._bytes >= BYTES_MAX:
            return 0.0
        return max(0.0, self._since_s + AGE_MAX_S - now_s)

    def take(self) -> bytes:
        """All of them as one message."""
        data = encode(RecorderBatch(v=SCHEMA_VERSION, samples=self._samples))
        self._samples, self._bytes = [], 0
        return data
