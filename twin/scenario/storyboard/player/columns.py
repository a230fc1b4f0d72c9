"""Columns of the player's tables and states, for the host and for kernels alike."""

from __future__ import annotations

from enum import IntEnum

ENTITIES_MAX = 64
"""Most entities of a program."""
ELEMENTS_MAX = 4096
"""Most storyboard elements of a program."""
CONDITIONS_MAX = 4096
"""Most conditions of a program."""
INSTANCES_MAX = 8192
"""Most actions of a program, counted once for each actor."""
POOL_MAX = 1 << 22
"""Most floats, and integers, of the records of all programs."""
HISTORY_MAX = 8
"""Changes of a delayed condition that are remembered at a time."""
TRANSITIONS_MAX = 1024
"""Transitions of a slot that are remembered since it was started."""
SCRATCH_REALS = 12
"""Floats that a running action remembers."""
SCRATCH_WHOLES = 4
"""Integers that a running action remembers."""


class ProgramColumn(IntEnum):
    """Where a program's rows begin in the tables, and how many there are."""

    ENTITY = 0
    ENTITIES = 1
    ELEMENT = 2
    ELEMENTS = 3
    CONDITION = 4
    CONDITIONS = 5
    INSTANCE = 6
    INSTANCES = 7
    INITS = 8
    """Instances of Init actions; they stand first."""
    TRIGGER = 9
    VARIABLE = 10
    VARIABLES = 11
    TRAJECTORY = 12
    ROUTE = 13
    MODEL = 14
    ENVIRONMENT = 15
    STATES = 16
    """First of the program's element-state conditions in ``watchers``."""
    STATE_COUNT = 17
    VISIT = 18
    """First of the elements in ``visits``."""
    VISIT_COUNT = 19
    CONTROLLER = 20
    CONTROLLERS = 21
    """Of traffic signals."""


class EntityColumn(IntEnum):
    """Floats of an entity that never change."""

    CENTRE_X = 0
    CENTRE_Y = 1
    LENGTH = 2
    WIDTH = 3
    SPEED_MAX = 4
    ACCELERATION_MAX = 5
    DECELERATION_MAX = 6
    HEIGHT = 7
    HITCH = 8
    COUPLER = 9


class EntityWhole(IntEnum):
    """Integers of an entity that never change."""

    CATEGORY = 0
    EGO = 1
    PLACED = 2
    START_REALS = 3
    START_WHOLES = 4
    LIST = 5
    """Where the entity's instances begin in ``actor_instances``."""
    LIST_COUNT = 6
    TOWS = 7
    """Trailer at its hitch at the beginning; -1: none."""
    TRACTOR = 8
    """The other way round."""


class ElementColumn(IntEnum):
    """Integers of a storyboard element; indices count from the program's first."""

    KIND = 0
    PARENT = 1
    END = 2
    """Element behind the last of its descendants."""
    START = 3
    """Trigger, -1: none."""
    STOP = 4
    PRIORITY = 5
    RUNS_MAX = 6
    INSTANCE = 7
    INSTANCES = 8
    BY_TRIGGER = 9
    """Actors of a group are those that triggered the event."""


class ConditionColumn(IntEnum):
    """Integers of a condition."""

    KIND = 0
    GROUP = 1
    EDGE = 2
    ALL = 3
    ENTITY = 4
    """Where its triggering entities begin in the pool of integers."""
    ENTITIES = 5
    REALS = 6
    """Where its floats begin in the pool; the delay stands before them."""
    WHOLES = 7
    RING = 8
    """Its history, -1: not delayed."""
    OWNER = 9
    """Element of its trigger."""


class InstanceColumn(IntEnum):
    """Integers of an action of one actor."""

    KIND = 0
    ACTOR = 1
    """-1: global."""
    ELEMENT = 2
    """-1: of Init."""
    REALS = 3
    WHOLES = 4
    DOMAINS = 5
    LEVEL = 6
    """Round of Init in which it starts: after those that it is relative to."""
    ALWAYS = 7
    """1: named as an actor, so it does not matter who triggered."""


class ControllerColumn(IntEnum):
    """Integers of a controller of traffic signals."""

    VARIABLE = 0
    """Holds the name of its phase."""
    PHASE = 1
    """Its first row of ``phases``, and how many there are."""
    PHASES = 2


