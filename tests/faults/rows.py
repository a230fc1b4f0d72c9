"""The rows of the table: each fault by itself, and storms of many."""

from __future__ import annotations

import importlib
import shutil
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from fabric import fabric
from injection import Injector, Outcome, Plan
from kinds import FAULTS
from ledger import Quiet, count

for _module in ("process_faults", "network_faults", "host_faults", "store_faults"):
    importlib.import_module(_module)  # which fills the table, in this order

STORM = "storm"
STORM_INJECTIONS = 60
STORM_PAUSE_S = (0.2, 1.2)
STORM_WORKERS = 2


@dataclass(frozen=True, slots=True)
class Run:
    """One fabric's worth of a row."""

    row: str
    """Name of a fault, or :data:`STORM`."""
    number: int
    times: int

    @property
    def name(self) -> str:
        """For files."""
        spelled = self.row.replace("%", "percent").replace("of -", "of minus ")
        words = "".join(c if c.isalnum() else "-" for c in spelled)
        return f"{words.strip('-')}-{self.number}"

    @property
    def extras(self) -> frozenset[str]:
        """What its fabric needs."""
        return frozenset() if self.row == STORM else FAULTS[self.row].extras

    def plan(self) -> Plan:
        """What is done to its fabric."""
        if self.row == STORM:
            stormy = tuple(fault for fault in FAULTS.values() if fault.stormy)
            return Plan(stormy, self.times, self.number, STORM_PAUSE_S)
        return Plan((FAULTS[self.row],), self.times, self.number)


def runs(times: int, storms: int, only: list[str]) -> list[Run]:
    """All runs of the table; ``only`` names rows, all if empty."""
    single = [Run(name, 0, times) for name in FAULTS if not only or name in only]
    stormy = [Run(STORM, number, STORM_INJECTIONS) for number in range(storms)]
    return single + (stormy if not only or STORM in only else [])


def carry_out(run: Run, folder: Path, quiet: Quiet) -> Outcome:
    """Do one run in ``folder``, which is new; its logs and fault journal stay there."""
    began_s = time.monotonic()
    workers = STORM_WORKERS if run.row == STORM else 1
    with fabric(folder, run.extras, workers) as made:
        with (folder / "faults.jsonl").open("w") as journal:
            injector = Injector(made, run.plan(), journal)
            ended = injector.run()
        made.end()
        found = count(made.state, len(made.campaigns), quiet)
        if not ended or found.lost or found.doubled or found.wrong:
            shutil.copytree(made.state, folder / "state", dirs_exist_ok=True)
    return Outcome(
        row=run.row,
        seed=run.number,
        injected=dict(sorted(injector.injected.items())),
        recoveries_s=[round(s, 3) for _, s in injector.recoveries_s()],
        ended=ended,
        wall_s=round(time.monotonic() - began_s, 1),
        **asdict(found),
    )
