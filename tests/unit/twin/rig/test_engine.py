"""The engine at its exact limits: latency, ends, isolation and independence of slots."""

import math
from collections import deque

import msgspec
import numpy as np
import pytest
from case_changes import changed
from msgspec import structs

from schemas.case import Case
from schemas.files.assets import asset_digest
from schemas.files.kpi import KPI_COLUMNS, SCALARS
from schemas.messages import Command, Detection, Lights
from schemas.plan import expand, parse_campaign
from schemas.sections.objects import ObjectVariation
from twin.base.errors import RefusedError
from twin.rig.command_delay import Delays
from twin.rig.engine import Engine
from twin.scenario.case_files import check_files
from twin.vehicle.state import COLUMN


def case(
    name="a",
    weather="clear",
    time="12:00",
    latency_ms=0,
    camera=None,
    hz=20,
    environment=None,
    autonomy=None,
    **scenario,
):
    camera = {"width": 32, "height": 18, "hz": 10, **(camera or {})}
    data = {
        "campaign": "test",
        "seed": 4,
        "control_hz": hz,
        "camera": camera,
        "scenario": {"ego_start_m": 60.0, "duration_s": 2.0, **scenario},
        "autonomy": autonomy or {"latency_ms": latency_ms},
        "environment": environment or {},
        "matrix": {"weather": [weather], "time_of_day": [time]},
    }
    campaign, mistakes = parse_campaign(data)
    assert campaign is not None, mistakes
    return changed(expand(campaign)[0], id=name)


def ask(engine, slot, throttle=0.0, brake=0.0, steering=0.0, **more):
    return Command(slot, 0, int(engine.tick[slot]), throttle, brake, steering, **more)


def run(engine, cases, policy):
    """Run ``{slot: case}`` to the end; returns {case id: (Finished, frames)}."""
    for slot, one in cases.items():
        engine.reset(slot, one)
    frames = {one.id: [] for one in cases.values()}
    done = {}
    while engine.active.any():
        sensors = engine.sense()
        for slot, one in cases.items():
            if engine.active[slot] and "camera" in sensors:
                boxes = sensors["boxes"]
                parts = (sensors["camera"].values[slot], boxes.values[slot], boxes.count[slot])
                frames[one.id].append(b"".join(p.tobytes() for p in parts))
        commands = [policy(engine, s) if engine.active[s] else None for s in range(engine.slots)]
        for ended in engine.step(commands):
            done[cases[ended.slot].id] = (ended, frames[cases[ended.slot].id])
    return done


def table_bytes(table):
    parts = [table.columns[n].values.tobytes() for n in sorted(table.columns)]
    parts += [c.valid.tobytes() for c in table.columns.values() if c.valid is not None]
    return b"".join(parts) + repr(table.to_lists()["detections"]).encode()


def brake_late(engine, slot):
    at_s = engine.sim_time_ns[slot] / 1e9
    found = [Detection("car", 0.5 + at_s / 100, 1.0, 2.0, 3.0, 4.0)] if at_s > 0.5 else []
    lights = Lights(high=True, indicators=1)
    if at_s < 1.0:
        return ask(engine, slot, 0.5, 0.0, 0.01 * at_s, lights=lights, detections=found)
    return ask(engine, slot, 0.0, 1.0, 0.0, aeb=True, lights=lights, detections=found)


def test_results_do_not_depend_on_slots_or_neighbours():
    cases = [
        case("a", "clear", ego_speed_mps=9.0, duration_s=1.5),
        case("b", "heavy_snow", "05:00", ego_speed_mps=8.0),
        case("c", "heavy_rain", latency_ms=130, ego_speed_mps=5.0, duration_s=1.0),
        case("d", "heavy_fog", "19:00", ego_start_m=6.0, ego_speed_mps=12.0),
    ]
    alone = {}
    for one in cases:
        engine = Engine(one, 1)
        alone |= run(engine, {0: one}, brake_late)
        engine.close()
    engine = Engine(cases[0], 5)
    together = run(engine, dict(zip((4, 1, 3, 0), cases, strict=True)), brake_late)
    again = run(engine, dict(zip((0, 4, 1, 2), cases, strict=True)), brake_late)
    assert together["d"][0].verdict == "collision"
    for other in (together, again):
        for name, (ended, frames) in alone.items():
            assert table_bytes(other[name][0].table) == table_bytes(ended.table)
            assert other[name][0].scalars == ended.scalars
            assert other[name][0].reasons == ended.reasons
            assert other[name][1] == frames
    assert len({frames[0] for _, frames in alone.values()}) == 4


