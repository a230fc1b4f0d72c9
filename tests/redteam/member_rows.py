"""Attacks of members: they hold a key of some role, and mind no rule of ours."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
from attacks import Found, attack, refused_if
from processes import keys_of
from strangers import SILENCE_S, Stranger, options_of
from theatre import Theatre, ask, noop

from schemas import SCHEMA_VERSION
from schemas.wire import topics
from schemas.wire.delivery import extras_sha256, files_sha256
from twin.base.software import software_digest
from twin.fabric.bus import Bus
from twin.fabric.discovery import find_conductor
from twin.fabric.keys.authority import load_authority
from twin.fabric.keys.key_file import load_key
from twin.fabric.keys.roles import Role
from twin.fabric.zenoh_bus import open_bus

PATIENCE_S = 20.0
PROMPT_S = 2.0
"""Others are answered within this time, or an attack has harmed them."""
WORKER, STATUS = topics.RPC_WORKER.key, topics.RPC_STATUS.key


def hello(bus: Bus, worker: str) -> dict[str, Any]:
    """Join as a worker; what every later request of it says."""
    speaks = {"worker": worker, "session": os.urandom(32)}
    answer = ask(
        *(bus, WORKER, PATIENCE_S),
        verb="hello",
        host="h",
        pid=1,
        device_class="cpu:redteam",
        software=software_digest(),
        slots=4,
        **speaks,
    )
    assert answer is not None
    assert not answer["error"], answer
    return speaks


def lease(bus: Bus, speaks: dict[str, Any], k: int = 1) -> list[dict[str, Any]]:
    """Cases that this worker gets."""
    answer = ask(bus, WORKER, PATIENCE_S, verb="next", seq=1, k=k, **speaks)
    assert answer is not None
    assert answer["leases"], answer
    found: list[dict[str, Any]] = answer["leases"]
    return found


Rage = Callable[[Bus], None]
"""What an attacker does with its session; a function of a module."""


def _in_process(rage: Rage, endpoint: str, key: Path, role: Role) -> None:
    rage(open_bus("client", connect=[endpoint], key=load_key(key, role)))


def slowest_s(theatre: Theatre, rage: Rage, role: Role) -> float:
    """The longest answer to another member while an attacker of ``role`` is at work [s].

    In a process of its own: sessions of one process share threads.
    """
    worst_s, bus = 0.0, theatre.own(Role.viewer)
    endpoint, key = find_conductor(theatre.state).endpoint, theatre.invite(str(role))
    attacker = multiprocessing.get_context("spawn").Process(
        target=_in_process, args=(rage, endpoint, key, role)
    )
    attacker.start()
    while attacker.is_alive():
        began_s = time.monotonic()
        answer = ask(bus, STATUS, PATIENCE_S, verb="status")
        worst_s = max(worst_s, time.monotonic() - began_s, PATIENCE_S * (answer is None))
        time.sleep(0.02)
    attacker.join()
    return worst_s


@attack(4, "submits a campaign with a command", "invited member", "admin")
def admin_submits_a_command(theatre: Theatre) -> Found:
    """By our own command, and by hand on every key there is."""
    theatre.serve()
    ran = theatre.folder / "ran"
    text = noop("theirs", 1, f"{{command: [touch, {ran}]}}")
    path, key = theatre.write("theirs.yaml", text), theatre.invite("admin")
    endpoint = find_conductor(theatre.state).endpoint
    told = theatre.marked.run(
        *("conductor", "submit", str(path), "--connect", endpoint, "--key", str(key))
    )
    campaign = {
        "campaign": "theirs",
        "simulator": "noop",
        "matrix": {"repeat": [0]},
        "autonomy": {"command": ["touch", str(ran)]},
    }
    data = msgpack.packb({"v": SCHEMA_VERSION, "verb": "submit", "campaign": campaign})
    stranger = Stranger(endpoint, options_of(load_key(key, Role.admin)), PATIENCE_S)
    keys = [topic.key for topic in topics.TOPICS if topic.key.startswith("conductor/rpc")]
    stranger.answers([(each, data) for each in keys], SILENCE_S)
    stranger.close()
    status = ask(theatre.own(Role.viewer), STATUS, PATIENCE_S, verb="status")
    assert status is not None
    campaigns = status["status"]["campaigns"]
    return refused_if(
        told.returncode == 2 and not campaigns and not ran.exists(),
        "submitting takes the role `submitter`",
        f"campaigns {sorted(campaigns)}, exit code {told.returncode}",
    )


WILD: list[dict[str, Any]] = [
    {"verb": "next", "seq": 2**63, "k": 1},
    {"verb": "next", "seq": 1, "k": 2**64 - 1},
    {"verb": "beat", "held": {"9" * 20: 1}},
    {"verb": "beat", "held": {"1": 2**63 - 1}},
    {"verb": "next", "seq": 2, "k": 1, "held": [2**63]},
]


def wild_worker(bus: Bus) -> None:
    """Joins, and then says :data:`WILD`."""
    speaks = hello(bus, "wild")
    for message in WILD * 10:
        ask(bus, WORKER, PATIENCE_S, **{**message, **speaks})


@attack(7, "numbers of 64 bits and more in `next` and `beat`", "invited member", "worker")
def wild_numbers(theatre: Theatre) -> Found:
    """Others lease and commit as before, and the conductor never reads its journal again."""
    theatre.serve()
    theatre.submit("mine", 50)
    worst_s = slowest_s(theatre, wild_worker, Role.worker)
    done = theatre.marked.run("twin", "worker", "--state", str(theatre.state), "--until-done")
    said = theatre.said()
    broken = [
        word for word in ("Traceback", "internal error", "reads its journal again") if word in said
    ]
    return refused_if(
        done.returncode == 0 and not broken and worst_s < PROMPT_S,
        "integers are bounded by their types",
        f"the conductor said {broken}, slowest answer {worst_s:.1f} s, worker {done.returncode}",
    )


@attack(7, "`out` with a name of 300 characters", "invited member", "submitter")
def long_folder_name(theatre: Theatre) -> Found:
    """The next member is answered."""
    theatre.serve()
    bus = theatre.member(theatre.invite("submitter"), Role.submitter)
    campaign = {"campaign": "long", "simulator": "noop", "matrix": {"repeat": [0]}}
    out = str(theatre.folder / ("x" * 300) / "run")
    answer = ask(
        *(bus, topics.RPC_SUBMIT.key, PATIENCE_S), verb="submit", campaign=campaign, out=out
    )
    theatre.submit("mine", 1)
    said = theatre.said()
    error = (answer or {}).get("error", "")
    fine = bool(error) and "internal" not in error and "Traceback" not in said
    return refused_if(fine, "names in paths are bounded", f"answered {error!r:.100}")


def large_beats(bus: Bus) -> None:
    """Nearly as large as a message may be."""
    held = {str(n): n for n in range(1_200_000)}
    data = msgpack.packb({"v": SCHEMA_VERSION, "verb": "beat", "worker": "w", "held": held})
    for _ in range(30):
        bus.request(STATUS, data, 5.0)


@attack(8, "16 MiB of `beat` on the status route, 30 times", "invited member", "viewer")
def large_beats_of_a_viewer(theatre: Theatre) -> Found:
    """Another member's status meanwhile."""
    theatre.serve()
    worst_s = slowest_s(theatre, large_beats, Role.viewer)
    return refused_if(
        worst_s < PROMPT_S,
        f"size and role are looked at before decoding; others waited {worst_s:.1f} s at most",
        f"another member waited {worst_s:.1f} s",
    )


