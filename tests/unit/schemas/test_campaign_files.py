"""Campaign files: every mistake in one line with file, path and what is allowed."""

import copy
from typing import get_args

import msgspec
import pytest
from case_changes import changed

from conductor.run.source import check, load, shipped
from devkit.darknet.variant import ARCHITECTURES
from schemas.campaign import WEATHERS
from schemas.files.yaml_file import YamlError, load_yaml, parse_yaml
from schemas.identity import campaign_digest, case_digest, rig_key, stream_key
from schemas.plan import expand, parse_campaign, parse_plan
from schemas.sections.view_mode import View, ViewMode
from twin.base.errors import UsageError

GOOD = {
    "campaign": "c",
    "matrix": {"weather": ["clear", "heavy_fog"], "time_of_day": ["05:00", "13:00"]},
}

# (change to a good file, path of the mistake, words that the line must hold)
BAD = [
    ({"campaign": "A b"}, "campaign", ["'A b'", "text matching"]),
    ({"campaign": None}, "campaign", ["nothing"]),
    ({"schema": 2}, "schema", ["given 2", "allowed: 1"]),
    ({"simulator": "wrap"}, "simulator", ["'wrap'", "noop, warp", "did you mean 'warp'?"]),
    ({"seed": -1}, "seed", ["given -1", ">= 0"]),
    ({"seed": 1.5}, "seed", ["given 1.5", "a whole number"]),
    ({"attempts_max": 0}, "attempts_max", ["given 0", ">= 1"]),
    ({"deadline_s": float("nan")}, "deadline_s", ["nan", "finite"]),
    ({"control_hz": 40}, "control_hz", ["given 40", "divisor of 500"]),
    ({"camera": {"hz": 15}}, "camera.hz", ["given 15", "divisor of control_hz 20"]),
    ({"camera": {"width": "wide"}}, "camera.width", ["'wide'", ">= 16 and <= 3840"]),
    ({"camera": 3}, "camera", ["given 3", "mapping", "width"]),
    ({"scenario": {"durations_s": 3}}, "scenario.durations_s", ["did you mean 'duration_s'?"]),
    ({"scenario": {"type": "lane_keep"}}, "scenario.type", ["did you mean 'lane_keeping'?"]),
    ({"scenario": {"distance_m": 50}}, "scenario", ["distance_m", "belongs to type lane_keeping"]),
    (
        {"scenario": {"type": "lane_keeping", "ego_start_m": 60}},
        "scenario",
        ["ego_start_m is set", "belongs to type jump_scare", "this is lane_keeping"],
    ),
    (
        {"scenario": {"type": "lane_keeping", "lateral_limit_m": 0}},
        "scenario.lateral_limit_m",
        ["given 0", "> 0 and <= 10"],
    ),
    (
        {"matrix": {"scenario.distance_m": [50]}},
        "matrix.scenario",
        ["belongs to type lane_keeping"],
    ),
    ({"scenario": {"scene": "downtwn"}}, "scenario.scene", ["did you mean 'downtown'?"]),
    ({"scenario": {"vehicle": "no/car.yaml"}}, "scenario.vehicle", ["no/car.yaml", "opencav"]),
    ({"camera": {"name": "front"}}, "cameras", ["opencav", "'front'", "front_right"]),
    ({"cameras": [{"name": "rear"}]}, "cameras", ["opencav", "'rear'", "front_left"]),
    ({"lidars": [{"name": "roof"}], "control_hz": 25, "camera": {"hz": 5}}, "lidars", ["10 Hz"]),
    ({"camera": {"outputs": ["depth", "depth"]}}, "camera.outputs", ["'depth' appears twice"]),
    ({"matrix": {"environment.date": ["2025-06-31"]}}, "matrix.environment", ["no day"]),
    ({"lidars": [{"name": "rof"}]}, "lidars", ["did you mean 'roof'?"]),
    (
        {"scenario": {"vehicle": "bmw_320i"}, "lidars": [{"name": "roof"}]},
        "lidars",
        ["bmw_320i", "it has none"],
    ),
    ({"autonomy": {"stack": "devkit.aeb"}}, "autonomy.stack", ["'devkit.aeb'", "text matching"]),
    ({"autonomy": {"stack": "nowhere:X"}}, "autonomy.stack", ["no module 'nowhere'"]),
    ({"autonomy": {"perception": {}}}, "autonomy.perception", ["name at least one"]),
    (
        {"autonomy": {"perception": {"a": {"type": "yolo"}}}},
        "autonomy.perception.a.type",
        ["'yolo'", "ground_truth"],
    ),
    (
        {"autonomy": {"perception": {"a": {"type": "ground_truth", "contrast_min": 2}}}},
        "autonomy.perception.a.contrast_min",
        ["given 2", "<= 1"],
    ),
    ({"matrix": {}}, "matrix", ["no cases"]),
    ({"matrix": {"wether": ["clear"]}}, "matrix.wether", ["did you mean 'weather'?"]),
    ({"matrix": {"weather": ["hevy_fog"]}}, "matrix.weather", ["did you mean 'heavy_fog'?"]),
    ({"matrix": {"weather": "clear"}}, "matrix.weather", ["expected a list"]),
    ({"matrix": {"weather": []}}, "matrix.weather", ["at least 1"]),
    ({"matrix": {"weather": ["clear", "clear"]}}, "matrix.weather", ["twice"]),
    ({"matrix": {"time_of_day": ["5am"]}}, "matrix.time_of_day", ["'5am'"]),
    ({"matrix": {"model": ["yolov9"]}}, "matrix.model", ["'yolov9'", "default"]),
    ({"matrix": {"scenario.duration_s": [0]}}, "matrix.scenario.duration_s", ["given 0"]),
    ({"cases": [{"weather": "clear", "time_of_day": "05:00"}]}, "cases[0]", ["twice"]),
    ({"exclude": [{"weather": "light_snow"}]}, "exclude[0]", ["matches no case"]),
    ({"exclude": [{}]}, "exclude", ["every case is excluded"]),
    ({"batch": {"size": 0}}, "batch.size", ["given 0"]),
    ({"surprise": 1}, "surprise", ["unknown key", "simulator"]),
]


