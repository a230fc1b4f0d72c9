"""A process that waits for a signal ends by it, wherever it is hit."""

import signal
import subprocess
import sys

import pytest

from twin.base.command import StopSignal

WAITS = """
import signal
from twin.base.command import StopSignal

stop = StopSignal()
signal.signal(signal.SIGALRM, stop._receive)
for delay in range(1, 3000):
    stop._asked = False
    signal.setitimer(signal.ITIMER_REAL, delay * 1e-7)
    while not stop.wait(0.0):
        pass
print("ended")
"""


@pytest.fixture
def _handlers():
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [(number, signal.getsignal(number)) for number in numbers]
    yield
    for number, handler in before:
        signal.signal(number, handler)


@pytest.mark.usefixtures("_handlers")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_either_signal_is_noticed_once_and_for_all(number):
    stop = StopSignal()
    assert not stop.wait(0.0)
    signal.raise_signal(number)
    assert stop.wait(60.0)
    assert stop.wait(0.0)


def test_a_signal_in_the_middle_of_a_wait_does_not_lock_up():
    """Three thousand, a tenth of a microsecond apart; an Event hangs within a few hundred."""
    done = subprocess.run(
        [sys.executable, "-c", WAITS], capture_output=True, text=True, timeout=100, check=True
    )
    assert done.stdout == "ended\n"
