"""UN R152 with real processes: stacks that never and always brake, one that brakes late, and a row
that is off its speed."""

import json
from pathlib import Path

import pytest
import yaml
from processes import outcomes

STACK = '''
from devkit.stack import Observation, Stack
from schemas.messages import VEHICLE_COLUMNS, Command, Episode

SPEED = VEHICLE_COLUMNS.index("speed_mps")
STARTS_S = 8.0


class Brakes(Stack):
    """Brakes when the time to collision is `from_s`: it knows that the target, at a constant speed,
    is 8 s ahead at the start. 0: never; 99: always."""

    def __init__(self, slots: int, from_s: float = 0.0, target_mps: float = 0.0) -> None:
        super().__init__(slots)
        self.from_s, self.target_mps = from_s, target_mps
        self.gap_m = [0.0] * slots
        self.brakes = [False] * slots

    def reset(self, slot: int, episode: Episode) -> None:
        self.gap_m[slot], self.brakes[slot] = -1.0, False
        self.period_s = episode.control_period_ns * 1e-9

    def step(self, observation: Observation) -> list[Command]:
        return [self.drive(slot, observation) for slot in observation.active_slots()]

    def drive(self, slot: int, observation: Observation) -> Command:
        closing_mps = float(observation.sensors["vehicle"][slot][SPEED]) - self.target_mps
        if self.gap_m[slot] < 0.0:
            self.gap_m[slot] = STARTS_S * closing_mps
        near = closing_mps > 0 and self.gap_m[slot] <= self.from_s * closing_mps
        self.brakes[slot] |= near and self.from_s > 0.0
        self.gap_m[slot] = max(0.0, self.gap_m[slot] - closing_mps * self.period_s)
        brakes = self.brakes[slot]
        return Command(
            slot=slot,
            token=int(observation.token[slot]),
            tick=int(observation.tick[slot]),
            throttle=0.0,
            brake=1.0 if brakes else 0.0,
            steering_rad=0.0,
            aeb=brakes,
        )
'''
CAMPAIGNS = Path(__file__).parents[2] / "conductor/campaigns"
SHIPPED = CAMPAIGNS / "un-r152.yaml"
PERIOD_HZ = 50
pytestmark = pytest.mark.slow


def written(folder, name, from_s, shipped=SHIPPED, **changes):
    """A shipped rulebook with a stack that brakes at a time to collision, and without cameras."""
    (folder / "late_stack.py").write_text(STACK)
    data = yaml.safe_load(shipped.read_text())
    autonomy = {
        "stack": "late_stack:Brakes",
        "perception": {"none": {"type": "ground_truth"}},
        "parameters": {"from_s": from_s},
    }
    data |= {"campaign": name, "render": False, "control_hz": PERIOD_HZ, "autonomy": autonomy}
    path = folder / f"{name}.yaml"
    path.write_text(yaml.safe_dump(data | changes, sort_keys=False))
    return str(path)


def ran(marked, folder, path, out, *options, slots=16):
    done = marked.run(
        *("conductor", "run", path, "--workers", "1", "--slots", str(slots)),
        *("--out", str(folder / out), *options),
        folder=folder,
    )
    assert done.returncode in (0, 1), done.stderr
    judged = json.loads((folder / out / "judgement.json").read_text())
    assert judged["agree"] == judged["attempts"] > 0, judged
    return outcomes(folder / out)


def words(rows):
    return {name: row["verdict"] for name, row in rows.items()}


def test_who_never_brakes_fails_and_who_always_brakes_passes(marked, tmp_path):
    never = ran(marked, tmp_path, written(tmp_path, "never", 0.0), "never", slots=48)
    assert len(never) == 48
    assert set(words(never).values()) == {"fail"}, words(never)
    always = ran(marked, tmp_path, written(tmp_path, "always", 99.0), "always", slots=48)
    # It never warns, which four cases ask for.
    warned = {name for name in always if name.startswith("car-warning")}
    assert {name for name, word in words(always).items() if word == "fail"} == warned
    assert len(warned) == 4
    assert set(words(always).values()) == {"pass", "fail"}, words(always)
    for name, row in never.items():
        scalars = row["scalars"]
        planned = 20 if "moving" not in name else 10
        assert scalars["impact_relative_mps"] * 3.6 >= planned - 1e-3
        assert scalars["trial_begin_s"] >= 2.0
        assert "the stack did not intervene" in row["reasons"][-1]


