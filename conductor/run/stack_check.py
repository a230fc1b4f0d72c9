"""Whether a campaign's stack can be built on this machine; nothing of it is imported or run."""

from __future__ import annotations

from collections.abc import Iterable

from schemas.campaign import Campaign
from schemas.case import Case
from schemas.kinds.bridge import bridges
from schemas.sections.autonomy import Autonomy
from schemas.validation import Mistake
from twin.stack_identity.imports import locate
from twin.stack_identity.stack_class import class_mistakes


def stack_mistakes(campaign: Campaign, cases: Iterable[Case]) -> list[Mistake]:
    """A missing module, class or package, and parameters that the class does not take, no
    camera for one that drives by it."""
    mistakes = _missing_packages(campaign.autonomy)
    wanted: dict[str, set[str]] = {}
    for case in cases:
        if case.rig.stack:
            wanted.setdefault(case.rig.stack, set()).update(case.rig.parameters)
    for entry_point, parameters in wanted.items():
        mistakes += class_mistakes(entry_point, sorted(parameters), blind=not campaign.render)
    return mistakes


def _missing_packages(autonomy: Autonomy) -> list[Mistake]:
    """Packages of a bridge that is started on this machine or one that is set up alike."""
    bridge = bridges().get(autonomy.bridge)
    if autonomy.placement == "node" or bridge is None:
        return []
    return [
        Mistake(
            "autonomy.bridge",
            f"'{autonomy.bridge}' needs the package {package}, which is not installed: "
            f"pip install '{bridge.installed_by}'",
        )
        for package in bridge.packages
        if locate(package) is None
    ]
