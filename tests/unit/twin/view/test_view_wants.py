"""Which sensors the view needs, of those that the stack does not look at."""

import pytest
from unit.twin.view.test_view_publisher import RIG, Listener, Sim, clock, lease

from schemas.wire.view import ViewMode
from twin.sensors.wanted import NOTHING
from twin.view.demand import Demand
from twin.view.items import SlotRun
from twin.view.port import GuardedView, NoView
from twin.view.publisher import ViewPublisher

__all__ = ["clock"]

ALL, CAMERA = None, frozenset(["camera"])


@pytest.mark.parametrize(
    ("keys", "wanted"),
    [
        ([], NOTHING),
        (["view/*/*/thumbnail"], CAMERA),
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


def test_the_wall_needs_a_camera_twice_a_second_and_not_at_every_tick(hub, clock):
    Listener(hub, ["view/*/*/thumbnail"])
    view = GuardedView(ViewPublisher(hub.open(), RIG, ViewMode.live))
    sim = Sim()
    assert view.wanted() == NOTHING, "nothing is built"
    sim.begin(view, lease())
    assert view.wanted() == CAMERA
    sim.step(view)
    assert view.wanted() == NOTHING
    clock.now_s += 0.49
    assert view.wanted() == NOTHING
    clock.now_s += 0.02
    assert view.wanted() == CAMERA
    sim.step(view, camera=False)
    assert view.wanted() == CAMERA, "until there was a picture"
    sim.step(view)
    assert view.wanted() == NOTHING
    sim.active[0] = False
    clock.now_s += 5.0
    assert view.wanted() == NOTHING, "a case that stands still has the picture it had"
    sim.end(view)
    view.close(10)


def test_cases_of_a_rig_have_their_thumbnails_together():
    demand = Demand(None, ViewMode.live)
    first, second = (SlotRun(lease(token), recorded=False) for token in (5, 6))

    def due(run, now_s):
        return demand.due(run, ["camera"], now_s, wall=True, singles=False) == {"thumbnail"}

    assert due(first, 10.0)
    assert due(second, 10.3), "its first one at once"
    assert [due(run, 10.49) for run in (first, second)] == [False, False]
    assert [due(run, 10.52) for run in (first, second)] == [True, True]
    assert [due(run, 10.99) for run in (first, second)] == [False, False]
    assert [due(run, 11.0) for run in (first, second)] == [True, True]


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