def honest_and_thief(theatre: Theatre) -> tuple[Bus, Bus]:
    """Two workers of a conductor that has the campaign ``mine``."""
    theatre.serve()
    theatre.submit("mine")
    return theatre.own(Role.worker), theatre.member(theatre.invite("worker"), Role.worker)


@attack(9, "delivers files for another worker's attempt", "invited member", "worker")
def files_for_another(theatre: Theatre) -> Found:
    """The honest worker's attempt folder stays empty."""
    honest, thief = honest_and_thief(theatre)
    (got,) = lease(honest, hello(honest, "honest"))
    case, attempt = got["case"]["variation"]["id"], got["attempt"]
    kpi, log = b"PAR1 forged", b"forged"
    answer = ask(
        *(thief, topics.FILES.key, PATIENCE_S),
        verb="attempt",
        campaign="mine",
        case=case,
        attempt=attempt,
        kpi=kpi,
        log=log,
        sha256=files_sha256(kpi, log),
        extras={},
        extras_sha256=extras_sha256({}),
        **hello(thief, "thief"),
    )
    forged = theatre.state / "mine" / "cases" / case / f"attempt-{attempt}" / "kpi.parquet"
    return refused_if(
        not forged.exists(),
        "files are taken from whoever holds the lease",
        f"the file lies in the attempt, answered {answer}",
    )


@attack(9, "commits a case that another worker runs", "invited member", "worker")
def commit_for_another(theatre: Theatre) -> Found:
    """Under its own name, and under the other's."""
    honest, thief = honest_and_thief(theatre)
    spoken = hello(honest, "honest")
    leases = lease(honest, spoken, 2)
    names = [hello(thief, "thief"), {**spoken, "session": os.urandom(32)}]
    for got, speaks in zip(leases, names, strict=True):
        result = {
            "campaign": "mine",
            "case": got["case"]["variation"]["id"],
            "token": got["token"],
            "outcome": "verdict",
            "verdict": "pass",
        }
        ask(thief, WORKER, PATIENCE_S, verb="next", seq=7, k=0, results=[result], **speaks)
    status = ask(theatre.own(Role.viewer), STATUS, PATIENCE_S, verb="status")
    assert status is not None
    passed = status["status"]["campaigns"]["mine"]["passed"]
    return refused_if(
        passed == 0,
        "a commit shows the secret of the session that got the lease",
        f"{passed} of 2 forged verdicts were committed",
    )


