"""Identity: what makes two cases, two rigs and two streams of random numbers the same."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Iterable
from pathlib import PurePath

import msgspec
from msgspec import UNSET

from schemas.campaign import Campaign
from schemas.case import Case, RigSpec
from schemas.digest import digest
from schemas.kinds.perception import perception_kind
from schemas.kinds.scenario import kind_of
from schemas.sections.perception import Perception, file_fields
from schemas.sections.repeated import CaseOrigin
from schemas.sections.scenario import Scenario
from schemas.sections.search import rows_of
from schemas.sections.stack_identity import StackIdentity, StackSource

DIGESTS = 1
"""Version of what the digests of cases and campaigns are taken over. 0: the paths of files, and
nothing of the stack; 1: their contents."""


def case_digest(case: Case) -> str:
    """Digest of everything that decides a case's result (batch label and viewers do not).

    Taken over a case as it was before it had a rig and a variation, one mapping of all its fields:
    so it is the same as in the first stage.
    """
    rig, variation = msgspec.to_builtins(_by_content(case.rig)), msgspec.to_builtins(case.variation)
    variation["perception"] = msgspec.to_builtins(perception_by_content(case))
    # Which sensors there are, and their rates, stand in their sections.
    del rig["sensor_hz"], rig["scene"], rig["vehicle"]
    del rig["bodies"]  # follows from the family of the scenario
    if not variation["formula"]:
        del variation["formula"]
    variation["scenario"] = msgspec.to_builtins(scenario_by_content(case))
    undecisive = {
        "batch": 0,
        "view": "live",
        "keep": "all",
        "drive": "none",
        "sandbox": "default",
        # Others hold them by content.
        "files": {},
        "models": [],
    }
    return digest([_canonical(rig | variation | undecisive)])


def perception_by_content(case: Case) -> Perception:
    """The perception variant with digests in place of the paths of its files: the same file may
    lie elsewhere."""
    variation = case.variation
    changed = {
        # What its name ends with says what a file is.
        key: variation.files[path] + PurePath(path).suffix
        for key, path in file_fields(variation.perception).items()
        if path in variation.files
    }
    return msgspec.structs.replace(variation.perception, **changed)


def scenario_by_content(case: Case) -> Scenario:
    """The scenario with digests in place of the paths of scene, vehicle and other files."""
    rig, scenario = _by_content(case.rig), case.variation.scenario
    kind = kind_of(scenario)
    files = {
        key: case.variation.files.get(path, path)
        for key, path in zip(kind.files, kind.files_of(scenario), strict=True)
    }
    return msgspec.structs.replace(scenario, scene=rig.scene, vehicle=rig.vehicle, **files)


def _by_content(rig: RigSpec) -> RigSpec:
    """The rig with digests in place of paths; shipped scenes and vehicles keep their names."""
    identity = StackIdentity(rig.source.identity.digest)
    return msgspec.structs.replace(
        rig,
        scene=rig.files.get(rig.scene, rig.scene),
        vehicle=rig.files.get(rig.vehicle, rig.vehicle),
        files={},
        models=sorted(rig.files.get(path, path) for path in rig.models),
        source=StackSource(identity=identity, parameters=rig.source.parameters),
    )


def campaign_digest(campaign: Campaign, cases: Iterable[Case]) -> str:
    """Digest of a campaign: equal for files that list the same cases in another order. It has the
    versions of the plug-ins that the campaign uses, and of no others. A search begins with the
    digest of its section and the first generation of its chains, and every later one is added to
    it."""
    if campaign.search is not UNSET and not campaign.search.chosen:
        listed, sizes = list(cases), [len(rows_of(rows)) for rows in campaign.search.proposed]
        begin = sum(sizes[: campaign.search.chains])
        whole = _digest_of(campaign, listed[:begin])
        for size in sizes[campaign.search.chains :]:
            whole = grown_digest(whole, listed[begin : begin + size])
            begin += size
        return whole
    return _digest_of(campaign, cases)


def grown_digest(before: str, cases: Iterable[Case]) -> str:
    """Digest of a search after a further generation."""
    return digest([before.encode(), *_digests_of(cases)])


def _digest_of(campaign: Campaign, cases: Iterable[Case]) -> str:
    plugins = sorted(campaign.plugins.items())
    section = []
    if campaign.search is not UNSET:
        asked = msgspec.structs.replace(campaign.search, first=[], proposed=[], forks=UNSET)
        fields = msgspec.to_builtins(asked)
        if asked.chains == 1:
            del fields["chains"]  # there was no other number once
        section = [b"search " + _canonical(fields)]
    return digest(
        [
            campaign.campaign.encode(),
            *_digests_of(cases),
            *(f"plug-in {name} {version}".encode() for name, version in plugins),
            *section,
        ]
    )


def _digests_of(cases: Iterable[Case]) -> list[bytes]:
    pairs = sorted((case.id, case_digest(case)) for case in cases)
    return [f"{i}={d}".encode() for i, d in pairs]


def rig_key(case: Case) -> str:
    """Cases with equal keys may share one rig (simulator and stack process): digest of all that
    the rig is built for."""
    rig = _by_content(case.rig)
    # The cases of a campaign have few different keys, and the digest is the slow part.
    packed = msgspec.msgpack.encode(rig)
    key = _rig_keys.get(packed)
    if key is None:
        if len(_rig_keys) >= RIG_KEYS_MAX:
            _rig_keys.clear()
        key = _rig_keys[packed] = digest([_canonical(msgspec.to_builtins(rig))])[:16]
    return key


RIG_KEYS_MAX = 4096
"""Most keys remembered."""

_rig_keys: dict[bytes, str] = {}


def stream_key(campaign_seed: int, case_id: str, stream: str) -> int:
    """64-bit key of a counter-based random stream.

    First 8 bytes of SHA-256 over the length-prefixed (campaign seed, case id, stream name); the
    counter is (case tick, element). Nothing depends on slot, worker or order.
    """
    parts = [struct.pack("<Q", campaign_seed), case_id.encode(), stream.encode()]
    return int.from_bytes(bytes.fromhex(digest(parts))[:8], "little")


def case_stream(case: Case, stream: str, name: str = "") -> int:
    """Key of a random stream of a case, see :func:`stream_key`; of the one that it has from its
    start, or of that which it has while its numbers are those of ``name``."""
    forks = case.variation.forks
    name = name or (_original(case).case if forks is UNSET else forks[0].case)
    return stream_key(case.variation.seed, name, stream)


def _original(case: Case) -> CaseOrigin:
    """The case that a case repeats, or the case itself."""
    origin = case.variation.origin
    if origin is not UNSET:
        return origin
    return CaseOrigin(campaign=case.variation.campaign, case=case.id)


def stack_name(case: Case) -> str:
    """What a stack knows ``case`` by: the same in every attempt and on every worker, and without
    the campaign's seed nobody tells which case it is. Its name, if the campaign says so."""
    original = _original(case)
    if "case" in case.variation.tell:
        return original.case
    names = digest([original.campaign.encode(), original.case.encode()]).encode()
    key = struct.pack("<Q", case.variation.seed)
    return (
        f"case-{hashlib.blake2b(names, digest_size=8, key=key, person=b'drive name').hexdigest()}"
    )


def stack_seed(case: Case) -> int:
    """The seed that a stack gets for ``case``: a stream of its own, with which it cannot draw the
    simulator's numbers again. The campaign's, if the campaign says so."""
    if "seed" in case.variation.tell:
        return case.variation.seed
    return case_stream(case, "stack") >> 1


def is_told_truth(case: Case) -> bool:
    """Whether the stack gets boxes and the exact environment in ``case``."""
    variation = case.variation
    return perception_kind(variation.perception).told_truth or "truth" in variation.tell


def _canonical(value: object) -> bytes:
    return msgspec.json.encode(value, order="sorted")
