"""When a run ends it is signed; when it is opened again or read, it must be as it was signed."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from conductor.journal.chain import Chain
from conductor.journal.store import read_journal
from conductor.records.outcomes import FILE_NAME as OUTCOMES_FILE
from conductor.records.outcomes import Outcomes, read_outcomes
from conductor.records.software_file import write_software
from conductor.records.timeline import FILE_NAME as TIMELINE_FILE
from conductor.serve.folders import CAMPAIGN_FILE
from conductor.trust.judge_feed import FILE_NAME as JUDGEMENT_FILE
from conductor.trust.judge_feed import read_judged
from conductor.trust.manifest import (
    BEFORE_FILE,
    DERIVED_FILE,
    RUN_FILE,
    JournalSum,
    Manifest,
    changed,
    is_derived,
    journal_of,
    listed,
    read_manifest,
    read_manifest_file,
    signed,
    write_manifest,
)
from conductor.trust.signing import TRUSTED_FOLDER, own_signer, short, trusted_keys
from schemas.words import counted
from twin.base.errors import InfrastructureError, TwinError, storage_error
from twin.base.own_folder import own_folder

READ_FILES = (OUTCOMES_FILE, CAMPAIGN_FILE, JUDGEMENT_FILE, TIMELINE_FILE)
"""What every report reads. KPI files are held against the digests in the outcomes, one by one."""
CACHE_FILE = ".report/read.msgpack"


class UnfitRunError(InfrastructureError):
    """A run is not as it was signed, or its verdicts are not those of its files."""


@dataclass(frozen=True, slots=True)
class Provenance:
    """What the manifest of a run says about where it comes from."""

    manifest: Manifest | None
    """Manifest of the run; None: it is not signed."""
    cache_fits: bool
    """Whether what earlier reports have read may be used."""

    @property
    def words(self) -> str:
        """Provenance in a few words."""
        return f"signed by key {short(self.manifest.key)}" if self.manifest else "not signed"


def require_fit(folder: Path) -> Provenance:
    """Refuse a run that is not as it was signed, or whose verdicts do not follow from its files.

    Quick: signature, key, and the files that every report reads.

    Raises:
        UnfitRunError: it does not fit; one line.
    """
    require_agreement(folder)
    manifest = read_manifest(folder)
    if manifest is None:
        return Provenance(None, cache_fits=True)
    if manifest.key not in trusted_keys():
        raise UnfitRunError(
            f"{folder}: signed by key {manifest.key}, which is not yours; if you know whose it is, "
            f"write it into {own_folder() / TRUSTED_FOLDER}/NAME.pub"
        )
    if wrong := changed(folder, manifest, READ_FILES):
        raise UnfitRunError(
            f"{folder}: {wrong[0]} is not what was signed; restore it, `conductor verify {folder}` "
            "lists all that was changed"
        )
    return Provenance(manifest, _cache_fits(folder, manifest))


def require_agreement(folder: Path) -> None:
    """Refuse a run in which the judge has found a difference.

    Raises:
        InfrastructureError: there is one; one line.
    """
    judged = read_judged(folder)
    if judged is not None and judged.differences:
        name, lines = next(iter(judged.differences.items()))
        more = len(judged.differences) - 1
        raise UnfitRunError(
            f"{folder}: case {name}: {lines[0] if lines else 'differs'}"
            + (f" (and {counted(more, 'more case', 'more cases')})" if more else "")
            + f"; its verdicts are not those of its files, see {JUDGEMENT_FILE}"
        )


def _cache_fits(folder: Path, manifest: Manifest) -> bool:
    try:
        derived = read_manifest(folder, "derived")
        trusted = trusted_keys()
    except TwinError:
        return False
    return (
        derived is not None
        and derived.of == manifest.signature
        and derived.key in trusted
        and not changed(folder, derived, [CACHE_FILE])
    )


def reopen(folder: Path) -> bool:
    """A conductor opens a run folder that may be signed: from now on it is not, until it ends.

    Returns:
        Whether it was signed.

    Raises:
        InfrastructureError: it is not as it was signed.
    """
    manifest = read_manifest(folder)
    if manifest is None:
        return False
    if wrong := changed(folder, manifest, READ_FILES):
        raise UnfitRunError(
            f"{folder}: {wrong[0]} is not what was signed; restore it, or remove {RUN_FILE} to go "
            "on with what is there"
        )
    try:
        (folder / RUN_FILE).replace(folder / BEFORE_FILE)
    except OSError as error:
        raise storage_error(error, str(folder / RUN_FILE)) from None
    return True


def sign_run(
    folder: Path, outcomes: Outcomes, fingerprint: str, chain: Chain | None = None
) -> Manifest:
    """Sign a run that has ended.

    Args:
        folder: run folder.
        outcomes: what stands in it.
        fingerprint: of its KPI values.
        chain: where the journal stands that a conductor still writes; None: it is closed, and read.

    Raises:
        TwinError: there is no key to sign with, or files were changed since it was signed before.
    """
    write_software(folder, outcomes.software)
    return _sign(folder, outcomes, fingerprint, _files(folder), chain)


def _files(folder: Path) -> dict[str, str]:
    """What the manifest of a run lists; every file is read."""
    return listed(folder, lambda name: not is_derived(name))


def _sign(
    folder: Path,
    outcomes: Outcomes,
    fingerprint: str,
    files: dict[str, str],
    chain: Chain | None = None,
) -> Manifest:
    signer = own_signer()
    _require_unchanged(folder, files)
    manifest = signed(
        Manifest(
            kind="run",
            campaign=outcomes.campaign,
            digest=outcomes.digest,
            fingerprint=fingerprint,
            journal=_journal_sum(folder) if chain is None else _sum_of("../conductor.db", chain),
            key="",
            files=files,
        ),
        signer,
    )
    write_manifest(folder, manifest)
    for name in (BEFORE_FILE, DERIVED_FILE):
        (folder / name).unlink(missing_ok=True)
    return manifest


def sign_again(folder: Path, *, reported: bool = False) -> None:
    """Sign a run that was opened and closed with the attempts that it had: a refused command, or a
    signal, takes away no signature. Of others nothing is signed.

    Args:
        folder: run folder.
        reported: whoever closed it has made its report anew, which is signed too.

    Raises:
        TwinError: there is no key to sign with, or a file of the run is damaged.
    """
    before = read_manifest_file(folder / BEFORE_FILE)
    if before is None or (folder / RUN_FILE).exists():
        return
    outcomes = read_outcomes(folder)
    if not outcomes.complete:
        return
    files = _files(folder)
    if _attempts(files) != _attempts(before.files):
        return
    derived = read_manifest(folder, "derived")
    _sign(folder, outcomes, before.fingerprint, files)
    if reported or (derived is not None and derived.files == listed(folder, is_derived)):
        sign_derived(folder)


def _is_case(name: str) -> bool:
    return name.startswith("cases/")


def _attempts(files: dict[str, str]) -> dict[str, str]:
    return {name: value for name, value in files.items() if _is_case(name)}


def sign_derived(folder: Path) -> None:
    """Sign what a report has made of a signed run; of others nothing is signed.

    Raises:
        TwinError: there is no key to sign with.
    """
    manifest = read_manifest(folder)
    if manifest is None:
        return
    files = listed(folder, is_derived)
    derived = Manifest(
        kind="derived",
        of=manifest.signature,
        campaign=manifest.campaign,
        fingerprint=manifest.fingerprint,
        key="",
        files=files,
    )
    write_manifest(folder, signed(derived, own_signer()))


def _journal_sum(folder: Path) -> JournalSum | None:
    path = journal_of(folder)
    if path is None:
        return None
    chain, facts = read_journal(path)
    for _ in facts:  # what is signed fits
        pass
    return _sum_of("conductor.db" if path.parent == folder else "../conductor.db", chain)


def _sum_of(file: Literal["conductor.db", "../conductor.db"], chain: Chain) -> JournalSum:
    return JournalSum(file=file, head=chain.head.hex(), count=chain.count)


def _require_unchanged(folder: Path, files: dict[str, str]) -> None:
    """What a run was signed with before may have grown, and has not changed otherwise."""
    before = read_manifest_file(folder / BEFORE_FILE)
    if before is None:
        return
    wrong = sorted(
        name for name, value in before.files.items() if _is_case(name) and files.get(name) != value
    )
    if wrong:
        with contextlib.suppress(OSError):
            (folder / BEFORE_FILE).replace(folder / RUN_FILE)
        raise UnfitRunError(
            f"{folder}: {wrong[0]} is not what was signed; restore it and run the command again"
        )
