"""Reasons, columns and scalars name what was hit and what was near, whatever it is."""

from dataclasses import replace

import numpy as np
import pytest
from unit.twin.rig.test_engine import ask, case, run

from twin.rig import engine as engine_module
from twin.rig.engine import Engine
from twin.world.scene import load_scene
from twin.world.street.build import build_world
from twin.world.things import Thing, named

WALKER = """
scene: walker
obstacle: {x_m: 190.0}
bake: false
furniture: {parked_cars: 0.0, tree_spacing_m: 100, lamp_spacing_m: 100}
objects:
  - kind: van
    waypoints: [[100.0, 3.5]]
  - kind: pedestrian
    name: steps into the road
    waypoints: [[140.0, -6.0], [140.0, 6.0]]
    speed_mps: 1.4
"""


@pytest.fixture
def walker(tmp_path):
    path = tmp_path / "walker.yaml"
    path.write_text(WALKER)
    return str(path)


def roll(engine, slot):
    return ask(engine, slot)


def ended(scene, policy=roll, slots=1, slot=0, **scenario):
    one = case(scene=scene, **scenario)
    engine = Engine(one, slots)
    finished = run(engine, {slot: one}, policy)["a"][0]
    engine.close()
    return finished


# The walker is in the ego's lane, 50 m before the obstacle, from 3.2 s to 5.4 s.
MEETS = {"ego_start_m": 75.0, "ego_speed_mps": 6.5, "duration_s": 8.0}


def test_a_pedestrian_that_is_hit_is_named_and_was_at_no_distance(walker):
    finished = ended(walker, **MEETS)
    assert finished.verdict == "collision"
    assert "with 'steps into the road' (pedestrian)" in finished.reasons[0]
    names, scalars = finished.names, finished.scalars
    assert names["hit_object"] == names["nearest_object"] == "steps into the road"
    assert names["hit_class"] == "pedestrian"
    assert (scalars["nearest_min_m"], scalars["hit_hull"]) == (0.0, 1)
    assert scalars["dtc_min_m"] > 40.0  # about the target, which is the obstacle
    table = finished.table.columns
    assert table["nearest_m"].values[-1] == pytest.approx(0.0, abs=0.1)
    assert table["nearest_object"].values[-1] == "steps into the road"
    # A second before the impact it is a second away, and nothing else is in the way.
    before = -21
    assert table["nearest_ttc_object"].values[before] == "steps into the road"
    assert table["nearest_ttc_s"].values[before] == pytest.approx(1.0, abs=0.2)


def test_what_is_near_follows_who_moves_past(walker):
    """The van stands in the oncoming lane; beside it, it is the nearest, and never in the way."""
    finished = ended(walker, **{**MEETS, "duration_s": 2.0, "ego_start_m": 100.0})
    table = finished.table.columns
    beside = int(np.argmin(table["nearest_m"].values))
    assert table["nearest_object"].values[beside] == "van 0"
    assert 1.0 < table["nearest_m"].values[beside] < 2.5
    assert "van 0" not in set(table["nearest_ttc_object"].values)
    assert finished.names["nearest_object"] == "van 0"
    assert "hit_object" not in finished.names
    assert finished.scalars["hit_hull"] is None


def test_the_same_names_and_bytes_in_any_slot(walker):
    alone, among = ended(walker, **MEETS), ended(walker, slots=3, slot=2, **MEETS)
    assert among.names == alone.names
    assert among.scalars == alone.scalars
    for name in ("nearest_m", "nearest_object", "nearest_ttc_s", "nearest_ttc_object"):
        one, other = alone.table.columns[name], among.table.columns[name]
        assert one.values.tobytes() == other.values.tobytes()
        assert one.valid.tobytes() == other.valid.tobytes()


def test_the_obstacle_is_called_so():
    finished = ended("downtown", ego_start_m=8.0, ego_speed_mps=9.0, duration_s=4.0)
    assert finished.reasons[0].endswith("with 'obstacle' (car)")
    assert finished.names["hit_object"] == "obstacle"
    assert finished.scalars["dtc_min_m"] == finished.scalars["nearest_min_m"] == 0.0


def test_a_parked_truck_or_a_post_is_named():
    """Steered to the right, the ego meets what stands at the kerb."""

    def right(engine, slot):
        return ask(engine, slot, throttle=0.2, steering=-0.06)

    finished = ended("downtown", right, ego_start_m=50.0, ego_speed_mps=9.0, duration_s=6.0)
    assert finished.verdict == "collision"
    hit = finished.names["hit_object"]
    assert hit != "obstacle"
    assert finished.reasons[0].endswith(f"with '{hit}' ({finished.names['hit_class']})")
    world = build_world(load_scene("downtown"))
    assert hit in {thing.name for thing in world.things}


def test_the_second_hull_of_a_truck_is_told_from_its_first(walker, monkeypatch):
    """Cab and trailer stand in a row; the ego comes from behind and meets the trailer."""
    world = build_world(load_scene(walker))
    x, y, yaw, half_length, half_width = world.colliders[0].tolist()
    hulls = [(x + 20.0, y, yaw, half_length, half_width), (x - 30.0, y, yaw, 4.0, 1.2)]
    truck = [Thing("articulated", "truck", hull, 2) for hull in (1, 2)]
    count = len(world.colliders)
    made = replace(
        world,
        colliders=np.concatenate([world.colliders, hulls]),
        things=(*world.things[:count], *truck, *world.things[count:]),
    )
    monkeypatch.setattr(engine_module, "build_world", lambda _scene, _bodies: made)
    finished = ended(walker, ego_start_m=40.0, ego_speed_mps=8.0, duration_s=4.0)
    assert finished.reasons[0].endswith("with 'articulated' (truck, hull 2 of 2)")
    assert finished.scalars["hit_hull"] == 2


@pytest.mark.parametrize("scene", ["downtown", "crossing", "downtown-loop"])
def test_every_hull_of_a_shipped_scene_has_a_name_of_its_own(scene):
    world = build_world(load_scene(scene))
    assert len(world.things) == len(world.colliders) + world.motion.count
    assert len({thing.name for thing in world.things}) == len(world.things)
    assert world.things[0] == Thing("obstacle", "car")


def test_names_from_files_stay_on_one_line():
    assert named("a\nb\x1b[2J", "car").words.isprintable()
    assert len(named("x" * 500, "car").name) <= 61
