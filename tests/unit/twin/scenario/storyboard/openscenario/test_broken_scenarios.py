"""Broken scenario files: each mistake is one line with file and line number, exit code 2."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

pytest.importorskip("lxml", reason="lxml is not installed")

from broken_files import CAR, GOOD, HEADER, LAUGHS, MISTAKES, ROUTE, TELEPORT

from twin.base.errors import UsageError
from twin.scenario.storyboard.compile.fates import (
    DESCRIBED_ATTRIBUTES,
    HANDLERS,
    NO_EFFECT,
    NO_EFFECT_ATTRIBUTES,
    REFUSED_TYPES,
    STRUCTURE,
    fate_of,
)
from twin.scenario.storyboard.openscenario.element import MISTAKES_MAX
from twin.scenario.storyboard.openscenario.scenario import expand, read_scenario
from twin.scenario.storyboard.openscenario.standard import (
    coverage,
    coverage_table,
    element_rules,
)
from twin.validate.command import app


def _write(folder: Path, text: str) -> Path:
    (folder / "routes").mkdir(exist_ok=True)
    path = folder / "s.xosc"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("old", "new", "line", "words"), MISTAKES)
def test_one_clear_line(tmp_path: Path, old: str, new: str, line: int, words: str) -> None:
    (tmp_path / "routes").mkdir()
    (tmp_path / "routes" / "r.xosc").write_text(ROUTE)
    assert old in GOOD
    path = _write(tmp_path, GOOD.replace(old, new, 1))
    with pytest.raises(ValueError, match=words) as refusal:
        read_scenario(path)
    assert f"{path}:{line}: " in str(refusal.value)
    result = CliRunner().invoke(app, ["scenario", str(path)])
    assert isinstance(result.exception, UsageError)
    assert result.exception.exit_code == 2


def test_entries_in_a_circle(tmp_path: Path) -> None:
    path = _write(tmp_path, GOOD.replace("<Init><Actions/></Init>", TELEPORT.format("A")))
    (tmp_path / "routes" / "r.xosc").write_text(ROUTE)
    with pytest.raises(ValueError, match=r"r\.xosc:5: catalog entries refer .* Routes/A"):
        read_scenario(path)


def test_billion_laughs(tmp_path: Path) -> None:
    path = _write(tmp_path, LAUGHS)
    with pytest.raises(ValueError, match=r"s\.xosc:1: ") as refusal:
        read_scenario(path)
    assert len(str(refusal.value).splitlines()) == 1


def test_large_sparse_file(tmp_path: Path) -> None:
    path = tmp_path / "s.xosc"
    with path.open("wb") as file:
        file.truncate(200 << 20)
    with pytest.raises(ValueError, match=r"s\.xosc:1: .*16777216"):
        read_scenario(path)


def test_all_mistakes_at_once_up_to_a_limit(tmp_path: Path) -> None:
    text = GOOD.replace("/ 3.6", "/ 0").replace('priority="overwrite"', 'priority="first"')
    with pytest.raises(ValueError) as refusal:
        read_scenario(_write(tmp_path, text))
    assert len(str(refusal.value).splitlines()) == 2
    text = GOOD.replace("<RoadNetwork/>", "<RoadNetwork/>" + "<Rood/>\n" * 200)
    with pytest.raises(ValueError) as refusal:
        read_scenario(_write(tmp_path, text))
    lines = str(refusal.value).splitlines()
    assert len(lines) == MISTAKES_MAX + 1
    assert lines[-1] == "and more; correct these first"


def _distribution(folder: Path, inner: str) -> Path:
    path = folder / "d.xosc"
    path.write_text(
        f'<OpenSCENARIO>\n{HEADER}\n<ParameterValueDistribution><ScenarioFile filepath="s.xosc"/>\n'
        f"{inner}\n</ParameterValueDistribution></OpenSCENARIO>"
    )
    return path


def test_draws_depend_on_seed_run_and_name_only(tmp_path: Path) -> None:
    scenario = _write(tmp_path, GOOD)

    def drawn(runs: int, seed: int) -> list[object]:
        file = _distribution(
            tmp_path,
            f'<Stochastic numberOfTestRuns="{runs}" randomSeed="{seed}">'
            '<StochasticDistribution parameterName="speed"><NormalDistribution expectedValue="5" '
            'variance="4"><Range lowerLimit="4" upperLimit="6"/></NormalDistribution>'
            "</StochasticDistribution></Stochastic>",
        )
        return [permutation.values["speed"] for permutation in expand(scenario, file)]

    assert drawn(20, 1)[:5] == drawn(5, 1) != drawn(5, 2)
    assert len(set(drawn(20, 1))) == 20
    assert all(4 <= float(str(value)) <= 6 for value in drawn(20, 1))


def test_user_defined_distribution_is_refused(tmp_path: Path) -> None:
    scenario = _write(tmp_path, GOOD)
    file = _distribution(
        tmp_path,
        '<Deterministic><DeterministicSingleParameterDistribution parameterName="speed">'
        '<UserDefinedDistribution type="t"/></DeterministicSingleParameterDistribution>'
        "</Deterministic>",
    )
    with pytest.raises(ValueError, match=r"d\.xosc:4: UserDefinedDistribution is refused"):
        expand(scenario, file)


def test_outline_says_what_happens(tmp_path: Path) -> None:
    path = _write(tmp_path, GOOD)
    result = CliRunner().invoke(app, ["scenario", str(path), "--output", "json"])
    answer = json.loads(result.stdout)
    assert result.exit_code == 0
    assert answer["valid"]
    event = "event event, when SimulationTime rule=greaterThan value=2 [rising] after 1 s"
    assert f"        {event}" in answer["outline"]
    assert "          action faster: SpeedAction" in answer["outline"]
    assert "parameter speed = 10" in answer["outline"]


def test_the_page_has_the_table() -> None:
    page = (Path(__file__).parents[6] / "docs" / "openscenario.md").read_text()
    assert "\n".join(coverage_table(fate_of)) in page
    fates = {fate.split(":")[0] for *_, fate in coverage(fate_of)}
    assert fates == {"read", "played", "no effect", "refused", "ignored"}


def test_whatever_stands_in_a_table_of_fates_is_an_element_type() -> None:
    known = element_rules()
    named = [*HANDLERS, *STRUCTURE, *REFUSED_TYPES, *NO_EFFECT]
    assert [name for name in named if name not in known] == []
    # An animation starts and ends as an event, and changes nothing.
    assert {name for name in named if named.count(name) > 1} == {"AnimationAction"}
    for name, attribute in (*NO_EFFECT_ATTRIBUTES, *DESCRIBED_ATTRIBUTES):
        assert attribute in known[name].attributes


def test_what_cannot_be_played_is_told_at_once(tmp_path: Path) -> None:
    text = GOOD.replace(CAR, '<ExternalObjectReference name="car"/>')
    path = _write(tmp_path, text)
    result = CliRunner().invoke(app, ["scenario", str(path)])
    assert isinstance(result.exception, UsageError)
    assert f"{path}:9: ExternalObjectReference is refused" in str(result.exception)
