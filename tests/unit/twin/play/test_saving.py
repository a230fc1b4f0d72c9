"""What is saved of a played scenario, from records made by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from schemas.files.played_scenario import PATHS_MAX, TEXT_CHARS_MAX
from twin.base.errors import UsageError
from twin.play import saving
from twin.play.playing import PlayedScenario, PoseRow
from twin.play.report import NamedPlay
from twin.play.saving import save_played, save_plays, to_play
from twin.records.play_file import points_of, poses_of, read_play
from twin.scenario.storyboard.player.storyboard_player import Transition
from twin.scenario.storyboard.program.actions import (
    DynamicsDimension,
    DynamicsShape,
    FollowTrajectoryAction,
    SpeedAction,
    TransitionDynamics,
)
from twin.scenario.storyboard.program.conditions import (
    ComparisonRule,
    Condition,
    ConditionEdge,
    ElementState,
    SimulationTimeCondition,
    Trigger,
)
from twin.scenario.storyboard.program.entities import BodyBox, EntityCategory, StoryboardEntity
from twin.scenario.storyboard.program.places import Trajectory, TrajectoryPiece
from twin.scenario.storyboard.program.program import (
    ElementKind,
    InitAction,
    Program,
    StoryElement,
)

STEP_S = 0.01


def body(name: str, category: EntityCategory, ego: bool = False) -> StoryboardEntity:
    return StoryboardEntity(
        name=name,
        category=category,
        box=BodyBox(1.4, 0.0, 0.75, 4.5, 1.8, 1.5),
        speed_max_mps=70.0,
        acceleration_max_mps2=10.0,
        deceleration_max_mps2=10.0,
        wheelbase_m=2.8,
        mass_kg=1500.0,
        ego=ego,
    )


def condition(name: str) -> Condition:
    later = SimulationTimeCondition(1.0, ComparisonRule.GREATER)
    return Condition(name, later, ConditionEdge.NONE, 0.0)


LINE = TrajectoryPiece(
    start_s_m=0.0, length_m=10.0,
    x=(0.0, 1.0, 0.0, 0.0), y=(0.0,) * 4, z=(0.0,) * 4, heading=(0.0,) * 4,
)  # fmt: skip
FOLLOW = FollowTrajectoryAction(
    trajectory=0, timed=False, absolute_time=False, time_scale=1.0, time_offset_s=0.0,
    follow=True, initial_distance_m=0.0,
)  # fmt: skip
FASTER = SpeedAction(
    TransitionDynamics(DynamicsShape.STEP, DynamicsDimension.TIME, 0.0), entity=-1, value=10.0
)
EITHER = Trigger(((condition("near"), condition("slow")), (condition("late"),)))
ELEMENTS = (
    StoryElement(ElementKind.STORYBOARD, "", -1),
    StoryElement(ElementKind.STORY, "s", 0, line=3),
    StoryElement(ElementKind.ACT, "a", 1),
    StoryElement(ElementKind.GROUP, "g", 2, actors=(1,)),
    StoryElement(ElementKind.MANEUVER, "m", 3),
    StoryElement(ElementKind.EVENT, "e", 4, line=9, start=EITHER),
    StoryElement(ElementKind.ACTION, "x", 5, action=FOLLOW),
)


def program(**parts: object) -> Program:
    values: dict[str, object] = {
        "name": "p",
        "entities": (
            body("Ego", EntityCategory.CAR, ego=True),
            body("van", EntityCategory.VAN),
            body("never there", EntityCategory.OBSTACLE),
        ),
        "elements": ELEMENTS,
        "init": (InitAction(FASTER, 0),),
        "trajectories": (Trajectory("t", False, False, (LINE,), from_actor=True),),
    }
    return Program(**{**values, **parts})  # type: ignore[arg-type]


def played(**parts: object) -> PlayedScenario:
    """Ego from the beginning, the van from the third row on; 20 steps."""
    rows = [
        PoseRow(time_s, name, x, 2.0, 0.5, 0.25, 5.0)
        for number, time_s in enumerate((0.0, 0.05, 0.1, 0.15, 0.2))
        for name, x in (("Ego", number * 1.0), ("van", 10.0 + number))
        if name == "Ego" or number >= 2
    ]
    transitions = [
        Transition(0, 0, ElementState.START_TRANSITION),
        Transition(12, 5, ElementState.START_TRANSITION),
        Transition(12, 6, ElementState.START_TRANSITION),
        Transition(15, 6, ElementState.END_TRANSITION),
        Transition(15, 5, ElementState.SKIP_TRANSITION),
        Transition(20, 0, ElementState.STOP_TRANSITION),
    ]
    values: dict[str, object] = {
        "program": program(), "rows": rows, "transitions": transitions, "steps": 20,
        "finished": True,
    }  # fmt: skip
    return PlayedScenario(**{**values, **parts})  # type: ignore[arg-type]


def test_entities_elements_and_transitions() -> None:
    play = to_play(played(), STEP_S, ["a note", "a note"])
    assert [(e.name, e.category, e.ego) for e in play.entities] == [
        ("Ego", "car", True),
        ("van", "van", False),
        ("never there", "obstacle", False),
    ]
    assert play.entities[0].centre_m == (1.4, 0.0, 0.75)
    rows = [poses_of(entity.poses) for entity in play.entities]
    assert [len(each) for each in rows] == [5, 3, 0]
    assert rows[1][0].tolist() == [0.1, 12.0, 2.0, 0.5, 0.25, 5.0]
    assert (play.period_s, play.end_s, play.finished) == (0.05, 0.2, True)
    assert [element.path for element in play.elements] == [
        *("storyboard", "s", "s::a", "s::a::g", "s::a::g::m", "s::a::g::m::e"),
        "s::a::g::m::e::x",
    ]
    event, action = play.elements[5:]
    assert (event.level, event.line, event.actors) == ("event", 9, [1])
    assert event.trigger == "near and slow or late"
    assert (action.action, action.actors) == ("follow trajectory", [1])
    assert [(t.time_s, t.element, t.transition) for t in play.transitions[1:5]] == [
        (0.12, 5, "start"),
        (0.12, 6, "start"),
        (0.15, 6, "end"),
        (0.15, 5, "skip"),
    ]
    assert play.notes == ["a note"]


def test_a_trajectory_of_the_actor_begins_where_the_actor_was() -> None:
    [path] = to_play(played(), STEP_S).paths
    assert (path.kind, path.name) == ("trajectory", "t")
    # At 0.12 s the latest pose is that of 0.1 s.
    assert points_of(path.points)[0, :2].tolist() == pytest.approx([12.0, 2.0])


def test_too_many_poses_are_thinned_evenly_with_a_note(monkeypatch) -> None:
    monkeypatch.setattr(saving, "POSES_MAX", 4)
    play = to_play(played(), STEP_S)
    assert [poses_of(e.poses)[:, 0].tolist() for e in play.entities] == [
        [0.0, 0.1, 0.2],
        [0.1, 0.2],
        [],
    ]
    assert play.notes == ["one of 2 poses is kept: there are too many"]


def test_too_many_paths_are_left_out_with_a_note(monkeypatch) -> None:
    many = played(
        program=program(
            trajectories=tuple(Trajectory(str(i), False, False, (LINE,)) for i in range(3)),
            init=tuple(
                InitAction(FollowTrajectoryAction(i, False, False, 1.0, 0.0, False, 0.0), 0)
                for i in range(3)
            ),
        )
    )
    assert len(to_play(many, STEP_S).paths) == 3 <= PATHS_MAX
    monkeypatch.setattr(saving, "PATHS_MAX", 2)
    play = to_play(many, STEP_S)
    assert [path.name for path in play.paths] == ["0", "1"]
    assert play.notes == ["1 trajectories and routes are not drawn: there are too many"]
    monkeypatch.setattr(saving, "PATH_POINTS_MAX", 3)
    assert [path.name for path in to_play(many, STEP_S).paths] == ["0"]


def test_long_names_are_cut_and_a_scenario_of_nothing_is_saved(tmp_path: Path) -> None:
    name = "n" * (TEXT_CHARS_MAX + 5)
    nothing = PlayedScenario(program(name=name, entities=(), elements=ELEMENTS[:1], init=()))
    save_played(tmp_path / "s.play", nothing, STEP_S)
    play = read_play(tmp_path / "s.play")
    assert play.name == name[:TEXT_CHARS_MAX]
    assert (play.period_s, play.end_s, play.entities) == (STEP_S, 0.0, [])


def test_one_permutation_is_a_file_and_several_are_a_folder(tmp_path: Path) -> None:
    plays = [NamedPlay(f"p-{i:03d}", i, {}, ("n",), played()) for i in range(2)]
    assert save_plays(tmp_path / "one.play", plays[:1], STEP_S) == [tmp_path / "one.play"]
    paths = save_plays(tmp_path / "all", plays, STEP_S)
    assert [path.name for path in paths] == ["p-000.play", "p-001.play"]
    assert read_play(paths[1]) == read_play(tmp_path / "one.play")
    assert read_play(paths[1]).notes == ["n"]
    with pytest.raises(UsageError, match="No such file"):
        save_plays(tmp_path / "none" / "s.play", plays[:1], STEP_S)
