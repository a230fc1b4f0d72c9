"""What people type of objects, and what comes of it."""

from __future__ import annotations

import math

import pytest

from schemas.object_settings import object_actions, split_objects
from schemas.settings import parse_words
from schemas.wire.interventions import Action, FreeObject, MoveObject, ObjectState, RemoveObject

OBJECTS = [
    ObjectState(0, "van", True, 10.0, -2.0, math.pi / 2, False, "van"),
    ObjectState(1, "car", True, 30.0, -2.0, 0.0, False, "parked car"),
    ObjectState(2, "car", True, 40.0, -2.0, 0.0, False, "twin"),
    ObjectState(3, "car", True, 50.0, -2.0, 0.0, False, "twin"),
]


def actions(words: list[str]) -> list[Action]:
    return object_actions(split_objects(parse_words(words))[1], OBJECTS)


def test_what_is_not_said_stays_where_it_is() -> None:
    assert actions(["object.van.x_m=12.5", "object.van.speed_mps=4"]) == [
        MoveObject(0, 12.5, -2.0, yaw_rad=math.pi / 2, speed_mps=4.0)
    ]
    assert actions(["object.1.yaw_deg=180"]) == [MoveObject(1, 30.0, -2.0, yaw_rad=math.pi)]


def test_objects_go_and_come_back_by_name_or_number() -> None:
    words = ["object.parked car=away", "object.van=free", "object.3=free"]
    assert actions(words) == [RemoveObject(1), FreeObject(0), FreeObject(3)]


def test_other_settings_are_left() -> None:
    words = ["weather=clear", "object.van.y_m=1", "x_m=3"]
    rest, objects = split_objects(parse_words(words))
    assert rest == {"weather": "clear", "x_m": "3"}
    assert objects == {"van": {"y_m": "1"}}


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["object.van.colour=red"], "given 'object.van.colour=red', expected object.NAME.x_m="),
        (["object.van=stop"], "given 'object.van=stop', expected object.NAME.x_m="),
        (["object.=3"], "given 'object.=3', expected object.NAME.x_m="),
        (["object.lorry.x_m=3"], "object 'lorry': not in this case; allowed: van, parked car"),
        (["object.vam.x_m=3"], "object 'vam': not in this case; did you mean 'van'?"),
        (["object.twin.x_m=3"], "object 'twin': several have that name; give a number: 2, 3"),
        (["object.9=free"], "object '9': not in this case"),
        (["object.van.x_m=near"], "object.van.x_m: given 'near', expected a number"),
        (["object.van.x_m=inf"], "object.van.x_m: given inf, expected a finite number"),
        (["object.van.speed_mps=101"], "object.van.speed_mps: given 101"),
        (["object.van=free", "object.van.x_m=3"], "object 'van': free takes no numbers"),
    ],
)
def test_mistakes_are_one_line(words: list[str], line: str) -> None:
    with pytest.raises(ValueError) as refused:
        actions(words)
    assert str(refused.value).startswith(line)
    assert "\n" not in str(refused.value)


def test_nothing_moves_in_some_cases() -> None:
    with pytest.raises(ValueError, match="object 'van': nothing moves in this case"):
        object_actions({"van": {"x_m": "1"}}, [])
