"""conductor.run.command: what the command is made of."""

from __future__ import annotations

import pytest

from conductor.run.command import RunOptions, local_workers, run_campaign
from conductor.run.places import WorkersOption
from conductor.run.source import only_case
from schemas.plan import parse_plan
from twin.base.errors import UsageError


def test_it_says_when_nobody_computes_any_more(tmp_path, capsys):
    plan, mistakes = parse_plan(
        {"campaign": "alpha", "simulator": "noop", "matrix": {"repeat": [0, 1, 2]}}
    )
    assert plan is not None, mistakes
    options = RunOptions(out=tmp_path / "run", workers=WorkersOption(count=1), slots=2)
    workers = local_workers(plan, options)
    left: list[int] = []
    try:
        code = run_campaign(plan, options, workers, lambda: left.append(len(workers.children)))
    finally:
        workers.stop()
    assert (code, left) == (0, [0])
    assert "3 of 3 passed" in capsys.readouterr().out


def test_a_case_is_chosen_by_its_name_and_a_misspelt_one_is_told_the_nearest():
    plan, mistakes = parse_plan(
        {"campaign": "alpha", "matrix": {"weather": ["clear", "heavy_fog", "light_rain"]}}
    )
    assert plan is not None, mistakes
    assert [case.id for case in only_case(plan, "heavy_fog").cases] == ["heavy_fog"]
    lists = "`conductor validate FILE --output json` lists them"
    for given, hint in (("heavy-fog", "did you mean 'heavy_fog'? "), ("dusk", "")):
        with pytest.raises(UsageError) as error:
            only_case(plan, given)
        assert str(error.value) == f"--case {given}: no case of 'alpha'; {hint}{lists}"
