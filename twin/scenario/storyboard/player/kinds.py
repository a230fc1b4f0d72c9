"""Codes of actions and conditions, and the columns of their numbers that kernels read."""

from __future__ import annotations

from typing import get_args

from twin.scenario.storyboard.player.columns import Domain
from twin.scenario.storyboard.program import actions, conditions
from twin.scenario.storyboard.program.actions import (
    Action,
    GlobalAction,
    LightAction,
    PrivateAction,
    VisibilityAction,
)
from twin.scenario.storyboard.program.program import Program

ACTION_TYPES: tuple[type, ...] = (*get_args(PrivateAction), *get_args(GlobalAction))
"""Types of actions; a code is an index of it."""
CONDITION_TYPES: tuple[type, ...] = (
    *get_args(conditions.EntityExpression),
    *get_args(conditions.ValueExpression),
)
"""Types of conditions; a code is an index of it."""

_LONGITUDINAL = (
    actions.SpeedAction,
    actions.SpeedProfileAction,
    actions.LongitudinalDistanceAction,
    actions.SynchronizeAction,
)
_LATERAL = (actions.LaneChangeAction, actions.LaneOffsetAction, actions.LateralDistanceAction)
_COUPLE = actions.ConnectTrailerAction | actions.DisconnectTrailerAction
_ROUTING = (actions.AssignRouteAction, actions.AcquirePositionAction)


def action_code(record: type) -> int:
    """Code of a type of action."""
    return ACTION_TYPES.index(record)


def condition_code(expression: object) -> int:
    """Code of a condition's type."""
    return CONDITION_TYPES.index(type(expression))


def kind_code(record: type) -> int:
    """Code of a type of condition."""
    return CONDITION_TYPES.index(record)


def domains_of(action: Action) -> int:
    """What an action controls (ASAM OpenSCENARIO XML 1.3, section 7.5.2); bits of ``Domain``.

    A trajectory with times controls both; one without leaves the speed to other actions.
    """
    if isinstance(action, _LONGITUDINAL):
        return Domain.LONGITUDINAL
    if isinstance(action, _LATERAL):
        return Domain.LATERAL
    if isinstance(action, _ROUTING):
        return Domain.ROUTING
    if isinstance(action, actions.TeleportAction):
        return Domain.LONGITUDINAL | Domain.LATERAL
    if isinstance(action, actions.FollowTrajectoryAction):
        lateral = Domain.LATERAL | Domain.ROUTING
        return lateral | Domain.LONGITUDINAL if action.timed else lateral
    if isinstance(action, LightAction):
        return Domain.LIGHTS
    assert isinstance(action, VisibilityAction | actions.ControllerAction | GlobalAction | _COUPLE)
    return Domain.NONE


def lasts(action: Action) -> bool:
    """True of actions that may still run after their first step."""
    if isinstance(action, actions.SpeedAction):
        return action.dynamics.shape is not actions.DynamicsShape.STEP or action.continuous
    return bool(domains_of(action) & (Domain.LONGITUDINAL | Domain.LATERAL)) and not isinstance(
        action, actions.TeleportAction
    )


def tows(program: Program) -> bool:
    """True if trailers are towed, or may be."""
    written = [*(init.action for init in program.init), *(e.action for e in program.elements)]
    connects = any(isinstance(action, actions.ConnectTrailerAction) for action in written)
    return connects or any(entity.tractor >= 0 for entity in program.entities)


def watches_lanes(program: Program) -> bool:
    """True if anything waits for lanes to be free."""
    triggers = [trigger for e in program.elements for trigger in (e.start, e.stop) if trigger]
    every = (condition for trigger in triggers for group in trigger.groups for condition in group)
    return any(isinstance(c.expression, conditions.RelativeClearanceCondition) for c in every)
