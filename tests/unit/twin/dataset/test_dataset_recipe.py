"""Recipes, rules and splits of datasets: exact limits, and who may appear where."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from twin.base.errors import UsageError
from twin.dataset.images.cameras import eyes_of
from twin.dataset.images.cast import PAINT_DISTANCE, streets_of
from twin.dataset.images.shot import plan_shot, where
from twin.dataset.images.traffic import PLACES, half_extent_m
from twin.dataset.labels import SeenObject, ignored_for
from twin.dataset.recipe import SPLITS, DatasetRecipe, Rules, Shares, parse_recipe
from twin.vehicle.vehicle_file import load_vehicle

RECIPE = DatasetRecipe(seed=9)
RULES = Rules()
GOOD = SeenObject(
    class_index=0,
    look="",
    instance=3,
    box=(10, 10, 8, 6),
    full_box=(10, 10, 8, 6),
    visible_px=40,
    unoccluded_px=40,
    truncation=0.0,
    distance_m=20.0,
    contrast=30.0,
)


@pytest.fixture(scope="module")
def streets():
    return {split: streets_of(RECIPE, split) for split in SPLITS}


@pytest.mark.parametrize(
    ("count", "shares", "expected"),
    [
        (1000, (0.8, 0.1, 0.1), (800, 100, 100)),
        (7, (0.8, 0.1, 0.1), (5, 1, 1)),
        (1, (0.8, 0.1, 0.1), (1, 0, 0)),
        (10, (1.0, 0.0, 0.0), (10, 0, 0)),
        (3, (0.5, 0.25, 0.25), (1, 1, 1)),
    ],
)
def test_counts_add_up(count, shares, expected):
    found = DatasetRecipe(count=count, split_shares=Shares(*shares)).counts()
    assert tuple(found.values()) == expected
    assert sum(found.values()) == count


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({"count": 0}, "count"),
        ({"colour": 1}, "colour"),
        ({"format": "bmp"}, "format"),
        ({"rules": {"size_min": 1}}, "size_min"),
        ({"split_shares": {"train": 0.5, "held_out": 0.1, "other_scene": 0.1}}, "add up to 1"),
        ({"scene": "crossing"}, "other_scene"),
    ],
)
def test_mistakes_are_one_line_that_names_the_key(data, said):
    with pytest.raises(UsageError) as caught:
        parse_recipe(data, "dataset")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_recipe_survives_being_written():
    assert parse_recipe(msgspec.to_builtins(RECIPE), "x") == RECIPE


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"visible_px": RULES.visible_px_min - 1, "unoccluded_px": 24}, "small"),
        ({"box": (0, 0, RULES.long_side_px_min - 1, 6)}, "small"),
        ({"box": (0, 0, 8, RULES.short_side_px_min - 1)}, "small"),
        ({"unoccluded_px": 101}, "hidden"),
        ({"truncation": RULES.truncation_max + 0.001}, "truncated"),
        ({"distance_m": 3001.0}, "air"),
        ({"behind": True}, "behind"),
        ({"contrast": RULES.contrast_min - 0.01}, "contrast"),
    ],
)
def test_beyond_a_limit_a_box_is_ignored(change, reason):
    assert ignored_for(replace(GOOD, **change), RULES, 0.001) == [reason]


@pytest.mark.parametrize(
    "change",
    [
        {"visible_px": RULES.visible_px_min, "unoccluded_px": 24},
        {"box": (0, 0, RULES.long_side_px_min, RULES.short_side_px_min)},
        {"unoccluded_px": 100},
        {"truncation": RULES.truncation_max},
        {"distance_m": 2995.0},
        {"contrast": RULES.contrast_min},
    ],
)
def test_at_the_limit_a_box_is_a_label(change):
    assert ignored_for(replace(GOOD, **change), RULES, 0.001) == []


def test_splits_share_no_place_and_no_look(streets):
    places = {s: {street.name for street in own} for s, own in streets.items()}
    seeds = {
        s: {(street.scene.scene, street.scene.seed) for street in own} for s, own in streets.items()
    }
    looks = {
        s: {look.name for street in own for look in (*street.cast, street.obstacle)}
        for s, own in streets.items()
    }
    for found in (places, seeds):
        assert sum(len(names) for names in found.values()) == len(set.union(*found.values()))
    for split in ("held_out", "other_scene"):
        assert not looks["train"] & looks[split]
    assert {street.scene.scene for street in streets["other_scene"]} == {"crossing"}
    assert {street.scene.scene for street in streets["train"]} == {"downtown"}


def test_vehicles_outside_training_are_painted_differently(streets):
    def paints(split):
        found = {}
        for street in streets[split]:
            for look in (*street.cast, street.obstacle):
                if look.kind not in ("pedestrian", "cyclist"):
                    found.setdefault(look.body, []).append(np.sqrt(look.color))
        return found

    known = paints("train")
    compared = 0
    for split in ("held_out", "other_scene"):
        for body, colors in paints(split).items():
            for color in colors:
                apart = np.linalg.norm(np.array(known[body]) - color, axis=1).min()
                assert apart >= PAINT_DISTANCE
                compared += 1
    assert compared > 30


def test_shots_depend_on_their_number_alone(streets):
    vehicle = load_vehicle("opencav")
    more = msgspec.structs.replace(RECIPE, count=5000)
    for index in (0, 7, 31):
        first = plan_shot(RECIPE, vehicle, streets["train"], "train", index)
        assert first == plan_shot(more, vehicle, streets["train"], "train", index)
        assert (first.street, first.eye) == where(RECIPE, "train", index)
    other = msgspec.structs.replace(RECIPE, seed=10)
    assert plan_shot(other, vehicle, streets["train"], "train", 0) != plan_shot(
        RECIPE, vehicle, streets["train"], "train", 0
    )


def test_nobody_stands_in_anybody(streets):
    vehicle = load_vehicle("opencav")
    pairs = people = 0
    for index in range(60):
        shot = plan_shot(RECIPE, vehicle, streets["train"], "train", index)
        cast = streets["train"][shot.street].cast
        assert all(
            sum(p.class_name == name for p in shot.placed) <= most for name, most in PLACES.items()
        )
        for k, a in enumerate(shot.placed):
            people += a.class_name == "pedestrian"
            for b in shot.placed[:k]:
                near = np.hypot(a.x_m - b.x_m, a.y_m - b.y_m)
                least = sum(min(half_extent_m(cast[p.look])) for p in (a, b))
                assert near >= least
                pairs += 1
    assert pairs > 1000
    assert people > 60


def test_the_first_camera_is_the_vehicles_own_and_others_differ():
    vehicle = load_vehicle("opencav")
    eyes = eyes_of(RECIPE, vehicle)
    assert eyes[0].mount == vehicle.camera("front_right")
    assert eyes[0].camera.hfov_deg == 70.0
    assert {eye.mount.lens.model for eye in eyes} == {"pinhole", "brown_conrady", "fisheye"}
    assert len({eye.name for eye in eyes}) == len(eyes)
    assert any("motion_blur" in eye.camera.active_effects() for eye in eyes)
