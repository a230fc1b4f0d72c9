"""Scores of detections on labelled images: groups, recalls and tables, by hand."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from detection_rows import detections_of

from devkit.detector.labelled_images import (
    NO_CLASS,
    DetectorClass,
    LabelledImages,
    classes_for,
    parse_classes,
)
from devkit.detector.score_tables import failures, joint_table, merit_line, recall_tables, report
from devkit.detector.scoring import (
    NIGHT,
    Scorecard,
    block_of,
    joined,
    plain,
    renamed,
    score,
    shifted,
)
from twin.base.errors import UsageError

NAMES = ("car", "pedestrian")

found = partial(detections_of, NAMES)

CLEAR_NOON, FOG, NIGHT_CLEAR = (12.5, "clear"), (13.9, "light_fog"), (1.0, "clear")


def images(conditions, rows) -> LabelledImages:
    """Rows (image, class, x, y, width, height, ignored, visibility, distance, truncation)."""
    rows = [(*row, 0.0) if len(row) == 9 else row for row in rows]
    data = np.array(rows, np.float64).reshape(-1, 10)
    count = len(conditions)
    return LabelledImages(
        names=NAMES,
        paths=tuple(Path(f"{n}.jpg") for n in range(count)),
        size_px=np.tile([320, 192], (count, 1)),
        hour=np.array([hour for hour, _ in conditions], float),
        weather=tuple(weather for _, weather in conditions),
        image=data[:, 0].astype(int),
        class_id=data[:, 1].astype(int),
        box_px=data[:, 2:6],
        ignored=data[:, 6].astype(bool),
        visibility=data[:, 7],
        truncation=data[:, 9],
        distance_m=data[:, 8],
    )


BOX, FAR, SMALL = (10, 10, 40, 30), (200, 50, 40, 30), (100, 90, 8, 6)


@pytest.fixture
def card() -> Scorecard:
    """Three images: the car is found at noon, missed in fog, and a person at night is found."""
    data = images(
        [CLEAR_NOON, FOG, NIGHT_CLEAR],
        [
            (0, 0, *BOX, 0, 1.0, 8.0),
            (0, 0, *SMALL, 0, 0.6, 70.0),
            (1, 0, *BOX, 0, 1.0, 25.0),
            (2, 1, *FAR, 0, 0.8, 12.0),
            (2, NO_CLASS, *BOX, 1, 1.0, 9.0),
        ],
    )
    detections = found(
        (0, 0, 0.9, *BOX), (0, 0, 0.1, *SMALL), (1, 1, 0.8, *BOX), (2, 1, 0.7, *FAR),
        (2, 0, 0.6, *BOX), (2, 1, 0.6, *BOX),
    )  # fmt: skip
    return score(data, detections)


def test_groups_by_hour_weather_and_both(card):
    groups = card.evaluation.groups
    assert sorted(groups) == ["block", "hour", "joint", "weather"]
    assert sorted(groups["hour"]) == ["01", "13", "14"]  # 12:30 is nearest to 13
    assert groups["weather"]["clear"].classes["car"].ap == pytest.approx(1.0)
    assert groups["weather"]["light_fog"].classes["car"].ap == 0.0
    assert groups["joint"]["13 light_fog"].images == 1
    assert groups["joint"][f"{NIGHT} clear"].classes["car"].ap is None


def test_the_figure_of_merit(card):
    assert card.noon_images == 1
    assert (card.noon.ap, card.noon.truths) == (pytest.approx(1.0), 2)
    assert "100.0 (2 objects in 1 images)" in merit_line(card)
    nobody = score(images([FOG], [(0, 0, *BOX, 0, 1.0, 8.0)]), found())
    assert nobody.noon is None
    assert plain(nobody)["car_clear_noon"] == {
        "ap": None, "objects": 0, "detections": 0, "images": 0
    }  # fmt: skip
    assert "no such object" in merit_line(nobody)


@pytest.mark.parametrize(
    ("hour", "weather", "counts"),
    [(11.0, "clear", 1), (13.99, "clear", 1), (14.0, "clear", 0), (10.99, "clear", 0),
     (12.0, "cloudy", 0)],
)  # fmt: skip
def test_what_clear_noon_is(hour, weather, counts):
    assert score(images([(hour, weather)], []), found()).noon_images == counts


@pytest.mark.parametrize(
    ("hour", "block"),
    [(3.99, NIGHT), (4.0, "05"), (5.99, "05"), (12.0, "13"), (19.99, "19"), (20.0, NIGHT),
     (0.0, NIGHT), (23.99, NIGHT)],
)  # fmt: skip
def test_blocks_of_hours(hour, block):
    assert block_of(hour) == block


def test_a_box_of_no_class_is_ignored_in_every_class(card):
    classes = card.evaluation.all.classes
    # The two boxes on the cyclist count neither way; the person seen in the fog's car does.
    assert (classes["car"].truths, classes["car"].detections) == (3, 2)
    assert (classes["pedestrian"].truths, classes["pedestrian"].detections) == (1, 2)


def test_large_and_visible_objects_alone(card):
    # The car 30 px high at noon and in fog, the person; not the one of 6 px.
    assert card.moderate.classes["car"].truths == 2
    assert card.moderate.classes["car"].ap == pytest.approx(0.5)
    assert (card.noon_moderate.truths, card.noon_moderate.ap) == (1, pytest.approx(1.0))
    assert plain(card)["moderate"]["car_clear_noon"]["objects"] == 1
    assert "car 50.0 of 2, pedestrian" in report(card)
    assert "car at clear noon 100.0 of 1" in report(card)


@pytest.mark.parametrize(
    ("height", "visibility", "truncation", "counts"),
    [(12.8, 0.5, 0.3, True), (12.7, 1.0, 0.0, False), (40, 0.49, 0.0, False),
     (40, 1.0, 0.31, False)],
)  # fmt: skip
def test_what_is_moderate(height, visibility, truncation, counts):
    data = images([FOG], [(0, 0, 5, 5, 9, height, 0, visibility, 9.0, truncation)])
    assert data.moderate.tolist() == [counts]
    ignored = images([FOG], [(0, 0, 5, 5, 9, height, 1, visibility, 9.0, truncation)])
    assert not ignored.moderate.any()


def test_recalls_are_of_what_is_reported(card):
    sizes, distances = card.recalls["size_px"], card.recalls["distance_m"]
    # The small car was seen with a confidence of 0.1, which is not reported.
    assert (sizes["8 to 12"]["car"].found, sizes["8 to 12"]["car"].objects) == (0, 1)
    assert (sizes["32 to 48"]["car"].found, sizes["32 to 48"]["car"].objects) == (1, 2)
    assert (distances["10 to 20"]["pedestrian"].found) == 1
    assert card.recalls["visibility"]["0.5 to 0.75"]["car"].objects == 1
    total = sum(f.objects for group in sizes.values() for f in group.values())
    assert total == 4


def test_tables_say_how_much_they_rest_on(card):
    text = joint_table(card)
    assert "| car: hours | clear | light_fog |" in text
    assert "| 12:00 to 13:59 | (100) | (0) |" in text
    assert "| 20:00 to 3:59 | - | - |" in text
    assert "fewer than 20" in text
    assert "| 8 to 12 | 0 % | - |" in recall_tables(card)
    assert merit_line(card) in report(card)


def test_failures_name_what_is_lost_and_nothing_that_rests_on_little(card):
    assert failures(card) == []
    data = images(
        [CLEAR_NOON, FOG],
        [(n, 0, 10 * k, 10, 8, 6, 0, 1.0, 50.0) for n in (0, 1) for k in range(20)],
    )
    seen = found(*[(0, 0, 0.9, 10 * k, 10, 8, 6) for k in range(19)])
    sentences = failures(score(data, seen))
    assert any("12:00 to 13:59 light_fog 0.0" in s for s in sentences)
    assert any("By weather, mAP falls from 95.0 (clear) to 0.0 (light_fog)" in s for s in sentences)
    assert any("car 8 to 12 px long (48 % of 40)" in s for s in sentences)


def test_parts_of_detections():
    first, second = found((0, 0, 0.9, *BOX)), shifted(found((0, 1, 0.8, *FAR)), 3)
    both = joined([first, second])
    assert both.image.tolist() == [0, 3]
    only = renamed(both, ("pedestrian",))
    assert (only.names, only.image.tolist(), only.class_id.tolist()) == (("pedestrian",), [3], [0])


# --- classes --------------------------------------------------------------------------------------


def test_classes_and_their_categories():
    assert parse_classes("car, truck=truck+bus") == (
        DetectorClass("car", ("car",)),
        DetectorClass("truck", ("truck", "bus")),
    )
    for text in ("", "car,", "=car", "car,car", "car,truck=car+bus", "a=b+"):
        with pytest.raises(UsageError, match="classes"):
            parse_classes(text)


def test_classes_of_a_detector():
    named = {one.label: one.categories for one in classes_for(("truck", "dog"), None, "m")}
    assert named == {"truck": ("truck", "bus")}
    both = {one.label: one.categories for one in classes_for(("truck", "bus"), None, "m")}
    assert both == {"truck": ("truck",), "bus": ("bus",)}
    coco = classes_for(("person", "car"), "person=pedestrian", "m")
    assert coco == (DetectorClass("person", ("pedestrian",)),)
    with pytest.raises(UsageError, match=r"m: no class 'cat'; .*allowed: person, car"):
        classes_for(("person", "car"), "cat", "m")
    with pytest.raises(UsageError, match="none of its classes is a category"):
        classes_for(("person",), None, "m")