def test_noise_depends_on_seed_and_case_only():
    def first(one, slots=1, slot=0):
        engine = Engine(one, slots)
        engine.reset(slot, one)
        return engine.sense()["camera"].values[slot].copy()

    base = case("a")
    assert (first(base) == first(base, 3, 2)).all()
    assert (first(base) != first(case("b"))).any()
    assert (first(base) != first(changed(base, seed=5))).any()
    # Without clouds, whose place is the case's own too.
    bare = {"custom": {"bare": {}}}
    quiet = case("a", "bare", camera={"noise": False}, environment=bare)
    assert (first(quiet) == first(changed(quiet, seed=5))).all()


@pytest.mark.parametrize("latency_ms", [0, 2, 30, 50, 98, 130, 3])
def test_a_command_is_in_force_exactly_after_the_latency(latency_ms):
    one = case(latency_ms=latency_ms, hz=20, duration_s=1.0)
    engine = Engine(one, 1)
    engine.reset(0, one)
    actuator = COLUMN["throttle"]
    gain = -math.expm1(-0.002 / 0.25)
    for tick in range(6):
        engine.step([ask(engine, 0, throttle=1.0)])
        steps = (tick + 1) * 25 - math.ceil(latency_ms / 2)  # steps with the command in force
        expected = 1.0 - (1.0 - gain) ** max(0, steps)
        assert engine.state[0, actuator] == pytest.approx(expected, abs=1e-12)
        assert (engine.state[0, actuator] == 0.0) == (steps <= 0)


def test_latency_longer_than_many_periods_keeps_the_order():
    one = case(latency_ms=210, hz=50, camera={"hz": 50}, duration_s=1.0)
    engine = Engine(one, 1)
    engine.reset(0, one)
    asked = [0.1 * (k % 7) for k in range(40)]
    position, gain = 0.0, -math.expm1(-0.002 / 0.25)
    for tick, value in enumerate(asked):
        engine.step([ask(engine, 0, throttle=value)])
        for step in range(tick * 10, tick * 10 + 10):
            given = (step - 105) // 10
            position += ((asked[given] if given >= 0 else 0.0) - position) * gain
        found = engine.state[0, COLUMN["throttle"]]
        assert found == pytest.approx(position, abs=1e-12)