@pytest.mark.parametrize(("change", "path", "words"), BAD, ids=[str(b[0])[:60] for b in BAD])
def test_bad_files(change, path, words):
    campaign, mistakes = check({**copy.deepcopy(GOOD), **change})
    assert campaign is None
    assert len(mistakes) == 1, mistakes
    line = mistakes[0].line("c.yaml")
    assert line.startswith(f"c.yaml: {path}: ")
    assert len(line.splitlines()) == 1
    for word in words:
        assert word in line


def test_all_mistakes_at_once():
    data = {**GOOD, "seed": -1, "camera": {"width": 1, "hight": 2}}
    _, mistakes = check(data)
    assert {m.path for m in mistakes} == {"seed", "camera.width", "camera.hight"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [1, 2", ["c.yaml:"]),
        ("a: 1\na: 2", ["key 'a' appears twice", "c.yaml:2"]),
        ("? [a]\n: 1", ["plain value"]),
        ("a: !!python/object:os.system {}", ["c.yaml"]),
        ("a: \x00", ["c.yaml"]),
    ],
)
def test_not_yaml(text, words):
    with pytest.raises(YamlError) as error:
        parse_yaml(text, "c.yaml")
    assert len(str(error.value).splitlines()) == 1
    for word in words:
        assert word in str(error.value)


def test_times_and_words_stay_text():
    assert parse_yaml("{a: 11:00, b: no, c: on, d: 1e3, e: 010}", "x") == {
        "a": "11:00",
        "b": "no",
        "c": "on",
        "d": 1000.0,
        "e": "010",
    }


