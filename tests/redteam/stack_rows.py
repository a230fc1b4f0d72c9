"""Attacks of the stack under test, under each sandbox that its campaign can ask for."""

from __future__ import annotations

import json
import os
import struct
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import pyarrow.parquet as parquet
from attacks import Found, attack, refused_if
from bait import WORD, baited
from container_images import missing, python_folders, shell_image
from foreign_campaigns import campaign
from processes import keys_of, outcomes
from test_need_to_know_spy import SEED, read, spied
from theatre import Theatre

from hpc.software.container import COMMANDS
from schemas.sections.autonomy import Autonomy

HERE = Path(__file__).parent
MODES = ("default", "strict")
DAEMON = "import time; time.sleep(616)"
WEATHERS = ["clear", "heavy_fog"]


def sandboxes() -> list[dict[str, Any]]:
    """Sections of a campaign, one for each kind of sandbox; an empty one where there is none."""
    known = "sandbox" in Autonomy.__struct_fields__
    return [{"sandbox": mode} for mode in MODES] if known else [{}]


def mode_of(sandbox: dict[str, Any]) -> str:
    """In words."""
    return str(sandbox.get("sandbox", "no sandbox"))


def run(theatre: Theatre, name: str, autonomy: dict[str, Any], cases: int = 2) -> tuple[Path, str]:
    """Run cases with a stack that finds our modules; the run folder, and what it printed."""
    places = [str(HERE), str(HERE.parent / "e2e"), str(HERE.parent)]
    before = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = ":".join([*places, before])
    os.environ["AWS_SECRET_ACCESS_KEY"] = WORD
    try:
        matrix = {"weather": WEATHERS, "repeat": list(range(cases // len(WEATHERS)))}
        path = campaign(theatre.folder, name, autonomy, matrix=matrix)
        out = theatre.folder / f"run-{name}"
        done = theatre.marked.run(
            *("conductor", "run", str(path), "--workers", "1", "--slots", "1", "--out", str(out))
        )
    finally:
        os.environ["PYTHONPATH"] = before
        del os.environ["AWS_SECRET_ACCESS_KEY"]
    if done.returncode not in (0, 1, 3):
        raise AssertionError(done.stderr[-2000:])
    logs = [path.read_text() for path in sorted(out.glob("cases/*/attempt-*/log.txt"))]
    return out, "".join(logs)


@attack(1, "commits its own verdict", "stack under test", "its user")
def commits_its_own_verdict(theatre: Theatre) -> Found:
    """It drives into the obstacle; is any case passed?"""
    told = []
    for sandbox in sandboxes():
        name = f"forged-{len(told)}"
        state = theatre.folder / f"run-{name}"
        targets = {"state": str(state), "keys": str(keys_of(state)), "campaign": name}
        parameters = {"targets": json.dumps(targets)}
        stack = {"stack": "forging_stack:ForgingStack", "parameters": parameters, **sandbox}
        out, said = run(theatre, name, stack)
        verdicts = sorted(str(case["verdict"]) for case in outcomes(out).values())
        tried = [line for line in said.splitlines() if line.startswith(("FORGED", "STOPPED"))]
        if "pass" in verdicts:
            return Found("open", f"{mode_of(sandbox)}: verdicts {', '.join(verdicts)}")
        if not tried:
            return Found("not run", f"{mode_of(sandbox)}: it was not tried: {said[-100:]!r}")
        told.append(f"{mode_of(sandbox)}: {tried[0].partition('(')[0].lower()}")
    return Found("refused", f"verdicts stay collisions ({'; '.join(told)})")


@attack(1, "files, ports, /proc, signals, shared memory, disk", "stack under test", "its user")
def cheats_in_every_way(theatre: Theatre) -> Found:
    """The list of ``cheating_stack.py`` in every case; and do they come out as without it?"""
    reached, tried = [], 0
    honest = _kpis(run(theatre, "honest", {}, theatre.cases)[0])
    for sandbox in sandboxes():
        name = f"cheat-{mode_of(sandbox)}".replace(" ", "-")
        targets = {
            "folder": str(theatre.folder / f"run-{name}"),
            "pid": os.getppid(),
            "secret": str(theatre.secret),
        }
        with baited(name, sandbox, **targets) as stack:
            out, said = run(theatre, name, stack, theatre.cases)
        if _kpis(out) != honest:
            reached.append(f"{mode_of(sandbox)}: what was measured in its cases")
        lines = [line for line in said.splitlines() if line.startswith("CHEAT ")]
        tried += len(lines)
        names = [line[6:].partition(":")[0] for line in lines if "REACHED" in line]
        reached += [f"{mode_of(sandbox)}: {name}" for name in names]
    if not tried:
        return Found("not run", "it was not tried")
    by = f"{tried} tries in {len(sandboxes()) * theatre.cases} cases, in its sandbox"
    return refused_if(not reached, by, ", ".join(reached))


def _kpis(out: Path) -> dict[str, tuple[str, str]]:
    """Verdict and KPI digest by case."""
    return {
        name: (str(case["verdict"]), str(case["kpi_sha256"]))
        for name, case in outcomes(out).items()
    }


@attack(3, "reads keys, journal and environment", "stack in a container", "its user")
def from_a_container(theatre: Theatre) -> Found:
    """An image that is shown the system and this Python, and asks for the run's folder as well."""
    runtime = next((name for name, word in COMMANDS.items() if not missing(word)), "")
    if runtime not in ("apptainer", "charliecloud"):
        return Found("not run", missing("apptainer", "ch-run"))
    script = theatre.write("probes/probe.py", PROBE)
    root = str(shell_image(theatre.folder / "image"))
    said = []
    for number, sandbox in enumerate(sandboxes()):
        image = {"path": root, "runtime": runtime, "binds": [*python_folders(), str(script.parent)]}
        words = [sys.executable, str(script), str(theatre.folder), WORD]
        _, log = run(theatre, f"contained-{number}", {"command": words, "image": image, **sandbox})
        seen = sorted({line for line in log.splitlines() if line.startswith("SEEN")})
        if not seen:
            return Found("not run", f"{mode_of(sandbox)}: it was not tried: {log[-200:]!r}")
        if seen != ["SEEN []"]:
            return Found("open", f"{mode_of(sandbox)}: {'; '.join(seen)[:300]}")
        said.append(mode_of(sandbox))
    return Found("refused", f"{runtime} in the sandbox shows it none ({', '.join(said)})")


PROBE = """
import os, sys
from pathlib import Path

here, word = Path(sys.argv[1]), sys.argv[2]
seen = [str(path) for path in here.rglob("*.key") if os.access(path, os.R_OK)]
seen += [str(path) for path in here.rglob("conductor.db") if os.access(path, os.R_OK)]
seen += [str(path) for path in here.rglob("outcomes.json") if os.access(path, os.W_OK)]
seen += ["environment"] if word in os.environ.values() else []
print("SEEN", seen, flush=True)
"""
"""A command that looks for what it must not have: what it found is printed."""


LEAVES = """
import os, signal, subprocess, sys
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        os.execve(sys.executable, [sys.executable, "-c", {daemon!r}], {{}})
    os._exit(0)
os.kill(os.getppid(), signal.SIGKILL)
signal.pause()
"""


@attack(12, "leaves a daemon and kills who watches it", "stack under test", "its user")
def daemon_that_stays(theatre: Theatre) -> Found:
    """Does anything live on when the run has ended?"""
    for number, sandbox in enumerate(sandboxes()):
        word = f"{DAEMON}  # {os.getpid()}-{number}"
        script = theatre.write(f"leaves-{number}.py", LEAVES.format(daemon=word))
        command = {"command": [sys.executable, str(script)], **sandbox}
        run(theatre, f"left-{number}", command)
        until_s = time.monotonic() + 5
        while (left := _with(word)) and time.monotonic() < until_s:
            time.sleep(0.1)
        for process in left:
            process.kill()
        if left:
            return Found("open", f"{mode_of(sandbox)}: {len(left)} processes lived on")
    return Found("contained", "what it started ends with the attempt")


def _with(word: str) -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter(["cmdline"]):
        if word in (process.info["cmdline"] or []):
            found.append(process)
    return found


@attack(13, "subscribes to truth: boxes, name, seed", "stack under test", "its rig")
def listens_for_truth(theatre: Theatre) -> Found:
    """A stack for a network writes down everything that reaches it; so it has no sandbox."""
    path, notes = spied(theatre.folder, {"sandbox": "off"})
    out = theatre.folder / "spied"
    done = theatre.marked.run(*("conductor", "run", str(path), "--workers", "1", "--out", str(out)))
    entries = read(notes) if notes.exists() else []
    if not entries:
        return Found("not run", f"it was not tried: {done.stderr[-100:]!r}")
    ((name, case),) = outcomes(out).items()
    leaked = set()
    for entry in entries[1:]:
        words = entry["payload"] + entry["attachment"] if "attachment" in entry else b""
        kind = entry["key"].rpartition("/")[2]
        if kind != "camera" and (name.encode() in words or struct.pack("<q", SEED) in words):
            leaked.add(f"name or seed by {kind}")
        if kind == "boxes" and any(entry["payload"]):
            leaked.add("distances by boxes")
    rows = parquet.read_table(out / str(case["attempt_dir"]) / "kpi.parquet").num_rows
    return refused_if(
        not leaked and rows > 0,
        "boxes are empty, name and seed opaque",
        ", ".join(sorted(leaked)),
    )


@attack(16, "writes 600 MB into its run folder", "stack under test", "its user")
def fills_the_disk(theatre: Theatre) -> Found:
    """How much lies there when the run has ended."""
    source = (
        "import sys\n"
        "print('FILLS', flush=True)\n"
        "try:\n"
        "    for n in range(600): open(sys.argv[1], 'ab').write(bytes(10**6))\n"
        "except OSError as error: print(error, flush=True)\n"
        "print('FILLED', flush=True)\n"
    )
    script = theatre.write("fills.py", source)
    for number, sandbox in enumerate(sandboxes()):
        out = theatre.folder / f"run-filled-{number}"
        command = {"command": [sys.executable, str(script), str(out / "filling")], **sandbox}
        _, said = run(theatre, f"filled-{number}", command)
        if "FILLED" not in said:
            return Found("not run", f"{mode_of(sandbox)}: it was not tried: {said[-200:]!r}")
        filled = sum(path.stat().st_size for path in out.rglob("filling")) / 1e6
        if filled > 300:
            return Found("open", f"{mode_of(sandbox)}: {filled:.0f} MB lie there")
    return Found("contained", "its scratch has a quota, and the run folder is not there")
