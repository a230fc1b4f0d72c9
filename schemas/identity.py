"""Identity: what makes two cases, two rigs and two streams of random numbers the same."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable
from pathlib import PurePath
from typing import Literal

import msgspec

from schemas.campaign import Campaign, Case
from schemas.sections.perception import GroundTruthPerception, file_fields
from schemas.sections.stack_identity import StackIdentity, StackSource

DIGESTS = 1
"""Version of what the digests of cases and campaigns are taken over. 0: the paths of files, and
nothing of the stack; 1: their contents."""


def digest(parts: Iterable[bytes]) -> str:
    """SHA-256 over length-prefixed parts, hexadecimal."""
    sha = hashlib.sha256()
    for part in parts:
        sha.update(struct.pack("<Q", len(part)))
        sha.update(part)
    return sha.hexdigest()


def case_digest(case: Case) -> str:
    """Digest of everything that decides a case's result (batch label and viewers do not)."""
    same = msgspec.structs.replace(
        by_content(case),
        batch=0,
        view="live",
        keep="all",
        drive="none",
        files={},
        source=_source_of(case),
        sandbox="default",
        models=[],
    )
    return digest([_canonical(same)])


def _source_of(case: Case) -> StackSource:
    """What the stack consists of: digests alone, no paths."""
    identity = StackIdentity(case.source.identity.digest)
    return StackSource(identity=identity, parameters=case.source.parameters)


def by_content(case: Case) -> Case:
    """The case with digests in place of the paths of scene, vehicle and model files: the same file
    may lie elsewhere."""
    if not case.files:
        return case
    scenario = msgspec.structs.replace(
        case.scenario, scene=_content_of(case, "scene"), vehicle=_content_of(case, "vehicle")
    )
    named = file_fields(case.perception)
    changed = {
        # What its name ends with says what a file is.
        key: case.files[path] + PurePath(path).suffix
        for key, path in named.items()
        if path in case.files
    }
    perception = msgspec.structs.replace(case.perception, **changed)
    return msgspec.structs.replace(case, scenario=scenario, perception=perception)


def _content_of(case: Case, field: Literal["scene", "vehicle"]) -> str:
    """Digest of the scene or vehicle file; the name of a shipped one."""
    name: str = getattr(case.scenario, field)
    return case.files.get(name, name)


def campaign_digest(campaign: Campaign, cases: Iterable[Case]) -> str:
    """Digest of a campaign: equal for files that list the same cases in another order."""
    pairs = sorted((case.id, case_digest(case)) for case in cases)
    return digest([campaign.campaign.encode(), *(f"{i}={d}".encode() for i, d in pairs)])


def rig_key(case: Case) -> str:
    """Cases with equal keys may share one rig (simulator and stack process).

    Perception variants, times, weathers and errors of sensors differ per slot; simulator, scene,
    vehicle, camera, which sensors there are, rates, stack and its parameters do not, nor what is
    shown: a rig has a recorder beside it or has none.
    """
    parts = (
        *(
            case.simulator,
            case.control_hz,
            _content_of(case, "scene"),
            _content_of(case, "vehicle"),
        ),
        *(case.camera, case.cameras, case.lidars, case.sensors.rates(case.control_hz), case.stack),
        *(case.parameters, case.placement, _source_of(case), case.view, case.render),
        *(case.foreign, case.slots, case.keep, case.clock, case.cosim),
        case.sandbox,
    )
    # The cases of a campaign have few different keys, and the digest is the slow part.
    packed = msgspec.msgpack.encode(parts)
    found = _rig_keys.get(packed)
    if found is None:
        if len(_rig_keys) >= RIG_KEYS_MAX:
            _rig_keys.clear()
        found = _rig_keys[packed] = _rig_key(case)
    return found


RIG_KEYS_MAX = 4096
"""Most keys remembered."""

_rig_keys: dict[bytes, str] = {}


def _rig_key(case: Case) -> str:
    shared = {
        "simulator": case.simulator,
        "control_hz": case.control_hz,
        "scene": _content_of(case, "scene"),
        "vehicle": _content_of(case, "vehicle"),
        "camera": msgspec.to_builtins(case.camera),
        "cameras": msgspec.to_builtins(case.cameras),
        "lidars": msgspec.to_builtins(case.lidars),
        "sensors": case.sensors.rates(case.control_hz),
        "stack": case.stack,
        "parameters": case.parameters,
        "placement": case.placement,
        "clock": case.clock,
        "cosim": case.cosim,
        "source": msgspec.to_builtins(_source_of(case)),
        "view": case.view,
        "keep": case.keep,
        "render": case.render,
        "foreign": msgspec.to_builtins(case.foreign),
        "slots": case.slots,
        "sandbox": case.sandbox,
    }
    return digest([_canonical(shared)])[:16]


def stream_key(campaign_seed: int, case_id: str, stream: str) -> int:
    """64-bit key of a counter-based random stream.

    First 8 bytes of SHA-256 over the length-prefixed (campaign seed, case id, stream name); the
    counter is (case tick, element). Nothing depends on slot, worker or order.
    """
    parts = [struct.pack("<Q", campaign_seed), case_id.encode(), stream.encode()]
    return int.from_bytes(bytes.fromhex(digest(parts))[:8], "little")


def stack_name(case: Case) -> str:
    """What a stack knows ``case`` by: the same in every attempt and on every worker, and without
    the campaign's seed nobody tells which case it is. Its name, if the campaign says so."""
    if "case" in case.tell:
        return case.id
    names = digest([case.campaign.encode(), case.id.encode()]).encode()
    key = struct.pack("<Q", case.seed)
    return (
        f"case-{hashlib.blake2b(names, digest_size=8, key=key, person=b'drive name').hexdigest()}"
    )


def stack_seed(case: Case) -> int:
    """The seed that a stack gets for ``case``: a stream of its own, with which it cannot draw the
    simulator's numbers again. The campaign's, if the campaign says so."""
    if "seed" in case.tell:
        return case.seed
    return stream_key(case.seed, case.id, "stack") >> 1


def is_told_truth(case: Case) -> bool:
    """Whether the stack gets boxes and the exact environment in ``case``."""
    return isinstance(case.perception, GroundTruthPerception) or "truth" in case.tell


def _canonical(value: object) -> bytes:
    return msgspec.json.encode(value, order="sorted")
