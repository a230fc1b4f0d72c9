"""Environments, lamps and states of signals in OpenSCENARIO files."""

from __future__ import annotations

import datetime

import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from compiled_text import compiled, scenario_text

from twin.scenario.storyboard.program.actions import LIGHTS, LampMode, LightAction
from twin.scenario.storyboard.program.program import StoryboardEnvironment
from twin.world.sky.weather import WEATHER


def of_environment(folder, body: str) -> StoryboardEnvironment:
    result = compiled(folder, with_environment(body))
    assert result.notes == ()
    return result.program.environments[0]


def with_environment(body: str) -> str:
    return scenario_text(
        action='<GlobalAction><EnvironmentAction><Environment name="e">'
        f"{body}</Environment></EnvironmentAction></GlobalAction>"
    )


def with_light(kind: str, state: str, more: str = "") -> str:
    return scenario_text(
        action=f"<PrivateAction><AppearanceAction><LightStateAction{more}><LightType>"
        f'<VehicleLight vehicleLightType="{kind}"/></LightType><LightState {state}/>'
        "</LightStateAction></AppearanceAction></PrivateAction>"
    )


def light_of(result) -> LightAction:
    return next(
        element.action
        for element in result.program.elements
        if isinstance(element.action, LightAction)
    )


@pytest.mark.parametrize(
    ("body", "values"),
    [
        (
            '<Weather fractionalCloudCover="sixOktas"><Sun azimuth="1" elevation="0.5" '
            'illuminance="900"/><Fog visualRange="80"/><Wind direction="2" speed="7"/></Weather>',
            {
                "cloud_fraction": 0.75,
                "sun_azimuth_rad": 1.0,
                "sun_elevation_rad": 0.5,
                "sun_illuminance_lx": 900.0,
                "fog_visual_range_m": 80.0,
                "wind_direction_rad": 2.0,
                "wind_speed_mps": 7.0,
                "rain_mm_per_h": None,
            },
        ),
        (
            '<Weather cloudState="overcast"><Precipitation precipitationType="rain" '
            'precipitationIntensity="4"/></Weather>',
            {"cloud_fraction": 1.0, "rain_mm_per_h": 4.0, "snow_mm_per_h": 0.0},
        ),
        (
            '<Weather><Precipitation precipitationType="snow" precipitationIntensity="2"/>'
            "</Weather>",
            {"cloud_fraction": None, "rain_mm_per_h": 0.0, "snow_mm_per_h": 2.0},
        ),
        (
            '<Weather><Precipitation precipitationType="dry" precipitationIntensity="0"/>'
            "</Weather>",
            {"rain_mm_per_h": 0.0, "snow_mm_per_h": 0.0},
        ),
        (
            '<RoadCondition frictionScaleFactor="0.6" wetness="wetWithPuddles"/>',
            {"friction_factor": 0.6, "water_mm": 1.0},
        ),
        ('<Weather><Fog visualRange="INF"/></Weather>', {"fog_visual_range_m": 1e6}),
    ],
)
def test_values_of_an_environment(tmp_path, body, values):
    environment = of_environment(tmp_path, body)
    for name, value in values.items():
        assert getattr(environment, name) == value, name


def test_precipitation_of_version_1_0_is_a_share(tmp_path):
    for kind, field, heavy in (
        ("rain", "rain_mm_per_h", WEATHER["heavy_rain"].rain_mm_per_h),
        ("snow", "snow_mm_per_h", WEATHER["heavy_snow"].snow_mm_per_h),
    ):
        body = f'<Weather><Precipitation precipitationType="{kind}" intensity="1"/></Weather>'
        environment = of_environment(tmp_path, body)
        assert getattr(environment, field) == pytest.approx(heavy)


