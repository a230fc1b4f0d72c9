"""A certificate of a finished run."""

from __future__ import annotations

import datetime
import platform
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import msgspec

from conductor.certify.form import (
    CAMPAIGN_BYTES_MAX,
    LOCK_BYTES_MAX,
    SIGNED,
    Certificate,
    MadeIn,
    SignedHead,
    encode_certificate,
)
from conductor.certify.lock import encode_lock, installed, with_archives
from conductor.certify.merkle import root_of
from conductor.certify.rows import Row, counts_of, leaves_of
from conductor.certify.software import difference_from
from conductor.records.fingerprint import fingerprint, label_of
from conductor.records.outcomes import CaseOutcome, Outcomes, read_outcomes
from conductor.records.software_file import read_software
from conductor.serve.folders import CAMPAIGN_FILE
from conductor.trust.signing import Signer, trusted_keys
from conductor.trust.verify import verify_run
from schemas.files.software import digest_of
from schemas.identity import DIGESTS, campaign_digest
from schemas.plan import Plan
from schemas.sections.autonomy import UNPROTECTED, driver
from schemas.words import counted, unended
from twin.base.errors import InfrastructureError, UnfinishedError, UsageError
from twin.base.progress import Told
from twin.base.software import library_versions, software_digest, software_files
from twin.records.campaign_file import read_plan
from twin.stack_identity.identity import Named, shown_name


@dataclass(frozen=True, slots=True)
class Asked:
    """What a certificate is to say and to be signed with."""

    signer: Signer
    by: str = ""
    """Who makes it, in words of his own."""
    lock: Path | None = None
    """Report of `pip` with the hashes of archives."""
    unprotected: bool = False
    """Also certify a run whose stack had no sandbox."""


def certify(folder: Path, asked: Asked, told: Told = lambda _what, _done, _total: None) -> bytes:
    """The certificate of the run in ``folder``, as the bytes of its file.

    Args:
        folder: of a finished and signed run.
        asked: how.
        told: hears of progress.

    Raises:
        UnfinishedError: cases have not ended.
        UsageError: there is no run, it went by the wall clock, had no sandbox, or other software
            ran it.
        InfrastructureError: it is not as it was signed.
    """
    outcomes = read_outcomes(folder)
    _require_certifiable(folder, outcomes, asked)
    verified = verify_run(folder, trusted_keys(), told=told)
    if verified.differences or verified.manifest is None:
        raise InfrastructureError(
            f"{folder}: is not as it was signed, and is not certified: {verified.differences[0]}; "
            f"`conductor verify {folder}` lists all"
        )
    # Reads every KPI file: the digests in the outcomes are those of the values.
    if fingerprint(folder).sha256 != verified.manifest.fingerprint:
        raise InfrastructureError(f"{folder}: its fingerprint is not the one that was signed")
    plan = read_plan(folder / CAMPAIGN_FILE)
    campaign = _embedded(folder, plan, outcomes)
    classes = outcomes.device_classes
    rows = [row_of(name, case, classes) for name, case in outcomes.cases.items()]
    locked = installed() if asked.lock is None else with_archives(installed(), asked.lock)
    lock = encode_lock(locked)
    if len(lock) > LOCK_BYTES_MAX:
        raise UsageError(f"{len(locked)} distributions are installed here, too many to list")
    autonomy = plan.campaign.autonomy
    driven = driver(autonomy)
    files, libraries = software_files(), library_versions()
    if digest_of(files, libraries) != outcomes.software:
        raise UsageError(f"{folder}: the software was changed meanwhile; type the command again")
    head = SignedHead(
        name=outcomes.campaign,
        digest=outcomes.digest,
        fingerprint=verified.manifest.fingerprint,
        software=outcomes.software,
        libraries=libraries,
        stack=shown_name(Named(driven["stack"], driven.get("foreign"), autonomy.files)),
        stack_digest=plan.campaign.stack_identity.digest,
        protected=is_protected(outcomes),
        protection=outcomes.protection,
        made_in=_made_in(classes),
        made=f"{datetime.datetime.now(datetime.UTC):%Y-%m-%dT%H:%M:%SZ}",
        by=asked.by,
        run_key=verified.manifest.key,
        run_signature=verified.manifest.signature,
    )
    return encode_certificate(sealed(head, rows, campaign, lock, asked.signer, files))


