"""A stack in the simulator's process meets what it would meet in its own."""

import numpy as np
import pytest
from unit.twin.rig.test_engine import case

from schemas import SCHEMA_VERSION
from schemas.messages import Commands, Tick
from twin.base.errors import InfrastructureError
from twin.rig import inline
from twin.sensors.data import SensorData


class Host:
    """Writes into what it is given."""

    takes_device_frames = False
    closed = 0

    def __init__(self, *_):
        pass

    def answer(self, incoming):
        try:
            incoming.sensors["camera"][0] = 9
        except ValueError as error:
            return Commands(v=SCHEMA_VERSION, seq=0, commands=[], error=str(error))
        return Commands(v=SCHEMA_VERSION, seq=0, commands=[])

    def close(self):
        Host.closed += 1


def test_arrays_are_read_only_and_the_stack_is_closed(monkeypatch):
    monkeypatch.setattr(inline, "HOST", f"{__name__}:Host")
    stack = inline.InlineStack(case("a"), 1)
    values = np.zeros((1, 4), np.uint8)
    tick = Tick(SCHEMA_VERSION, 0, [True], [1], [0], [0], ["camera"], 0)
    with pytest.raises(InfrastructureError, match="read-only"):
        stack.exchange(tick, {"camera": SensorData(values)}, [])
    assert not values.any()
    values[0] = 3  # the simulator's own array stays as it is
    stack.close()
    assert Host.closed == 1