@attack(11, "asks the conductor for files that no case left", "invited member", "viewer")
def files_of_nobody(theatre: Theatre) -> Found:
    """Names that lead elsewhere, and files that are links."""
    worker, _ = honest_and_thief(theatre)
    spoken = hello(worker, "honest")
    (got,) = lease(worker, spoken)
    case, number = got["case"]["variation"]["id"], got["attempt"]
    attempt = theatre.state / "mine" / "cases" / case / f"attempt-{number}"
    attempt.mkdir(parents=True)
    result = {"campaign": "mine", "case": case, "token": got["token"], "outcome": "failed"}
    result |= {"verdict": "stack", "attempt_dir": f"cases/{case}/attempt-{number}"}
    committed = ask(worker, WORKER, PATIENCE_S, verb="next", seq=2, k=0, results=[result], **spoken)
    assert committed is not None
    assert committed["acks"] == [got["token"]], committed
    viewer = theatre.member(theatre.invite("viewer"), Role.viewer)

    def given(bus: Bus, **asked: Any) -> bytes | None:
        """Bytes that come; None: silence."""
        named = {"campaign": "mine", "case": case, "file": "log.txt", **asked}
        answer = ask(bus, topics.CASE_FILES.key, SILENCE_S, **named)
        return None if answer is None else answer["data"]

    (attempt / "log.txt").write_bytes(b"honest")
    honest = given(viewer) == b"honest"
    up = "../" * (len(attempt.parts) - 1)
    names = (f"{up}{theatre.secret}", "conductor.json", "../../../conductor.json", "log.txt\0", "")
    leaked = [given(viewer, file=name) for name in names]
    leaked += [given(viewer, case=name) for name in (f"{case}/..", "..", f"x/../{case}", "/")]
    leaked += [given(viewer, campaign=name) for name in ("mine/../mine", "..", ".", "/")]
    for name in ("log.txt", "kpi.parquet"):
        (attempt / name).unlink(missing_ok=True)
        (attempt / name).symlink_to(theatre.secret)
        leaked.append(given(viewer, file=name))
    return refused_if(
        honest and not any(leaked),
        f"paths are the journal's, links count as nothing; {len(leaked)} tries",
        f"{[data for data in leaked if data]}",
    )


def _standing(bus: Bus) -> bool:
    return ask(bus, STATUS, 1.0, verb="status") is not None


@attack(10, "goes on with a session after its key was withdrawn", "invited member", "viewer")
def session_of_a_withdrawn_key(theatre: Theatre) -> Found:
    """Until nothing is answered any more, 10 s at most."""
    theatre.serve()
    key = theatre.invite("viewer")
    bus = theatre.member(key, Role.viewer)
    assert _standing(bus)
    done = theatre.marked.run("conductor", "revoke", str(key), "--state", str(theatre.state))
    cut = _silent_within(bus, 10.0)
    return refused_if(
        done.returncode == 0 and cut,
        "`conductor revoke` cuts the sessions of a key",
        f"still answered 10 s later; `conductor revoke` exits with {done.returncode}",
    )


@attack(10, "goes on with a session after its key's end", "invited member", "viewer")
def session_of_an_expired_key(theatre: Theatre) -> Found:
    """A key of a quarter of a minute."""
    theatre.serve()
    path = theatre.folder / "short.key"
    path.touch(0o600)
    path.write_bytes(load_authority(keys_of(theatre.state)).issue(Role.viewer, 15 / 86400))
    bus = theatre.member(path, Role.viewer)
    assert _standing(bus)
    time.sleep(15)
    return refused_if(
        _silent_within(bus, 10.0),
        "the front ends sessions with their keys",
        "still answered 10 s after its end",
    )


def _silent_within(bus: Bus, patience_s: float) -> bool:
    until_s = time.monotonic() + patience_s
    while time.monotonic() < until_s:
        if not _standing(bus):
            return True
        time.sleep(0.2)
    return False


def vast_submissions(bus: Bus) -> None:
    """Ten, each of another name."""
    matrix = {"repeat": list(range(10_000)), "friction": [n / 1e4 for n in range(1, 10_001)]}
    for number in range(10):
        campaign = {"campaign": f"vast-{number}", "simulator": "noop", "matrix": matrix}
        ask(bus, topics.RPC_SUBMIT.key, PATIENCE_S, verb="submit", campaign=campaign)


@attack(16, "submits ten campaigns of a hundred million cases", "invited member", "submitter")
def too_many_cases(theatre: Theatre) -> Found:
    """Another member's status meanwhile."""
    theatre.serve()
    worst_s = slowest_s(theatre, vast_submissions, Role.submitter)
    return refused_if(
        worst_s < PROMPT_S,
        f"counted before they are made; others waited {worst_s:.1f} s at most",
        f"another member waited {worst_s:.1f} s",
    )