def test_where_nothing_is_to_be_done_it_is_the_other_way_round(marked, tmp_path):
    """FMVSS 127: a steel plate in the lane, and two parked cars beside it."""
    shipped = CAMPAIGNS / "fmvss-127.yaml"
    quick = ("--quick", "--rows", "lead,pedestrian-day,false-activation")
    for name, from_s, positive, negative in (
        ("never", 0.0, "fail", "pass"),
        ("always", 99.0, "pass", "false_reaction"),
    ):
        path = written(tmp_path, name, from_s, shipped)
        found = words(ran(marked, tmp_path, path, name, *quick))
        negatives = {"steel-plate", "parked-gate"}
        assert negatives < found.keys()
        assert len(found) == 18
        assert {found[row] for row in negatives} == {negative}
        assert {word for row, word in found.items() if row not in negatives} == {positive}


def test_repetitions_differ_in_speed_offset_and_load(marked, tmp_path):
    rows = ran(
        marked, tmp_path, written(tmp_path, "never", 0.0), "few", "--rows", "car-stationary-running"
    )
    names = [f"car-stationary-running-ego.speed_kmh_60-r{repeat}" for repeat in (0, 1)]
    first, second = (rows[name]["scalars"] for name in names)
    assert first["trial_speed_mps"] == pytest.approx(60 / 3.6)
    assert 58 / 3.6 <= second["trial_speed_mps"] < 60 / 3.6
    assert first["trial_lateral_m"] == pytest.approx(0.0, abs=1e-6)
    assert 0.0 < abs(second["trial_lateral_m"]) <= 0.1


def test_a_contact_below_its_limit_passes_and_slots_decide_nothing(marked, tmp_path):
    """From 60 km/h a contact of up to 35 km/h passes, from 20 km/h none does."""
    path = written(tmp_path, "late", 0.75)
    options = ("--rows", "car-stationary-20-running,car-stationary-running")
    rows = ran(marked, tmp_path, path, "one", *options, slots=1)
    again = ran(marked, tmp_path, path, "six", *options, slots=6)
    assert {n: r["kpi_sha256"] for n, r in rows.items()} == {
        n: r["kpi_sha256"] for n, r in again.items()
    }
    for name, row in rows.items():
        impact = row["scalars"]["impact_relative_mps"]
        kmh = 0.0 if impact is None else impact * 3.6
        limit = 35.0 if "60" in name else 0.0
        passes = kmh <= limit if limit else impact is None
        assert row["verdict"] == ("pass" if passes else "fail"), (name, kmh)
    assert (
        rows["car-stationary-running-ego.speed_kmh_60-r0"]["scalars"]["impact_relative_mps"] > 0.0
    )


def test_an_ego_off_its_speed_is_inconclusive_and_says_so(marked, tmp_path):
    book = yaml.safe_load(SHIPPED.read_text())["rulebook"]
    row = book["rows"][0] | {"repetitions": 1, "varied": {}, "values": {"ego.speed_kmh": 23.1}}
    row["trial"] |= {"speed_kmh": 20, "speed_tolerance_kmh": [0, 2]}
    path = written(tmp_path, "off", 99.0, rulebook=book | {"rows": [row]})
    (only,) = ran(marked, tmp_path, path, "off").values()
    assert (only["verdict"], only["passed"]) == ("inconclusive", False)
    assert "the ego was 3.10 km/h faster than the planned 20 km/h" in only["reasons"][0]


def test_a_row_that_is_not_there_is_refused_in_one_line(marked, tmp_path):
    for command in ("run", "validate"):
        done = marked.run("conductor", command, "un-r152", "--rows", "car-moving-max,bycicle")
        assert done.returncode == 2
        (line,) = done.stderr.splitlines()
        assert line.startswith("conductor: --rows: no row, group or test 'bycicle'; did you mean")
