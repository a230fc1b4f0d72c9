"""A stack says which sensor messages it looks at, and gets those alone."""

import re
import sys
from types import ModuleType

import numpy as np
import pytest

from devkit.aeb import AebStack
from devkit.fusion.stack import FusionStack
from devkit.hosting.host import Inline, step
from devkit.idle import IdleStack
from devkit.stack import Stack, StackError, load_stack, looked_at, reads_of
from schemas.messages import Command, Tick
from schemas.sections.stack_identity import StackSource
from schemas.wire.topics import reads_mistake
from twin.fabric.drive import Incoming

ARRAYS = {
    "vehicle": np.zeros((1, 7)),
    "camera": np.zeros((1, 4, 8, 3), np.uint8),
    "camera.front_left": np.zeros((1, 4, 8, 3), np.uint8),
    "lidar.roof": np.zeros((1, 9, 7), np.float32),
}


class Curious(Stack):
    """Notes what it gets; brakes."""

    def __init__(self, slots):
        super().__init__(slots)
        self.got = []

    def reset(self, slot, episode):
        pass

    def step(self, observation):
        self.got.append(set(observation.sensors))
        return [Command(0, 1, 0, 0.0, 1.0, 0.0)]


class Modest(Curious):
    reads = ("camera", "lidar.roof")


class Derived(Modest):
    """Does not say what it looks at, so it looks at all."""


class Greedy(Modest):
    reads = ("camera",)

    def step(self, observation):
        return observation.sensors["lidar.roof"]


def incoming(arrays=ARRAYS):
    return Incoming(Tick(1, 0, [True], [1], [0], [0], list(arrays), 0), [], dict(arrays), {})


@pytest.mark.parametrize(
    ("kind", "gets"),
    [
        (Curious, set(ARRAYS)),
        (Modest, {"camera", "lidar.roof"}),
        (Derived, set(ARRAYS)),
    ],
)
def test_a_stack_gets_what_it_reads_also_from_a_record_with_more(kind, gets):
    stack = kind(1)
    step(stack, incoming())
    assert stack.got == [gets]


def test_what_is_not_due_is_still_absent():
    few = {"vehicle": ARRAYS["vehicle"]}
    shown = looked_at(few, Modest)
    assert "camera" not in shown
    with pytest.raises(KeyError, match=r"^'camera'$"):
        shown["camera"]


def test_a_message_that_was_not_said_is_a_mistake_with_a_name():
    with pytest.raises(KeyError, match=r"lidar\.roof: Greedy says that it reads camera; add it"):
        step(Greedy(1), incoming())


@pytest.mark.parametrize(
    ("reads", "said"),
    [
        (("camra",), "reads 'camra'; allowed: messages of sensors (boxes, camera,"),
        ("camera", "reads is of type str; allowed: a tuple of sensor messages, or None for all"),
        ((7,), "reads 7; allowed"),
        (lambda self: (), "reads is of type function"),
    ],
)
def test_what_is_no_message_is_refused_in_one_line(monkeypatch, reads, said):
    module = ModuleType("a_stack_that_reads")
    module.Mine = type("Mine", (Curious,), {"reads": reads, "__module__": module.__name__})
    monkeypatch.setitem(sys.modules, module.__name__, module)
    with pytest.raises(StackError, match=re.escape(said)) as refused:
        load_stack("a_stack_that_reads:Mine", 1, {})
    assert "\n" not in str(refused.value)


def test_messages_of_further_cameras_and_lidars_may_be_read():
    assert not reads_mistake(["camera.front_left", "lidar.roof", "depth", "imu", "vehicle"])


def test_shipped_stacks():
    assert reads_of(IdleStack) == frozenset()
    assert reads_of(AebStack) == {"vehicle", "environment", "camera", "boxes"}
    assert reads_of(FusionStack) is None, "which lidar it looks at is the campaign's choice"


def test_inline_stacks_say_it_too():
    inline = Inline("devkit.aeb:AebStack", 1, {}, StackSource())
    assert inline.reads == reads_of(AebStack)
    inline.close()
