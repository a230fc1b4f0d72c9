"""Attacks by somebody who may write the bucket of a result store."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

from attacks import Found, attack, refused_if
from parser_theft import READS_S, theft
from theatre import Theatre

from conductor.journal.owner import this_process
from conductor.stored.owner import StoreClaims
from conductor.stored.seals import StoreSeal
from schemas.wire.codec import encode
from schemas.wire.control import Result, Sealed
from twin.stores.folder import FolderStore
from twin.stores.objects import put_pack

HUGE_BYTES = 64 << 30
"""Of a sparse file [bytes]."""


def _left(theatre: Theatre) -> tuple[FolderStore, tuple[str, ...]]:
    """A store that a conductor has left with its node, and the command of a successor."""
    store, keys = theatre.folder / "store", theatre.folder / "keys"
    assert theatre.marked.run("conductor", "keygen", str(keys)).returncode == 0
    first = theatre.serve("--key", str(keys), "--store", str(store), "--durable", "store")
    path = theatre.write("c.yaml", "campaign: c\nsimulator: noop\nmatrix: {repeat: [0, 1]}\n")
    done = theatre.command("submit", str(path), "--key", str(keys))
    assert done.returncode == 0, done.stderr
    first.terminate()
    first.communicate()
    successor = ("conductor", "serve", "--key", str(keys), "--store", str(store), "--drain-s", "1")
    return FolderStore(store), successor


def _huge(name: str) -> Callable[[FolderStore], None]:
    def change(store: FolderStore) -> None:
        for found in store.names(name):
            with (Path(store.url) / found).open("wb") as file:
                file.truncate(HUGE_BYTES)

    return change


def _noise(name: str) -> Callable[[FolderStore], None]:
    def change(store: FolderStore) -> None:
        for found in store.names(name):
            store.put(found, store.get(found)[:-1] + b"\0")

    return change


def _own_claim(store: FolderStore) -> None:
    """A claim as a conductor without keys would make it."""
    StoreClaims(store, StoreSeal(store, None)).claim(2, 99, this_process(), "ab" * 16)


CHANGES: dict[str, Callable[[FolderStore], None]] = {
    "a claim without the key": _own_claim,
    "another claim": _noise("owner/"),
    "another head": _noise("journal/"),
    "another object": _noise("objects/"),
    "a huge claim": _huge("owner/"),
    "a huge head": _huge("journal/"),
    "a huge object": _huge("objects/"),
}


@attack(14, "forges claims, heads and objects of a store", "who writes a bucket", "store")
def forged_store(theatre: Theatre) -> Found:
    """Each keeps a successor from taking over, by a line, and none is taken for a journal."""
    store, successor = _left(theatre)
    kept = {name: store.get(name) for name in store.names("")}
    said = {}
    for number, (name, change) in enumerate(CHANGES.items()):
        for found in store.names(""):
            store.delete(found)
        for found, data in kept.items():
            store.put(found, data)
        change(store)
        state = theatre.folder / f"next-{number}"
        child = theatre.marked.start(*successor, "--state", str(state))
        _, err = child.communicate(timeout=READS_S)
        lines = err.strip().splitlines()
        if child.returncode not in (2, 3) or (state / "conductor.db").exists():
            said[name] = f"exit code {child.returncode}: {lines[-1:]}"
    by = f"marks and digests: {len(CHANGES)} changes, one line and no takeover each"
    return refused_if(not said, by, str(said))


@attack(14, "puts results of its own into a store", "who writes a bucket", "store")
def forged_results(theatre: Theatre) -> Found:
    """A pass for every case, sealed by nobody; a successor looks for results."""
    store, successor = _left(theatre)
    done = [Result("c", f"repeat_{n}", n + 1, "verdict", "pass") for n in range(2)]
    forged = [Sealed(made.token, "w1", encode(made), bytes(64)) for made in done]
    put_pack(store, "w1", 1, forged)
    put_pack(store, "../w1", 2, forged)
    theatre.state = theatre.folder / "next"
    theatre.serve(*successor[2:-2])
    shown = theatre.command("status", "--key", successor[3], "--output", "json")
    assert shown.returncode == 0, shown.stderr
    left = json.loads(shown.stdout)["left"]
    return refused_if(left == 2, "results count with a session's seal alone", f"{left} are left")


TAKES_OVER = """
from twin.kpi.foreign import KPI, KpiValues
from twin.world.apart.parser import Parser

def tries(path):
    return KpiValues(np.frombuffer(reached(path, "beside.parquet").encode(), np.uint8))

TRIES = Parser("taken_over:tries", KPI.check, "cannot be read as KPIs")
"""

READS_KPI = """
import functools, json, sys
from pathlib import Path
from twin.kpi import foreign
from twin.world.apart.reading import AskedFile, read_apart, unprotected
def taken(asks, **limits):
    asks = [AskedFile("taken_over:TRIES", ask.path) for ask in asks]
    return read_apart(asks, readable=[Path(sys.argv[2])], **limits)
foreign.read_apart = taken
foreign.table_of = lambda values, path: values.encoded.tobytes().decode()
(found,) = foreign.tables_apart([Path(sys.argv[1])])
print(json.dumps([found, unprotected()]))
"""


@attack(15, "a KPI file in a store that takes its parser over", "who writes a bucket", "store")
def kpi_that_takes_over(theatre: Theatre) -> Found:
    """What code in the parser's process reaches."""
    theatre.write("beside.parquet", "another file")
    by = "it is parsed by a process in a sandbox, and written anew from its values"
    return theft(theatre, READS_KPI, TAKES_OVER, "kpi.parquet", by)
