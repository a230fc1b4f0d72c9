"""What ``conductor run`` says on the terminal of cases that have failed: the reason, the last
frames of a traceback, and where the rest is."""

from __future__ import annotations

from pathlib import Path

from conductor.records.attempts import LOG_FILE, attempt_file
from conductor.records.outcomes import CaseOutcome, Outcomes
from schemas.escape import escape
from twin.base.errors import TwinError
from twin.base.process import last_frames

GROUPS_MAX = 3
"""Most different reasons that are told."""

FRAME_LINES_MAX = 8
"""Most lines of a traceback, counted from its end."""

LINE_CHARS_MAX = 300
"""Longest line that is shown [characters]."""

LOG_BYTES_MAX = 1 << 20
"""What is read of the end of a log; one of ours is shorter [bytes]."""


def told(folder: Path, outcomes: Outcomes) -> list[str]:
    """Lines about the cases that ended as ``failed`` or ``unresolved``, one group per reason.

    Args:
        folder: of the campaign.
        outcomes: how its cases ended.
    """
    groups: dict[tuple[str, str], list[str]] = {}
    for name, case in outcomes.cases.items():
        if case.outcome in ("failed", "unresolved"):
            reason = next(iter(case.reasons), "")
            groups.setdefault((case.outcome, reason), []).append(name)
    lines: list[str] = []
    for (outcome, reason), names in list(groups.items())[:GROUPS_MAX]:
        more = f" (and {len(names) - 1} more)" if len(names) > 1 else ""
        lines.append(escape(f"{names[0]}{more} {outcome}: {reason}", LINE_CHARS_MAX))
        lines += _seen_in_log(folder, names[0], outcomes.cases[names[0]])
    left = sum(map(len, list(groups.values())[GROUPS_MAX:]))
    if left:
        lines.append(f"{left} more cases failed for {len(groups) - GROUPS_MAX} other reasons")
    return lines


def _seen_in_log(folder: Path, name: str, case: CaseOutcome) -> list[str]:
    """The last frames in the log of a case's last attempt, and its path."""
    log = _log_of(folder, name, case)
    if log is None:
        return []
    frames = last_frames(_end_of(log))[-FRAME_LINES_MAX:]
    shown = [f"  {escape(line, LINE_CHARS_MAX)}" for line in frames]
    return [*shown, f"  log: {log}"]


def _log_of(folder: Path, name: str, case: CaseOutcome) -> Path | None:
    """The log of the committed attempt, or of the last one that left any."""
    last = [case.attempt] if case.attempt else range(case.attempts, 0, -1)
    for attempt in last:
        try:
            log = attempt_file(folder, f"cases/{name}/attempt-{attempt}", LOG_FILE)
        except TwinError:  # a link that leads elsewhere
            continue
        if log.is_file():
            return log
    return None


def _end_of(log: Path) -> str:
    try:
        with log.open("rb") as file:
            file.seek(max(0, log.stat().st_size - LOG_BYTES_MAX))
            return file.read(LOG_BYTES_MAX).decode("utf-8", "replace")
    except OSError:
        return ""
