"""What is wrong with a campaign that only the simulator knows: its scenes, and its plug-ins."""

from __future__ import annotations

from schemas.campaign import Campaign
from schemas.kinds.registry import implementation
from schemas.plan import expand, kinds_of_others
from schemas.validation import Mistake
from twin.validate.scene_check import Variant, mistakes_of


def campaign_mistakes(campaign: Campaign) -> list[Mistake]:
    """One per line of :func:`twin.validate.scene_check.mistakes_of`, and one per kind of another
    distribution whose implementation cannot be imported."""
    cases = expand(campaign)
    lines = mistakes_of(Variant(case.rig.scene, case.variation.objects) for case in cases)
    mistakes = [Mistake("scenario.scene", line) for line in lines]
    kinds = [kind for kind in kinds_of_others(campaign, cases) if kind.implementation]
    if not kinds:
        return mistakes
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels
    for kind in kinds:
        try:
            implementation(kind.implementation)
        except ValueError as error:
            mistakes.append(Mistake(kind.key, str(error)))
    return mistakes
