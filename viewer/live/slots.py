"""Latest-only slots: whoever is late sees the newest, and memory stays bounded."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from twin.fabric.bus import Sample

KEYS_MAX = 4096
"""Keys that wait at the same time; further keys are left out until these are taken."""


@dataclass(slots=True)
class SampleCounters:
    """Counts of what became of the samples."""

    received: int = 0
    overwritten: int = 0
    refused: int = 0
    """Left out, because too many keys were waiting."""


class LatestSlots:
    """One slot per key; written by the session's threads, emptied by one."""

    def __init__(self, keys_max: int = KEYS_MAX) -> None:
        self.counters = SampleCounters()
        self._keys_max = keys_max
        self._latest: dict[str, Sample] = {}
        self._lock = threading.Lock()

    def put(self, sample: Sample) -> None:
        """Keep ``sample``, forget the key's older one."""
        with self._lock:
            self.counters.received += 1
            if sample.key in self._latest:
                self.counters.overwritten += 1
                del self._latest[sample.key]  # the newest come last
            elif len(self._latest) >= self._keys_max:
                self.counters.refused += 1
                return
            self._latest[sample.key] = sample

    def take(self) -> list[Sample]:
        """All samples that wait, in the order of their arrival."""
        with self._lock:
            samples = list(self._latest.values())
            self._latest.clear()
        return samples
