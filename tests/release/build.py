"""Builds a release: sdist and wheel of ``drivetwin``, wheel of ``drivetwin-worker``, a list of what
an installation consists of (CycloneDX), and the SHA-256 of all of them.

The wheel is built from the sdist, so what is missing there is missing here too. The same tree gives
the same bytes: times in the archives are those of ``SOURCE_DATE_EPOCH``, or a constant of the build
backend.

``python -m release.build [--out dist]``
"""

from __future__ import annotations

import argparse
import hashlib
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from release.environment import make_environment
from release.worker import write_tree

ROOT = Path(__file__).parents[2]
SUMS = "SHA256SUMS"


def build(root: Path, out: Path) -> list[Path]:
    """Build everything of the tree ``root`` into the folder ``out``.

    Returns:
        the files, sorted.

    Raises:
        CalledProcessError: the build backend failed; its words stand on stderr.
    """
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="release-") as name:
        made, tree = Path(name) / "made", Path(name) / "tree"
        call_build(root, made)
        write_tree(root, tree)
        call_build(tree, made, "--wheel")
        wheel = next(made.glob("drivetwin-*.whl"))
        write_sbom(root, wheel, made / f"{wheel.name.rpartition('-py3')[0]}.cdx.json")
        archives = []
        for path in sorted(made.iterdir()):
            # Not renamed: the folder of temporary files may lie on another file system.
            archives.append(Path(shutil.move(path, out / path.name)))
    sums = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in archives]
    (out / SUMS).write_text("".join(sums))
    return archives


def call_build(source: Path, out: Path, *options: str) -> None:
    """Build an sdist and from it a wheel, or what ``options`` say, with the backend that is
    installed here."""
    words = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(out), *options]
    subprocess.run([*words, str(source)], check=True, stdout=sys.stderr.fileno())


def write_sbom(root: Path, wheel: Path, out: Path) -> None:
    """Write what an installation of a wheel consists of, as a CycloneDX file without a time."""
    with tempfile.TemporaryDirectory(prefix="release-") as name:
        python = make_environment(wheel, Path(name) / "environment")
        words = [sys.executable, "-m", "cyclonedx_py", "environment", str(python)]
        words += ["--pyproject", str(root / "pyproject.toml"), "--output-reproducible"]
        subprocess.run([*words, "--of", "JSON", "-o", str(out)], check=True)


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    arguments = parser.parse_args()
    for path in build(ROOT, arguments.out):
        print(f"{path.stat().st_size / 1e6:6.1f} MB  {path}")


if __name__ == "__main__":
    main()
