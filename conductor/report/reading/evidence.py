"""What speaks for or against the results: fingerprint, audits, alarms, and where they came from."""

from __future__ import annotations

import importlib.metadata
import platform
import shlex
from collections.abc import Iterable
from dataclasses import dataclass

from conductor.records.fingerprint import Fingerprint
from conductor.records.realtime import too_slow
from conductor.report.reading.dossier import Dossier
from schemas.identity import DIGESTS
from schemas.names import SHIPPED_STACKS
from schemas.words import unended
from twin.records.repeating import again_folder, campaign_of, repeat_command, run_name

_PACKAGES = ("drivetwin", "numpy", "warp-lang", "opencv-python-headless", "pyarrow", "plotly")


@dataclass(frozen=True, slots=True)
class Evidence:
    """Fingerprint and alarms of a campaign."""

    fingerprint: Fingerprint | None
    fingerprint_missing: str
    """Why there is none; empty if there is one."""
    alarms: list[str]
    """Reasons not to trust the results, one line each."""
    audits: int
    """Results that came a second time, with a dead token, and could be compared."""
    disagreements: int
    steered: list[str]
    """Attempts without a verdict, because of interventions, one line each."""


def gather(dossier: Dossier, broken: Iterable[str], found: Fingerprint | None) -> Evidence:
    """Audit the campaign; ``broken`` are the mistakes found while its KPI files were read, and
    ``found`` is the fingerprint that came out of them."""
    alarms = list(broken)
    audits = disagreements = 0
    for row in dossier.rows:
        for late in row.end.late:
            audits += late.agrees is not None
            if late.agrees is False:
                disagreements += 1
                alarms.append(
                    f"case {row.case.id}: two attempts of this case disagree. Committed: "
                    f"{row.status}, KPI {row.end.kpi_sha256[:12] or 'none'} "
                    f"({row.end.attempt_dir}); late: {late.verdict or late.outcome}, KPI "
                    f"{late.kpi_sha256[:12] or 'none'} ({late.attempt_dir}, worker {late.worker})"
                )
    same_kind = dossier.outcomes.digests == DIGESTS  # a folder of before has digests of its own
    if same_kind and dossier.digest_now != dossier.outcomes.digest:
        alarms.append(
            f"campaign.yaml gives the digest {dossier.digest_now[:12]}, but "
            f"{dossier.outcomes.digest[:12]} was run: the file or this installation has changed"
        )
    if dossier.campaign.device == "same" and len(dossier.outcomes.device_classes) > 1:
        alarms.append(
            "the campaign asks for one device class, its results come from "
            + ", ".join(dossier.outcomes.device_classes)
        )
    if warning := too_slow(dossier.outcomes):
        alarms.append(warning)
    steered = [f"{row.case.id}, {touch}" for row in dossier.rows for touch in row.end.steered]
    missing = "" if found else _missing(dossier)
    return Evidence(found, missing, alarms, audits, disagreements, steered)


def versions() -> dict[str, str]:
    """Versions of what made the report (what made the results is in the software digest)."""
    by_package = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            by_package[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            by_package[name] = "not installed as a package"
    return by_package


def commands(dossier: Dossier) -> list[str]:
    """Shell commands that run the campaign again and compare, from the folder that holds the run's
    (:mod:`twin.records.repeating`)."""
    name = run_name(dossier.folder)
    again = again_folder(name)
    if dossier.imported is not None:
        words = ["conductor", "report", "--import-autodrive", dossier.imported.source]
        first = shlex.join([*words, "--out", again])
    else:
        on_gpu = any(name.startswith("cuda") for name in dossier.outcomes.ran_on)
        device = "cuda:0" if on_gpu else ""
        first = repeat_command(campaign_of(dossier.folder), name, device=device)
    return [first, *(shlex.join(["conductor", "fingerprint", run]) for run in (again, name))]


def found_where(dossier: Dossier) -> str:
    """What else a repetition needs, in words that follow "in the folder ..."; empty: nothing."""
    autonomy = dossier.campaign.autonomy
    shipped = autonomy.stack.startswith(SHIPPED_STACKS)
    if autonomy.command or shipped or dossier.imported is not None:
        return ""
    return f", where its stack {autonomy.stack} is found (PYTHONPATH)"


def _missing(dossier: Dossier) -> str:
    if dossier.outcomes.complete:
        return "a KPI file is missing or damaged, see the alarm above"
    return unended(dossier.left, len(dossier.rows))
