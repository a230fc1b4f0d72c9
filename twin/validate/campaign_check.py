"""What is wrong with a campaign that only the simulator knows: its scenes, vehicles, plug-ins."""

from __future__ import annotations

from collections.abc import Sequence

from schemas.campaign import Campaign
from schemas.case import Case
from schemas.kinds.registry import implementation
from schemas.kinds.scenario import scenario_kinds
from schemas.plan import plan_of
from schemas.validation import Mistake
from twin.validate.scene_check import Variant, check_scenes, vehicle_mistakes
from twin.vehicle.masses import load_of


def check_campaign(campaign: Campaign) -> tuple[list[Mistake], list[str]]:
    """Mistakes, and notes of what is left out of files.

    One per line of what :mod:`twin.validate.scene_check` says, and one per kind of another
    distribution whose implementation cannot be imported.
    """
    plan = plan_of(campaign)
    asked = (
        Variant(case.rig.scene, case.variation.objects)
        for case in plan.cases
        if case.rig.scene == case.variation.scenario.scene
    )
    scenes = check_scenes(asked)
    mistakes = [Mistake("scenario.scene", line) for line in scenes.mistakes]
    lines = vehicle_mistakes(
        (case.rig.vehicle, load_of(case.variation.scenario)) for case in plan.cases
    )
    mistakes += [Mistake("scenario.vehicle", line) for line in lines]
    mistakes += _of_families(plan.cases)
    kinds = [kind for kind in plan.kinds_of_others() if kind.implementation]
    if not kinds:
        return mistakes, scenes.notes
    from twin.world.kernel_cache import prepare_kernels

    prepare_kernels()  # before the modules that define kernels
    for kind in kinds:
        try:
            implementation(kind.implementation)
        except ValueError as error:
            mistakes.append(Mistake(kind.key, str(error)))
    return mistakes, scenes.notes


def _of_families(cases: Sequence[Case]) -> list[Mistake]:
    """What the families of the cases find wrong with them."""
    mistakes = []
    for kind in scenario_kinds().declared:
        own = [case for case in cases if case.variation.scenario.type == kind.name]
        if own and kind.checks:
            lines: list[str] = implementation(kind.checks)(own)
            key = kind.files[0] if kind.files else "scene"
            mistakes += [Mistake(f"scenario.{key}", line) for line in lines]
    return mistakes