def sealed(
    head: SignedHead,
    rows: list[Row],
    campaign: bytes,
    lock: bytes,
    signer: Signer,
    files: dict[str, str] | None = None,
) -> Certificate:
    """A signed certificate; what of the head follows from the other parts is filled in."""
    whole = msgspec.structs.replace(
        head,
        count=len(rows),
        outcomes=counts_of(rows),
        root=root_of(leaves_of(rows, head.made_in.device_classes)).hex(),
        campaign=sha256(campaign).hexdigest(),
        lock=sha256(lock).hexdigest(),
    )
    signed = msgspec.json.encode(whole)
    return Certificate(
        head=whole,
        signed=signed,
        key=signer.public,
        signature=signer.sign(SIGNED + signed),
        rows=rows,
        campaign=campaign,
        lock=lock,
        files=files,
    )


def row_of(name: str, case: CaseOutcome, classes: list[str]) -> Row:
    """What a certificate says of a case of a run with these device classes."""
    place = classes.index(case.device_class) if case.device_class else -1
    return Row(name, label_of(case), case.kpi_sha256, place)


def is_protected(outcomes: Outcomes) -> bool:
    """Whether no stack of a run could touch more than its rig, as far as the record says."""
    if outcomes.simulator == "noop":
        return True
    said = outcomes.protection
    return bool(said) and not any(each.startswith(UNPROTECTED) for each in said)


def _require_certifiable(folder: Path, outcomes: Outcomes, asked: Asked) -> None:
    if not outcomes.complete:
        left = sum(not case.outcome for case in outcomes.cases.values())
        raise UnfinishedError(
            f"{folder}: {unended(left, len(outcomes.cases))}; run the campaign again to finish it"
        )
    if outcomes.clock == "realtime":
        raise UsageError(f"{folder}: went by the wall clock, so nobody can run it again")
    if outcomes.digests != DIGESTS:
        raise UsageError(f"{folder}: its campaign digest is of an earlier version; run it anew")
    here = software_digest()
    if outcomes.software != here:
        what = difference_from(read_software(folder, outcomes.software))
        raise UsageError(
            f"{folder}: was run by software {outcomes.software[:12] or 'unknown'}, this is "
            f"{here[:12]}{what}; certify it with the version and environment that ran it"
        )
    if not is_protected(outcomes) and not asked.unprotected:
        said = next((p for p in outcomes.protection if p.startswith(UNPROTECTED)), "not known")
        raise UsageError(
            f"{folder}: its stack had no sandbox ({said}), so it could have written its verdicts; "
            "run it in one, or give --allow-unprotected, and the certificate says so"
        )


def _embedded(folder: Path, plan: Plan, outcomes: Outcomes) -> bytes:
    """The campaign as JSON, from which the same cases follow."""
    found = campaign_digest(plan.campaign, plan.cases)
    names = [case.id for case in plan.cases]
    if found != outcomes.digest or sorted(names) != sorted(outcomes.cases):
        raise InfrastructureError(
            f"{folder / CAMPAIGN_FILE}: other cases follow from it here than were run (digest "
            f"{found[:12]}, of the run {outcomes.digest[:12]})"
        )
    data = msgspec.json.encode(msgspec.to_builtins(plan.campaign))
    if len(data) > CAMPAIGN_BYTES_MAX:
        raise UsageError(
            f"{folder / CAMPAIGN_FILE}: {counted(len(data), 'byte')} as JSON, at most "
            f"{CAMPAIGN_BYTES_MAX} fit into a certificate; certify parts of it"
        )
    return data


def _made_in(classes: list[str]) -> MadeIn:
    return MadeIn(
        python=platform.python_version(),
        system=f"{platform.system()} {platform.release()}",
        machine=platform.machine(),
        device_classes=classes,
    )
