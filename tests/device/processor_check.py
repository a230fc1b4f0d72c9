"""Bytes of everything that computes on this processor, with and without AVX-512.

    PYTHONPATH=tests python tests/device/processor_check.py --out FOLDER

Runs the parts of ``bytes_check.py`` as this machine would, and once more with AVX-512 hidden from
all that chooses its code by processor: Warp's kernels (built for AVX2 and FMA), NumPy, OpenBLAS,
OpenCV and the C library; in caches of its own, so nothing is reused. Before that it proves that
each of them is hidden. Stacks run without their sandbox, which would keep these settings from
them. Prints what differs, or that all is equal. Half an hour on two cores, most of it compilers;
another call goes on behind the parts that are complete. Exit code 1: bytes differ; 2: this
processor has no AVX-512, or it cannot be hidden.
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
PARTS = "tables,division,vehicle,lidar,radar,pictures,campaigns"
GLIBC = ",".join(
    f"-{name}"
    for name in ("AVX512F", "AVX512DQ", "AVX512CD", "AVX512BW", "AVX512VL", "Prefer_No_VZEROUPPER")
)
PROOF = """
import hashlib, re
import cv2, numpy as np, warp as wp
from twin.world.kernel_cache import prepare_kernels

found = np.show_config(mode="dicts")["SIMD Extensions"]["found"]
usable = [word for word in cv2.getCPUFeaturesLine().split() if re.search("AVX512[^?]*$", word)]
exps = hashlib.sha256(np.exp(np.random.default_rng(11).normal(0, 2, 100_000)).tobytes())
prepare_kernels()
print([name for name in found if name.startswith(("X86_V4", "AVX512"))], usable,
      exps.hexdigest()[:8], wp.config.cpu_compiler_flags.split(" -mllvm")[0], sep="|")
"""
"""Prints what a process of the run sees of the processor."""


def hidden(folder: Path) -> dict[str, str]:
    """Environment of processes from which AVX-512 is hidden; their caches are in ``folder``."""
    path = [str(HERE / "narrow"), str(HERE.parent)]
    return {
        "PYTHONPATH": os.pathsep.join(path),
        "NPY_DISABLE_CPU_FEATURES": " ".join(numpy_sets()),
        "OPENBLAS_CORETYPE": "Haswell",
        "OPENCV_CPU_DISABLE": "AVX512-SKX",
        "GLIBC_TUNABLES": f"glibc.cpu.hwcaps={GLIBC}",
        **caches(folder),
    }


def caches(folder: Path) -> dict[str, str]:
    """Environment of processes that keep kernels and worlds in ``folder``."""
    return {"XDG_CACHE_HOME": str(folder / "cache"), "WARP_CACHE_PATH": str(folder / "warp")}


def numpy_sets() -> list[str]:
    """Instruction sets beyond AVX2 that NumPy finds here."""
    found = np.show_config(mode="dicts")["SIMD Extensions"]["found"]
    return [name for name in found if name.startswith(("X86_V4", "AVX512"))]


def proven(environment: dict[str, str]) -> list[str]:
    """What a process with this environment sees of the processor: NumPy's and OpenCV's sets beyond
    AVX2, digest of NumPy's exponentials, target of Warp."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", PROOF],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"processor_check: cannot look at the processor: {done.stderr[-500:]}")
    return done.stdout.strip().split("|")


def main() -> int:
    """Print a line per process, then what differs."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="Folder for digests and caches.")
    parser.add_argument("--parts", default=PARTS, help="As of bytes_check.py.")
    parser.add_argument("--share", type=float, default=0.05, help="Of its usual numbers.")
    options = parser.parse_args()
    out: Path = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    if platform.machine() != "x86_64" or not numpy_sets():
        print("processor_check: no AVX-512 on this processor: nothing to hide", file=sys.stderr)
        return 2
    places = {"wide": caches(out / "wide"), "narrow": hidden(out / "narrow")}
    seen = {name: proven(variables) for name, variables in places.items()}
    for name, words in seen.items():
        print(f"{name}: NumPy {words[0]}, OpenCV {words[1]}, exp {words[2]}, Warp {words[3]}")
    wide, narrow = seen.values()
    if narrow[:2] != ["[]", "[]"] or any(a == b for a, b in zip(wide, narrow, strict=True)):
        print("processor_check: AVX-512 is not hidden from all of them", file=sys.stderr)
        return 2
    differing = [
        part
        for part in options.parts.split(",")
        if any(ran(out, name, part, places[name], options.share) for name in places)
    ]
    print(f"DIFFER: {', '.join(differing)}" if differing else "equal with and without AVX-512")
    return 1 if differing else 0


def ran(out: Path, name: str, part: str, variables: dict[str, str], share: float) -> int:
    """Run a part as this machine would or with AVX-512 hidden, and compare the second.

    Returns:
        Exit code of ``bytes_check.py``.
    """
    folder = out / name / part
    print(f"{name}:", flush=True)
    words = [sys.executable, str(HERE / "bytes_check.py"), "--device", "cpu", "--out", str(folder)]
    words += ["--share", str(share), "--parts", "" if (folder / "bytes.json").exists() else part]
    words += ["--against", str(out / "wide" / part)] if name == "narrow" else []
    path = {"PYTHONPATH": str(HERE.parent)} | variables
    code = subprocess.run(words, env={**os.environ, **path}, check=False).returncode
    if not (folder / "bytes.json").exists():
        raise SystemExit(f"processor_check: {part} ended with {code}")
    return code


if __name__ == "__main__":
    sys.exit(main())
