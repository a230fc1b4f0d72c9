"""Attacks by files that somebody sends: campaigns, links, pipes, meshes."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from attacks import Found, attack, refused_if
from parser_theft import READS_S, theft
from theatre import Theatre


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


TAKES_OVER = """
from twin.world.apart.checks import Text
from twin.world.apart.parser import Parser

TRIES = Parser("taken_over:reached", Text(), "cannot be read as a mesh")
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
    by = "it is parsed by a process in a sandbox, which sees its files and nothing else"
    return theft(theatre, READS_MESH, TAKES_OVER, "scan.obj", by)
