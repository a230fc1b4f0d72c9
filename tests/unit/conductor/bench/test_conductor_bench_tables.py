"""The bench: its arithmetic, its refusals, and a small run of our side."""

from __future__ import annotations

from pathlib import Path

import pytest

import conductor.bench.peers
from conductor.bench.command import bench
from conductor.bench.compare import SCHEDULERS, TARGETS, SchedulerComparison
from conductor.bench.own import SchedulerRun, check_disk, measure, noop_campaign
from conductor.bench.peers import PACKAGES, missing
from conductor.bench.scale import POINTS, Scale, large_campaign
from conductor.trust.judge_feed import JudgementFile
from schemas.plan import expand
from twin.base.errors import InfrastructureError, UsageError


def comparison(**rates: list[float]) -> SchedulerComparison:
    runs = {
        name: [SchedulerRun(1000, 1000 / r) for r in rates.get(name, [])] for name in SCHEDULERS
    }
    return SchedulerComparison(runs)


def test_ratios_are_medians_of_rounds() -> None:
    found = comparison(k8=[100, 40, 90], k1=[30, 30, 30], dask=[10, 2, 10], hyperqueue=[10, 10, 10])
    assert found.ratios() == pytest.approx(
        {"ratio_dask_k8": 10, "ratio_hyperqueue_k8": 9, "ratio_dask_k1": 3}
    )
    assert found.rate("k8") == pytest.approx(90)


@pytest.mark.parametrize("name", TARGETS)
def test_just_below_a_target_is_missed(name: str) -> None:
    rates = {"k8": [1.500015e4], "k1": [3.00001e3], "dask": [1e3], "hyperqueue": [3e3]}
    assert comparison(**rates).misses() == []
    _, peer, ours = name.split("_")
    found = comparison(**{**rates, ours: [rates[ours][0] * 0.999]})
    assert any(line.startswith(name) for line in found.misses())
    assert comparison(**{**rates, peer: [rates[peer][0] * 1.001]}).misses()


def test_a_missing_peer_is_named_and_its_ratio_is_null(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PACKAGES, "dask", "no_such_package")
    assert missing("dask") == (
        "dask: package 'no_such_package' is not installed; run `make install-bench`"
    )
    found = comparison(k8=[100], k1=[30], hyperqueue=[10])
    found.missing.append(missing("dask"))
    plain = found.to_json()
    assert (plain["ratio_dask_k8"], plain["ratio_dask_k1"]) == (None, None)
    assert plain["ratio_hyperqueue_k8"] == 10
    assert found.misses() == [missing("dask")]
    assert conductor.bench.peers.missing("dask")


def test_scale_targets_are_limits() -> None:
    exact = Scale(100_000, 5.0, 9.0, 5.0, 300.0, (1.0, 2.0, 300.0), 100.0)
    assert exact.misses() == []
    over = Scale(100_000, 5.01, 9.0, 5.01, 300.1, (1.0, 2.0, 3.0), 100.1)
    assert [line.split()[0] for line in over.misses()] == [
        "submit_s",
        "restart_s",
        "rss_mb",
        "status_ms",
    ]


def test_campaigns() -> None:
    assert len(expand(noop_campaign(5))) == 5
    assert len(expand(large_campaign(2 * POINTS))) == 2 * POINTS
    with pytest.raises(UsageError, match=f"multiple of {POINTS}"):
        large_campaign(POINTS + 1)


def test_memory_is_no_disk(tmp_path: Path) -> None:
    check_disk(tmp_path)
    with pytest.raises(UsageError, match="nothing is durable there"):
        check_disk(Path("/dev/shm"))


def test_a_small_run_of_ours(tmp_path: Path) -> None:
    found = measure(100, 8, tmp_path)
    assert found.cases == 100
    assert found.rate > 10
    assert list(tmp_path.iterdir()) == []


def test_a_small_run_with_files_of_attempts_is_judged(tmp_path: Path) -> None:
    """Digests, verdicts and scalars agree, or there is no figure."""
    found = measure(10, 8, tmp_path, files=True)
    assert found.cases == 10
    assert found.judged_s > found.wall_s
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "judged",
    [
        pytest.param(None, marks=pytest.mark.slow),
        JudgementFile(attempts=3, agree=2, differences={"a": ["no"]}),
    ],
)
def test_attempts_that_are_not_judged_give_no_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, judged: JudgementFile | None
) -> None:
    monkeypatch.setattr("conductor.bench.own.read_judged", lambda _: judged)
    with pytest.raises(InfrastructureError, match="of 3 attempts"):
        measure(3, 8, tmp_path, files=True)
    assert list(tmp_path.iterdir()) == []


def test_the_row_with_files_has_its_ratio(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = comparison(k8=[1000, 1000], k1=[10, 10], dask=[1, 1], hyperqueue=[1, 1])
    found.runs["files"] = [SchedulerRun(100, 1.0, 0.0, 2.0), SchedulerRun(100, 0.5, 0.0, 2.0)]
    plain = found.to_json()
    assert (plain["ratio_files_k8"], plain["files_judged_per_s"]) == (0.15, 50)
    assert plain["files_cases_per_s"] == 150
    monkeypatch.setattr("conductor.bench.command.compare", lambda *_: found)
    bench(10, 1, 0, tmp_path, as_json=False, check=False)
    shown = capsys.readouterr().out
    assert "0.150x" in shown
    assert "with KPI files" in shown


def test_check_fails_when_a_target_is_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    slow = comparison(k8=[1], k1=[1], dask=[1], hyperqueue=[1])
    monkeypatch.setattr("conductor.bench.command.compare", lambda *_: slow)
    for check, code in ((True, 1), (False, 0)):
        assert bench(10, 1, 0, tmp_path, as_json=not check, check=check) == code
        assert "missed: ratio_dask_k8 is 1.0, the target is 15" in capsys.readouterr().err
