"""conductor.run.command: what the command is made of."""

from __future__ import annotations

from conductor.run.command import RunOptions, local_workers, run_campaign
from conductor.run.places import WorkersOption
from schemas.plan import parse_plan


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
