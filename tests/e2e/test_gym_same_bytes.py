"""An environment sees what a stack sees: the bytes of a recorded drive, of a real campaign."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pyarrow.parquet as pq
import pytest
from gym_rigs import SMALL
from processes import Marked, nothing_left, outcomes

from schemas.files.yaml_file import dump_yaml
from twin.gym import make_vec
from twin.records.drive_record import RecordReader, decoded

SENSORS = ("camera", "imu", "gnss", "vehicle", "lidar.roof")
REWARD = "speed_mps - 3 * abs(lateral_error_m) - 10 * collisions"


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    """Control at the cameras' rate, so that the reference stack answers once per step; it drives
    by what it sees, through rain and fog, and its parking lamps alone are on."""
    path = tmp_path_factory.mktemp("gym") / "small.yaml"
    data = {
        **SMALL,
        "control_hz": 10,
        "sensors": {"imu": {}, "gnss": {}},
        "lidars": [{"name": "roof", "hz": 10}],
        "autonomy": {
            "parameters": {"steering": "visual", "cruise_speed_mps": 8.0, "fog_above_per_m": 1.0}
        },
        "recording": {"drive": "all"},
        "view": "none",
    }
    path.write_text(dump_yaml(data))
    return path


@pytest.fixture(scope="module")
def run(campaign):
    """Folder of the campaign that was run."""
    starter = Marked()
    out = campaign.parent / "run"
    with nothing_left(starter):
        done = starter.run(
            *("conductor", "run", str(campaign), "--workers", "1", "--slots", "2"),
            *("--out", str(out)),
        )
    assert done.returncode in (0, 1), done.stderr[-2000:]
    return out


def attempts(run):
    """Attempt folder of every case."""
    found = {path.parents[0].name: path for path in sorted(run.glob("cases/*/attempt-1"))}
    assert found.keys() == outcomes(run).keys()
    assert len(found) == 3
    return found


def test_the_same_commands_show_the_same_bytes(campaign, run):
    """Every case in a slot of its own, beside others: sensors, verdict and KPIs."""
    records = {name: RecordReader(path) for name, path in attempts(run).items()}
    drives = {name: list(reader.ticks()) for name, reader in records.items()}
    names = list(drives)
    options = {"sensors": SENSORS, "reward": REWARD, "lights": ["parking"]}
    with closing(make_vec(campaign, len(names), **options)) as envs:
        seen, infos = envs.reset(seed=[SMALL["seed"]] * len(names), options={"case": names})
        assert infos["case"].tolist() == names
        returns, ended = np.zeros(len(names)), {}
        for tick in range(max(map(len, drives.values()))):
            actions = np.zeros((len(names), 3))
            for env, name in enumerate(names):
                if name in ended:
                    continue
                recorded = drives[name][tick]
                for sensor in SENSORS:
                    then = decoded(recorded.seen.sensors[sensor])
                    assert then.tobytes() == seen[sensor][env].tobytes(), (name, tick, sensor)
                command = recorded.answer.command
                actions[env] = command.steering_rad, command.throttle, command.brake
            seen, reward, terminated, truncated, infos = envs.step(actions)
            for env in np.flatnonzero(terminated | truncated).tolist():
                ended.setdefault(names[env], (tick, infos["verdict"][env], kpis_of(infos, env)))
            returns += np.where([n in ended and ended[n][0] < tick for n in names], 0.0, reward)
    told = outcomes(run)
    assert ended.keys() == told.keys()
    for env, name in enumerate(names):
        last, verdict, kpis = ended[name]
        assert last == len(drives[name]) - 1
        assert verdict == told[name]["verdict"]
        assert kpis == {k: v for k, v in told[name]["scalars"].items() if v is not None}
        assert returns[env] == pytest.approx(return_of(attempts(run)[name]), abs=1e-9)


def kpis_of(infos, env):
    values = {n: v[env] for n, v in infos["kpis"].items() if not n.startswith("_")}
    return {name: value for name, value in values.items() if not np.isnan(value)}


def return_of(attempt):
    rows = pq.read_table(attempt / "kpi.parquet").to_pylist()
    assert len(rows) > 10
    return sum(
        row["speed_mps"] - 3 * abs(row["lateral_error_m"]) - 10 * row["collisions"] for row in rows
    )


def test_the_seed_of_an_environment_is_that_of_the_campaign(campaign, run):
    """With another seed the pictures are others: the comparison above can fail."""
    name, path = next(iter(attempts(run).items()))
    first = next(RecordReader(path).ticks())
    with closing(make_vec(campaign, 1, sensors=["camera"])) as envs:
        seen, _ = envs.reset(seed=SMALL["seed"] + 1, options={"case": name})
    assert decoded(first.seen.sensors["camera"]).tobytes() != seen["camera"][0].tobytes()
