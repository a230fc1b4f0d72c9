"""The cases that a search has proposed since it began, as images of a snapshot.

A thousand in each, and those that are full are taken once: what a snapshot costs does not grow with
the search.
"""

from __future__ import annotations

import msgspec
from msgspec import UNSET, Struct

from conductor.core.case_table import CaseTable, pack, unpack
from conductor.core.facts import Image
from conductor.core.state import IMAGE_CASES, CampaignState, State
from schemas.identity import rig_key


class _Proposed(Struct, frozen=True):
    """Cases that a search has proposed since it began."""

    campaign: str
    cases: CaseTable


def proposed_images(campaign: CampaignState) -> list[Image]:
    """Images of the cases of later generations; those that are full are taken once."""
    begun, images = begun_cases(campaign), []
    full = max(0, campaign.imaged - begun) // IMAGE_CASES
    for number in range(full, -(-(len(campaign.ordered) - begun) // IMAGE_CASES)):
        first = begun + number * IMAGE_CASES
        cases = [case.case for case in campaign.ordered[first : first + IMAGE_CASES]]
        content = _Proposed(campaign.campaign.campaign, pack(cases))
        images.append(
            Image(f"1/{campaign.order:06d}/{number:06d}", msgspec.msgpack.encode(content))
        )
    return images


def begun_cases(campaign: CampaignState) -> int:
    """Number of cases that came with a campaign."""
    record, search = campaign.search, campaign.campaign.search
    if record is None or search is UNSET:
        return len(campaign.ordered)
    return sum(record.sizes[: search.chains])


def is_proposed(image: Image) -> bool:
    """Whether an image is one of these."""
    return image.key.startswith("1/") and image.key.count("/") > 1


def restore_proposed(state: State, image: Image) -> None:
    """Add the cases of an image to their campaign, which is there.

    Raises:
        msgspec.MsgspecError: the image is damaged.
    """
    part = msgspec.msgpack.decode(image.data, type=_Proposed)
    campaign, cases = state.campaigns[part.campaign], unpack(part.cases)
    campaign.extend(cases, [rig_key(case) for case in cases])
    campaign.imaged = len(campaign.ordered)
