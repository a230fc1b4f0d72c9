"""The session of the pages: one for all of them, and another one where the conductor has moved."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from free_ports import reserved_port
from waiting import PATIENCE_S

from schemas import SCHEMA_VERSION as V
from schemas.wire.case_files import CaseFileRequest
from twin.fabric.discovery import Target
from twin.fabric.zenoh_bus import open_bus
from viewer.browser import desk as desk_module
from viewer.browser.desk import Desk


@pytest.fixture
def another_port():
    with reserved_port() as found:
        yield found


def target(port):
    return Target(f"tcp/127.0.0.1:{port}", "twin", None)


def test_pages_that_ask_at_once_share_a_session(opened, port):
    """None ends the session that another one has just opened."""
    opened.append(open_bus("router", listen=[f"tcp/127.0.0.1:{port}"]))
    together = threading.Barrier(4)

    def resolve():
        together.wait(PATIENCE_S)
        return target(port)

    desk = Desk(resolve)
    opened.append(desk)
    with ThreadPoolExecutor(4) as pages:
        sessions = [page.result() for page in [pages.submit(desk.session) for _ in range(4)]]
    assert len({id(session) for session in sessions}) == 1


def test_a_conductor_that_has_moved_gets_another_session(opened, port, another_port):
    places = [port, port, another_port]
    for place in {*places}:
        opened.append(open_bus("router", listen=[f"tcp/127.0.0.1:{place}"]))
    desk = Desk(lambda: target(places.pop(0)))
    opened.append(desk)
    first = desk.session()
    assert desk.session() is first
    assert desk.session() is not first


def test_a_conductor_that_gives_no_file_is_looked_for_anew(opened, port, monkeypatch):
    """Nobody answers there: the next question has another session."""
    monkeypatch.setattr(desk_module, "ASK_S", 0.01)
    opened.append(open_bus("router", listen=[f"tcp/127.0.0.1:{port}"]))
    desk = Desk(lambda: target(port))
    opened.append(desk)
    first = desk.session()
    request = CaseFileRequest(v=V, campaign="demo", case="c", file="log.txt")
    assert desk.case_file(request) is None
    assert desk.session() is not first
