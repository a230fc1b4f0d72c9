"""A second chance for tests that lost a race, which hides nothing.

``python tests/again.py make test`` runs the command. If at most three tests of it fail, these run
once more, alone: the command with ``ARGS=--last-failed``, in one process. A test that passes then
is printed as ``flaky: NAME``, and the exit code is 0 if all of them do. There is no second chance
where files were not collected, the tests were cut off, a process of theirs died, or one that failed
speaks of sameness: a result that differs once is wrong.

The tests' ends lie in pytest's cache, where :class:`Ends` puts them.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

MOST = 3
"""Most failed tests that run again."""
SAMENESS = re.compile(
    "byte|last_bit|digest|fingerprint|same|identical|golden|determin", re.IGNORECASE
)
"""What names of tests hold that compare results."""
ENDS = "again/ends"
"""Key of the cache: exit code of pytest, and names of the tests by how they ended."""
CACHE = Path(".pytest_cache/v")
CRASHED = "???"
"""Phase of a test whose process of pytest-xdist died."""


class Ends:
    """Plug-in of pytest that puts into its cache how every test ended."""

    def __init__(self) -> None:
        self.collected: set[str] = set()

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, ids: list[str]) -> None:
        """A process of pytest-xdist has told what it will run; each names all."""
        self.collected.update(ids)

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """What runs in this process."""
        self.collected.update(item.nodeid for item in session.items)

    def pytest_terminal_summary(
        self, terminalreporter: pytest.TerminalReporter, exitstatus: int, config: pytest.Config
    ) -> None:
        """The last lines of the output are written: all tests that were to end have ended."""
        by_end: dict[str, set[str]] = {"crashed": set()}
        for end, reports in terminalreporter.stats.items():
            for report in reports:
                if end and (name := getattr(report, "nodeid", None)):
                    crashed = getattr(report, "when", None) == CRASHED
                    by_end.setdefault("crashed" if crashed else end, set()).add(name)
        by_end["never ended"] = self.collected.difference(*by_end.values())
        tests = {end: sorted(names) for end, names in sorted(by_end.items())}
        assert config.cache is not None
        config.cache.set(ENDS, {"exit": int(exitstatus), "tests": tests})


def failed_tests(ends: dict[str, Any]) -> list[str]:
    """Names of those that failed, also before or after the test itself."""
    tests = ends["tests"]
    failed = (name for end in ("failed", "error", "crashed") for name in tests.get(end, ()))
    return sorted({*failed})


def refusal(ends: dict[str, Any] | None) -> str | None:
    """Why nothing runs again, in one line; None: it does."""
    if ends is None:
        return "pytest did not come to its end"
    failed = failed_tests(ends)
    if uncollected := [name for name in failed if "::" not in name]:
        return f"not collected: {', '.join(uncollected)}"
    if ends["exit"] != 1 or not failed:  # pytest's code of 'all ran, and some failed'
        return f"pytest ended with {ends['exit']}, not with tests that failed (1)"
    if cut_off := ends["tests"]["never ended"]:
        return f"{len(cut_off)} tests did not come to their end: {cut_off[0]}, ..."
    if len(failed) > MOST:
        return f"{len(failed)} tests failed; at most {MOST} run again"
    if crashed := ends["tests"]["crashed"]:
        return f"the process of a test died: {', '.join(crashed)}"
    if compared := [name for name in failed if SAMENESS.search(name)]:
        return f"results that must be the same are so at once: {', '.join(compared)}"
    return None


def main(command: list[str]) -> int:
    """Run ``command``, and what failed once more; the exit code of the first, or 0."""
    if not command:
        print("again: name the command, as in: python tests/again.py make test", file=sys.stderr)
        return 2
    for name in (ENDS, "cache/lastfailed"):  # nothing of earlier runs
        (CACHE / name).unlink(missing_ok=True)
    code = _run(command)
    if code == 0:
        return 0
    ends = _ends()
    if (reason := refusal(ends)) is not None:
        print(f"again: no second chance: {reason}", flush=True)
        return code
    assert ends is not None
    failed = failed_tests(ends)
    print(f"again: {len(failed)} failed and run once more, alone", flush=True)
    (CACHE / ENDS).unlink()
    _run([*command, "ARGS=--last-failed"])
    second = _ends() or {"tests": {}}
    lost = {*failed_tests(second)}
    passed = [name for name in failed if name in second["tests"].get("passed", ())]
    passed = [name for name in passed if name not in lost]  # not even after the test
    for name in failed:
        print(f"flaky: {name}" if name in passed else f"failed again: {name}", flush=True)
    return 0 if passed == failed else code


def _run(command: list[str]) -> int:
    code = subprocess.run(command, check=False).returncode
    return code if code >= 0 else 128 - code  # as a shell says that a signal ended it


def _ends() -> dict[str, Any] | None:
    """What the run that has just ended kept, if it came so far."""
    try:
        kept: dict[str, Any] = json.loads((CACHE / ENDS).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    return kept


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
