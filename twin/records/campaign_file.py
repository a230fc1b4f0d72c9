"""The campaign file of a run's folder, as its readers take it: the plan that was run."""

from __future__ import annotations

import functools
from pathlib import Path

from schemas.files.proposals import with_proposals
from schemas.files.yaml_file import YamlError, parse_yaml, read_yaml_text
from schemas.plan import Plan, parse_plan
from twin.base.errors import InfrastructureError

PLANS_MAX = 2
"""Plans that are remembered: a comparison has two folders."""


def read_plan(path: Path) -> Plan:
    """The plan of the campaign file ``path``.

    A report opens its folder several times, while the file may change: it is read each time, but
    the same text gives the same plan.

    Raises:
        InfrastructureError: the file is damaged.
    """
    try:
        return _plan_of(read_yaml_text(path), path)
    except YamlError as error:
        raise InfrastructureError(str(error)) from None


@functools.lru_cache(maxsize=PLANS_MAX)
def _plan_of(text: str, path: Path) -> Plan:
    content = with_proposals(parse_yaml(text, str(path)), path.parent, str(path))
    plan, mistakes = parse_plan(content)
    if plan is None:
        raise InfrastructureError(mistakes[0].line(str(path)))
    return plan
