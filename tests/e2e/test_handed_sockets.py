"""The sockets past the front, on a real run: who has them open, and who has not."""

import os
import re
import subprocess
from contextlib import suppress
from pathlib import Path

import pytest
from foreign_campaigns import CLIENT, campaign, python

from twin.fabric.keys.roles import MEMBERS

pytestmark = pytest.mark.skipif(os.getuid() != 0, reason="looks at what others keep to themselves")

NAMED = re.compile(rf"/twin-\w+-gone/({'|'.join(MEMBERS)}) \(deleted\)")
"""A socket behind a front, which lost its name."""

LOOK_S = 0.05
"""How often processes are looked at [s]."""

KINDS = {
    "conductor run": ("conductor", "run"),
    "worker": ("twin", "worker"),
    "simulator": ("twin", "sim"),
    "recorder": ("viewer", "record"),
    "stack": (str(CLIENT),),
    "front": ("twin.fabric.front.process",),
}


def kind_of(words):
    for kind, wanted in KINDS.items():
        if all(word in words for word in wanted):
            return kind
    return " ".join(words)


def open_files(process):
    """Where the descriptors of a process lead."""
    folder, found = Path(f"/proc/{process.pid}/fd"), set()
    with suppress(OSError):
        for name in os.listdir(folder):
            with suppress(OSError):
                found.add(str((folder / name).readlink()))
    return found


def test_nobody_but_the_worker_has_the_socket_of_a_run(marked, tmp_path):
    """Neither an unprotected stack nor any other child of the worker: not the conductor's socket,
    and no other end of the two."""
    autonomy = {"command": python(CLIENT), "sandbox": "off"}
    path = campaign(tmp_path, "handed", autonomy, view="record")
    words = ("conductor", "run", str(path), "--workers", "1", "--out", str(tmp_path / "out"))
    with (tmp_path / "said").open("w") as log:
        run = marked.start(*words, log=log)
    seen, sockets = {}, {}
    while run.poll() is None:
        with suppress(subprocess.TimeoutExpired):
            run.wait(LOOK_S)
        for process in marked.processes():
            with suppress(Exception):  # it has ended
                kind = kind_of(process.cmdline())
                files = open_files(process)
                roles = {match[1] for match in map(NAMED.search, files) if match}
                seen.setdefault(kind, set()).update(roles)
                ours = {file for file in files if file.startswith("socket:")}
                sockets.setdefault(kind, set()).update(ours)
    said = (tmp_path / "said").read_text()
    assert run.returncode in (0, 1), said
    assert "unprotected" in said
    assert {"conductor run", "worker", "simulator", "recorder", "stack"} <= seen.keys(), seen
    assert {kind: roles for kind, roles in seen.items() if roles} == {
        "conductor run": set(map(str, MEMBERS)),
        "worker": {"worker"},
        **({"front": set(map(str, MEMBERS))} if "front" in seen else {}),
    }
    ours = sockets.pop("conductor run") | sockets["worker"]
    shared = {kind: files & ours for kind, files in sockets.items() if kind != "worker"}
    assert not any(files for kind, files in shared.items() if kind != "front"), shared
