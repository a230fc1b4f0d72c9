"""Which campaigns were begun anew: their tokens start again, and may be lower than those seen."""

from __future__ import annotations

from schemas.wire.status import ConductorStatus


class Renewal:
    """Compares one status of the conductor with the one before."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[str, int, int]] = {}

    def status(self, found: ConductorStatus) -> list[str]:
        """Campaigns that are no longer those of the same name in the status before.

        In one folder neither the conductor's epoch nor the number of attempts ever falls.
        """
        renewed = []
        for name, row in found.get("campaigns", {}).items():
            now = (row.get("out", ""), found.get("epoch", 0), row.get("attempts", 0))
            out, epoch, attempts = self._seen.get(name, now)
            if now[0] != out or now[1] < epoch or now[2] < attempts:
                renewed.append(name)
            self._seen[name] = now
        return renewed
