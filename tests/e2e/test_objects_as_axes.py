"""A matrix over scripted objects and the stack's parameters, run with real processes."""

import yaml
from processes import outcomes

MATRIX = {
    "objects.steps into the road.start_s": [-3.0, -6.0],
    "objects.steps into the road.offset_m": [-0.5, 2.0],
    "autonomy.parameters.cruise_speed_mps": [9.0, 12.0],
}


def campaign(folder):
    """Eight cases of two seconds in which somebody crosses; two rigs, one for each speed."""
    path = folder / "crossing.yaml"
    data = {
        "campaign": "crossing",
        "scenario": {"scene": "crossing", "ego_start_m": 60, "ego_speed_mps": 10, "duration_s": 2},
        "camera": {"width": 64, "height": 36, "hz": 10, "reflections": False},
        "matrix": MATRIX,
    }
    path.write_text(yaml.safe_dump(data))
    return str(path)


def run(marked, path, out, slots):
    """Its cases, and the fingerprint."""
    done = marked.run(
        *("conductor", "run", path, "--workers", "1", "--slots", slots, "--out", str(out))
    )
    assert done.returncode in (0, 1), done.stderr
    return outcomes(out)


def test_results_are_the_same_with_one_slot_and_with_four(marked, tmp_path):
    path = campaign(tmp_path)
    one, four = (run(marked, path, tmp_path / slots, slots) for slots in ("1", "4"))
    same = marked.run("conductor", "fingerprint", str(tmp_path / "1"), str(tmp_path / "4"))
    assert same.returncode == 0, same.stdout
    assert same.stdout.startswith("the same: ")
    assert len(one) == len(four) == 8
    assert len({row["kpi_sha256"] for row in one.values()}) == 8, "every case is another"