class Domain(IntEnum):
    """Bits of what an action controls; starting one ends those it shares a bit with."""

    NONE = 0
    LONGITUDINAL = 1
    LATERAL = 2
    ROUTING = 4
    LIGHTS = 8
    """Only those of the same lamp conflict."""


class InstanceState(IntEnum):
    """State of an action of one actor."""

    IDLE = 0
    STARTING = 1
    RUNNING = 2
    FINISHED = 3
    """At its end, which the storyboard has not noticed yet."""
    DONE = 4


class SlotColumn(IntEnum):
    """Integers of a slot."""

    PROGRAM = 0
    RUNNING = 1
    STEP = 2
    TRANSITIONS = 3
    """How many there were, also those that were not remembered."""
    OVERFLOW = 4
    """Bits of :class:`Overflow`."""
    ENVIRONMENT = 5
    """Whose clock runs, counted from the program's first; -1: none."""
    ENVIRONMENT_STEP = 6
    STARTED = 7


class Overflow(IntEnum):
    """Bits of what did not fit while a slot ran."""

    TRANSITIONS = 1
    HISTORY = 2
    ROUTE = 4


class ConditionState(IntEnum):
    """Integers of a condition in a slot."""

    LAST = 0
    """Its expression at the last step; -1: not evaluated yet."""
    HELD = 1
    """Its value after edges and before delays."""
    CHANGES = 2
    """Of its value so far."""
    SEEN = 3
    """Bits of states and transitions of its element since it was last evaluated."""
    LATEST = 4
    """State of its element at that time."""
    TRUTH = 5
    """Whether its expression on entities holds in this step."""


class Real(IntEnum):
    """Floats of an entity in a slot."""

    X = 0
    Y = 1
    Z = 2
    HEADING = 3
    PITCH = 4
    ROLL = 5
    SPEED = 6
    ACCELERATION = 7
    """Forwards."""
    VX = 8
    VY = 9
    VZ = 10
    AX = 11
    AY = 12
    AZ = 13
    S = 14
    T = 15
    OFFSET = 16
    """From the centre of the lane, to the left along s."""
    TURN = 17
    """Heading relative to the direction of the lane along s."""
    TRAVELED = 18
    WAY = 19
    """Distance along the trajectory that the entity follows."""
    ROAD_HEADING = 20
    """Of the reference line there."""
    OLD_X = 21
    """Where it was at the end of the last step."""
    OLD_Y = 22
    OLD_Z = 23
    WAY_X = 24
    """Origin of the trajectory's axes, if it is given in those of the actor."""
    WAY_Y = 25
    WAY_Z = 26
    WAY_HEADING = 27
    CHANGE_FROM = 28
    """Offset at which a driver model began to change lanes."""
    CHANGE_AT = 29
    """Time since then [s]."""


class Whole(IntEnum):
    """Integers of an entity in a slot.

    What they number counts from the first of the slot's program, or of the route: rows of tables
    move while a slot runs, when a program before it gives its place to another.
    """

    ROAD = 0
    LANE = 1
    VISIBLE = 2
    """Bits: 1 graphics, 2 sensors, 4 traffic."""
    PRESENT = 3
    TRAJECTORY = 4
    """Which it follows; -1: none."""
    ROUTE = 5
    LEG = 6
    """Counted from the route's first."""
    STILL_SINCE = 7
    """Step; -1: moves."""
    OFF_SINCE = 8
    END_SINCE = 9
    JUMPED = 10
    """It was put somewhere in this step."""
    CONTROLLED = 11
    """Bits of :class:`Domain` that a controller has instead of actions."""
    MODEL = 12
    IMPOSED = 13
    """Its pose comes from outside; 1: this step's was told."""
    LIGHTS = 14
    """Two bits a lamp."""
    CLAIMED = 15
    """Bits of :class:`Domain` that actions of Init have moved in this step."""
    CHANGING = 16
    """Lane to which a driver model changes; 0: it does not."""
    TOWS = 17
    """Trailer at its hitch; -1: none."""
    TRACTOR = 18
    """Who tows it; -1: nobody."""
    LEAPT = 19
    """It was put somewhere in the step that has just been made."""
