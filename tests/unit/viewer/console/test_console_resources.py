"""What workers used over time, of a finished run and of one that runs."""

import datetime

import msgspec
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from schemas.files.resources import ResourceSample
from viewer.console.resources import POINTS_MAX, gpus_of, resources_of
from viewer.console.run_folder import RunFolder


def sample(second=0, worker="w1", **changes):
    values = {
        "time_ns": second * 10**9,
        "host": "node",
        "worker": worker,
        "batch": 0,
        "cases": 1,
        "cpu_cores": None,
        "ram_bytes": 5,
        "processes": [],
        "node_cpus": 2,
        "node_cpu_cores": None,
        "node_ram_bytes": 1,
        "node_ram_total_bytes": 2,
    }
    return ResourceSample(**values | changes)


def part(run, worker, samples, torn=b""):
    folder = run / "resources"
    folder.mkdir(exist_ok=True)
    lines = b"\n".join(msgspec.json.encode(s) for s in samples)
    (folder / f"{worker}.jsonl").write_bytes(lines + b"\n" + torn)


def test_a_running_campaigns_workers_write_logs(tmp_path):
    part(tmp_path, "w1", [sample(1), sample(6, cpu_cores=1.5, gpu="GPU-a")], b'{"time_ns": 1')
    part(tmp_path, "w2", [sample(2, "w2", gpu="GPU-a"), sample(7, "w2", gpu="GPU-b")])
    found = resources_of(RunFolder(tmp_path))
    assert found["w1"]["t"] == [1.0, 6.0]
    assert found["w1"]["cpu_cores"] == [None, 1.5], "what was not measured is never 0"
    assert found["w1"]["gpu"] == "GPU-a"
    assert gpus_of(RunFolder(tmp_path)) == 2


def test_a_finished_campaign_has_a_table(tmp_path):
    rows = [sample(1), sample(6, gpu="GPU-a")]
    columns = {
        name: [getattr(row, name) for row in rows]
        for name in ("worker", "host", "cases", "cpu_cores", "ram_bytes", "gpu", "gpu_percent")
    }
    times = pa.array([row.time_ns for row in rows], pa.timestamp("ns", "UTC"))
    pq.write_table(pa.table({"time_ns": times, **columns}), tmp_path / "resources.parquet")
    part(tmp_path, "stale", [sample(9, "stale")])
    found = resources_of(RunFolder(tmp_path))
    assert list(found) == ["w1"]
    assert found["w1"]["t"] == [1.0, 6.0]
    assert found["w1"]["gpu_memory_bytes"] == [None, None], "a column that it has not"
    assert gpus_of(RunFolder(tmp_path)) == 1


def test_without_any_nothing_is_known(tmp_path):
    assert resources_of(RunFolder(tmp_path)) == {}
    assert gpus_of(RunFolder(tmp_path)) is None
    (tmp_path / "resources.parquet").write_bytes(b"PAR1 damaged")
    assert resources_of(RunFolder(tmp_path)) == {}


def test_links_and_long_logs(tmp_path):
    part(tmp_path, "w1", [sample(second) for second in range(5000)])
    found = resources_of(RunFolder(tmp_path))["w1"]
    assert 0 < len(found["t"]) <= POINTS_MAX
    assert found["t"] == sorted(found["t"])
    (tmp_path / "resources" / "w2.jsonl").symlink_to(tmp_path / "resources" / "w1.jsonl")
    assert list(resources_of(RunFolder(tmp_path))) == ["w1"]


def test_times_are_of_the_wall_clock(tmp_path):
    day_s = datetime.datetime(2026, 11, 26, tzinfo=datetime.UTC).timestamp()
    part(tmp_path, "w1", [sample(int(day_s))])
    assert resources_of(RunFolder(tmp_path))["w1"]["t"] == [pytest.approx(day_s)]


def test_the_table_is_read_again_when_it_changes(tmp_path, monkeypatch):
    run, reads = RunFolder(tmp_path), []
    read = RunFolder.read

    def counted(self, name, most):
        reads.append(name)
        return read(self, name, most)

    monkeypatch.setattr(RunFolder, "read", counted)

    def write(gpus):
        columns = {"time_ns": pa.array(range(len(gpus)), pa.timestamp("ns", "UTC"))}
        columns |= {"worker": ["w1"] * len(gpus), "gpu": gpus}
        pq.write_table(pa.table(columns), tmp_path / "resources.parquet")

    part(tmp_path, "w1", [sample(1, gpu="GPU-a")])
    assert gpus_of(run) == 1
    part(tmp_path, "w2", [sample(1, "w2", gpu="GPU-b")])
    assert gpus_of(run) == 2, "logs grow, so they are read each time"
    write(["GPU-a"])
    reads.clear()
    assert (gpus_of(run), gpus_of(run)) == (1, 1)
    assert reads == ["resources.parquet"]
    write(["GPU-a", "GPU-b", "GPU-c"])
    assert gpus_of(run) == 3
