"""Which sensors the view needs, of those that the stack does not look at."""

import pytest
from unit.twin.view.test_view_publisher import RIG, Listener, Sim, hub, lease

from schemas.wire.view import ViewMode
from twin.sensors.wanted import NOTHING
from twin.view.port import GuardedView, NoView
from twin.view.publisher import ViewPublisher

__all__ = ["hub"]

ALL = None


@pytest.mark.parametrize(
    ("keys", "wanted"),
    [
        ([], NOTHING),
        (["view/*/*/thumbnail"], frozenset(["camera"])),
        (["view/c/clear/live/*"], ALL),
        (["view/c/foggy/live/*"], NOTHING),
        (["view/*/*/thumbnail", "view/c/clear/live/*"], ALL),
    ],
    ids=["nobody", "the wall", "this case", "another case", "wall and case"],
)
def test_who_looks_needs_sensors(hub, keys, wanted):
    Listener(hub, keys)
    view = GuardedView(ViewPublisher(hub.open(), RIG, ViewMode.live))
    sim = Sim()
    sim.begin(view, lease())
    assert view.wanted() == wanted
    sim.end(view)
    view.close(10)


def test_a_recording_needs_all_from_the_first_tick_to_the_last(hub):
    Listener(hub, recorder=True)
    view = GuardedView(ViewPublisher(hub.open(), RIG, ViewMode.record))
    sim = Sim()
    sim.begin(view, lease())
    assert view.wanted() is ALL
    sim.step(view)
    assert view.wanted() is ALL
    sim.end(view)
    assert view.wanted() == NOTHING, "no case runs"
    view.close(10)


def test_a_view_that_fails_wants_nothing(capsys):
    class Broken(NoView):
        def wanted(self):
            raise RuntimeError("out of luck")

    view = GuardedView(Broken())
    assert view.wanted() == NOTHING
    assert view.wanted() == NOTHING
    assert capsys.readouterr().err.count("Traceback") == 1
    assert NoView().wanted() == NOTHING
