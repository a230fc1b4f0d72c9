"""``twin play``: poses, events, permutations, and what it refuses."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

pytest.importorskip("lxml", reason="lxml is not installed")

from twin.base.errors import UsageError
from twin.cli import app
from twin.play.report import CSV_COLUMNS

SCENARIO = """<OpenSCENARIO>
<FileHeader author="a" date="2026-01-31T12:00:00" description="" revMajor="1" revMinor="3"/>
<ParameterDeclarations>
<ParameterDeclaration name="speed" parameterType="double" value="10"/>
</ParameterDeclarations>
<CatalogLocations/><RoadNetwork/>
<Entities><ScenarioObject name="Ego"><Vehicle name="car" vehicleCategory="car"><BoundingBox>
<Center x="1.4" y="0" z="0.9"/><Dimensions width="2" length="5" height="1.8"/></BoundingBox>
<Performance maxSpeed="70" maxDeceleration="8" maxAcceleration="5"/><Axles>
<RearAxle maxSteering="0" wheelDiameter="0.8" trackWidth="1.7" positionX="0" positionZ="0.4"/>
</Axles></Vehicle></ScenarioObject></Entities>
<Storyboard><Init><Actions><Private entityRef="Ego">
<PrivateAction><TeleportAction><Position><WorldPosition x="3" y="4" h="0"/></Position>
</TeleportAction></PrivateAction>
<PrivateAction><LongitudinalAction><SpeedAction>
<SpeedActionDynamics dynamicsShape="step" dynamicsDimension="time" value="0"/>
<SpeedActionTarget><AbsoluteTargetSpeed value="$speed"/></SpeedActionTarget></SpeedAction>
</LongitudinalAction></PrivateAction></Private></Actions></Init>
<Story name="story"><Act name="act"><ManeuverGroup name="group" maximumExecutionCount="1">
<Actors selectTriggeringEntities="false"><EntityRef entityRef="Ego"/></Actors>
<Maneuver name="maneuver"><Event name="brake" priority="override"><Action name="stop">
<PrivateAction><LongitudinalAction><SpeedAction>
<SpeedActionDynamics dynamicsShape="linear" dynamicsDimension="time" value="2"/>
<SpeedActionTarget><AbsoluteTargetSpeed value="0"/></SpeedActionTarget></SpeedAction>
</LongitudinalAction></PrivateAction></Action>
<StartTrigger><ConditionGroup><Condition name="c" conditionEdge="none" delay="0">
<ByValueCondition><SimulationTimeCondition rule="greaterOrEqual" value="1"/></ByValueCondition>
</Condition></ConditionGroup></StartTrigger></Event></Maneuver></ManeuverGroup></Act></Story>
<StopTrigger><ConditionGroup><Condition name="end" conditionEdge="none" delay="0">
<ByValueCondition><SimulationTimeCondition rule="greaterOrEqual" value="4"/></ByValueCondition>
</Condition></ConditionGroup></StopTrigger></Storyboard></OpenSCENARIO>
"""
DISTRIBUTION = """<OpenSCENARIO>
<FileHeader author="a" date="2026-01-31T12:00:00" description="" revMajor="1" revMinor="3"/>
<ParameterValueDistribution><ScenarioFile filepath="brake.xosc"/><Deterministic>
<DeterministicSingleParameterDistribution parameterName="speed"><DistributionSet>
<Element value="4"/><Element value="6"/><Element value="8"/></DistributionSet>
</DeterministicSingleParameterDistribution></Deterministic></ParameterValueDistribution>
</OpenSCENARIO>
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """A car that drives a second, brakes for two and stands; open ground."""
    (tmp_path / "speeds.xosc").write_text(DISTRIBUTION)
    path = tmp_path / "brake.xosc"
    path.write_text(SCENARIO)
    return path


def _play(*words: object) -> Result:
    return CliRunner().invoke(app, ["play", *map(str, words)])