def test_unreadable_files(tmp_path):
    for path in (tmp_path / "none.yaml", tmp_path):
        with pytest.raises(UsageError):
            load(str(path))
    latin = tmp_path / "latin.yaml"
    latin.write_bytes(b"campaign: caf\xe9")
    with pytest.raises(YamlError, match="not UTF-8"):
        load_yaml(latin)


def test_shipped_campaigns_are_the_papers():
    plain = {"aeb-256", "aeb-demo", "aeb-demo-int8", "chaos-16", "lane-loop", "latency-study"}
    plain |= {"aeb-256-fusion", "aeb-ablation", "aeb-fusion", "aeb-search", "free-driving"}
    books = {"euro-ncap-2026", "fmvss-127", "un-r152", "un-r152-n1"}
    assert set(shipped()) == plain | books | {f"{book}-fusion" for book in books}
    plan = load("aeb-256")
    campaign, cases = plan.campaign, plan.cases
    assert len(cases) == len({c.id for c in cases}) == 256
    assert {c.variation.model for c in cases} == {f"{name}-w25" for name in ARCHITECTURES}
    assert {c.variation.weather for c in cases} == set(WEATHERS)
    assert sorted({c.variation.time_of_day_min for c in cases}) == [60 * h for h in range(5, 20, 2)]
    assert sorted({c.variation.batch for c in cases}) == list(range(1, 9))
    assert {c.variation.model for c in cases if c.variation.batch in (1, 2)} == {"yolov2-w25"}
    assert campaign.scenario.ego_start_m == 148
    assert campaign.control_hz == campaign.camera.hz == 20
    demo = load("aeb-demo").cases
    assert len(demo) == 8
    assert {c.id for c in demo} <= {c.id for c in cases}
    assert demo[0].variation.scenario.ego_start_m >= 60
    assert demo[0].rig.camera.noise
    assert len(load("chaos-16").cases) == 16
    lane = load("lane-loop").cases
    assert [c.variation.weather for c in lane] == ["clear", "light_rain"]
    assert {(c.variation.scenario.type, c.variation.scenario.distance_m) for c in lane} == {
        ("lane_keeping", 1000)
    }


def test_ids_do_not_depend_on_the_file():
    one = {"campaign": "c", "matrix": {"weather": ["clear", "cloudy"], "repeat": [0, 1]}}
    other = {"campaign": "c", "matrix": {"repeat": [1, 0], "weather": ["cloudy", "clear"]}}
    first, _ = parse_campaign(one)
    second, _ = parse_campaign(other)
    by_id = {c.id: c for c in expand(first)}
    assert by_id == {c.id: c for c in expand(second)}
    assert set(by_id) == {f"{w}-repeat_{r}" for w in ("clear", "cloudy") for r in (0, 1)}
    assert campaign_digest(first, expand(first)) == campaign_digest(second, expand(second))


def test_batches_are_labels_only():
    plain, _ = parse_campaign(GOOD)
    labelled, _ = parse_campaign({**GOOD, "batch": {"size": 3}})
    assert [c.variation.batch for c in expand(labelled)] == [1, 1, 1, 2]
    for a, b in zip(expand(plain), expand(labelled), strict=True):
        assert case_digest(a) == case_digest(b)


def test_exclude_and_cases():
    data = {**GOOD, "exclude": [{"weather": "clear"}], "cases": [{"weather": "light_snow"}]}
    campaign, mistakes = parse_campaign(data)
    assert not mistakes
    ids = [c.id for c in expand(campaign)]
    assert ids == ["0500-heavy_fog", "1300-heavy_fog", "light_snow"]