def test_a_clock_shows_the_hour_of_its_own_zone(tmp_path):
    body = '<TimeOfDay animation="false" dateTime="2026-07-01T22:30:00{}"/>'
    shown = datetime.datetime(2026, 7, 1, 22, 30, tzinfo=datetime.UTC).timestamp()
    here = of_environment(tmp_path, body.format(""))
    there = of_environment(tmp_path, body.format("+02:00"))
    assert (here.clock_s, here.time_of_day_s) == (shown, shown)
    assert (there.clock_s, there.time_of_day_s) == (shown, shown - 7200.0)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (
            '<Weather><Fog visualRange="-1"/></Weather>',
            "fog visual range m is -1, allowed: 0 to 1e+06",
        ),
        (
            '<Weather><Precipitation precipitationType="rain" precipitationIntensity="2000"/>'
            "</Weather>",
            "rain mm per h is 2000, allowed: 0 to 1000",
        ),
        (
            '<Weather><Sun azimuth="1" elevation="66" illuminance="9"/></Weather>',
            "sun elevation rad is 66, allowed: -1.5708 to 1.5708",
        ),
        (
            '<Weather><Wind direction="0" speed="400"/></Weather>',
            "wind speed mps is 400, allowed: 0 to 150",
        ),
        (
            '<RoadCondition frictionScaleFactor="-0.5"/>',
            "friction factor is -0.5, allowed: 0 to 100",
        ),
    ],
)
def test_values_that_no_weather_has_are_refused(tmp_path, body, words):
    with pytest.raises(ValueError, match=r"s\.xosc:\d+: Environment") as refused:
        compiled(tmp_path, with_environment(body))
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ('<Weather temperature="280"/>', "nothing freezes or melts"),
        ('<Weather atmosphericPressure="100000"/>', "the air is as dense as ever"),
        (
            '<Weather><Fog visualRange="9"><BoundingBox><Center x="0" y="0" z="0"/><Dimensions '
            'width="1" length="1" height="1"/></BoundingBox></Fog></Weather>',
            "the fog is everywhere",
        ),
    ],
)
def test_what_has_no_effect_is_noted(tmp_path, body, words):
    notes = compiled(tmp_path, with_environment(body)).notes
    assert [note for note in notes if words in note]


@pytest.mark.parametrize(
    ("state", "mode", "times"),
    [
        ('mode="on"', LampMode.ON, (0.5, 0.5)),
        ('mode="off"', LampMode.OFF, (0.5, 0.5)),
        (
            'mode="flashing" flashingOnDuration="0.2" flashingOffDuration="0.7"',
            *(LampMode.FLASHING, (0.2, 0.7)),
        ),
    ],
)
def test_modes_of_lamps(tmp_path, state, mode, times):
    result = compiled(tmp_path, with_light("fogLightsRear", state))
    action = light_of(result)
    assert (LIGHTS[action.light], action.mode) == ("fogLightsRear", mode)
    assert (action.on_s, action.off_s) == times
    assert result.notes == ()


def test_lamps_that_no_body_has_are_noted(tmp_path):
    result = compiled(tmp_path, with_light("specialPurposeLights", 'mode="on"'))
    assert light_of(result).mode == LampMode.ON
    (note,) = result.notes
    assert "bodies have no specialPurposeLights" in note
    (note,) = compiled(tmp_path, with_light("lowBeam", 'mode="on"', ' transitionTime="1"')).notes
    assert "lamps change at once" in note


@pytest.mark.parametrize(("state", "known"), [("green", True), ("on;off;off", True), ("x", False)])
def test_states_of_signals_that_pictures_do_not_know_are_noted(tmp_path, state, known):
    result = compiled(
        tmp_path,
        scenario_text(
            action="<GlobalAction><InfrastructureAction><TrafficSignalAction>"
            f'<TrafficSignalStateAction name="light" state="{state}"/></TrafficSignalAction>'
            "</InfrastructureAction></GlobalAction>"
        ),
    )
    assert (result.notes == ()) == known
    if not known:
        assert "pictures do not know the state 'x'" in result.notes[0]
