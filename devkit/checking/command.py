"""The command ``devkit check``."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin.base.cli import Output, OutputOption, duration
from twin.base.errors import UsageError

if TYPE_CHECKING:
    from devkit.checking.check import RuleCheck


def check(
    stack: Annotated[
        str, typer.Argument(help="module:Class, a command line in quotes, or a campaign file.")
    ],
    parameters: Annotated[str, typer.Option(help="Stack parameters as JSON.")] = "{}",
    ticks: Annotated[int, typer.Option(min=15, max=10_000, help="Ticks of every drive.")] = 40,
    deadline_s: Annotated[
        float, duration("Longest time for an answer, start-up included [s].", least=0.1)
    ] = 60.0,
    output: OutputOption = Output.human,
) -> None:
    """Check that a stack keeps the rules that make its verdicts repeatable; exits 1 if not.

    Two processes of it see made-up drives, without a simulator: the same frames twice, another case
    between, frames that are lost, a seq that comes again, messages of a later version.
    """
    from devkit.checking.check import check_present, check_stack, plan_of

    values = parsed_parameters(parameters)
    case = plan_of(stack, values).cases[0]
    check_present(case)
    human = output is Output.human
    done = check_stack(case, ticks, deadline_s, _print if human else _quiet)
    passed = all(one.passed for one in done)
    if human:
        failed = sum(not one.passed for one in done)
        print(f"{stack}: {'conforms' if passed else f'{failed} of {len(done)} checks failed'}")
    else:
        rows = [{"check": c.name, "passed": c.passed, "detail": c.detail} for c in done]
        print(json.dumps({"stack": stack, "passed": passed, "checks": rows}, indent=1))
    raise typer.Exit(0 if passed else 1)


def parsed_parameters(text: str) -> dict[str, Any]:
    """Stack parameters as given on the command line.

    Raises:
        UsageError: no JSON object; one line.
    """
    try:
        values = json.loads(text)
    except ValueError as error:
        raise UsageError(f"--parameters: not JSON: {error}") from None
    if not isinstance(values, dict):
        raise UsageError("--parameters: expected a JSON object, e.g. '{\"gap_m\": 8}'")
    return values


def _print(one: RuleCheck) -> None:
    print(f"{'pass' if one.passed else 'FAIL'}  {one.name:<17} {one.detail}", flush=True)


def _quiet(one: RuleCheck) -> None:
    """JSON comes at the end, all of it."""
