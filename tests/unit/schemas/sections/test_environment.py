"""The section ``environment``: custom weathers on the axis, a timeline in order, clear mistakes."""

import msgspec
import pytest

from schemas.case import Variation
from schemas.names import minutes
from schemas.plan import parse_plan
from schemas.sections.environment import Environment

DRIZZLE = {"drizzle": {"rain": 0.2, "fog": 0.1, "wind": 0.4}}


def parse(environment, weather=("clear",), **axes):
    matrix = {"weather": list(weather), **axes}
    return parse_plan({"campaign": "c", "environment": environment, "matrix": matrix})


def test_campaigns_without_the_section_have_its_defaults():
    plan, mistakes = parse_plan({"campaign": "c", "matrix": {"weather": ["clear"]}})
    assert mistakes == []
    cases = plan.cases
    assert cases[0].variation.environment == Environment()
    plain = msgspec.to_builtins(cases[0].variation)
    del plain["environment"]
    assert msgspec.convert(plain, Variation) == cases[0].variation


def test_custom_weathers_and_fields_are_axes():
    plan, mistakes = parse(
        {"custom": DRIZZLE},
        ("clear", "drizzle"),
        **{"environment.family": ["physical", "autodrive"], "environment.exposure_ev100": [12]},
    )
    assert mistakes == []
    cases = plan.cases
    assert [c.id for c in cases][2] == "drizzle-exposure_ev100_12-family_physical"
    assert {(c.variation.weather, c.variation.environment.family) for c in cases} == {
        (w, f) for w in ("clear", "drizzle") for f in ("physical", "autodrive")
    }


@pytest.mark.parametrize(
    ("environment", "weather", "path", "words"),
    [
        ({"custom": DRIZZLE}, "drizle", "matrix.weather", ["'drizle'", "did you mean 'drizzle'?"]),
        ({"custom": {"clear": {}}}, "clear", "environment.custom.clear", ["choose another"]),
        ({"custom": {"a": {"rain": 2}}}, "a", "environment.custom.a.rain", ["2", "<= 1"]),
        ({"custom": {"a": {"hail": 1}}}, "a", "environment.custom.a.hail", ["unknown key"]),
        ({"date": "2025-02-30"}, "clear", "environment", ["2025-02-30", "YYYY-MM-DD"]),
        ({"date": "1812-02-20"}, "clear", "environment", ["1950 to 2100"]),
        ({"timeline": [{"at_s": 1}]}, "clear", "environment.timeline[0]", ["nothing changes"]),
        (
            {"timeline": [{"at_s": 1, "weather": "fogg"}]},
            "clear",
            "environment.timeline[0].weather",
            ["'fogg'", "light_fog"],
        ),
        (
            {
                "timeline": [
                    {"at_s": 1, "over_s": 4, "weather": "cloudy"},
                    {"at_s": 3, "time_of_day": "20:00"},
                    {"at_s": 4, "weather": "clear"},
                ]
            },
            "clear",
            "environment.timeline[2].at_s",
            ["given 4", "ends at 5"],
        ),
    ],
)
def test_mistakes_name_place_and_what_is_allowed(environment, weather, path, words):
    plan, mistakes = parse(environment, (weather,))
    assert plan is None
    assert [m.path for m in mistakes] == [path]
    for word in words:
        assert word in mistakes[0].message
    assert "\n" not in mistakes[0].line("f")


def test_custom_and_timeline_are_no_axes():
    _, mistakes = parse({}, **{"environment.timeline": ["x"]})
    assert [m.path for m in mistakes] == ["matrix.environment.timeline"]


def test_minutes_of_a_time():
    assert [minutes(t) for t in ("00:00", "06:05", "23:59")] == [0, 365, 1439]


def test_a_change_may_begin_when_the_one_before_ends():
    timeline = [
        {"at_s": 1.0, "over_s": 2.0, "weather": "heavy_fog"},
        {"at_s": 3.0, "weather": "clear"},
    ]
    plan, mistakes = parse({"timeline": timeline})
    assert mistakes == []
    assert [change.at_s for change in plan.cases[0].variation.environment.timeline] == [1.0, 3.0]
    timeline[1]["at_s"] = 2.999
    assert len(parse({"timeline": timeline})[1]) == 1
