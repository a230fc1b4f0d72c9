"""The scenarios of a run's cases, as its campaign file has them."""

from __future__ import annotations

from pathlib import Path

from schemas.campaign import Scenario
from schemas.files.yaml_file import YamlError, load_yaml
from schemas.plan import expand, parse_campaign
from twin.base.errors import InfrastructureError


def scenarios_in(path: Path) -> dict[str, Scenario]:
    """Case -> scenario of the campaign file ``path``.

    Raises:
        InfrastructureError: the file is damaged.
    """
    try:
        campaign, mistakes = parse_campaign(load_yaml(path))
    except YamlError as error:
        raise InfrastructureError(str(error)) from None
    if campaign is None:
        raise InfrastructureError(mistakes[0].line(str(path)))
    return {case.id: case.variation.scenario for case in expand(campaign)}
