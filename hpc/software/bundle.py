"""``hpc bundle``: all that compute nodes without internet need, in one folder.

``wheels/`` and ``constraints.txt`` to install from, ``kernels/`` so that the first case need not
wait for a compiler, and ``install.sh``, which uses them. Warp names compiled kernels after the
instruction set or GPU generation they are for, so one folder serves nodes of several kinds, and a
node of a further kind compiles its own.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from hpc.software.wheels import LOCK_FILE, call, fill_wheels
from twin.base.errors import EXIT_FAILED, EXIT_PASS, UsageError
from twin.base.progress import steps

KERNEL_CAMPAIGN = "chaos-16"
"""A campaign that takes seconds and needs the kernels of vehicles, pictures and boxes."""


def install_script(python: str) -> str:
    """``install.sh``. Pure.

    Args:
        python: version that the wheels are for, e.g. ``3.12``.
    """
    return f"""\
#!/bin/sh
# Installs drivetwin without a network, from the folder in which this script lies.
#
# usage: [PYTHON=python{python}] ./install.sh [VENV]
#   VENV    folder of the new Python environment, on a file system that the nodes see;
#           default: drivetwin, here
#   PYTHON  the interpreter, version {python}; default: python{python}
# Kernels go to WARP_CACHE_PATH if that is set, else to Warp's usual cache in the home folder.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
venv=${{1:-drivetwin}}
python=${{PYTHON:-python{python}}}
if [ "$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')" != {python} ]; then
  echo "install.sh: $python is not Python {python}, for which these wheels are; set PYTHON" >&2
  exit 2
fi
if [ -e "$venv" ]; then
  echo "install.sh: $venv exists already; remove it or name another folder" >&2
  exit 2
fi
"$python" -m venv "$venv"
PIP_CONFIG_FILE=/dev/null "$venv/bin/python" -m pip install --quiet --disable-pip-version-check \\
  --no-index --find-links="$here/wheels" --constraint="$here/{LOCK_FILE}" drivetwin
if [ -d "$here/kernels" ]; then
  cache=${{WARP_CACHE_PATH:-${{XDG_CACHE_HOME:-$HOME/.cache}}/warp}}
  mkdir -p "$cache"
  cp -Ru "$here/kernels/." "$cache/"
fi
"$venv/bin/conductor" --version
echo "installed; next: $venv/bin/conductor run aeb-demo"
"""


def write_bundle(
    source: Path, out: Path, devices: Sequence[str], campaigns: Sequence[str] = ()
) -> None:
    """Write the folder ``out``, complete or not at all.

    Args:
        source: the project's checkout.
        out: new folder.
        devices: compile the kernels on these, e.g. ``cpu`` and ``cuda:0``; none: no kernels.
        campaigns: names or files; kernels and checked networks of the first case of each are added.

    Raises:
        UsageError: ``out`` exists, a campaign is not valid, or there are campaigns and no devices.
        InfrastructureError: pip failed, or the kernels cannot be compiled.
    """
    out = out.absolute()
    if out.exists():
        raise UsageError(f"{out}: exists already; remove it or choose another --out")
    if campaigns and not devices:
        raise UsageError("--campaign adds kernels, and --no-kernels leaves them out: choose one")
    for name in campaigns:  # before half a gigabyte is fetched
        check_campaign(name)
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent) as name:
        folder = Path(name) / out.name
        (folder / "wheels").mkdir(parents=True)
        fill_wheels(source, folder / "wheels")
        shutil.copy(source / LOCK_FILE, folder)
        for device in steps("devices with kernels", devices):
            compile_kernels(device, folder / "kernels", Path(name), campaigns)
        script = folder / "install.sh"
        script.write_text(install_script(f"{sys.version_info[0]}.{sys.version_info[1]}"))
        script.chmod(0o755)
        folder.rename(out)


def check_campaign(name: str) -> None:
    """Refuse a campaign that cannot be run; what is wrong is on stderr.

    Raises:
        UsageError: it is not valid.
    """
    words = [sys.executable, "-m", "conductor", "validate", name]
    if subprocess.run(words, stdout=subprocess.DEVNULL, check=False).returncode != EXIT_PASS:
        raise UsageError(f"--campaign {name}: not a valid campaign; see above what is wrong")


def compile_kernels(
    device: str, kernels: Path, scratch: Path, campaigns: Sequence[str] = ()
) -> None:
    """Run a short campaign with the kernel cache ``kernels``, and a case of each of ``campaigns``:
    what they compile is what cases need, and networks that were found good are noted beside it.

    Raises:
        InfrastructureError: a run failed.
    """
    runs = [[KERNEL_CAMPAIGN, "--slots", "4"], *([name, "--cases", "1"] for name in campaigns)]
    for number, run in enumerate(runs):
        words = [sys.executable, "-m", "conductor", "run", *run, "--workers", "1"]
        out = scratch / f"run-{device.replace(':', '-')}-{number}"
        call(
            [*words, "--device", device, "--out", str(out)],
            f"compiling kernels of {run[0]} on {device}",
            environment={**os.environ, "WARP_CACHE_PATH": str(kernels)},
            allowed=(EXIT_PASS, EXIT_FAILED),
        )
