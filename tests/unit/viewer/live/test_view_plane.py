"""The view plane over real Zenoh sessions on loopback: who hears whom, and who is waited for."""

import functools
import socket

import pytest
from waiting import wait_for

from schemas.sections.view_mode import ViewMode
from schemas.wire import topics
from twin.base.errors import UsageError
from twin.fabric.memory_bus import intersects
from twin.fabric.zenoh_bus import open_bus
from twin.view import publisher
from twin.view.port import NoView
from twin.view.publisher import ViewOptions, open_view
from viewer.live.hub import open_hub

LOOPBACK = ["tcp/127.0.0.1:0"]
THUMBNAIL = "view/*/*/thumbnail"
RECORDED = [topics.FEED_RECORDED.key.format(rig=str(index)) for index in range(2)]


def test_a_recorder_hears_its_own_feed_and_viewers_hear_all():
    router = open_bus("router", listen=LOOPBACK)
    feeds = [
        open_bus("peer", listen=LOOPBACK, connect=router.endpoints, connect_required=False)
        for _ in range(2)
    ]
    recorder = open_bus("peer", connect=feeds[0].endpoints)
    viewer = open_bus("client", connect=router.endpoints)
    try:
        assert not feeds[0].wanted(RECORDED[0])
        heard = {"recorder": [], "viewer": []}
        recorder.subscribe("feed/*/recorded", lambda s: heard["recorder"].append(s.key))
        viewer.subscribe(THUMBNAIL, lambda s: heard["viewer"].append(s.key))
        wait_for(
            lambda: feeds[0].wanted(RECORDED[0]) and all(f.wanted(THUMBNAIL) for f in feeds),
            "both subscriptions",
        )
        assert not feeds[1].wanted(RECORDED[1]), "its samples would go nowhere"
        for index in (1, 0):
            feeds[index].publish(RECORDED[index], b"x")
            feeds[index].publish(f"view/c/{index}/thumbnail", b"x")
        wait_for(lambda: heard["recorder"] and len(heard["viewer"]) == 2, "every message")
        assert heard["recorder"] == [RECORDED[0]]
        assert sorted(heard["viewer"]) == ["view/c/0/thumbnail", "view/c/1/thumbnail"]
        viewer.close()
        wait_for(lambda: not feeds[0].wanted(THUMBNAIL), "the end of the viewer")
    finally:
        for bus in (viewer, recorder, *feeds, router):
            bus.close()


def test_a_router_out_of_reach_costs_no_time(monkeypatch):
    """Whoever waited for it would do so beyond the end of this test."""
    patient = functools.partial(open_bus, connect_timeout_s=3600.0)
    monkeypatch.setattr(publisher, "open_bus", patient)
    feed = open_view("r", ViewOptions(ViewMode.record_live, "twin", "tcp/127.0.0.1:1"))
    assert feed.endpoint.startswith("tcp/127.0.0.1:")
    assert feed.endpoint != "tcp/127.0.0.1:0"
    feed.close(0)


def test_no_view_is_no_session(capsys):
    assert isinstance(open_view("r", ViewOptions(ViewMode.none)), NoView)
    broken = open_view("r", ViewOptions(ViewMode.live, "twin", "nonsense"))
    assert isinstance(broken, NoView), "the cases run all the same"
    assert "no view of this rig" in capsys.readouterr().err


def test_a_hub_port_in_use_is_one_line():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(UsageError, match=f"--port {port}: already in use"):
            open_hub(port)


def test_a_single_case_is_wanted_by_name_and_by_the_wildcard():
    router = open_bus("router", listen=LOOPBACK)
    feed = open_bus("peer", listen=LOOPBACK, connect=router.endpoints, connect_required=False)
    viewer = open_bus("client", connect=router.endpoints)
    try:
        viewer.subscribe(topics.live_keys("c", "1"), lambda _: None)
        wait_for(lambda: feed.wanted(topics.live_keys("*", "*")), "the look")
        wait_for(lambda: feed.wanted(topics.live_keys("c", "1")), "the look by name")
        assert not feed.wanted(topics.live_keys("c", "2"))
        feed.release(topics.live_keys("c", "1"))
        assert feed.wanted(topics.live_keys("c", "1")), "asked again, it is known again"
    finally:
        for bus in (viewer, feed, router):
            bus.close()


def test_key_expressions_meet():
    for one, other in (("view/*/*/live/*", "view/c/1/live/x"), ("a/**", "a"), ("**", "a/*/c")):
        assert intersects(one, other)
        assert intersects(other, one)
    for one, other in (("a/b", "a/c"), ("a/*", "a/b/c"), ("a/*/c", "a/**/d"), ("a", "a/b")):
        assert not intersects(one, other)
        assert not intersects(other, one)
