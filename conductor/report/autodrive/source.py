"""A folder of AutoDRIVE logs, read against its configuration: which case has which log."""

from __future__ import annotations

import statistics
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from conductor.report.autodrive.layout import Instance, StudyConfig, read_config
from conductor.report.autodrive.logs import Log, read_log
from schemas.digest import digest
from schemas.escape import escape
from schemas.files.autodrive_log import log_name
from twin.base.errors import UsageError
from twin.records.autodrive_files import read_log_files

SHORT = 0.75
"""A log that lasts less than this share of its longer neighbours is much shorter; the published
ones last 0.9 of them at least."""
NAMED_MAX = 3
"""Most logs that a warning names."""
_UNTELLING = frozenset(("csv", "data", "log", "logs", "out", "output", "raw", "results"))
"""Names of folders that say nothing about what is in them."""


@dataclass(frozen=True, slots=True)
class StudyCase:
    """A case of the configuration."""

    batch: int
    instance: int
    described: Instance

    @property
    def file(self) -> str:
        """Log of the case."""
        return log_name(self.batch, self.instance)


@dataclass(slots=True)
class LogFolder:
    """What a folder of logs holds."""

    config: StudyConfig
    places: list[StudyCase]
    """Every case of the configuration, in its order."""
    logs: dict[tuple[int, int], Log] = field(default_factory=dict)
    """Logs by batch and instance; also those that could not be read, with the reason."""
    damaged: dict[int, str] = field(default_factory=dict)
    """Damage by batch: its folder or archive that could not be read to its end, and why."""
    notes: list[str] = field(default_factory=list)
    """What is no log of a case, or is damaged, a line each, escaped."""
    sha256: str = ""
    """SHA-256 over names and bytes of the configuration and every log that was read."""

    @property
    def kept(self) -> list[StudyCase]:
        """Cases of the batches of which something is there."""
        present = {batch for batch, _ in self.logs} | set(self.damaged)
        return [place for place in self.places if place.batch in present]

    def log_of(self, place: StudyCase) -> Log:
        """The log of a case; one that is not there says why."""
        log = self.logs.get((place.batch, place.instance))
        if log is not None:
            return log
        archive = self.damaged.get(place.batch)
        return Log(place.file, foreign=f"no such file; {archive}" if archive else "no such file")


def read_source(folder: Path) -> LogFolder:
    """Read the configuration and the logs in ``folder``.

    Raises:
        UsageError: there is no configuration, or no log of one of its cases that can be read; one
            line.
    """
    config, config_bytes = read_config(folder)
    size = config.batch_size
    places = [
        StudyCase(number // size + 1, number % size + 1, instance)
        for number, instance in enumerate(config.simulation_instances)
    ]
    source = LogFolder(config, places)
    by_place = {(place.batch, place.instance): place for place in places}
    for file in read_log_files(folder):
        known = by_place.get(file.place) if file.place else None
        if file.batch:
            source.damaged[file.batch] = f"{file.name}: {file.refused}"
        if known is None:
            reason = file.refused or "the configuration has no case for it"
            source.notes.append(f"{file.name}: {reason}")
            continue
        place = (known.batch, known.instance)
        before = source.logs.get(place)
        if before is not None:  # another file of the same name could not be read
            source.notes.append(f"{before.name}: {before.foreign}")
        if file.refused:
            source.logs[place] = Log(file.name, foreign=file.refused)
        else:
            source.logs[place] = read_log(file.name, file.data, known.described)
    if not any(log.sha256 for log in source.logs.values()):
        notes = [*source.notes, *(f"{x.name}: {x.foreign}" for x in source.logs.values())]
        also = f"; {notes[0]}" if notes else ""
        raise UsageError(
            f"{folder}: no log batch_N/aeb_metrics_sim_inst_M.csv of a case in its "
            f"configuration{also}"
        )
    digests = sorted((x.name, x.sha256) for x in source.logs.values() if x.sha256)
    parts = [config_bytes, *(f"{name}={sha256}".encode() for name, sha256 in digests)]
    source.sha256 = digest(parts)
    return source


def title(folder: Path) -> str:
    """Name of a folder for people: its own, after its parent's if its own says nothing, such as
    ``logs``."""
    folder = folder.resolve()
    names = [folder.name]
    if folder.name.lower() in _UNTELLING and folder.parent.name:
        names.insert(0, folder.parent.name)
    return escape("/".join(names))


def short_logs(logs: Iterable[Log]) -> list[str]:
    """A warning, if logs are much shorter than their neighbours; with a collision a log may end
    when it likes."""
    lengths = {log.name: log.rows[-1].time_us / 1e6 for log in logs if log.rows}
    open_ended = {log.name for log in logs if log.rows and not log.rows[-1].collisions}
    if len(lengths) < 2:
        return []
    usual_s = statistics.quantiles(lengths.values(), n=4, method="inclusive")[2]
    short = {n: s for n, s in lengths.items() if n in open_ended and s < SHORT * usual_s}
    if not short:
        return []
    named = ", ".join(list(short)[:NAMED_MAX])
    more = f" and {len(short) - NAMED_MAX} more" if len(short) > NAMED_MAX else ""
    span = f"{min(short.values()):.0f} to {max(short.values()):.0f} s"
    return [
        f"{len(short)} of {len(lengths)} logs are much shorter than their neighbours ({span}; "
        f"those last {usual_s:.0f} s) and look cut off: {named}{more}"
    ]
