"""Libraries that a campaign's results do not depend on."""

from __future__ import annotations

from schemas.campaign import Campaign
from schemas.device_class import is_portable
from schemas.files.software import DECODERS, GPU_LIBRARIES, OPENCV, RUNTIMES, TRANSLATORS
from schemas.kinds.bridge import NONE


def spared(campaign: Campaign, *, has_assets: bool) -> frozenset[str]:
    """Libraries that no result of ``campaign`` depends on, whether they are installed or not.

    Only where all that runs is ours: no stack, command or plug-in of somebody else and nothing
    behind a bridge, all of which may use what they find. Then runtimes of float networks count for
    nothing if the campaign is portable, for it has no such network (OpenCV resizes the pictures of
    others in whole numbers); decoders if no file that somebody else made is read for its world; and
    translators, for no bridge runs.

    Args:
        campaign: as it was submitted, the identity of its stack filled in.
        has_assets: it names a file of a scene, vehicle or scenario.
    """
    autonomy = campaign.autonomy
    foreign = campaign.stack_identity.digest or autonomy.command or autonomy.files
    if foreign or autonomy.bridge != NONE or campaign.plugins or autonomy.placement == "node":
        return frozenset()
    runtimes = (OPENCV, *RUNTIMES, *GPU_LIBRARIES) if is_portable(campaign) else ()
    return frozenset((*TRANSLATORS, *runtimes, *(() if has_assets else DECODERS)))
