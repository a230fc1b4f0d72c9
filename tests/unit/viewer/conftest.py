"""Fixtures of the viewer's unit tests."""

import pytest
from free_ports import reserved_port


@pytest.fixture
def port():
    """Where nobody listens until a test does."""
    with reserved_port() as found:
        yield found


@pytest.fixture
def opened():
    """What is to be closed."""
    things = []
    yield things
    for thing in reversed(things):
        thing.close()
