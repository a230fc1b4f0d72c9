"""Rows of sensors that see, as points of a recording."""

import msgspec
import numpy as np
import pytest
from test_viewer_convert import only, paths, values
from view_messages import STAGE, start, state

from schemas.kinds.point_look import colors, places
from schemas.kinds.sensor import sensor_kinds
from schemas.wire.view import RowsSite
from viewer.recording import naming
from viewer.recording.blueprint import case_blueprint
from viewer.recording.convert import CaseConverter
from viewer.recording.scenery import BLUE, GREY, RED, rotation

KIND = sensor_kinds().find("radar")
SITE = RowsSite(list(KIND.columns), KIND.points, [3.7, 0.9, 0.5], [0.0, 0.0, 45.0])
PATH = naming.sensor("radar")


def detection(range_m, azimuth_rad=0.0, elevation_rad=0.0, speed_mps=0.0):
    return [range_m, azimuth_rad, elevation_rad, speed_mps, 10.0, 30.0]


def shown(*samples):
    return values(CaseConverter(start(rows={"radar": SITE})).states(samples))[PATH]


def test_a_radar_sits_where_it_is_mounted():
    logged = [a for p, a in CaseConverter(start(rows={"radar": SITE})).start() if p == PATH]
    mount = logged[0]
    assert mount.translation.as_arrow_array().to_pylist()[0] == pytest.approx(SITE.position_m)
    turn = np.array(mount.mat3x3.as_arrow_array().to_pylist()).reshape(3, 3).T
    assert turn == pytest.approx(rotation([0.0, 0.0, 45.0]))
    assert PATH not in paths(CaseConverter(start()).start())


def test_detections_are_points_in_the_axes_of_the_sensor():
    up = np.radians(30.0)
    found = shown(
        state(0, 0, rows={"radar": [detection(10.0), detection(20.0, np.pi / 2)]}),
        state(1, 1),
        state(2, 2, rows={"radar": [detection(2.0, 0.0, up)]}),
        state(3, 3, rows={"radar": []}),
    )
    assert [len(row) for row in found["positions"]] == [2, 1, 0], "a tick without a reading is none"
    assert found["positions"][0] == pytest.approx(np.array([[10, 0, 0], [0, 20, 0]]), abs=1e-5)
    assert found["positions"][1] == pytest.approx(np.array([[2 * np.cos(up), 0, 1]]), abs=1e-5)


def test_a_point_says_its_row_and_no_label_stands_in_the_picture():
    found = shown(state(0, 0, rows={"radar": [detection(10.0, speed_mps=-3.25)]}))
    assert found["labels"][0] == [
        "range_m 10.00, azimuth_rad 0.00, elevation_rad 0.00, radial_speed_mps -3.25, "
        "rcs_dbsm 10.00, snr_db 30.00"
    ]
    style = [a for p, a in CaseConverter(start(rows={"radar": SITE})).start() if p == PATH][1]
    assert style.show_labels.as_arrow_array().to_pylist() == [False]


def test_the_colour_is_the_radial_speed():
    speeds = {"radial_speed_mps": np.array([-99.0, -15.0, 0.0, 7.5, 15.0])}
    half = np.rint((np.array(GREY, float) + BLUE) / 2).astype(int).tolist()
    expected = [RED, RED, GREY, tuple(half), BLUE]
    assert [tuple(row) for row in colors(KIND.points, speeds).tolist()] == expected


def test_rows_without_an_elevation_lie_level():
    look = msgspec.structs.replace(KIND.points, elevation_rad="")
    named = {"range_m": np.array([3.0]), "azimuth_rad": np.array([np.pi / 2])}
    assert places(look, named) == pytest.approx(np.array([[0.0, 3.0, 0.0]]), abs=1e-12)


def test_rows_of_another_width_are_left_out():
    converter = CaseConverter(start(rows={"radar": SITE}))
    rows = converter.states([state(0, 0, rows={"radar": [[1.0, 2.0]], "other": [[1.0]]})])
    assert PATH not in [entity.path for entity in rows]


def test_messages_without_rows_are_those_of_earlier_releases():
    assert CaseConverter(start()).start()
    sample = msgspec.structs.replace(state(0, 0), rows={})
    assert PATH not in [entity.path for entity in CaseConverter(start()).states([sample])]
    assert only(CaseConverter(start()).start(), naming.EGO_BODY)


def test_a_case_with_a_radar_has_a_view_from_above():
    def names(part):
        inner = getattr(part, "contents", [])
        own = [part.name] if getattr(part, "class_identifier", "") == "3D" else []
        children = [] if own else [name for child in inner for name in names(child)]
        return own + children

    assert names(case_blueprint(STAGE).root_container) == ["Street"]
    both = names(case_blueprint(STAGE, rows=["radar"]).root_container)
    assert both == ["Street", "Radar from above"]


def test_a_case_with_a_grid_has_its_picture_beside_the_cameras():
    def origins(part):
        inner = getattr(part, "contents", [])
        own = [part.origin] if getattr(part, "class_identifier", "") == "2D" else []
        return own or [origin for child in inner for origin in origins(child)]

    plain = origins(case_blueprint(STAGE).root_container)
    both = origins(case_blueprint(STAGE, grids=["radar_cube"]).root_container)
    assert both == [*plain, naming.grid("radar_cube")]
