"""Values of the axes that a matrix may name, as reports show them."""

import pytest
from msgspec.structs import fields
from unit.conductor.report.synthetic_campaign import campaign_data, make_campaign, page_of

from conductor.report import write_summary
from conductor.report.reading.axes import axis_label, axis_value, varied_axes
from conductor.report.reading.dossier import open_dossier
from schemas.axes import axes_allowed
from schemas.kinds.scenario import scenario_kinds
from schemas.plan import expand, parse_campaign

VARIED = {
    "autonomy.parameters.gap_m": [12.5, 18.0],
    "objects.parked.car.offset_m": [0.0, 0.5],
    "objects.cyclist.speed_mps": [3.0, 4.0],
    "sensors.imu.hz": [10, 20],
}


def data(**changes):
    return campaign_data(matrix={"model": ["yolov3"], **VARIED}, sensors={"imu": {}}, **changes)


@pytest.mark.parametrize("family", scenario_kinds().declared, ids=lambda kind: kind.name)
def test_every_axis_that_is_allowed_has_a_value(family):
    needed = {key.name: "x" for key in fields(family.config) if key.required}
    scenario = {"type": family.name, **needed}
    given = {"campaign": "c", "scenario": scenario, "matrix": {"weather": ["clear"]}}
    campaign, mistakes = parse_campaign(given)
    assert campaign is not None, mistakes
    (case,) = expand(campaign)
    axes = axes_allowed()
    assert len(axes) > 40
    assert all(hash(axis_value(case, axis)) is not None for axis in axes)


def test_numbers_of_a_scenario_file_have_the_values_of_their_case():
    axis = "storyboard.actors.van.ahead_m"
    campaign, mistakes = parse_campaign(
        {
            "campaign": "c",
            "scenario": {"type": "storyboard", "storyboard": "x"},
            "matrix": {axis: [20, 30]},
            "cases": [{"weather": "clear"}],
        }
    )
    assert campaign is not None, mistakes
    values = [axis_value(case, axis) for case in expand(campaign)]
    assert values == [20.0, 30.0, "as in the file"]
    assert axis_label(axis) == "Actors van ahead [m]"


def test_parameters_objects_and_sensors_have_the_values_of_their_case():
    campaign, mistakes = parse_campaign(data(cases=[{"model": "yolov3"}]))
    assert campaign is not None, mistakes
    cases = expand(campaign)
    seen = [tuple(axis_value(case, axis) for axis in VARIED) for case in cases]
    assert seen[0] == (12.5, 0.0, 3.0, 10)
    assert seen[15] == (18.0, 0.5, 4.0, 20)
    assert seen[16][:3] == ("as the stack has it", 0.0, "as in the scene")


def test_a_report_shows_them(tmp_path):
    make_campaign(tmp_path, data(cases=[{"model": "yolov3"}]))
    assert varied_axes(open_dossier(tmp_path)) == list(VARIED)
    page = page_of(tmp_path)
    assert "as the stack has it" in page
    assert "as in the scene" in page
    summary = write_summary(tmp_path)
    assert summary["autonomy.parameters.gap_m"].to_pylist() == [12.5] * 8 + [18.0] * 8 + [None]


def test_values_of_several_types_are_texts_in_the_summary(tmp_path):
    matrix = {"model": ["yolov3"], "autonomy.parameters.mode": [1, 2.5, "auto", True]}
    make_campaign(tmp_path, campaign_data(matrix=matrix))
    column = write_summary(tmp_path)["autonomy.parameters.mode"].to_pylist()
    assert column == ["1", "2.5", "auto", "True"]
    assert page_of(tmp_path)


@pytest.mark.parametrize(
    ("axis", "label"),
    [
        ("autonomy.parameters.ttc_max_s", "Ttc max [s]"),
        ("objects.parked.car.offset_m", "Parked car offset [m]"),
        ("scenario.ego_start_m", "Ego start [m]"),
        ("sensors.imu.hz", "Imu hz"),
        ("storyboard.events.cross.do.target.arrive.speed_kmh", "Target arrive speed [km/h]"),
    ],
)
def test_labels_say_the_unit(axis, label):
    assert axis_label(axis) == label
