"""The repository of a stack: fetched and built where there is a network, pinned to its commit."""

from __future__ import annotations

import msgspec

from schemas.campaign import Campaign
from schemas.validation import Mistake
from twin.base.errors import InfrastructureError, UsageError
from twin.base.fetch import fetch


def with_repository(campaign: Campaign, shown: str) -> Campaign:
    """The campaign with the commit in place of a branch or tag; the files are in the cache.

    Raises:
        UsageError: no such repository or ref, or its set-up failed, with its last lines.
    """
    repository = campaign.autonomy.repository
    if repository is None:
        return campaign
    try:
        commit = fetch(repository).commit
    except InfrastructureError as error:
        raise UsageError(Mistake("autonomy.repository", str(error)).line(shown)) from None
    pinned = msgspec.structs.replace(repository, ref=commit)
    autonomy = msgspec.structs.replace(campaign.autonomy, repository=pinned)
    return msgspec.structs.replace(campaign, autonomy=autonomy)
