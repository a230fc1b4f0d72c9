"""Attacks by who sends a certificate: it names what is to run on the machine of who audits it."""

from __future__ import annotations

import json
import os
from pathlib import Path

from attacks import Found, attack, refused_if
from certificates import campaign, made, signer
from theatre import Theatre

from conductor.certify.form import encode_certificate

READS_S = 120.0
"""A certificate is refused within this time."""


def audited(theatre: Theatre, name: str, data: bytes) -> str:
    """What is wrong with how a certificate is refused; empty: nothing."""
    path = theatre.folder / f"{name}.cert"
    path.write_bytes(data)
    trusted = ("--public-key", signer().public, "--out", str(theatre.folder / f"{name}-audit"))
    done = theatre.marked.run("conductor", "audit", str(path), "--workers", "1", *trusted)
    if "Traceback" in done.stderr:
        return "traceback"
    return "" if done.returncode in (2, 3) else f"exit code {done.returncode}"


def sent(theatre: Theatre, **changed: object) -> bytes:
    """A certificate of a campaign of the simulator."""
    return encode_certificate(made(campaign(2, simulator="warp", **changed)))


@attack(
    17, "a certificate whose stack is a command, or any class", "who certifies", "a trusted key"
)
def stacks_that_run(theatre: Theatre) -> Found:
    """Commands, classes of libraries and repositories, by a key that the auditor trusts."""
    ran = theatre.folder / "ran"
    touch = ["/bin/sh", "-c", f"touch {ran}"]
    repository = {"url": f"file://{theatre.folder}", "ref": "main", "setup": f"touch {ran}"}
    parameters = {"args": f"touch {ran}", "shell": True}
    stacks: dict[str, dict[str, object]] = {
        "command": {"command": touch},
        "repository": {"command": touch, "repository": repository},
        "class": {"stack": "subprocess:Popen", "parameters": parameters},
        "ours": {"stack": "devkit.hosting.foreign:Popen", "parameters": parameters},
        "inline": {"placement": "inline"},
    }
    wrong = {n: audited(theatre, n, sent(theatre, autonomy=a)) for n, a in stacks.items()}
    said = "; ".join(f"{name}: {words}" for name, words in wrong.items() if words)
    by = "shown, and run with `--run-stack` alone, in a sandbox"
    return refused_if(not said and not ran.exists(), by, said or "it ran")


@attack(17, "a certificate that names files of the auditor", "who certifies", "a trusted key")
def files_of_the_auditor(theatre: Theatre) -> Found:
    """Keys and pipes as scene, vehicle, and parameter of a shipped stack."""
    secret = theatre.folder / "secret.yaml"
    secret.write_text("key: value\n")
    pipe = theatre.folder / "pipe.yaml"
    os.mkfifo(pipe)
    wrong = {}
    for number, place in enumerate((secret, pipe, Path("/etc/../etc/passwd.yaml"))):
        scene = sent(theatre, scenario={"scene": str(place)}, files={str(place): "0" * 64})
        wrong[f"scene {number}"] = audited(theatre, f"scene-{number}", scene)
    parameters = {"parameters": {"weights": str(secret)}}
    wrong["parameter"] = audited(theatre, "parameter", sent(theatre, autonomy=parameters))
    said = "; ".join(f"{name}: {words}" for name, words in wrong.items() if words)
    by = "paths are names: files count from the folder that the auditor gives, by their digest"
    return refused_if(not said, by, said)


@attack(17, "a table with changed, reordered or dropped rows", "who sends a certificate", "files")
def changed_tables(theatre: Theatre) -> Found:
    """Every field of a certificate that somebody else has signed."""
    true = encode_certificate(made())
    fields = json.loads(true)
    rows = fields["rows"]
    tables = {
        "changed": [[rows[0][0], "verdict/pass", "0" * 64, 0], *rows[1:]],
        "reordered": rows[::-1],
        "dropped": rows[:-1],
        "doubled": [*rows, rows[0]],
    }
    files = {
        name: json.dumps(fields | {"rows": table}, separators=(",", ":")).encode() + b"\n"
        for name, table in tables.items()
    }
    resigned = encode_certificate(made(key=signer(2)))
    files |= {"another key": resigned, "cut off": true[:-9], "longer": true + b"\n"}
    wrong = {name: audited(theatre, name.replace(" ", "-"), data) for name, data in files.items()}
    said = "; ".join(f"{name}: {words}" for name, words in wrong.items() if words)
    return refused_if(not said, "signature, root of the rows, one encoding", said)