def test_streams_and_rigs():
    campaign, _ = parse_campaign(GOOD)
    a, b, *_ = expand(campaign)
    assert rig_key(a) == rig_key(b)
    wide = changed(a, camera=msgspec.structs.replace(a.rig.camera, width=320))
    assert rig_key(a) != rig_key(wide)
    keys = {stream_key(seed, case, s) for seed in (1, 2) for case in "ab" for s in "xy"}
    assert len(keys) == 8
    assert stream_key(1, "ab", "c") != stream_key(1, "a", "bc")


def test_one_case_of_a_campaign_is_the_same_case():
    data = {
        "campaign": "one",
        "matrix": {"weather": ["clear", "heavy_fog"], "scenario.duration_s": [2, 4]},
        "exclude": [{"weather": "clear", "scenario.duration_s": 4}],
        "cases": [{"weather": "cloudy", "repeat": 3}],
    }
    plan, mistakes = parse_plan(data)
    assert mistakes == []
    assert len(plan.cases) == 4
    for case in plan.cases:
        one = plan.only(case.id)
        assert one.cases == expand(one.campaign) == [case]
    assert plan.only("no-such") is None


def test_what_is_shown_is_no_part_of_a_case_but_of_its_rig():
    """A recorder stands beside a rig; no result depends on it."""
    data = {"schema": 1, "campaign": "c", "matrix": {"weather": ["clear"]}}
    seen = []
    for view in ({}, {"view": "record+live"}):
        campaign, mistakes = parse_campaign({**data, **view})
        assert not mistakes
        seen.append((campaign, expand(campaign)))
    (plain, cases), (recorded, recorded_cases) = seen
    assert (cases[0].rig.view, recorded_cases[0].rig.view) == ("live", "record+live")
    assert campaign_digest(plain, cases) == campaign_digest(recorded, recorded_cases)
    assert rig_key(cases[0]) != rig_key(recorded_cases[0])
    _, mistakes = parse_campaign({**data, "view": "film"})
    assert mistakes[0].path == "view"
    assert "record+live" in mistakes[0].message
    assert get_args(View) == tuple(mode.value for mode in ViewMode)


def test_what_is_kept_of_recordings_is_no_part_of_a_case_but_of_its_rig():
    data = {"schema": 1, "campaign": "c", "matrix": {"weather": ["clear"]}}
    seen = []
    for keep in ("all", "failed"):
        campaign, mistakes = parse_campaign({**data, "recording": {"keep": keep}})
        assert not mistakes
        [case] = expand(campaign)
        assert case.rig.keep == keep
        seen.append((campaign_digest(campaign, [case]), rig_key(case)))
    assert seen[0][0] == seen[1][0]
    assert seen[0][1] != seen[1][1]
    _, mistakes = parse_campaign({**data, "recording": {"keep": "some"}})
    assert mistakes[0].path == "recording.keep"
    assert "failed" in mistakes[0].message


def test_views_without_a_recorder():
    assert [mode.unrecorded for mode in ViewMode] == ["none", "live", "none", "live"]


def test_paths_of_a_container_are_absolute(tmp_path, monkeypatch):
    (tmp_path / "stack.sif").touch()
    monkeypatch.chdir(tmp_path)
    image = "{path: stack.sif, binds: [/data, ./d]}"
    path = tmp_path / "c.yaml"
    path.write_text(
        f"campaign: c\nmatrix: {{weather: [clear]}}\nautonomy: {{command: [x], image: {image}}}\n"
    )
    with pytest.raises(UsageError) as raised:
        load(str(path))
    assert [line.split(": ", 1)[1] for line in str(raised.value).splitlines()] == [
        "autonomy.image.binds[1]: given './d', allowed: an absolute path (line 3)",
        "autonomy.image.path: given 'stack.sif', allowed: an absolute path, which all workers see "
        "(line 3)",
    ]


def cases_of(**changes):
    """The cases of a good file with these keys."""
    campaign, mistakes = parse_campaign({"campaign": "c", **changes})
    assert campaign is not None, mistakes
    return expand(campaign)


