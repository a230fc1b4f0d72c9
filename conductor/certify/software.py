"""The software that a run or a certificate was made with, beside the one that is installed here.

Two installations may come to the same bytes and have other digests: of what a campaign does not
depend on (:func:`conductor.certify.spared.spared`), versions and presence may differ.
"""

from __future__ import annotations

from collections.abc import Mapping

from conductor.certify.form import Certificate
from conductor.certify.lock import decode_lock, differences, installed
from conductor.certify.spared import spared
from conductor.records.software_file import SoftwareParts
from conductor.run.source import named_paths
from schemas.campaign import Campaign
from schemas.escape import escape
from schemas.files.software import differing
from twin.base.errors import InfrastructureError
from twin.base.software import library_versions, software_digest, software_files

SHOWN_CHARS_MAX = 200
"""Longest name of a file or library that is shown."""


def spared_libraries(campaign: Campaign) -> frozenset[str]:
    """Libraries that no result of a campaign depends on."""
    assets, _ = named_paths(campaign)
    return spared(campaign, has_assets=bool(assets))


def same_files(certificate: Certificate) -> bool:
    """Whether a certificate was made with the files of ours that are installed here."""
    if certificate.head.software == software_digest():
        return True
    files = certificate.files
    return files is not None and not file_lines(files, software_files())


def require_files(certificate: Certificate, shown: str) -> None:
    """Refuse a certificate that was made with other files of ours than are installed here.

    Needs nothing of its campaign, which other software may read otherwise.

    Raises:
        InfrastructureError: one line that names the first.
    """
    if same_files(certificate):
        return
    head, files, here = certificate.head, certificate.files, software_digest()
    if files is None:
        other = differences(decode_lock(certificate.lock, shown), installed())
        named = [line for line in other if line.split(" ", 1)[0] in head.libraries]
        raise _other(shown, head.software, here, named)
    raise _other(shown, head.software, here, file_lines(files, software_files()))


def require_libraries(certificate: Certificate, campaign: Campaign, shown: str) -> None:
    """Refuse a certificate whose campaign depends on a library that is another one here.

    Call it behind :func:`require_files`.

    Raises:
        InfrastructureError: one line that names the first.
    """
    head = certificate.head
    lines = library_lines(head.libraries, library_versions(), spared_libraries(campaign))
    if lines:
        raise _other(shown, head.software, software_digest(), lines)


def difference_from(parts: SoftwareParts | None) -> str:
    """What is installed otherwise here than a run was made with, as the end of a sentence; empty:
    nothing is, or it is not known."""
    if parts is None:
        return ""
    lines = library_lines(parts.libraries, library_versions())
    return _first(lines + file_lines(parts.files, software_files()))


def file_lines(before: Mapping[str, str], here: Mapping[str, str]) -> list[str]:
    """A line per file that is not the same, those that both have first."""
    names = sorted(differing(before, here), key=lambda name: not (name in before and name in here))
    return [f"{escape(name, SHOWN_CHARS_MAX)} {_said(before, here, name)}" for name in names]


def library_lines(
    before: Mapping[str, str], here: Mapping[str, str], unneeded: frozenset[str] = frozenset()
) -> list[str]:
    """A line per library that is not the same."""
    names = differing(before, here, unneeded)
    return [_library(name, before.get(name, ""), here.get(name, "")) for name in names]


def _library(name: str, there: str, here: str) -> str:
    shown = escape(name, SHOWN_CHARS_MAX)
    if not there:
        return f"{shown} {here}: was not installed there"
    return f"{shown} {escape(there, 60)}: {f'here {here}' if here else 'not installed here'}"


def _said(before: Mapping[str, str], here: Mapping[str, str], name: str) -> str:
    if name not in here:
        return "is not here"
    return "has another content here" if name in before else "is here and was not there"


def _first(lines: list[str]) -> str:
    more = f" (and {len(lines) - 1} more)" if len(lines) > 1 else ""
    return f"; {lines[0]}{more}" if lines else ""


def _other(shown: str, software: str, here: str, lines: list[str]) -> InfrastructureError:
    return InfrastructureError(
        f"{shown}: made with software {software[:12]}, this is {here[:12]}{_first(lines)}; install "
        f"that version (`conductor audit {shown} --lock` prints what it ran with)"
    )
