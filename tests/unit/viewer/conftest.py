"""Fixtures of the viewer's unit tests."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def opened():
    """What is to be closed."""
    things = []
    yield things
    for thing in reversed(things):
        thing.close()
