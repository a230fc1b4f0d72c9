"""Storyboard programs as flat tables: columns, limits and errors."""

from __future__ import annotations

import numpy as np
import pytest
from storyboard_programs import EventPlan, GroupPlan, at, car, from_time, program, start_at, when

from twin.base.errors import UsageError
from twin.scenario.storyboard.player import columns, tables
from twin.scenario.storyboard.player.instances import program_instances
from twin.scenario.storyboard.player.kinds import ACTION_TYPES, CONDITION_TYPES, domains_of
from twin.scenario.storyboard.player.layout import (
    flatten,
    layout_of,
    real_column,
    whole_column,
)
from twin.scenario.storyboard.player.tables import pack_programs
from twin.scenario.storyboard.program import actions, conditions
from twin.scenario.storyboard.program.places import RelativeFrame, RelativePosition
from twin.scenario.storyboard.program.program import InitAction


@pytest.mark.parametrize("record", [*ACTION_TYPES, *CONDITION_TYPES], ids=lambda r: r.__name__)
def test_every_record_has_columns(record):
    layout = layout_of(record)
    assert len(set(layout.reals)) == len(layout.reals)
    assert len(set(layout.wholes)) == len(layout.wholes)


def test_columns_are_where_flatten_writes():
    action = actions.SpeedAction(
        actions.TransitionDynamics(
            actions.DynamicsShape.CUBIC, actions.DynamicsDimension.RATE, 2.5
        ),
        3,
        12.0,
        factor=True,
    )
    reals, wholes = flatten(action)
    assert reals[real_column(actions.SpeedAction, "dynamics.value")] == 2.5
    assert reals[real_column(actions.SpeedAction, "value")] == 12.0
    assert wholes[whole_column(actions.SpeedAction, "dynamics.shape")] == 1
    assert wholes[whole_column(actions.SpeedAction, "entity")] == 3
    assert wholes[whole_column(actions.SpeedAction, "factor")] == 1


def test_places_of_both_kinds_share_columns():
    fixed = flatten(actions.TeleportAction(at(1.0, 2.0, 0.5)))
    moving = flatten(
        actions.TeleportAction(RelativePosition(RelativeFrame.LANE, 4, 7.0, 0.5, lanes=-1))
    )
    assert len(fixed[0]) == len(moving[0]) == len(layout_of(actions.TeleportAction).reals)
    assert fixed[0][:4] == [1.0, 2.0, 0.0, 0.5]
    frame = whole_column(actions.TeleportAction, "position.frame")
    lanes = whole_column(actions.TeleportAction, "position.lanes")
    assert (fixed[1][frame], moving[1][frame], moving[1][lanes]) == (-1, 3, -1)


def test_a_place_that_is_not_there_says_so():
    _, wholes = flatten(
        conditions.TimeToCollisionCondition(
            1,
            None,
            2.0,
            conditions.ComparisonRule.LESS,
            False,
            conditions.DistanceFrame.ENTITY,
            conditions.DistanceKind.EUCLIDEAN,
        )
    )
    assert wholes[whole_column(conditions.TimeToCollisionCondition, "position.frame")] == -2


def test_tails_stand_behind_the_columns():
    limits = actions.MotionLimits()
    entries = (actions.SpeedProfileEntry(1.0, 2.0), actions.SpeedProfileEntry(3.0, 4.0))
    reals, wholes = flatten(actions.SpeedProfileAction(-1, entries, True, limits))
    count = len(layout_of(actions.SpeedProfileAction).reals)
    assert reals[count:] == [1.0, 2.0, 3.0, 4.0]
    assert wholes[whole_column(actions.SpeedProfileAction, "entries.tail")] == 2
    acquire = actions.AcquirePositionAction(at(0.0), (5, -1, 6))
    assert flatten(acquire)[1][-3:] == [5, -1, 6]


def test_unknown_fields_have_no_column():
    with pytest.raises(ValueError, match="not in tuple"):
        real_column(actions.SpeedAction, "speed")


def test_every_action_has_a_domain():
    assert domains_of(actions.VisibilityAction(True, True, True)) == columns.Domain.NONE
    timed = actions.FollowTrajectoryAction(0, True, False, 1.0, 0.0, True, 0.0)
    assert domains_of(timed) & columns.Domain.LONGITUDINAL


def test_init_waits_for_what_it_is_relative_to():
    follows = RelativePosition(RelativeFrame.WORLD, 0, 5.0)
    init = [
        InitAction(actions.TeleportAction(at(1.0)), 0),
        InitAction(actions.TeleportAction(follows), 1),
        InitAction(actions.TeleportAction(at(9.0)), 0),
        InitAction(actions.TeleportAction(RelativePosition(RelativeFrame.WORLD, 1, 1.0)), 2),
    ]
    rows = program_instances(program([car("a"), car("b"), car("c")], init)).rows
    assert [row.level for row in rows] == [0, 1, 1, 2]


def test_several_programs_stand_one_after_the_other():
    one = program([car()], start_at(0, at(0.0), 1.0))
    two = program(
        [car(), car("b")],
        start_at(1, at(0.0), 1.0),
        [
            GroupPlan(
                (0, 1), [EventPlan(from_time(1.0), [actions.VisibilityAction(True, True, True)])]
            )
        ],
    )
    packed = pack_programs([one, two])
    entity = columns.ProgramColumn.ENTITY
    assert packed.programs[:, entity].tolist() == [0, 1]
    assert packed.programs[:, columns.ProgramColumn.INSTANCES].tolist() == [2, 4]
    assert packed.most["entities"] == 2
    assert packed.reals.dtype == np.float64


def test_no_program():
    with pytest.raises(UsageError, match="at least one program"):
        pack_programs([])


@pytest.mark.parametrize(
    ("limit", "words"),
    [
        ("ENTITIES_MAX", "2 entities; at most 1"),
        ("ELEMENTS_MAX", "7 elements; at most 1"),
        ("INSTANCES_MAX", "5 actions, counted once for each actor; at most 1"),
        ("CONDITIONS_MAX", "2 conditions; at most 1"),
        ("POOL_MAX", "more than 1 numbers"),
    ],
)
def test_limits_are_told(monkeypatch, limit, words):
    condition = when(conditions.SimulationTimeCondition(1.0, conditions.ComparisonRule.EQUAL))
    trigger = conditions.Trigger(((condition, condition),))
    plan = program(
        [car(), car("b")],
        start_at(0, at(0.0), 1.0)[:1] + start_at(1, at(0.0), 1.0),
        [GroupPlan((0, 1), [EventPlan(trigger, [actions.VisibilityAction(True, True, True)])])],
    )
    monkeypatch.setattr(tables, limit, 1)
    with pytest.raises(UsageError, match=words):
        pack_programs([plan])
    assert getattr(columns, limit) > 1


def test_parents_stand_before_their_children():
    plan = program([car()], [], [GroupPlan((0,), [])])
    import msgspec

    elements = (*plan.elements[:1], msgspec.structs.replace(plan.elements[1], parent=3))
    broken = msgspec.structs.replace(plan, elements=elements)
    with pytest.raises(UsageError, match="a parent stands before its children"):
        pack_programs([broken])
