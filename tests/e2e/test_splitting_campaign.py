"""A search by splitting with real processes: the same for other workers, and a fork runs again."""

from __future__ import annotations

import pyarrow.parquet as pq
import pytest
import yaml

from schemas.files.json_text import decode_json
from schemas.files.search_result import SearchFile

DATA = {
    "campaign": "gusts",
    "seed": 3,
    "control_hz": 10,
    "render": False,
    "environment": {"custom": {"gale": {"wind": 1.0}}},
    "scenario": {
        "type": "lane_keeping",
        "ego_speed_mps": 22.0,
        "duration_s": 3.0,
        "lateral_limit_m": 3.0,
        "distance_m": 200.0,
    },
    "autonomy": {"stack": "devkit.idle:IdleStack"},
    "matrix": {"weather": ["gale"]},
    "search": {
        "parameters": {},
        "objective": {"kpi": "lateral_error_max_m", "fails_above": 0.3},
        "sampler": "splitting",
        "options": {"particles": 10, "runs": 4},
        "budget": {"cases": 300},
    },
}


def _rows(folder, case):
    [file] = (folder / "cases" / case).glob("attempt-*/kpi.parquet")
    return pq.read_table(file)


@pytest.mark.slow
def test_forks_are_the_same_wherever_they_run_and_alone(marked, tmp_path):
    path = tmp_path / "gusts.yaml"
    path.write_text(yaml.safe_dump(DATA))
    files = []
    for workers, slots in (("1", "10"), ("2", "3")):
        out = tmp_path / workers
        done = marked.run(
            *("conductor", "run", str(path), "--workers", workers, "--slots", slots),
            *("--out", str(out)),
        )
        assert done.returncode in (0, 1), done.stderr
        files.append((out / "search.json").read_bytes())
    assert files[0] == files[1]
    file = decode_json(files[0], SearchFile)
    assert file.answer is not None
    assert file.answer.probability is not None
    first, forked = file.generations[0], file.generations[1]
    assert not first.forks
    case, branch = forked.cases[0], forked.forks[0]
    assert branch is not None
    assert branch.parent in first.cases
    child, parent = (_rows(tmp_path / "1", name) for name in (case, branch.parent))
    errors = [abs(value) for value in parent["lateral_error_m"].to_pylist()]
    moment = next(i for i, error in enumerate(errors) if 0.3 - error < branch.margin)
    same = [child["x_m"][i] == parent["x_m"][i] for i in range(min(len(child), len(parent)))]
    assert all(same[: moment + 2]), "the first other gust acts after the tick of the moment"
    assert not all(same)
    again = tmp_path / "again"
    done = marked.run(
        *("conductor", "run", str(tmp_path / "1" / "campaign.yaml"), "--case", case),
        *("--out", str(again)),
    )
    assert done.returncode in (0, 1), done.stderr
    assert _rows(again, case).equals(child)
