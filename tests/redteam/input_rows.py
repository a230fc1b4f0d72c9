"""Attacks by files that somebody sends: campaigns, links, pipes, meshes."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

from attacks import Found, attack, refused_if
from theatre import Theatre

READS_S = 60.0
"""A file is read, or refused, within this time."""


def validated(theatre: Theatre, path: Path) -> str:
    """What is wrong with how ``conductor validate`` refuses a file; empty: nothing."""
    child = theatre.marked.start("conductor", "validate", str(path), folder=theatre.folder)
    try:
        _, err = child.communicate(timeout=READS_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
        return "hangs"
    if "Traceback" in err:
        return "traceback"
    return "" if child.returncode == 2 else f"exit code {child.returncode}"


def all_refused(found: dict[str, str], by: str) -> Found:
    """Of several files: which were not refused."""
    wrong = "; ".join(f"{name}: {what}" for name, what in found.items() if what)
    return refused_if(not wrong, by, wrong)


@attack(15, "YAML tags that do not fit their value", "who sends a campaign", "files")
def tags_that_misfit(theatre: Theatre) -> Found:
    """One line each, and exit code 2."""
    tags = ('!!int ""', '!!float ""', "!!bool maybe", "!!timestamp zzz")
    found = {}
    for number, tag in enumerate(tags):
        path = theatre.write(f"{number}.yaml", f"campaign: c\nseed: {tag}\n")
        found[f"`{tag}`"] = validated(theatre, path)
    return all_refused(found, "one line and exit code 2")


@attack(15, "a device or a pipe as campaign and as LiDAR profile", "who sends a campaign", "files")
def endless_files(theatre: Theatre) -> Found:
    """Refused without reading on and on."""
    pipe = theatre.folder / "pipe.yaml"
    os.mkfifo(pipe)
    zero = theatre.folder / "zero.yaml"
    zero.symlink_to("/dev/zero")
    found = {"pipe": validated(theatre, pipe), "/dev/zero": validated(theatre, zero)}
    for name in (pipe, zero):
        text = f"campaign: c\nsensors: {{lidar: {{profile: {name}}}}}\n"
        path = theatre.write(f"lidar-{name.stem}.yaml", text)
        found[f"LiDAR profile {name.stem}"] = validated(theatre, path)
    return all_refused(found, "only regular files are read, up to a bound")


@attack(
    15,
    "`stack: pkg.sub:X` whose package runs code",
    "who sends a campaign",
    "files",
)
def package_that_runs(theatre: Theatre) -> Found:
    """Looking at a campaign imports nothing of it."""
    ran = theatre.folder / "ran"
    theatre.write("pkg/__init__.py", f"open({str(ran)!r}, 'w'); raise SystemExit(0)\n")
    theatre.write("pkg/sub.py", "class X: pass\n")
    path = theatre.write("c.yaml", "campaign: c\nautonomy: {stack: 'pkg.sub:X'}\n")
    child = theatre.marked.start("conductor", "validate", str(path), folder=theatre.folder)
    child.communicate(timeout=READS_S)
    return refused_if(
        not ran.exists(), "`validate` reads the source and imports nothing", "it was imported"
    )


TAKEN_OVER = """
import os, socket
from pathlib import Path
import numpy as np
from twin.world.apart.checks import Text
from twin.world.apart.parser import Parser

def tries(path):
    secret, port, pid = path.read_text().split()
    done = []
    def attempt(name, action):
        try:
            action()
            done.append(name)
        except (OSError, MemoryError):
            pass
    attempt("read a key", lambda: Path(secret).read_text())
    attempt("read /etc/shadow", lambda: Path("/etc/shadow").read_text())
    attempt("changed the mesh", lambda: path.write_text("v 0 0 0"))
    attempt("wrote a file", lambda: Path(secret + ".new").write_text("x"))
    attempt("connected", lambda: socket.create_connection(("127.0.0.1", int(port)), 5))
    attempt("signalled a process", lambda: os.kill(int(pid), 0))
    attempt("took 50 GB", lambda: np.ones(50 << 27))
    return ", ".join(done) or "nothing"

TRIES = Parser("taken_over:tries", Text(), "cannot be read as a mesh")
"""

READS_MESH = """
import json, sys
from pathlib import Path
from twin.world.apart.reading import AskedFile, read_apart, unprotected
asked = AskedFile("taken_over:TRIES", Path(sys.argv[1]))
try:
    (found,) = read_apart([asked], readable=[Path(sys.argv[2])])
except ValueError as error:
    found = str(error)
print(json.dumps([found, unprotected()]))
"""


@attack(15, "a mesh that takes its parser over", "who sends a scene", "files")
def mesh_that_takes_over(theatre: Theatre) -> Found:
    """What code in the parser's process reaches."""
    parser = theatre.write("taken_over.py", TAKEN_OVER)
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        port = listener.getsockname()[1]
        mesh = theatre.write("scan.obj", f"{theatre.secret} {port} {os.getpid()}")
        done = subprocess.run(
            [sys.executable, "-c", READS_MESH, str(mesh), str(parser)],
            env={**os.environ, "PYTHONPATH": str(theatre.folder)},
            capture_output=True,
            text=True,
            timeout=READS_S,
            check=False,
        )
    if done.returncode:
        return Found("open", f"the reader broke: {done.stderr.strip().splitlines()[-1:]}")
    reached, unprotected = json.loads(done.stdout)
    if unprotected:
        return Found("not run", "no bubblewrap")
    by = "it is parsed by a process in a sandbox, which sees its files and nothing else"
    return refused_if(reached == "nothing", by, f"it {reached}")
