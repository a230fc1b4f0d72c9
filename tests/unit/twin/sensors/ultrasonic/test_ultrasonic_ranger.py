"""The rangers in an engine: echoes of variable length, on the path of all ray sensors."""

import numpy as np

from devkit.checking.frames import CheckDrive, sense
from schemas.identity import case_digest, rig_key
from schemas.messages import Command
from schemas.plan import parse_plan
from schemas.wire.topics import sensor_topic
from twin.rig.engine import Engine, frame_channels

CAMPAIGN = {
    "campaign": "rangers",
    "control_hz": 20,
    "camera": {"width": 32, "height": 18, "hz": 10},
    "render": False,
    "scenario": {"duration_s": 2, "ego_start_m": 146, "ego_speed_mps": 5},
    "autonomy": {
        "stack": "devkit.idle:IdleStack",
        "perception": {"none": {"type": "ground_truth"}},
    },
    "sensors": {"ultrasonic": {"hz": 10}},
    "matrix": {"sensors.ultrasonic.range_m": [0.05, 10]},
}


def planned():
    plan, mistakes = parse_plan(CAMPAIGN)
    assert plan is not None, mistakes
    return sorted(plan.cases, key=lambda case: case.variation.sensors.ultrasonic.range_m)


def readings(cases, ticks=9):
    """Echoes per reading and slot, each [N, 2]."""
    channels = {c.name: c for c in frame_channels(cases[0], len(cases))}
    buffers = {name: np.zeros(c.shape, c.dtype) for name, c in channels.items()}
    engine = Engine(cases[0], len(cases), buffers=buffers)
    for slot, case in enumerate(cases):
        engine.reset(slot, case)
    found = []
    for _ in range(ticks):
        sensed = engine.sense()
        if "ultrasonic" in sensed:
            data = sensed["ultrasonic"]
            assert data.values is buffers["ultrasonic"]
            assert all((data.values[s, n:] == 0.0).all() for s, n in enumerate(data.count))
            found.append([data.values[s, :n].tolist() for s, n in enumerate(data.count)])
        engine.step([Command(s, 0, int(engine.tick[s]), 0.0, 0.0, 0.0) for s in range(len(cases))])
    return found


def test_slots_hear_as_far_as_their_cases_say_and_do_not_depend_on_each_other():
    cases = planned()
    assert len({rig_key(case) for case in cases}) == 1
    together = readings(cases)
    assert len(together) == 5, "10 Hz of 20"
    far = [slots[1] for slots in together]
    assert all(slots[0] == [] for slots in together)
    assert any(far)
    assert all(0.0 < distance_m <= 10.0 for rows in far for distance_m, _ in rows)
    assert [slots[0] for slots in readings(cases[1:])] == far


def test_all_else_follows_from_the_declaration():
    case = planned()[0]
    assert sensor_topic("ultrasonic").type == "ULTRASONIC_COLUMNS [S,8,2] float32"
    made, count = sense(case, [CheckDrive("a", 1, 60.0, 10.0), None], 36)["ultrasonic"]
    assert (made.shape, str(made.dtype), count) == ((2, 8, 2), "float32", [1, 0])


def test_campaigns_without_it_keep_their_digests():
    plan, _ = parse_plan({"campaign": "a", "matrix": {"weather": ["clear"]}})
    assert "ultrasonic" not in plan.cases[0].variation.sensors.sections()
    assert case_digest(plan.cases[0]) != case_digest(planned()[0])
