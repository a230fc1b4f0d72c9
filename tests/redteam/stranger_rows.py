"""Attacks of another user of the host: no key, and no right to any file of the victim."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

from attacks import Found, attack, refused_if
from processes import keys_of
from test_another_user import ATTACK
from theatre import NOBODY, Theatre

from twin.fabric.discovery import find_conductor

LOOKS_S = 15.0
"""So long an announcement lies there to be found."""


@attack(2, "submits a command over loopback", "another local user", "none", root=True)
def submits_over_loopback(theatre: Theatre) -> Found:
    """Plain, without a certificate, and with certificates of his own in every role."""
    theatre.serve()
    own = theatre.folder / "own"
    own.mkdir()
    own.chmod(0o777)
    endpoint = find_conductor(theatre.state).endpoint
    done = subprocess.run(
        [
            *(sys.executable, "-c", ATTACK.format(nobody=NOBODY)),
            *(endpoint.rpartition(":")[2], str(keys_of(theatre.state)), str(own)),
        ],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parents[1] / "e2e",
    )
    if done.returncode:
        reached = done.stderr.splitlines()[-1]
        return Found("open", f"not as expected: {reached}")
    seen = json.loads(done.stdout)
    return refused_if(
        not seen["inside"] and not seen["answered"] and not seen["read"],
        "mutual TLS on loopback; keys of mode 0600 in a folder of 0700",
        f"got in as {seen['inside']}, read {seen['read']}",
    )


@attack(5, "announces a command in `--join-dir`", "another local user", "files", root=True)
def announces_a_command(theatre: Theatre) -> Found:
    """A folder that everybody may write to, as /tmp; the host serves on."""
    folder, ran = theatre.folder / "rigs", theatre.folder / "ran"
    folder.mkdir()
    folder.chmod(0o1777)
    foreign = json.dumps({"command": ["sh", "-c", f"touch {ran}"]})
    said = [
        *("--connect", "tcp/127.0.0.1:1", "--rig", "r1"),
        *("--stack", "devkit.aeb:AebStack", "--foreign", foreign),
    ]
    code = "for n, t in zip(sys.argv[2::2], sys.argv[3::2]): Path(sys.argv[1], n).write_text(t)"
    announced = json.dumps({"arguments": said})
    theatre.as_nobody(code, str(folder), "r1.json", announced, "r2.json", "[]")
    with (theatre.folder / "host.log").open("w+") as log:
        child = theatre.marked.start("devkit", "host", "--join", str(folder), "--commands", log=log)
        until_s = time.monotonic() + LOOKS_S
        while time.monotonic() < until_s and child.poll() is None and not ran.exists():
            time.sleep(0.2)
        alive = child.poll() is None
        log.seek(0)
        words = log.read()
    told = words.count("ignored")
    return refused_if(
        alive and not ran.exists() and told >= 2 and "Traceback" not in words,
        "only files of its own user are believed; the rest is one line each",
        f"ran: {ran.exists()}, host still serves: {alive}, {told} ignored",
    )


FETCHES = """
import sys
from pathlib import Path
from hpc.inputs import NamedRepository, fetch_repository
fetch_repository(NamedRepository(sys.argv[1], "main"), Path(sys.argv[2]))
"""


@attack(14, "puts files into a fetch cache", "another local user", "files", root=True)
def cache_of_another(theatre: Theatre) -> Found:
    """A cache folder of his, mode 777: is a stack fetched into it, and run from there?"""
    origin, cache = theatre.folder / "origin", theatre.folder / "cache"
    origin.mkdir()
    (origin / "drive.py").write_text("print()\n")
    who = ["-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "--quiet", "-b", "main"], ["add", "."], [*who, "commit", "-qm", "x"]):
        subprocess.run(["git", "-C", str(origin), *words], check=True)
    own = theatre.folder / "own-cache"
    fetch = [sys.executable, "-c", FETCHES, str(origin)]
    subprocess.run([*fetch, str(own)], check=True)
    cache.mkdir()
    os.chown(cache, NOBODY, NOBODY)
    cache.chmod(0o777)
    done = subprocess.run([*fetch, str(cache)], capture_output=True, text=True, check=False)
    return refused_if(
        done.returncode != 0 and "UsageError" in done.stderr,
        "a cache in which others may write is refused",
        "what lies there would be run",
    )
