"""Attacks by scenario and road files that somebody sends."""

from __future__ import annotations

import os
import subprocess

from attacks import Found, attack
from hostile_scenarios import HOSTILE
from input_rows import all_refused
from parser_theft import READS_S, theft
from theatre import Theatre

LINES_MAX = 3
"""What is said of one mistake, and how the command says it."""


def played(theatre: Theatre, *words: str) -> str:
    """What is wrong with how a command refuses a file; empty: nothing."""
    child = theatre.marked.start("twin", *words, folder=theatre.folder)
    try:
        out, err = child.communicate(timeout=READS_S)
    except subprocess.TimeoutExpired:
        child.kill()
        child.communicate()
        return "hangs"
    if "Traceback" in err:
        return "traceback"
    if theatre.secret.read_text() in out + err or "root:" in out + err:
        return "tells what stands in another file"
    if len(err.splitlines()) > LINES_MAX:
        return f"{len(err.splitlines())} lines"
    return "" if child.returncode == 2 else f"exit code {child.returncode}"


@attack(
    15,
    "scenarios of bombs, links, pipes, devices, towers and circles",
    "who sends a scenario",
    "files",
)
def hostile_scenarios(theatre: Theatre) -> Found:
    """Each is a line and exit code 2, within a minute."""
    found = {}
    for name, make in HOSTILE.items():
        folder = theatre.folder / name
        folder.mkdir()
        path = make(folder)
        found[name] = played(theatre, "play", str(path), "--until-s", "1")
    by = f"{len(found)} files: one line and exit code 2 each; only what is named and fits is seen"
    return all_refused(found, by)


@attack(15, "roads of bombs, pipes and devices", "who sends a road", "files")
def hostile_roads(theatre: Theatre) -> Found:
    """The same of road files by themselves."""
    pipe = theatre.folder / "pipe.xodr"
    os.mkfifo(pipe)
    device = theatre.folder / "device.xodr"
    device.symlink_to("/dev/zero")
    bomb = theatre.folder / "bomb"
    bomb.mkdir()
    HOSTILE["road_bomb"](bomb)
    deep = theatre.write("deep.xodr", "<OpenDRIVE>" + "<a>" * 100_000)
    large = theatre.folder / "large.xodr"
    with large.open("wb") as file:
        file.truncate(200 << 20)
    paths = [pipe, device, bomb / "r.xodr", deep, large, theatre.secret]
    found = {path.name: played(theatre, "validate", "road", str(path)) for path in paths}
    return all_refused(found, "one line and exit code 2")


TAKES_OVER = """
from twin.scenario.storyboard.parsing import FAILED, PROGRAM, NamesAnswer, ProgramAnswer
from twin.scenario.storyboard.parsing import answer_bytes
from twin.world.apart.checks import Array
from twin.world.apart.parser import Parser

def names(path, question):
    return answer_bytes(NamesAnswer(()))

def tries(path, question):
    words = reached(path, "beside.xosc")
    return [answer_bytes(ProgramAnswer((words,))), np.zeros(0, np.uint8)]

NAMES = Parser("taken_over:names", Array("uint8", ("n",)), FAILED)
PROGRAM = Parser("taken_over:tries", PROGRAM.check, FAILED)
"""

READS_SCENARIO = """
import functools, json, sys
from pathlib import Path
from twin.scenario.storyboard import apart
from twin.world.apart.reading import read_apart, unprotected
apart._PARSING = "taken_over"
apart.read_apart = functools.partial(read_apart, readable=[Path(sys.argv[2])])
try:
    apart.program_apart(Path(sys.argv[1]))
    found = "a program"
except ValueError as error:
    found = str(error)
print(json.dumps([found, unprotected()]))
"""


@attack(15, "a scenario that takes its parser over", "who sends a scenario", "files")
def scenario_that_takes_over(theatre: Theatre) -> Found:
    """What code in the parser's process reaches."""
    theatre.write("beside.xosc", "another scenario")
    by = "it is parsed by a process in a sandbox, which sees its files and nothing else"
    return theft(theatre, READS_SCENARIO, TAKES_OVER, "scan.xosc", by)
