"""Two campaign folders, read and compared."""

from __future__ import annotations

from pathlib import Path

from conductor.records.fingerprint import fingerprint
from conductor.report.compare.comparison import Comparison, compare
from conductor.report.reading.dossier import open_dossier
from conductor.trust.sign_run import require_fit
from schemas.words import unended
from twin.base.errors import UnfinishedError


def compare_folders(before: Path, after: Path) -> Comparison:
    """Read and compare two campaign folders; every KPI file is checked on the way.

    Raises:
        UsageError: a folder holds no campaign, or they cannot be compared.
        UnfinishedError: cases of one have not ended.
        InfrastructureError: files are damaged.
    """
    for folder in (before, after):
        require_fit(folder)
    first, second = open_dossier(before), open_dossier(after)
    for dossier in (first, second):
        if not dossier.outcomes.complete:
            raise UnfinishedError(
                f"{dossier.folder}: {unended(dossier.left, len(dossier.rows))}; "
                "run the campaign again to finish it, then compare"
            )
    return compare(first, second, fingerprint(before), fingerprint(after))
