"""Running an attempt again: what stops it before and while it runs."""

import queue
import types

import pytest
from case_changes import changed
from unit.twin.rig.test_engine import case

from schemas.wire.control import Lease
from twin.base.errors import InfrastructureError, UsageError
from twin.rig.interventions.journal import InterventionJournal
from twin.rig.pipe import Progress
from twin.worker.reenact import _run, reenact


def test_it_overwrites_nothing(tmp_path):
    InterventionJournal(Lease(1, 2, str(tmp_path), case("a")), 1, "cpu").close()
    attempt = tmp_path / "cases" / "a" / "attempt-2"
    (attempt / "kpi.parquet").write_text("evidence")
    with pytest.raises(UsageError, match="attempt-2 exists, and nothing is overwritten; give"):
        reenact(attempt, "cpu", None, tmp_path)
    assert (attempt / "kpi.parquet").read_text() == "evidence"


@pytest.mark.parametrize("ticks", [[], [4, 4, 4]])
def test_a_rig_that_hangs_is_not_waited_for(ticks):
    inbox = queue.SimpleQueue()
    for tick in ticks:
        inbox.put((None, Progress([1], [tick])))
    lease = types.SimpleNamespace(
        case=types.SimpleNamespace(variation=types.SimpleNamespace(deadline_s=0.01))
    )
    with pytest.raises(
        InfrastructureError, match=f"no progress for 0.01 s at tick {max([0, *ticks])}"
    ):
        _run(None, inbox, lease, [])


def test_what_went_by_the_wall_clock_cannot_be_run_again(tmp_path):
    paced = changed(case("a"), clock="realtime")
    InterventionJournal(Lease(1, 2, str(tmp_path), paced), 1, "cpu").close()
    with pytest.raises(UsageError, match="went by the wall clock"):
        reenact(tmp_path / "cases" / "a" / "attempt-2", "cpu", None, None)