def test_poses_and_events(scenario: Path) -> None:
    out = scenario.parent / "poses.csv"
    result = _play(scenario, "--csv", out, "--output", "json")
    assert result.exit_code == 0, result.output
    (answer,) = json.loads(result.stdout)
    times = {
        (row["element"], row["transition"]): row["time_s"]
        for row in answer["transitions"]
        if row["element"].startswith("story::act::group::maneuver::brake")
    }
    event = "story::act::group::maneuver::brake"
    assert times[event, "start_transition"] == 1.0
    assert times[f"{event}::stop", "end_transition"] == pytest.approx(2.99)
    assert (answer["finished"], answer["duration_s"]) == (True, 4.0)
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == CSV_COLUMNS
    assert [row["time_s"] for row in rows] == [f"{0.05 * k:.4f}" for k in range(81)]
    assert rows[0]["x_m"] == "3.0000"
    assert rows[20]["x_m"] == "13.0000"
    # Braking by 5 m/s2 in 200 steps of which each drives its new speed: 10 m less half a step.
    assert float(rows[-1]["x_m"]) == pytest.approx(13 + 10 - 0.05, abs=1e-3)
    assert rows[-1]["speed_mps"] == "0.0000"
    assert {row["y_m"] for row in rows} == {"4.0000"}


def test_a_table_for_people(scenario: Path) -> None:
    result = _play(scenario)
    assert result.exit_code == 0
    for words in ("1.000", "story::act::group::maneuver::brake::stop", "end"):
        assert words in result.output
    assert result.output.splitlines()[-1] == "ended at 4.000 s: end"
    assert _play(scenario, "--until-s", "0.5").output.splitlines()[-1] == "still running at 0.500 s"


def test_of_a_file_written_by_hand_events_are_told_and_why_it_ended() -> None:
    """The ego drives through the van within less than the second after which it ends."""
    lines = _play("cut-in").output.splitlines()
    kinds = {line.split("│")[2].strip() for line in lines if line.count("│") == 5}
    assert kinds == {"storyboard", "event"}
    assert lines[-1] == "ended at 8.310 s: ego has touched something (+1 s)"
    (answer,) = json.loads(_play("cut-in", "--output", "json").stdout)
    assert answer["ended_by"] == "ego has touched something (+1 s)"
    assert {"act", "maneuver", "event"} < {row["kind"] for row in answer["transitions"]}
    assert _play("free-traffic").output.splitlines()[-1] == "ended at 30.000 s: its time is up"


def test_it_ends_when_told(scenario: Path) -> None:
    out = scenario.parent / "poses.csv"
    result = _play(scenario, "--until-s", "0.5", "--every", "10", "--csv", out, "--output", "json")
    (answer,) = json.loads(result.stdout)
    assert (answer["finished"], answer["duration_s"]) == (False, 0.5)
    assert len(out.read_text().splitlines()) == 1 + 6


def test_all_permutations_and_one(scenario: Path) -> None:
    speeds = scenario.parent / "speeds.xosc"
    out = scenario.parent / "all"
    result = _play(scenario, "--distribution", speeds, "--csv", out, "--output", "json")
    assert result.exit_code == 0, result.output
    answers = json.loads(result.stdout)
    assert [answer["values"] for answer in answers] == [{"speed": v} for v in ("4", "6", "8")]
    assert sorted(path.name for path in out.iterdir()) == [
        f"speeds-00{number}.csv" for number in range(3)
    ]
    one = scenario.parent / "one.csv"
    _play(scenario, "--distribution", speeds, "--permutation", 1, "--csv", one)
    assert one.read_text() == (out / "speeds-001.csv").read_text()
    assert one.read_text() != (out / "speeds-002.csv").read_text()


@pytest.mark.parametrize(
    ("words", "mistake"),
    [
        (["--permutation", "1"], "--permutation needs --distribution"),
        (["--distribution", "speeds.xosc", "--permutation", "3"], "permutation 3 of 3"),
        (["--csv", "nowhere/poses.csv"], "nowhere"),
        (["--distribution", "speeds.xosc", "--speed", "4"], "--speed needs --permutation"),
    ],
)
def test_usage(
    scenario: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], mistake: str
) -> None:
    monkeypatch.chdir(scenario.parent)
    result = _play(scenario, *words)
    assert mistake in str(result.exception)
    assert result.exit_code != 0


def test_a_broken_scenario_is_usage(scenario: Path) -> None:
    scenario.write_text(SCENARIO.replace("$speed", "$spead"))
    result = _play(scenario)
    assert isinstance(result.exception, UsageError)
    assert result.exception.exit_code == 2
    assert f"{scenario}:17: " in str(result.exception)
