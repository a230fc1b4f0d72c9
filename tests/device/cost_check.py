"""What the same bytes on every device cost: benches as shipped, and beside them the old arithmetic.

    PYTHONPATH=tests python tests/device/cost_check.py --device cuda:0 --out FOLDER

Runs the benches of cameras, LiDARs and vehicles in processes of their own, ``--rounds`` times in
alternation: as shipped, and with kernels as compilers like them (``loose/sitecustomize.py``). The
best of each counts, and a row per figure says what it loses. ``--campaign``: aeb-256 with networks,
two cameras and a LiDAR as well (part ``full`` of ``campaign_check.py``), whose time is a figure,
too. Kernels of both are compiled before anything is timed. Writes ``FOLDER/cost_check.json``. Exit
code 1: a figure loses more than ``--most`` percent.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
SHIPPED, LOOSE = "as shipped", "old arithmetic"
BENCHES = {"camera": ["--quick"], "lidar": [], "vehicle": []}


def environment(kind: str) -> dict[str, str]:
    """Environment of processes of a kind."""
    path = [str(HERE.parent)] if kind == SHIPPED else [str(HERE / "loose"), str(HERE.parent)]
    path += [str(HERE.parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path)}


def bench(name: str, device: str, kind: str) -> dict[str, float]:
    """Figures of a bench by name; more is better."""
    command = [sys.executable, "-m", "twin", "bench", name, "--device", device, "--output", "json"]
    done = subprocess.run(
        command + BENCHES[name], env=environment(kind), stdout=subprocess.PIPE, check=True
    )
    told: dict[str, Any] = json.loads(done.stdout)
    if name == "camera":
        # The Lambert picture is the bench's own beside its peer's; no sensor makes it.
        made = [p for p in told["pictures"] if p["picture"] != "lambert"]
        return {f"camera {p['picture']} [1/s]": p["frames_per_s"] for p in made}
    if name == "lidar":
        return {
            "lidar bare [rays/s]": told["bare_rays_per_s"],
            "lidar [rays/s]": told["rays_per_s"],
        }
    return {"vehicle [substeps/s]": told["substeps_per_s"]}


def campaign(device: str, kind: str, out: Path) -> dict[str, float]:
    """Simulated time per wall time of ``full``, by workers and slots."""
    folder = out / kind.replace(" ", "-")
    folder.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, str(HERE / "campaign_check.py"), "--device", device]
    command += ["--parts", "engine,full", "--out", str(folder)]  # engine: compiles kernels
    # Fingerprints of the old arithmetic may differ; that is what it is the old one for.
    subprocess.run(command, env=environment(kind), stdout=subprocess.DEVNULL, check=False)
    rows = json.loads((folder / "campaign_check.json").read_text())["full"]
    return {f"aeb-256 {name} [x real time]": row["real_time_factor"] for name, row in rows.items()}


def main() -> int:
    """Print what each figure loses; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--benches", default=",".join(BENCHES), help="which, with commas")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--campaign", action="store_true", help="aeb-256 as well")
    parser.add_argument("--most", type=float, default=5.0, help="loss that is allowed [%%]")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    best: dict[str, dict[str, float]] = {SHIPPED: {}, LOOSE: {}}

    def note(kind: str, figures: dict[str, float]) -> None:
        for name, value in figures.items():
            best[kind][name] = max(best[kind].get(name, 0.0), value)

    for name in filter(None, options.benches.split(",")):
        for _ in range(options.rounds):
            for kind in best:
                note(kind, bench(name, options.device, kind))
    if options.campaign:
        for kind in best:
            note(kind, campaign(options.device, kind, options.out))
    losses = {name: 100.0 * (1.0 - best[SHIPPED][name] / old) for name, old in best[LOOSE].items()}
    print(f"{'':34} {SHIPPED:>16} {LOOSE:>16}     loss")
    for name, loss in losses.items():
        print(f"{name:34} {best[SHIPPED][name]:16,.1f} {best[LOOSE][name]:16,.1f} {loss:+7.1f} %")
    told = {"device": options.device, "figures": best, "loss_percent": losses}
    (options.out / "cost_check.json").write_text(json.dumps(told, indent=1) + "\n")
    return 1 if any(loss > options.most for loss in losses.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
