"""Identity: what makes two cases, two rigs and two streams of random numbers the same."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable

import msgspec

from schemas.campaign import Campaign, Case


def digest(parts: Iterable[bytes]) -> str:
    """SHA-256 over length-prefixed parts, hexadecimal."""
    sha = hashlib.sha256()
    for part in parts:
        sha.update(struct.pack("<Q", len(part)))
        sha.update(part)
    return sha.hexdigest()


def case_digest(case: Case) -> str:
    """Digest of everything that decides a case's result (batch label and viewers do not)."""
    same = msgspec.structs.replace(case, batch=0, view="live", keep="all", drive="none")
    return digest([_canonical(same)])


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
        *(case.simulator, case.control_hz, case.scenario.scene, case.scenario.vehicle),
        *(case.camera, case.cameras, case.lidars, case.sensors.rates(case.control_hz), case.stack),
        *(case.parameters, case.placement, case.simulator_files(), case.view, case.render),
        *(case.foreign, case.slots, case.keep, case.clock, case.cosim),
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
        "scene": case.scenario.scene,
        "vehicle": case.scenario.vehicle,
        "camera": msgspec.to_builtins(case.camera),
        "cameras": msgspec.to_builtins(case.cameras),
        "lidars": msgspec.to_builtins(case.lidars),
        "sensors": case.sensors.rates(case.control_hz),
        "stack": case.stack,
        "parameters": case.parameters,
        "placement": case.placement,
        "clock": case.clock,
        "cosim": case.cosim,
        "files": case.simulator_files(),
        "view": case.view,
        "keep": case.keep,
        "render": case.render,
        "foreign": msgspec.to_builtins(case.foreign),
        "slots": case.slots,
    }
    return digest([_canonical(shared)])[:16]


def stream_key(campaign_seed: int, case_id: str, stream: str) -> int:
    """64-bit key of a counter-based random stream.

    First 8 bytes of SHA-256 over the length-prefixed (campaign seed, case id, stream name); the
    counter is (case tick, element). Nothing depends on slot, worker or order.
    """
    parts = [struct.pack("<Q", campaign_seed), case_id.encode(), stream.encode()]
    return int.from_bytes(bytes.fromhex(digest(parts))[:8], "little")


def _canonical(value: object) -> bytes:
    return msgspec.json.encode(value, order="sorted")
