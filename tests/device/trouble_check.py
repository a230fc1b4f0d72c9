"""Checks on one device what a queue may bring; needs no test runner.

    PYTHONPATH=tests:tests/device python tests/device/trouble_check.py --device cuda:0 --out FOLDER

Parts (``--parts``): ``mixed``: campaigns of two stacks and two scenes, with four networks each, in
one queue of one worker have the fingerprints that each has alone. ``trouble``: of sixteen cases
that two workers simulate together one sends NaN, and one each crashes, hangs, takes all memory of
the GPU and writes where it must not: these end with a reason, the others have the bytes that they
have without them. Writes ``FOLDER/trouble_check.json``; exit code 1: something is otherwise.

On a CPU (``--device cpu``) it is the same with small pictures, a rehearsal.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from campaign_check import Check, full_campaign

from conductor.records.fingerprint import fingerprint
from conductor.records.outcomes import read_outcomes
from conductor.run.source import load

SHORT = {"ego_start_m": 40.0, "ego_speed_mps": 8.0, "duration_s": 2.0}
"""Two seconds; files of sensors and networks are the real ones."""
SLOTS = 8
STACK = "trouble_stack:TroubledStack"


def axes(count: int) -> dict[str, list[str]]:
    """Weathers and hours, ``count`` of each."""
    return {
        "weather": ["clear", "heavy_fog", "cloudy"][:count],
        "time_of_day": ["13:00", "19:00"][:count],
    }


def run_alone(check: Check, path: str, name: str, workers: str) -> tuple[Path, int]:
    """One campaign by `conductor run`; its folder and exit code."""
    out = check.out / "runs" / name
    where = ["--workers", workers] if not check.cpu else ["--workers", "2"]
    command = ["conductor", "run", path, "--out", str(out), "--slots", str(SLOTS), *where]
    with (check.out / f"{name}.log").open("w") as log:
        done = subprocess.run(command, stdout=log, stderr=log, check=False)
    return out, done.returncode


def mixed(check: Check) -> None:
    """One queue with campaigns that need other rigs."""
    plans: dict[str, dict[str, Any]] = {
        "downtown": {},
        "crossing": {"scenario": {**SHORT, "scene": "crossing"}},
        "other-stack": {"autonomy": {"stack": STACK, "parameters": {}}},
    }
    paths = {
        name: full_campaign(check, name, **{"scenario": SHORT, **plan, **axes(1)})
        for name, plan in plans.items()
    }
    alone = {}
    for name, path in paths.items():
        out, _ = run_alone(check, path, f"alone-{name}", "cuda")
        alone[name] = fingerprint(out).sha256
    state = check.out / "queue"
    server = subprocess.Popen(["conductor", "serve", "--state", str(state)])
    try:
        while not (state / "conductor.json").exists():
            time.sleep(0.05)
        for path in paths.values():
            subprocess.run(["conductor", "submit", path, "--state", str(state)], check=True)
        command = ["twin", "worker", "--state", str(state), "--until-done"]
        subprocess.run([*command, "--slots", "3", "--device", check.device], check=True)
    finally:
        server.send_signal(signal.SIGTERM)
        server.wait()
    together = {name: fingerprint(state / name).sha256 for name in paths}
    ended = [case.outcome for name in paths for case in read_outcomes(state / name).cases.values()]
    check.expect(f"all cases have verdicts: {ended}", holds=set(ended) == {"verdict"})
    check.found["mixed"] = {name: [alone[name][:16], together[name][:16]] for name in paths}
    check.expect(f"mixed queue: {check.found['mixed']}", holds=alone == together)
    check.expect("scenes differ", holds=alone["downtown"] != alone["crossing"])
    check.write()


def trouble(check: Check) -> None:
    """Cases that end their rig, beside others."""
    plan: dict[str, Any] = {"scenario": SHORT, **axes(2)}
    peaceful = full_campaign(check, "peace", **plan, autonomy={"parameters": {}})
    names = [case.id for case in load(peaceful).cases]
    kinds = ("nan", "crash", "hang", "memory", "fault")
    troubled = dict(zip(kinds, names[1::3], strict=True))
    autonomy = {"stack": STACK, "parameters": troubled}
    path = full_campaign(check, "troubled", **plan, autonomy=autonomy)
    data = json.loads(Path(path).read_text())
    Path(path).write_text(
        json.dumps({**data, "attempts_max": 1, "deadline_s": 20 if check.cpu else 8})
    )
    # Two workers of one GPU: what ends one's rig may end the other's.
    expected, _ = run_alone(check, peaceful, "peace", "2xcuda")
    found, code = run_alone(check, path, "troubled", "2xcuda")
    check.expect(f"exit code 3, not {code}", holds=code == 3)
    before, after = (read_outcomes(folder).cases for folder in (expected, found))
    said = {}
    for kind, name in troubled.items():
        case = after[name]
        said[kind] = [case.outcome, " ".join(case.reasons)[:200]]
        ended = "failed" if kind == "nan" else "unresolved"
        check.expect(f"{kind}: {said[kind]}", holds=case.outcome == ended)
    others = [name for name in names if name not in troubled.values()]
    changed = {
        name: [after[name].outcome, " ".join(after[name].reasons)[:200]]
        for name in others
        if not before[name].kpi_sha256 == after[name].kpi_sha256 != ""
    }
    check.found["trouble"] = {"said": said, "others": len(others), "changed": changed}
    check.expect(f"of {len(others)} others none is changed: {changed}", holds=not changed)
    check.write()


def main() -> None:
    """Run the parts and print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--parts", default="mixed,trouble", help="which, with commas")
    options = parser.parse_args()
    options.out = options.out.absolute()
    options.out.mkdir(parents=True, exist_ok=True)
    options.slots, options.cases, options.model = SLOTS, None, []
    check = Check(options)
    here = str(Path(__file__).parent)
    os.environ["PYTHONPATH"] = f"{here}:{os.environ.get('PYTHONPATH', '')}"
    for part in options.parts.split(","):
        started = time.monotonic()
        {"mixed": mixed, "trouble": trouble}[part](check)
        check.found[f"{part}_s"] = round(time.monotonic() - started, 1)
        check.write()
    (options.out / "campaign_check.json").rename(options.out / "trouble_check.json")
    print(json.dumps(check.found, indent=1))
    sys.exit(1 if check.found["differs"] else 0)


if __name__ == "__main__":
    main()
