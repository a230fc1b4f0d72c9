"""The same files in another place: a campaign goes on whose model, scene or vehicle was moved, or
its folder.

Digests speak of contents, so a campaign is known again wherever its files lie; the paths that its
cases carry are those of the latest submission.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from schemas.campaign import Campaign
from schemas.case import Case
from schemas.sections.perception import Perception, file_fields


def moved(before: Campaign, now: Campaign) -> dict[str, str]:
    """Paths of the files of ``before`` that lie elsewhere in ``now``, a campaign of the same
    digest."""
    places: dict[tuple[str, str], str] = {}
    for path, sha in now.files.items():
        places.setdefault((sha, path.rpartition(".")[2]), path)
    paths = {}
    for path, sha in before.files.items():
        place = places.get((sha, path.rpartition(".")[2]))
        if now.files.get(path) != sha and place is not None:
            paths[path] = place
    pairs = zip(before.autonomy.files, now.autonomy.files, strict=False)
    paths |= {old: new for old, new in pairs if old != new}
    return paths


def out_at(out: str, before: str, now: str) -> str:
    """A campaign folder after the state folder was moved from ``before`` to ``now``: one that was
    it or lay in it came along, others stayed."""
    if out == before or out.startswith(f"{before}/"):
        return now + out[len(before) :]
    return out


def campaign_at(campaign: Campaign, paths: Mapping[str, str]) -> Campaign:
    """The campaign with its files at their new places."""
    variants = {n: _variant_at(v, paths) for n, v in campaign.autonomy.perception.items()}
    autonomy = msgspec.structs.replace(
        campaign.autonomy,
        perception=variants,
        files=[paths.get(path, path) for path in campaign.autonomy.files],
    )
    return msgspec.structs.replace(
        campaign,
        autonomy=autonomy,
        scenario=_scenario_at(campaign.scenario, paths),
        files=_files_at(campaign.files, paths),
    )


def case_at(case: Case, paths: Mapping[str, str]) -> Case:
    """The case with its files at their new places."""
    rig, variation = case.rig, case.variation
    files = [paths.get(path, path) for path in rig.source.files]
    return Case(
        rig=msgspec.structs.replace(
            rig,
            scene=paths.get(rig.scene, rig.scene),
            vehicle=paths.get(rig.vehicle, rig.vehicle),
            files=_files_at(rig.files, paths),
            source=msgspec.structs.replace(rig.source, files=files),
            models=sorted(paths.get(path, path) for path in rig.models),
        ),
        variation=msgspec.structs.replace(
            variation,
            perception=_variant_at(variation.perception, paths),
            scenario=_scenario_at(variation.scenario, paths),
            files=_files_at(variation.files, paths),
        ),
    )


def _variant_at(variant: Perception, paths: Mapping[str, str]) -> Perception:
    changed = {key: paths[path] for key, path in file_fields(variant).items() if path in paths}
    return msgspec.structs.replace(variant, **changed) if changed else variant


def _scenario_at(scenario: Any, paths: Mapping[str, str]) -> Any:
    changed = {
        key: paths[getattr(scenario, key)]
        for key in ("scene", "vehicle")
        if getattr(scenario, key) in paths
    }
    return msgspec.structs.replace(scenario, **changed) if changed else scenario


def _files_at(files: Mapping[str, str], paths: Mapping[str, str]) -> dict[str, str]:
    return {paths.get(path, path): sha for path, sha in files.items()}
