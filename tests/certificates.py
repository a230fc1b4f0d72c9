"""Certificates for tests: of real campaigns, with any results, signed by a key of the tests."""

from __future__ import annotations

import hashlib
from typing import Any

import msgspec
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from conductor.certify.form import Certificate, MadeIn, SignedHead, decode_certificate
from conductor.certify.lock import encode_lock, installed
from conductor.certify.making import sealed
from conductor.certify.rows import Row
from conductor.trust.signing import Signer
from schemas.identity import campaign_digest
from schemas.plan import Plan, parse_plan
from twin.base.software import library_versions, software_digest

DEVICE = "cpu:x86_64+avx2+fma"


def signer(number: int = 1) -> Signer:
    """A key that is always the same."""
    return Signer(Ed25519PrivateKey.from_private_bytes(bytes([number]) * 32))


def campaign(count: int = 8, **changed: Any) -> dict[str, Any]:
    """The content of a campaign file with so many cases of ``noop``."""
    matrix = {"scenario.ego_start_m": [20 + number / 16 for number in range(count)]}
    return {"campaign": "table", "simulator": "noop", "matrix": matrix, **changed}


def plan_of(data: dict[str, Any]) -> Plan:
    plan, mistakes = parse_plan(data)
    assert plan is not None, mistakes
    return plan


def results(plan: Plan) -> list[Row]:
    """A row for each case: every third collides."""
    verdicts = ["verdict/pass", "verdict/pass", "verdict/collision"]
    return [
        Row(case.id, verdicts[number % 3], hashlib.sha256(case.id.encode()).hexdigest(), 0)
        for number, case in enumerate(plan.cases)
    ]


def made(
    data: dict[str, Any] | None = None,
    rows: list[Row] | None = None,
    key: Signer | None = None,
    files: dict[str, str] | None = None,
    **said: Any,
) -> Certificate:
    """A certificate of a campaign, which tells the truth unless rows are given.

    ``said`` stands in the head.
    """
    plan = plan_of(campaign() if data is None else data)
    head = SignedHead(
        name=plan.campaign.campaign,
        digest=campaign_digest(plan.campaign, plan.cases),
        fingerprint="0" * 64,
        software=software_digest(),
        libraries=library_versions(),
        stack="stack devkit.aeb:AebStack",
        stack_digest=plan.campaign.stack_identity.digest,
        protected=True,
        protection=[],
        made_in=MadeIn(
            python="3.11.7", system="Linux 6", machine="x86_64", device_classes=[DEVICE]
        ),
        made="2026-11-26T12:00:00Z",
        by="",
        run_key="0" * 64,
        run_signature="0" * 128,
    )
    return sealed(
        msgspec.structs.replace(head, **said),
        results(plan) if rows is None else rows,
        msgspec.json.encode(msgspec.to_builtins(plan.campaign)),
        encode_lock(installed()[:3]),
        key or signer(),
        files,
    )


def decoded(data: bytes, *keys: Signer) -> Certificate:
    """What ``data`` holds, if one of the keys has signed it."""
    return decode_certificate(data, "c.cert", {each.public for each in keys or (signer(),)})
