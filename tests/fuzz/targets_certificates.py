"""Certificates, proofs and locks: by a stranger, and by somebody whose key is trusted."""

from __future__ import annotations

import contextlib
import hashlib
import json
from typing import Any

import msgspec
from certificates import decoded, signer
from fuzz_target import Target

from conductor.certify.consent import Consent, require_consent
from conductor.certify.form import FORMAT, SIGNED
from conductor.certify.lock import decode_lock
from conductor.certify.merkle import root_of
from conductor.certify.proof import decode_proof
from conductor.certify.rows import Row, leaves_of
from conductor.certify.software import require_files, require_libraries
from conductor.certify.subject import plan_in
from schemas.files.software import digest_of
from schemas.identity import campaign_digest
from schemas.plan import parse_plan
from twin.base.errors import TwinError


def _certificate(data: bytes) -> None:
    decoded(data)


def _signed(data: bytes) -> None:
    """Lines: head, rows, campaign, lock, and files if there is a fifth. They are sealed as the
    owner of a trusted key may do, so what he likes to write comes behind every signature and
    digest."""
    head, rows, campaign, lock, files = [*data.split(b"\n", 4), b"", b"", b"", b""][:5]
    with contextlib.suppress(ValueError, TypeError, AttributeError, RecursionError, LookupError):
        said = _bound(json.loads(head), rows, campaign, lock)
        if files:
            said["software"] = digest_of(json.loads(files), said["libraries"])
        head = json.dumps(said).encode()
    key = signer()
    parts = {"head": head, "rows": rows, "campaign": campaign, "lock": lock}
    parts |= {"files": files} if files else {}
    body = b",".join(b'"%s":%s' % (name.encode(), part) for name, part in parts.items())
    opening, at = body.split(b',"rows":', 1)
    proof = f',"key":"{key.public}","signature":"{key.sign(SIGNED + head)}","rows":'
    file = b'{"format":"%s",%s%s%s}\n' % (FORMAT.encode(), opening, proof.encode(), at)
    certificate = decoded(file)
    decode_lock(certificate.lock, "c.cert")
    plan = plan_in(certificate, "c.cert")
    with contextlib.suppress(TwinError):
        require_files(certificate, "c.cert")
    with contextlib.suppress(TwinError):
        require_libraries(certificate, plan.campaign, "c.cert")
    require_consent(plan, Consent(), "c.cert")


def _bound(head: dict[str, Any], rows: bytes, campaign: bytes, lock: bytes) -> dict[str, Any]:
    """The head with what follows from the other parts."""
    head |= {
        "campaign": hashlib.sha256(campaign).hexdigest(),
        "lock": hashlib.sha256(lock).hexdigest(),
    }
    with contextlib.suppress(msgspec.MsgspecError, IndexError):
        table = msgspec.json.decode(rows, type=list[Row])
        head["root"] = root_of(leaves_of(table, head["made_in"]["device_classes"])).hex()
    plan, _ = parse_plan(json.loads(campaign))
    if plan is not None:
        head["digest"] = campaign_digest(plan.campaign, plan.cases)
    return head


def _proof(data: bytes) -> None:
    decode_proof(data, "p.json", {signer().public})


def _lock(data: bytes) -> None:
    decode_lock(data, "c.cert")


TARGETS = {
    "certificate": Target(_certificate, (TwinError,), cost=5),
    "certificate-signed": Target(_signed, (TwinError,), cost=30),
    "certificate-proof": Target(_proof, (TwinError,), cost=2),
    "certificate-lock": Target(_lock, (TwinError,)),
}
