"""Attacks of the stack under test, under each sandbox that its campaign can ask for."""

from __future__ import annotations

import json
import os
import shutil
import struct
import sys
import time
from pathlib import Path
from typing import Any

import psutil
import pyarrow.parquet as parquet
from attacks import Found, attack, refused_if
from bait import WORD, baited
from foreign_campaigns import campaign
from processes import keys_of, outcomes
from test_need_to_know_spy import SEED, read, spied
from theatre import Theatre

from schemas.autonomy import Autonomy

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


def run(theatre: Theatre, name: str, autonomy: dict[str, Any]) -> tuple[Path, str]:
    """Run two cases with a stack that finds our modules; the run folder, and what it printed."""
    places = [str(HERE), str(HERE.parent / "e2e"), str(HERE.parent)]
    before = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = ":".join([*places, before])
    os.environ["AWS_SECRET_ACCESS_KEY"] = WORD
    try:
        path = campaign(theatre.folder, name, autonomy, matrix={"weather": WEATHERS})
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
    """The list of ``cheating_stack.py``, each with what was seen."""
    reached, tried = [], 0
    for sandbox in sandboxes():
        name = f"cheat-{mode_of(sandbox)}".replace(" ", "-")
        targets = {
            "folder": str(theatre.folder / f"run-{name}"),
            "pid": os.getppid(),
            "secret": str(theatre.secret),
        }
        with baited(name, sandbox, **targets) as stack:
            _, said = run(theatre, name, stack)
        lines = [line for line in said.splitlines() if line.startswith("CHEAT ")]
        tried += len(lines)
        names = [line[6:].partition(":")[0] for line in lines if "REACHED" in line]
        reached += [f"{mode_of(sandbox)}: {name}" for name in names]
    if not tried:
        return Found("not run", "it was not tried")
    return refused_if(not reached, f"{tried} ways were tried in its sandbox", ", ".join(reached))


@attack(3, "reads keys, journal and environment", "stack in a container", "its user")
def from_a_container(theatre: Theatre) -> Found:
    """Needs a container runtime and an image."""
    runtime = next((name for name in ("apptainer", "podman") if shutil.which(name)), "")
    image = os.environ.get("REDTEAM_IMAGE", "")
    if not (runtime and image):
        return Found("not run", "needs apptainer or podman, and REDTEAM_IMAGE")
    probe = (
        "import os, glob; from pathlib import Path\n"
        f"p = [Path({str(theatre.folder)!r}), Path({str(theatre.folder / 'home')!r})]\n"
        "seen = [str(f) for x in p for f in x.rglob('*.key')]\n"
        "seen += [str(f) for x in p for f in x.rglob('conductor.db') if os.access(f, os.W_OK)]\n"
        f"seen += ['environment'] if {WORD!r} in os.environ.values() else []\n"
        "print('SEEN', seen, flush=True)\n"
    )
    script = theatre.write("probe.py", probe)
    stack = {"command": ["python3", str(script)], "container": image}
    _, said = run(theatre, "contained", stack)
    seen = [line for line in said.splitlines() if line.startswith("SEEN")]
    fine = bool(seen) and seen[0] == "SEEN []"
    return refused_if(fine, f"{runtime} shows it none", str(seen or said[-100:]))


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
