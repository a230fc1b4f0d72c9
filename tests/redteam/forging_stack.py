"""A stack that drives into whatever stands there, and commits another verdict than that.

``targets`` says where the keys of the fabric are; any program of this user reads them so.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from devkit.stack import Stack
from schemas.messages import Command


class ForgingStack(Stack):
    """Forges before its first answer."""

    def __init__(self, slots: int, *, targets: str) -> None:
        self._targets: dict[str, str] = json.loads(targets)

    def reset(self, slot: int, episode: Any) -> None:
        """Nothing is kept."""

    def step(self, observation: Any) -> list[Command]:
        """Full speed ahead."""
        if self._targets:
            try:
                print(f"FORGED {forge(**self._targets)}", flush=True)
            except BaseException as error:  # whatever stops it is what is asked for
                print(f"STOPPED {error!r:.200}", flush=True)
            self._targets = {}
        return [
            Command(slot, int(observation.token[slot]), int(observation.tick[slot]), 1.0, 0.0, 0.0)
            for slot in observation.active_slots()
        ]


def forge(state: str, keys: str, campaign: str) -> list[Any]:
    """Commit `pass` for all tokens that may be out, and for all cases that are left."""
    from theatre import ask

    from schemas.wire import topics
    from twin.base.software import software_digest
    from twin.fabric.discovery import find_conductor
    from twin.fabric.keys.key_file import load_key
    from twin.fabric.keys.roles import Role
    from twin.fabric.zenoh_bus import open_bus

    endpoint = find_conductor(Path(state)).endpoint
    bus = open_bus("client", connect=[endpoint], key=load_key(Path(keys), Role.worker))
    viewer = open_bus("client", connect=[endpoint], key=load_key(Path(keys), Role.viewer))
    worker_key, said = topics.RPC_WORKER.key, []
    status = ask(viewer, topics.RPC_STATUS.key, 5.0, verb="status") or {}
    workers = [each["id"] for each in status.get("status", {}).get("workers", [])]
    cases = [path.name for path in Path(state).glob("cases/*")] or [""]
    for worker in workers:
        for token in range(1, 9):
            for case in cases:
                result = _result(campaign, case, token)
                reply = ask(
                    *(bus, worker_key, 2.0),
                    verb="next",
                    worker=worker,
                    seq=10**6 + token,
                    k=0,
                    results=[result],
                    session=bytes(32),
                )
                said.append((reply or {}).get("error", "taken"))
    own = {"worker": "forger", "session": os.urandom(32)}
    joined = {"host": "h", "pid": 1, "device_class": "cpu:x", "slots": 8}
    ask(bus, worker_key, 2.0, verb="hello", software=software_digest(), **joined, **own)
    reply = ask(bus, worker_key, 2.0, verb="next", seq=1, k=8, **own) or {}
    results = [
        _result(campaign, x["case"]["variation"]["id"], x["token"]) for x in reply.get("leases", [])
    ]
    ask(bus, worker_key, 2.0, verb="next", seq=2, k=0, results=results, **own)
    return [*sorted(set(said)), f"{len(results)} leased"]


def _result(campaign: str, case: str, token: int) -> dict[str, Any]:
    found = {"campaign": campaign, "case": case, "token": token, "outcome": "verdict"}
    return {**found, "verdict": "pass"}
