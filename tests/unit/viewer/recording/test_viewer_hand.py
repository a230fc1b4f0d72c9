"""What viewers say of a case that somebody steers by hand."""

import numpy as np
from view_messages import start, state, thumbnail

from twin.view.samples import jpeg
from viewer.live.overview import Overview
from viewer.live.pulse import Pulse
from viewer.recording import naming
from viewer.recording.convert import CaseConverter
from viewer.recording.scenery import BLUE, GREY, VIOLET


def test_the_wall_shows_it_until_the_case_has_ended():
    overview, picture = Overview(), jpeg(_black())
    for hand, colour, name, row in (
        ("", BLUE, "clear-1", "| running |"),
        ("by hand", VIOLET, "[by hand] clear-1", "| by hand |"),
    ):
        overview.take(thumbnail(hand=hand), picture)
        _, (_, frames), (_, table) = overview.logged()
        assert frames.labels.as_arrow_array().to_pylist() == [name]
        assert frames.colors.as_arrow_array().to_pylist() == [_packed(colour)]
        assert row in table.text.as_arrow_array().to_pylist()[0]
    fact = {"campaign": "demo", "case": "clear-1", "token": 10**12, "reason": "intervened"}
    assert overview.event({"fact": "attempt_ended", **fact})
    _, (_, frames), _ = overview.logged()
    assert frames.labels.as_arrow_array().to_pylist() == ["clear-1"]
    assert frames.colors.as_arrow_array().to_pylist() == [_packed(GREY)]


def test_the_case_text_and_its_events_tell_it_once():
    converter, said = CaseConverter(start()), []
    for tick, hand in enumerate(["", "paused", "paused", "steered", ""]):
        rows = converter.states([state(tick, tick=tick, hand=hand)])
        events = [row for row in rows if row.path == naming.EVENTS]
        texts = [str(column.as_arrow_array().to_pylist()) for e in events for column in e.columns]
        said += [text for text in texts if "by hand" in text]
        ((path, document),) = converter.touched()
        assert path == naming.SUMMARY
        assert _text(document).startswith(f"**RUNNING{', ' * bool(hand)}{hand.upper()}**")
    assert said == [f"[['by hand: {hand}']]" for hand in ("paused", "steered", "nothing")]


def test_the_conductors_events_tell_it():
    pulse = Pulse()
    fact = {"fact": "intervention", "campaign": "demo", "case": "a", "token": 7}
    pulse.event(fact | {"tick": 40, "what": "pause", "changes": 0})
    assert [_text(line) for _, line in pulse.take()] == ["demo/a by hand: pause, at tick 40"]


def _black():
    return np.zeros((90, 160, 3), np.uint8)


def _packed(colour):
    r, g, b = colour
    return r << 24 | g << 16 | b << 8 | 0xFF


def _text(archetype):
    return archetype.text.as_arrow_array().to_pylist()[0]
