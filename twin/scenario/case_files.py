"""Whether the files of a case are still those that its campaign was submitted with."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from schemas.case import Case
from schemas.files.assets import asset_digest
from schemas.files.yaml_file import YamlError
from schemas.kinds.scenario import kind_of
from twin.base.errors import RefusedError


def check_files(case: Case) -> None:
    """Refuse files of a rig, scene and vehicle, that are not those of the submission.

    Raises:
        RefusedError: one is another, or is missing; one line.
    """
    _check((case.rig.scene, case.rig.vehicle), case.rig.files)


def check_scenario_files(case: Case) -> None:
    """Refuse files that the scenario of a case names and that are not those of the submission.

    Raises:
        RefusedError: one is another, or is missing; one line.
    """
    scenario = case.variation.scenario
    _check(kind_of(scenario).files_of(scenario), case.variation.files)


def _check(names: Iterable[str], digests: Mapping[str, str]) -> None:
    for name in names:
        digest = digests.get(name)
        if digest is None:  # a shipped one
            continue
        try:
            content = asset_digest(Path(name))
        except (YamlError, OSError):  # gone, or cut short
            content = ""
        if content != digest:
            raise RefusedError(
                f"{name}: it, or a file it names, is not what the campaign was submitted with; "
                "put it back, or run the campaign anew with another --out"
            )
