"""Fixtures of the viewer's unit tests."""

import pytest


@pytest.fixture
def opened():
    """What is to be closed."""
    things = []
    yield things
    for thing in reversed(things):
        thing.close()
