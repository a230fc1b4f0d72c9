"""What each site has done, and what it cost."""

import msgspec
import pytest

from conductor.records.outcomes import CaseOutcome
from conductor.records.timeline import TimelineEvent
from conductor.report.reading.leases import leases_of
from conductor.report.reading.site_shares import ELSEWHERE, prices_of, site_shares
from schemas.files.allocations import FILE_NAME, AllocationBook, SiteRecord
from schemas.wire.site_name import host_at, site_of

NORTH, SOUTH = "n1@north-cpu-0123456789ab", "n1.x@so-uth-cuda0-0123456789ab"
HERE = "n1-cpu-0123456789ab"


def lease(case, worker, token, start_s, end_s, how="committed"):
    about = {"case": case, "token": token}
    return [
        TimelineEvent(at_s=start_s, event="leased", worker=worker, attempt=1, **about),
        TimelineEvent(at_s=end_s, event=how, worker=worker, **about),
    ]


def ended(worker):
    return CaseOutcome(outcome="verdict", worker=worker, device_class="cpu:avx2")


EVENTS = sorted(
    [
        *lease("a", NORTH, 1, 1000.0, 2800.0),
        *lease("b", NORTH, 2, 2800.0, 4600.0),
        *lease("c", SOUTH, 3, 1000.0, 1010.0, "lost"),
        *lease("c", SOUTH.replace("n1", "n2"), 4, 1020.0, 1920.0),
    ],
    key=lambda event: event.at_s,
)
OUTCOMES = {"a": ended(NORTH), "b": ended(NORTH), "c": ended(SOUTH.replace("n1", "n2"))}


def test_shares_and_costs():
    south, north = sorted(
        site_shares(OUTCOMES, leases_of(EVENTS), {"north": 2.0}), key=lambda line: line.cases
    )
    assert (north.site, north.cases, north.workers, north.unused) == ("north", 2, 1, 0)
    assert north.share == pytest.approx(2 / 3)
    assert north.worker_hours == pytest.approx(1.0)
    assert north.cost == pytest.approx(2.0)
    assert (south.site, south.cases, south.workers, south.unused) == ("so-uth", 1, 2, 1)
    assert south.worker_hours == pytest.approx((10 + 900) / 3600)
    assert south.cost is None
    assert south.device_classes == ("cpu:avx2",)


def test_workers_of_no_site():
    here = {"a": ended(HERE)}
    assert site_shares(here, leases_of(lease("a", HERE, 1, 0.0, 1.0)), {}) == []
    both = site_shares({"a": ended(HERE), "b": ended(NORTH)}, leases_of([]), {})
    assert [(line.site, line.share) for line in both] == [(ELSEWHERE, 0.5), ("north", 0.5)]


def test_prices(tmp_path):
    assert prices_of(tmp_path) == {}
    sites = {"north": SiteRecord(cost=2.5), "south": SiteRecord()}
    book = AllocationBook(campaign="aeb-demo", sites=sites)
    (tmp_path / FILE_NAME).write_bytes(msgspec.json.encode(book))
    assert prices_of(tmp_path) == {"north": 2.5}
    (tmp_path / FILE_NAME).write_text("{")
    assert prices_of(tmp_path) == {}


@pytest.mark.parametrize(
    ("worker", "site"),
    [
        (NORTH, "north"),
        (SOUTH, "so-uth"),
        (HERE, ""),
        ("n1@-cpu-0123456789ab", ""),
        ("n1@north-cpu-012345", ""),
        ("n1@no/rth-cpu-0123456789ab", ""),
        ("", ""),
    ],
)
def test_site_of(worker, site):
    assert site_of(worker) == site


def test_host_at():
    assert host_at("n1", "") == "n1"
    assert site_of(f"{host_at('n1', 'north')}-cuda7-{'a' * 12}") == "north"
