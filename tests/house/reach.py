"""How many product files a commit that adds a kind touches outside the kind's own folder.

``python tests/house/reach.py COMMIT...`` prints them beside their limits; exit code 1 beyond one.
What a commit adds is the beginning of its subject: ``Sensor:``, ``Scenario:``, ``KPI:`` or ``Batch
system:``. Its own folder is the one that was not there before; of several the largest. Product are
the packages and pyproject.toml; docs and tests do not count.
"""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PRODUCT = ("twin/", "devkit/", "conductor/", "viewer/", "schemas/", "hpc/", "pyproject.toml")
LIMITS = {"Sensor": 4, "Scenario": 2, "KPI": 2, "Perception variant": 2, "Batch system": 2}
"""Most files outside its own folder, by what a commit adds."""


@dataclass(frozen=True, slots=True)
class Reach:
    """What a commit touches."""

    subject: str
    kind: str
    own: str
    """The kind's own folder; empty: the commit makes none."""
    outside: list[str]
    """Product files outside it."""

    @property
    def kept(self) -> bool:
        """Whether the limit holds."""
        return len(self.outside) <= LIMITS[self.kind]


def reach(commit: str, root: Path = ROOT) -> Reach:
    """Look at a commit.

    Raises:
        ValueError: its subject does not say what it adds; one line.
        subprocess.CalledProcessError: there is no such commit.
    """
    subject = _git(root, "log", "-1", "--format=%s", commit).strip()
    kind = subject.partition(":")[0]
    if kind not in LIMITS:
        raise ValueError(f"{commit}: '{subject}' begins with none of {', '.join(LIMITS)}")
    # Without renames: the old and the new place are both touched.
    changed = _git(root, "show", "--no-renames", "--name-only", "--format=", commit).splitlines()
    product = [name for name in changed if name.startswith(PRODUCT)]
    before = _git(root, "ls-tree", "-r", "-d", "--name-only", f"{commit}^").splitlines()
    new = Counter(folder for name in product if (folder := _new_folder(name, {*before})))
    own = new.most_common(1)[0][0] if new else ""
    outside = [name for name in product if not own or not name.startswith(f"{own}/")]
    return Reach(subject, kind, own, outside)


def _new_folder(name: str, before: set[str]) -> str:
    """The outermost folder above a file that was not there; empty: all were."""
    parents = [folder.as_posix() for folder in reversed(Path(name).parents)][1:]
    return next((folder for folder in parents if folder not in before), "")


def _git(root: Path, *words: str) -> str:
    command = ["git", "-C", str(root), *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def main(commits: list[str]) -> int:
    """Print the reach of commits; the exit code."""
    if not commits:
        print("reach: give commits, e.g. HEAD", file=sys.stderr)
        return 2
    good = True
    for commit in commits:
        try:
            found = reach(commit)
        except subprocess.CalledProcessError as error:
            print(f"reach: {error.stderr.strip()}", file=sys.stderr)
            return 2
        except ValueError as error:
            print(f"reach: {error}", file=sys.stderr)
            return 2
        good &= found.kept
        verdict = "kept" if found.kept else "BROKEN"
        print(f"{commit[:12]}  {found.subject}")
        print(f"  own folder: {found.own or 'none'}")
        print(f"  outside: {len(found.outside)}, limit {LIMITS[found.kind]}: {verdict}")
        for name in found.outside:
            print(f"    {name}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
