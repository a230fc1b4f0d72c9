"""The resource section: gathering of parts, net use, the paper's Table 2, the page."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pyarrow.parquet as pq
import pytest
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign, page_of

from conductor.report import report_json
from conductor.report.plots.resources_figure import POINTS_MAX, thinned
from conductor.report.reading import resources
from conductor.report.reading.resources import RESOURCES_FILE, gather_resources, read_resources
from conductor.report.reading.resources_use import QUANTITIES, WORKERS_MAX, UseSeries
from schemas.files.resources import PERIOD_S, ProcessUse, ResourceSample

PERIOD_NS = PERIOD_S * 10**9


def sample(moment: int, worker: str = "w1", host: str = "n1", **changes: Any) -> ResourceSample:
    """Two cores and 1 GB of a worker, on a node of 8 CPUs and 16 GB."""
    values: dict[str, Any] = {
        "time_ns": moment * PERIOD_NS + 3_000_000,
        "host": host,
        "worker": worker,
        "batch": 0,
        "cases": 1,
        "cpu_cores": 2.0,
        "ram_bytes": 10**9,
        "processes": [ProcessUse(role="worker", pid=7, cpu_cores=None, rss_bytes=10**9)],
        "node_cpus": 8,
        "node_cpu_cores": 5.0,
        "node_ram_bytes": 6 * 10**9,
        "node_ram_total_bytes": 16 * 10**9,
        **changes,
    }
    return ResourceSample(**values)


def gpu(name: str, percent: float | None, memory_gb: int) -> dict[str, Any]:
    return {
        "gpu": name,
        "gpu_name": "H200",
        "gpu_percent": percent,
        "gpu_memory_bytes": memory_gb * 10**9,
        "gpu_memory_total_bytes": 100 * 10**9,
        "gpu_power_w": 300.0,
    }


def write_parts(folder: Path, *samples: ResourceSample, tail: bytes = b"") -> None:
    parts = folder / "resources"
    parts.mkdir(parents=True, exist_ok=True)
    for each in samples:
        with (parts / f"{each.worker}.jsonl").open("ab") as file:
            file.write(msgspec.json.encode(each) + b"\n" + tail)


def use_of(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(json.dumps(report_json(folder)["resources"]))
    return found


def test_parts_become_one_file_when_the_campaign_is_complete(tmp_path: Path) -> None:
    write_parts(tmp_path, sample(2), sample(1, "w2"), sample(3))
    gather_resources(tmp_path, complete=False)
    assert len(list((tmp_path / "resources").iterdir())) == 2
    gather_resources(tmp_path, complete=True)
    assert [path.name for path in tmp_path.iterdir()] == [RESOURCES_FILE]
    rows = pq.read_table(tmp_path / RESOURCES_FILE).to_pylist()
    assert [row["worker"] for row in rows] == ["w2", "w1", "w1"]
    assert rows[0]["processes"][0]["cpu_cores"] is None
    assert rows[0]["gpu_percent"] is None


def test_a_later_run_adds_to_it(tmp_path: Path) -> None:
    write_parts(tmp_path, sample(1))
    gather_resources(tmp_path, complete=True)
    write_parts(tmp_path, sample(9, "w2"))
    gather_resources(tmp_path, complete=True)
    assert read_resources(tmp_path).column("worker").to_pylist() == ["w1", "w2"]


def test_a_gathering_that_was_killed_before_it_removed_the_parts(tmp_path: Path) -> None:
    write_parts(tmp_path, sample(1), sample(2))
    gather_resources(tmp_path, complete=False)
    assert read_resources(tmp_path).num_rows == 2
    gather_resources(tmp_path, complete=True)
    assert read_resources(tmp_path).num_rows == 2


@pytest.mark.parametrize("tail", [b'{"time_ns": 12', b"\xff\x00", b'{"other": 1}'])
def test_a_torn_line_costs_that_line(tmp_path: Path, tail: bytes) -> None:
    write_parts(tmp_path, sample(1), sample(2, "w2"), tail=tail)
    assert read_resources(tmp_path).num_rows == 2


def test_a_damaged_file_is_told_in_its_section_and_kept(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    write_parts(tmp_path, sample(1))
    (tmp_path / RESOURCES_FILE).write_bytes(b"PAR1 not really")
    page = page_of(tmp_path)
    assert "resources.parquet: damaged" in page
    assert 'class="box alarm"' not in page
    assert (tmp_path / "resources" / "w1.jsonl").exists()
    assert "damaged" in use_of(tmp_path)["missing"]


def test_net_use_is_the_sum_over_workers_and_nodes(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    write_parts(
        tmp_path,
        *(sample(moment, worker) for moment in (1, 2) for worker in ("w1", "w2")),
        sample(2, "w3", "n2", cpu_cores=0.5),
    )
    found = use_of(tmp_path)
    assert [line["name"] for line in found["nodes"]] == ["n1", "n2"]
    assert found["nodes"][0]["cpu_cores"] == {"least": 4.0, "mean": 4.0, "most": 4.0}
    assert found["nodes"][0]["node_cpu_cores"]["most"] == 5.0, "a node counts once"
    total = found["total"]
    assert (total["workers"], total["samples"], total["node_cpus"]) == (3, 5, 16)
    assert total["cpu_cores"] == {"least": 4.0, "mean": 4.25, "most": 4.5}
    assert total["ram_gb"]["most"] == 3.0
    assert total["gpu_percent"] is None
    assert total["gpu_memory_gb"] is None


def test_unknown_use_is_not_zero(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    write_parts(tmp_path, sample(1, cpu_cores=None), sample(2, cpu_cores=3.0))
    assert use_of(tmp_path)["total"]["cpu_cores"] == {"least": 3.0, "mean": 3.0, "most": 3.0}


def test_a_shared_gpu_counts_once(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    write_parts(
        tmp_path,
        sample(1, "w1", **gpu("GPU-a", 40, 20)),
        sample(1, "w2", **gpu("GPU-a", 42, 20)),
        sample(1, "w3", **gpu("GPU-b", 80, 30)),
        sample(1, "w4", "n2", **gpu("GPU-c", None, 10)),
    )
    total = use_of(tmp_path)["total"]
    assert total["gpus"] == 3
    assert total["gpu_percent"]["most"] == 61.0, "mean of the GPUs that tell it"
    assert total["gpu_memory_gb"]["most"] == 60.0
    assert total["gpu_power_w"]["most"] == 900.0


def test_table_2_has_the_peaks_of_each_batch(tmp_path: Path) -> None:
    make_campaign(tmp_path, campaign_data(batch={"size": 4}))
    write_parts(
        tmp_path,
        sample(1, batch=1),
        sample(1, "w2", batch=1),
        sample(2, batch=1),
        sample(3, batch=0, cpu_cores=50.0),
        sample(4, batch=2, cpu_cores=1.0),
    )
    found = use_of(tmp_path)
    peaks = [(b["name"], b["models"], b["cpu_cores"]["most"]) for b in found["batches"]]
    assert peaks == [("1", ["yolov3"], 4.0), ("2", ["yolov2-tiny"], 1.0)]
    page = page_of(tmp_path)
    table = re.search(r'<table class="plain" id="resource-batches">.*?</table>', page, re.S)
    assert table
    text = re.sub(r"<[^>]+>", " ", table[0]).split()
    assert text[-5:] == ["Mean", "2.5", "1.50", "–", "–"]


def test_without_batches_the_peaks_are_of_the_workers(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    write_parts(tmp_path, sample(1), sample(2, cpu_cores=3.0), sample(1, "w2", ram_bytes=3 * 10**9))
    peaks = [(w["name"], w["cpu_cores"]["most"]) for w in use_of(tmp_path)["workers"]]
    assert peaks == [("w1", 3.0), ("w2", 2.0)]
    page = page_of(tmp_path)
    assert 'id="resource-batches"' not in page
    table = re.search(r'<table class="plain" id="resource-workers">.*?</table>', page, re.S)
    assert table
    assert re.sub(r"<[^>]+>", " ", table[0]).split()[-5:] == ["Mean", "2.5", "2.00", "–", "–"]


def test_a_run_without_samples_says_so(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    page = page_of(tmp_path)
    assert "No samples: workers take one every 5 s" in page
    assert not (tmp_path / RESOURCES_FILE).exists()
    found = use_of(tmp_path)
    assert (found["samples"], found["total"]) == (0, None)


def test_a_hostile_host_name_stays_text(tmp_path: Path) -> None:
    make_campaign(tmp_path)
    write_parts(tmp_path, sample(1, host="<script>alert(1)</script>"), sample(1, "w2"))
    page = page_of(tmp_path)
    assert "alert(1)" in page
    assert "<script>alert" not in page


def series(values: list[float], moments: list[int] | None = None) -> UseSeries:
    count = len(values)
    return UseSeries(
        np.array(moments or range(count), np.int64),
        {name: np.array(values, float) for name in QUANTITIES},
    )


def test_thinning_keeps_the_peak() -> None:
    values = [1.0] * 5000
    values[1234] = 9.0
    x, y = thinned(series(values), "cpu_cores")
    assert len(x) == len(y) <= POINTS_MAX
    assert max(v for v in y if v is not None) == 9.0


def test_a_pause_and_an_unknown_value_interrupt_the_line() -> None:
    found = thinned(series([1.0, 2.0, 3.0, np.nan], [0, 1, 100, 101]), "cpu_cores")
    assert found == ([0, 1, None, 100, 101], [1.0, 2.0, None, 3.0, None])


def test_a_part_that_is_gathered_meanwhile_is_in_the_gathered_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_parts(tmp_path, sample(1), sample(2, "w2"))
    listed = resources._parts(tmp_path)
    gather_resources(tmp_path, complete=True)
    monkeypatch.setattr(resources, "_parts", lambda folder: listed)
    assert read_resources(tmp_path).num_rows == 2


def test_every_worker_counts_for_the_mean_and_those_without_a_line_are_said(
    tmp_path: Path,
) -> None:
    make_campaign(tmp_path)
    many = WORKERS_MAX + 6
    write_parts(tmp_path, *(sample(1, f"w{n:03}", cpu_cores=float(n)) for n in range(many)))
    assert len(use_of(tmp_path)["workers"]) == many
    page = page_of(tmp_path)
    assert "<td>and 6 more</td>" in page
    assert f'<td>Mean of all</td>\n<td class="n">{(many - 1) / 2:.1f}</td>' in page