def test_of_commands_that_overtake_or_meet_in_a_period_the_newest_is_obeyed():
    """Jitter of several periods: an older command that arrives after a newer one is void, and of
    those that arrive within one control period only the newest takes effect, when it arrives."""
    autonomy = {"latency_ms": 10, "latency_jitter_ms": 180}
    one = case(autonomy=autonomy, hz=50, camera={"hz": 50}, duration_s=2.0)
    engine = Engine(one, 1)
    engine.reset(0, one)
    asked = [((7 * tick) % 10) / 10 for tick in range(80)]
    delays, arrival = Delays(one), []
    for tick in range(len(asked)):
        alone = deque()
        delays.send(alone, 10 * tick, tick, Command(0, 1, tick, asked[tick], 0.0, 0.0))
        arrival.append(alone[0][0])
    obeyed = [t for t, at in enumerate(arrival) if all(at < later for later in arrival[t + 1 :])]
    newest = {arrival[t] // 10: t for t in obeyed}  # of each period
    assert len(newest) < len(obeyed) < len(asked), "some are void, and some meet"
    position, force, gain = 0.0, 0.0, -math.expm1(-0.002 / 0.25)
    for tick, value in enumerate(asked):
        engine.step([ask(engine, 0, throttle=value)])
        for step in range(10 * tick, 10 * tick + 10):
            if tick in newest and step == arrival[newest[tick]]:
                force = asked[newest[tick]]
            position += (force - position) * gain
        assert engine.state[0, COLUMN["throttle"]] == pytest.approx(position, abs=1e-12), tick


def test_lamps_follow_the_command_with_its_latency():
    one = case(time="05:00", latency_ms=100, camera={"noise": False, "hz": 20})
    engine = Engine(one, 1)
    engine.reset(0, one)
    means = []
    for _ in range(4):
        means.append(float(engine.sense()["camera"].values.mean()))
        engine.step([ask(engine, 0, lights=Lights(high=True))])
    assert means[1] == pytest.approx(means[0], abs=0.2)
    assert means[2] > means[0] + 0.5
    assert means[3] > means[0] + 0.5


def test_time_is_up_at_the_first_tick_at_or_after_the_duration():
    for duration_s, ticks in ((1.0, 20), (1.01, 21), (0.99, 20)):
        one = case(duration_s=duration_s)
        ended, _ = run(Engine(one, 1), {0: one}, lambda e, s: ask(e, s, throttle=0.5))["a"]
        assert ended.scalars["ticks"] == ticks
        assert ended.table.rows == ticks + 1
        assert (ended.verdict, ended.passed) == ("time_up", False)
        assert ended.reasons[0].startswith("time is up")


def stop(engine, slot):
    return ask(engine, slot, brake=1.0)


def test_standstill_ends_a_case_and_far_rest_is_false_braking():
    one = case(ego_speed_mps=2.0, standstill_s=0.5, duration_s=20.0)
    ended, _ = run(Engine(one, 1), {0: one}, stop)["a"]
    speed = ended.table.columns["speed_mps"].values
    rest = int(np.argmax(speed == 0.0))
    assert ended.scalars["ticks"] - rest in (10, 9)
    assert (ended.verdict, ended.passed) == ("false_braking", False)
    near = case(ego_speed_mps=2.0, ego_start_m=20.0, standstill_s=0.5, duration_s=20.0)
    ended, _ = run(Engine(near, 1), {0: near}, stop)["a"]
    assert (ended.verdict, ended.passed) == ("pass", True)
    assert ended.reasons[0].startswith("came to rest")


def test_standstill_before_moving_does_not_count():
    one = case(standstill_s=0.1, duration_s=1.0)
    ended, _ = run(Engine(one, 1), {0: one}, stop)["a"]
    assert ended.scalars["ticks"] == 20
    assert ended.verdict == "false_braking"
    assert "never moved" in ended.reasons[0]
    assert ended.table.columns["speed_mps"].values.max() == 0.0


def test_collision_ends_at_the_next_tick_with_its_speed():
    one = case(ego_start_m=5.0, ego_speed_mps=10.0, duration_s=5.0)
    ended, _ = run(Engine(one, 1), {0: one}, lambda e, s: ask(e, s))["a"]
    assert (ended.verdict, ended.passed, ended.outcome) == ("collision", False, "verdict")
    assert ended.scalars["collisions"] == 1
    assert 9.8 < ended.scalars["impact_speed_mps"] < 10.0
    assert ended.scalars["ticks"] == 11  # 5 m at a little below 10 m/s: 0.50x s
    assert ended.scalars["dtc_end_m"] == 0.0
    columns = ended.table.columns
    assert columns["collisions"].values.tolist() == [0] * 11 + [1]
    assert columns["speed_mps"].values[-1] == 0.0
    assert not columns["ttc_s"].valid[-1]


def test_start_distance_and_ttc_are_exact():
    one = case(ego_start_m=60.0, ego_speed_mps=5.0)
    engine = Engine(one, 1)
    engine.reset(0, one)
    assert engine.state[0, COLUMN["dtc_m"]] == pytest.approx(60.0, abs=1e-9)
    ended, _ = run(engine, {0: one}, lambda e, s: ask(e, s))["a"]
    ttc = ended.table.columns["ttc_s"]
    assert ttc.valid[0]
    assert ttc.values[0] == pytest.approx(12.0)
    parked = case(ego_start_m=60.0)
    ended, _ = run(engine, {0: parked}, stop)["a"]
    assert not ended.table.columns["ttc_s"].valid.any()


def test_a_nan_command_fails_its_slot_only():
    cases = {0: case("bad", ego_speed_mps=5.0), 1: case("good", ego_speed_mps=5.0)}

    def policy(engine, slot):
        bad = slot == 0 and engine.tick[0] == 3
        return ask(engine, slot, throttle=math.nan if bad else 0.2)

    done = run(Engine(cases[0], 2), cases, policy)
    ended = done["bad"][0]
    assert (ended.outcome, ended.verdict, ended.passed) == ("failed", "", False)
    assert "throttle is nan, allowed: 0 to 1, at tick 3" in ended.reasons[0]
    assert ended.table.rows == 4
    assert ended.table.columns["throttle"].valid.tolist() == [True] * 3 + [False]
    alone = run(Engine(cases[1], 1), {0: cases[1]}, lambda e, s: ask(e, s, throttle=0.2))
    assert table_bytes(done["good"][0].table) == table_bytes(alone["good"][0].table)


def test_a_nan_state_fails_its_slot_only():
    cases = {0: case("bad", ego_speed_mps=5.0), 1: case("good", ego_speed_mps=5.0)}
    engine = Engine(cases[0], 2)
    for slot, one in cases.items():
        engine.reset(slot, one)
    engine.state[0, COLUMN["velocity_x_mps"]] = math.nan
    ended = engine.step([ask(engine, 0), ask(engine, 1)])
    assert [(e.slot, e.outcome) for e in ended] == [(0, "failed")]
    assert engine.active.tolist() == [False, True]
    assert np.isfinite(engine.state[1]).all()


def test_sensors_come_when_due_and_inactive_slots_are_zero():
    one = case(camera={"hz": 10})
    engine = Engine(one, 2)
    engine.reset(1, one)
    sensors = engine.sense()
    assert set(sensors) == {"camera", "boxes", "vehicle", "environment"}
    assert sensors["camera"].values.shape == (2, 18, 32, 3)
    assert not sensors["camera"].values[0].any()
    assert sensors["camera"].values[1].any()
    assert sensors["boxes"].count.tolist()[0] == 0
    assert not sensors["environment"].values[0].any()
    assert sensors["environment"].values[1, 0] > 1000
    engine.step([None, ask(engine, 1)])
    assert set(engine.sense()) == {"vehicle", "environment"}
    engine.reset(0, one)
    with pytest.raises(AssertionError, match="due"):
        engine.sense()
    engine.close()
    assert not engine.active.any()


def test_images_go_to_the_given_buffer():
    one = case()
    buffer = np.zeros((1, 18, 32, 3), np.uint8)
    engine = Engine(one, 1, buffers={"camera": buffer})
    engine.reset(0, one)
    values = engine.sense()["camera"].values
    assert np.shares_memory(values, buffer)
    assert buffer.any()
    engine.clear(0)
    assert not buffer.any()


def test_table_and_scalars_follow_the_schema():
    one = case(ego_speed_mps=8.0, duration_s=4.0, standstill_s=0.2)
    ended, _ = run(Engine(one, 1), {0: one}, brake_late)["a"]
    assert list(ended.scalars) == [c.name for c in SCALARS]
    assert isinstance(one, Case)
    lists = ended.table.to_lists()
    assert list(lists) == [c.name for c in KPI_COLUMNS]
    types = {"bool": np.bool_, "int32": np.int32, "int64": np.int64, "float64": np.float64}
    for column in KPI_COLUMNS:
        assert len(lists[column.name]) == ended.table.rows
        if not column.nullable:
            assert None not in lists[column.name]
        if column.type == "name":
            assert ended.table.columns[column.name].values.dtype.kind == "U"
        elif column.type != "detections":
            assert ended.table.columns[column.name].values.dtype == types[column.type]
    assert lists["throttle"][-1] is None
    assert lists["detections"][-1] is None
    assert lists["detections"][0] == []
    assert lists["detections"][15][0]["label"] == "car"
    assert lists["headlights"][0] == 2
    assert ended.scalars["aeb_time_s"] == 1.0
    assert ended.scalars["aeb_dtc_m"] == lists["dtc_m"][20]
    assert ended.scalars["decel_peak_mps2"] > 7.0
    assert ended.scalars["impact_speed_mps"] is None


def test_rows_grow_past_the_first_allocation():
    one = case(hz=500, camera={"hz": 1}, duration_s=1.2)
    engine = Engine(one, 1)
    engine.reset(0, one)
    ended = []
    while not ended:
        ended = engine.step([ask(engine, 0)])
    assert ended[0].table.rows == 601
    assert ended[0].table.columns["tick"].values.tolist() == list(range(601))


def test_unknown_device_is_one_line():
    with pytest.raises(ValueError, match=r"device 'cuda:99': not here; allowed: ") as error:
        Engine(case(), 1, device="cuda:99")
    assert "\n" not in str(error.value)


def test_weather_and_light_change_while_the_case_runs():
    timeline = [
        {"at_s": 0.5, "over_s": 0.4, "weather": "heavy_fog"},
        {"at_s": 1.0, "time_of_day": "23:00"},
        {"at_s": 1.2, "weather": "heavy_snow"},
    ]
    one = case(environment={"timeline": timeline}, ego_speed_mps=5.0)
    engine = Engine(one, 2)
    engine.reset(1, one)
    seen = []
    while engine.active.any():
        lux, extinction = engine.sense()["environment"].values[1]
        engine.step([None, ask(engine, 1)])
        seen.append((lux, extinction, engine._vehicles.friction[1]))
    lux, extinction, friction = (np.array(column) for column in zip(*seen, strict=True))
    fog = extinction[16:19]
    assert np.all(extinction[:11] == extinction[0])
    assert np.all(np.diff(extinction[10:19]) > 0)
    assert extinction[18] > 50 * extinction[0]
    assert np.all(lux[:10] > 1e4)
    assert np.all(lux[20:] < 10)
    assert friction[23] == pytest.approx(0.80)
    assert np.all(friction[24:-1] == pytest.approx(0.20))
    assert np.all(fog > 0)


def test_gusts_push_the_car_and_belong_to_the_case():
    def aside(one, slots=1, slot=0):
        engine = Engine(one, slots)
        engine.reset(slot, one)
        for _ in range(30):
            engine.sense()
            commands = [None] * slots
            commands[slot] = ask(engine, slot)
            engine.step(commands)
        return float(engine.state[slot, COLUMN["y_m"]])

    gale = {"custom": {"gale": {"wind": 0.6}, "calm": {}}, "wind_from_deg": 0.0}
    speed = {"ego_speed_mps": 20.0}
    blown = case(weather="gale", environment=gale, **speed)
    assert aside(case(weather="calm", environment=gale, **speed)) == 0.0
    assert abs(aside(blown)) > 0.01
    assert aside(blown) == aside(blown, 3, 2)
    assert aside(blown) != aside(changed(blown, seed=77))


def test_rain_falls_on_while_the_weather_changes():
    timeline = [{"at_s": 0.5, "over_s": 0.5, "weather": "light_rain"}]
    one = case(weather="heavy_rain", environment={"timeline": timeline}, duration_s=2.0)
    engine = Engine(one, 1)
    engine.reset(0, one)
    fallen, clouds = [], []
    while engine.active.any():
        engine.sense()
        row = engine._exteroceptive._sensors[0].camera.lights.host[0]
        fallen.append(float(row["fallen_m"]))
        clouds.append(row["cloud_offset"].copy())
        engine.step([ask(engine, 0)])
    steps = np.diff(fallen)
    assert np.all(steps > 0.15)  # 4 to 9 m/s, 50 ms
    assert np.all(steps < 0.5)
    assert np.abs(np.diff(clouds, axis=0)).max() < 0.01


def test_all_cameras_see_the_same_clouds():
    one = case(camera={"width": 32, "height": 18, "hz": 20})
    more = msgspec.structs.replace(one.rig.camera, name="front_left", hz=5)
    one = changed(one, cameras=[more])
    engine = Engine(one, 1)
    engine.reset(0, one)
    for _ in range(5):
        engine.sense()
        engine.step([ask(engine, 0)])
    engine.sense()
    a, b = (eye.camera.lights.host[0] for eye in engine._exteroceptive._sensors)
    assert a["key"] != b["key"]
    assert a["cloud_offset"].tobytes() == b["cloud_offset"].tobytes()


def test_objects_differ_per_slot_and_nothing_depends_on_the_slot():
    """A person crosses at another moment in each case: too late, into the ego, long before it."""
    cases = [
        changed(
            case(f"start {start_s}", scene="crossing", ego_speed_mps=10.0),
            objects={"steps into the road": ObjectVariation(start_s=start_s)},
        )
        for start_s in (-3.0, -6.0, -9.0)
    ]
    together = run(Engine(cases[0], 3), dict(enumerate(cases)), ask)
    assert [together[one.id][0].scalars["collisions"] for one in cases] == [0, 1, 0]
    assert len({b"".join(frames) for _, frames in together.values()}) == 3
    engine = Engine(cases[0], 1)
    for one in reversed(cases):
        ended, frames = run(engine, {0: one}, ask)[one.id]
        assert table_bytes(ended.table) == table_bytes(together[one.id][0].table)
        assert frames == together[one.id][1]


def test_no_time_passes_where_nothing_runs():
    one = case()
    engine = Engine(one, 3)
    engine.reset(1, one)
    for _ in range(2):
        engine.sense()
        engine.step([None, ask(engine, 1), None])
    assert engine.tick.tolist() == [0, 2, 0]
    assert engine.sim_time_ns.tolist() == [0, 100_000_000, 0]


def test_files_of_scene_and_vehicle_are_those_of_the_submission(tmp_path):
    campaign, _ = parse_campaign({"campaign": "c", "matrix": {"weather": ["clear"]}})
    (case,) = expand(campaign)
    network = tmp_path / "net.onnx"
    network.write_bytes(b"\0 no YAML")  # a stack's process looks at it, when it loads it
    networks = {str(network): "0" * 64}
    rig = structs.replace(case.rig, files=networks, models=[*networks])
    check_files(structs.replace(case, rig=rig))
    scene = tmp_path / "scene.yaml"
    scene.write_text("schema: 1\nscene: own\n")
    files = {**networks, str(scene): asset_digest(scene)}
    case = structs.replace(case, rig=structs.replace(rig, scene=str(scene), files=files))
    check_files(case)
    scene.write_text("schema: 1\nscene: other\n")
    with pytest.raises(RefusedError, match="not what the campaign was submitted with"):
        check_files(case)
