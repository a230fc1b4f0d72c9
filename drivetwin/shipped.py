"""Campaigns before they run: those that are shipped, and what a check says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from conductor.run.requested import RunRequest


@dataclass(frozen=True, slots=True)
class ShippedCampaign:
    """A campaign that comes with the package."""

    name: str
    cases: int
    """Cases that it has; of a search, at most."""
    description: str


@dataclass(frozen=True, slots=True)
class CheckedCampaign:
    """A campaign that can be run."""

    name: str
    seed: int
    cases: tuple[str, ...]
    """Names of its cases; of a search, those of its first generation."""


def shipped() -> list[ShippedCampaign]:
    """The shipped campaigns, by name."""
    from conductor.run.source import listed
    from conductor.run.source import shipped as names

    return [ShippedCampaign(name, *listed(name)) for name in names()]


def checked(request: RunRequest) -> CheckedCampaign:
    """Check a campaign and its networks, as `conductor validate` does.

    Raises:
        UsageError: it is not valid; a line per mistake.
        InfrastructureError: the check itself did not work.
    """
    from conductor.run.requested import checked_plan

    changes = request.changes
    plan = checked_plan(request.campaign, seed=request.seed, fetch=False, changes=changes)
    cases = tuple(case.id for case in plan.cases)
    return CheckedCampaign(plan.campaign.campaign, plan.campaign.seed, cases)