def test_parameters_of_the_stack_are_axes_with_rigs_of_their_own():
    slow, fast = cases_of(
        autonomy={"parameters": {"cruise_speed_mps": 8.0, "ttc_s": 2.0}},
        matrix={"autonomy.parameters.cruise_speed_mps": [5.0, 9.5]},
    )
    assert slow.id == "parameters.cruise_speed_mps_5.0"
    assert slow.rig.parameters == {"cruise_speed_mps": 5.0, "ttc_s": 2.0}
    assert fast.rig.parameters == {"cruise_speed_mps": 9.5, "ttc_s": 2.0}
    assert rig_key(slow) != rig_key(fast), "a stack is built with its parameters"


def test_objects_of_the_scene_are_axes_that_share_a_rig():
    cases = cases_of(
        objects={"oncoming truck": {"speed_mps": 7.0}},
        matrix={
            "objects.oncoming truck.start_s": [-2, 3.5],
            "objects.stroller.offset_m": [-1.5, 1.5],
        },
    )
    assert [case.id for case in cases] == [
        "oncoming_truck.start_s_minus_2-stroller.offset_m_minus_1.5",
        "oncoming_truck.start_s_minus_2-stroller.offset_m_1.5",
        "oncoming_truck.start_s_3.5-stroller.offset_m_minus_1.5",
        "oncoming_truck.start_s_3.5-stroller.offset_m_1.5",
    ]
    assert msgspec.to_builtins(cases[0].variation.objects) == {
        "oncoming truck": {"speed_mps": 7.0, "start_s": -2.0, "offset_m": 0.0},
        "stroller": {"speed_mps": None, "start_s": None, "offset_m": -1.5},
    }
    assert len({rig_key(case) for case in cases}) == 1
    assert len({case_digest(case) for case in cases}) == 4


@pytest.mark.parametrize(
    ("axis", "value", "words"),
    [
        ("objects.walker.speed", 1, ["unknown axis", "objects.NAME.speed_mps"]),
        ("objects.speed_mps", 1, ["unknown axis"]),
        ("objects.walker.speed_mps", 0, ["given 0", "> 0 and <= 60"]),
        ("objects.walker.offset_m", "left", ["'left'", "a number"]),
        ("autonomy.parameters.", 1, ["unknown axis"]),
        ("autonomy.parameters.a b", 1, ["unknown axis"]),
        ("autonomy.parameters.a.b", 1, ["unknown axis"]),
    ],
)
def test_an_axis_of_an_object_or_a_parameter_that_cannot_be_is_one_line(axis, value, words):
    campaign, mistakes = parse_campaign({"campaign": "c", "matrix": {axis: [value]}})
    assert campaign is None
    (mistake,) = mistakes
    assert all(word in mistake.line("c.yaml") for word in words), mistake


def test_mistakes_of_all_kinds_are_told_at_once():
    """Of single keys, of keys that do not go together, of axes, and of things outside the file."""
    variant = {"type": "network", "model": "no.onnx"}
    given = {
        **copy.deepcopy(GOOD),
        "scenario": {"scene": "downtwn", "vehicle": "none"},
        "lidars": [{"name": "roof"}, {"name": "roof"}],
        "autonomy": {"stack": "devkit.aeb:AebStak", "perception": {"a": variant}},
        "exclude": [{"weather": "cloudy"}],
    }
    given["matrix"]["wheather"] = ["clear"]
    assert [mistake.path for mistake in check(given)[1]] == [
        *("matrix.wheather", "lidars", "exclude[0]", "scenario.scene", "scenario.vehicle"),
        *("autonomy.perception.a.model", "autonomy.stack"),
    ]
    two = {"scenario": {"type": "lane_keeping", "ego_start_m": 60, "false_braking_m": 5}}
    (mistake,) = check({**copy.deepcopy(GOOD), **two})[1]
    assert "ego_start_m and false_braking_m are set, but they belong" in mistake.message
