"""Roads with curves: what is refused, and the shipped loop, which can be driven all round."""

import hashlib

import numpy as np
import pytest
import warp as wp
from msgspec.structs import replace

from schemas.messages import SEMANTIC_CLASSES
from twin.base.errors import UsageError
from twin.dataset.images.cast import streets_of
from twin.dataset.recipe import DatasetRecipe
from twin.render.light.street_lamps import LAMP_CELL_M, nearest_lamps
from twin.scenario.surroundings import place_before
from twin.vehicle.fleet import Fleet
from twin.vehicle.ground import drivable
from twin.vehicle.state import COLUMN
from twin.vehicle.vehicle_file import load_vehicle
from twin.world.kernel_cache import prepare_kernels
from twin.world.meshes.mesh import DECAL
from twin.world.scene import load_scene
from twin.world.street.build import build_world
from twin.world.street.layout import lay_out

prepare_kernels()
CPU = wp.get_device("cpu")

# Points, faces, materials, colours and hulls of the straight streets; after a wanted change of them
# take the values that the failing test shows.
STRAIGHT = {
    "downtown": "6870a28c3e0d4062",
    "crossing": "8e98e161ac6d10c6",
}

SIDE = "{line_m: 60}, {arc: {radius_m: 30, turn_deg: 90}}"
HEAD = "schema: 1\nscene: round\nbake: false\nobstacle: {x_m: 20, y_m: -2.9}\n"
SQUARE = HEAD + f"road: {{start_m: 0, path: [{', '.join([SIDE] * 4)}]}}\n"


@pytest.fixture(scope="module")
def loop():
    """The shipped scene, its light not worked out, and its world."""
    scene = replace(load_scene("downtown-loop"), bake=False)
    return scene, build_world(scene)


def corners(world):
    """Corners of the hulls [K, 4, 2] beside points in the middle of their edges [K, 4, 2]."""
    x, y, yaw, half_length, half_width = world.colliders.T
    along = np.stack([np.cos(yaw), np.sin(yaw)], 1) * half_length[:, None]
    across = np.stack([-np.sin(yaw), np.cos(yaw)], 1) * half_width[:, None]
    signs = [(1, 1), (1, -1), (-1, 1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1)]
    return np.stack([np.stack([x, y], 1) + a * along + b * across for a, b in signs], 1)


@pytest.mark.parametrize("name", STRAIGHT)
def test_straight_streets_are_what_they_were(name):
    world = build_world(replace(load_scene(name), bake=False))
    mesh = world.mesh
    digest = hashlib.sha256()
    for values in (mesh.points_m, mesh.faces, mesh.material, mesh.color, world.colliders):
        digest.update(np.ascontiguousarray(values).tobytes())
    assert digest.hexdigest()[:16] == STRAIGHT[name]
    assert not world.lane.closed
    pose = place_before(world.lane, world.colliders[world.obstacle], 100.0)
    assert pose == (world.obstacle_rear_m - 100.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("radius_m: 30", "radius_m: 9", "tighter than the road's half width, 11.65 m"),
        ("line_m: 60", "line_m: 61.5", "path: ends at x 1.5, y 0, needed: its start at x 0, y 0"),
        ("turn_deg: 90", "turn_deg: 80", "turns by 350 degrees in all, needed: 360 or -360"),
        ("line_m: 60", "line_m: 60, arc: {radius_m: 30, turn_deg: 90}", "one of line_m and arc"),
        ("{line_m: 60}", "{}", "give one of line_m and arc"),
        ("turn_deg: 90", "turn_deg: 0.5", "at least 1 degree"),
        ("turn_deg: 90", "turn_deg: 400", "turn_deg: given 400"),
        ("line_m: 60", "line_m: -3", "line_m: given -3"),
        ("{line_m: 60}", ", ".join(["{line_m: 1990}"] * 3), "6338 m long, allowed: at most 5000"),
        ("start_m: 0", "start_m: 0, end_m: 300", "leave end_m away"),
        ("start_m: 0", "start_m: 0, cross_streets_m: [30]", "no side streets"),
        ("{x_m: 20", "{x_m: 500", "must lie on the road, from 0 to 428.5 m"),
        (
            "bake: false",
            "street: false\nterrain: {heightmap: a.npy, size_m: [9, 9]}",
            "needs the gen",
        ),
        ("y_m: -2.9", "y_m: -9", "y_m: given -9"),
    ],
)
def test_mistakes_in_a_path(tmp_path, old, new, expected):
    path = tmp_path / "round.yaml"
    path.write_text(SQUARE)
    assert load_scene(str(path)).road.lane().length_m == pytest.approx(240 + 60 * np.pi)
    assert old in SQUARE
    path.write_text(SQUARE.replace(old, new, 1))
    with pytest.raises(ValueError) as error:
        load_scene(str(path))
    assert expected in str(error.value)
    assert "\n" not in str(error.value)
    assert "round.yaml" in str(error.value)


def test_a_road_that_meets_itself_is_refused(tmp_path):
    """A dent in one long side comes as near as 20 m to the other one."""
    path = tmp_path / "round.yaml"
    left, right = "arc: {radius_m: 15, turn_deg: 90}", "arc: {radius_m: 15, turn_deg: -90}"
    dent = [left, "line_m: 20", right, "line_m: 20", right, "line_m: 20", left]
    pieces = ["line_m: 150", left, "line_m: 40", left, "line_m: 20", *dent]
    pieces += ["line_m: 50", left, "line_m: 40", left]
    pieces = [f"{{{piece}}}" for piece in pieces]
    path.write_text(HEAD + f"road: {{start_m: 0, path: [{', '.join(pieces)}]}}\n")
    with pytest.raises(ValueError, match=r"the road meets itself about .* m from its start"):
        load_scene(str(path))


def test_the_loop_is_one(loop):
    scene, world = loop
    lane = world.lane
    assert 1100.0 < lane.length_m < 1300.0
    turns = lane.curvature[lane.curvature != 0.0]
    assert (turns > 0).sum() >= 2
    assert (turns < 0).sum() >= 2
    assert 18.0 <= 1.0 / np.abs(turns).max() <= 25.0
    end, start = lane.at(lane.length_m - 1e-9), lane.at(0.0)
    assert np.hypot(end.x_m - start.x_m, end.y_m - start.y_m) < 0.01
    assert (float(start.x_m), float(start.y_m), float(start.yaw_rad)) == (scene.road.start_m, 0, 0)


def test_its_mesh_is_sound(loop):
    _, world = loop
    mesh = world.mesh
    assert 40_000 < len(mesh.faces) < 100_000
    for values in (mesh.points_m, mesh.color, mesh.uv, world.colliders):
        assert np.isfinite(values).all()
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.points_m)
    assert np.abs(mesh.points_m).max() < 1000.0
    # What is walked and driven on looks up.
    a, b, c = mesh.points_m[mesh.faces].astype(float).transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    ground = np.isin(mesh.semantic, [SEMANTIC_CLASSES.index(n) for n in ("road", "marking")])
    assert (cross[ground & (mesh.instance < 0), 2] > -1e-9).all()


def test_markings_follow_the_lane(loop):
    """Their edges are chords, nowhere more than 1 cm beside the line they stand for."""
    scene, world = loop
    mesh, lane = world.mesh, scene.road.lane_width_m
    marks = mesh.semantic == SEMANTIC_CLASSES.index("marking")
    points = mesh.points_m[mesh.faces[marks]].astype(float)
    ends = world.lane.locate(points[..., 0], points[..., 1]).lateral_m
    lines = {-lane / 2 - 0.05: 0.05, lane / 2: 0.07, 1.5 * lane + 0.05: 0.05}
    found = np.zeros(len(points), bool)
    for centre, half in lines.items():
        on_line = (np.abs(np.abs(ends - centre) - half) < 1e-3).all(axis=1)
        middle = (points[on_line] + np.roll(points[on_line], 1, axis=1)) / 2
        lateral = world.lane.locate(middle[..., 0], middle[..., 1]).lateral_m - centre
        assert (np.abs(lateral) < half + 0.01).all()
        found |= on_line
    # Edge lines are solid; of the middle line a little less than a half is painted.
    s = np.arange(0.0, world.lane.length_m, 1.9)
    for centre, share in ((-lane / 2 - 0.05, 1.0), (lane / 2, 3.0 / 7.5)):
        at = world.lane.at(s, centre)
        inside = _covered(points[found][..., :2], np.stack([at.x_m, at.y_m], 1))
        assert inside.mean() == pytest.approx(share, abs=0.03)


def _covered(triangles, places):
    """Whether each place [n, 2] lies in one of the triangles [t, 3, 2]."""
    a, b, c = (triangles[None, :, i] for i in range(3))
    p = places[:, None]

    def side(u, v):
        return (v - u)[..., 0] * (p - u)[..., 1] - (v - u)[..., 1] * (p - u)[..., 0]

    signs = np.stack([side(a, b), side(b, c), side(c, a)])
    return ((signs > -1e-9).all(axis=0)).any(axis=1)


def test_nothing_stands_in_its_lanes(loop):
    """No hull, no vertex below 4.2 m, no walker; the obstacle is parked beside them."""
    scene, world = loop
    lane = scene.road.lane_width_m / 2
    hulls = world.lane.locate(*np.moveaxis(corners(world), -1, 0)).lateral_m
    assert ((hulls < -lane) | (hulls > 3 * lane - 0.1)).all()
    mesh = world.mesh
    standing = mesh.faces[(mesh.tag != DECAL) & (mesh.points_m[mesh.faces][..., 2].max(1) > 0.02)]
    points = mesh.points_m[standing].reshape(-1, 3)
    points = points[points[:, 2] < 4.2]
    lateral = world.lane.locate(points[:, 0], points[:, 1]).lateral_m
    assert not ((lateral > -lane) & (lateral < 3 * lane - 0.1)).any()
    walkers = world.motion.at(np.arange(0.0, 240.0, 2.0)).position_m.reshape(-1, 3)
    lateral = world.lane.locate(walkers[:, 0], walkers[:, 1]).lateral_m
    kerbs = lay_out(scene)
    assert ((lateral < kerbs.kerb_right - 0.3) | (lateral > kerbs.kerb_left + 0.3)).all()
    assert ((lateral > kerbs.wall_right + 0.3) & (lateral < kerbs.wall_left - 0.3)).all()
    x, y = world.colliders[0, :2]
    place = world.lane.locate(x, y)
    assert place.lateral_m == pytest.approx(scene.obstacle.y_m, abs=1e-6)
    pose = place_before(world.lane, world.colliders[world.obstacle], 200.0)  # round the last curve
    behind = world.lane.locate(*pose[:2])
    rear = world.lane.locate(*world.lane.at(scene.obstacle.x_m)[:2]).s_m
    assert behind.s_m == pytest.approx((rear - 200.0) % world.lane.length_m, abs=1e-6)
    assert abs(behind.lateral_m) < 1e-6


def test_it_can_be_driven_all_round(loop):
    """A driver who knows the lane goes once round at 8 m/s, on level ground, touching nothing."""
    _, world = loop
    car = load_vehicle("opencav")
    fleet = Fleet([car], 1, CPU, colliders=world.colliders, ground=drivable(world, CPU))
    start = world.lane.at(0.0)
    fleet.place(0, float(start.x_m), 8.0, 0.9, y_m=float(start.y_m), yaw_rad=float(start.yaw_rad))
    fleet.active[0] = 1
    way, last, worst = 0.0, 0.0, 0.0
    for k in range(1700):
        row = fleet.state[0, 0]
        x, y, yaw = (row[COLUMN[name]] for name in ("x_m", "y_m", "yaw_rad"))
        place = world.lane.locate(x, y)
        way += (float(place.s_m) - last + 300.0) % world.lane.length_m - 300.0
        last = float(place.s_m)
        worst = max(worst, abs(float(place.lateral_m)))
        if way >= world.lane.length_m:
            break
        ahead = world.lane.at(last + 5.0)
        bearing = np.arctan2(ahead.y_m - y, ahead.x_m - x) - yaw
        steering = np.arctan(2.0 * car.wheelbase_m * np.sin(bearing) / 5.0)
        gas = np.clip(0.2 + 0.5 * (8.0 - row[COLUMN["speed_mps"]]), 0.0, 1.0)
        fleet.commands[0, 0] = (gas, 0.0, steering, 0.0, 1.0)
        fleet.first_step[0] = 50 * k
        fleet.advance(50)
        assert fleet.event_count[0] == 0, f"touched something after {way:.1f} m"
    assert way >= world.lane.length_m
    assert worst < 0.8
    assert abs(float(fleet.state[0, 0, COLUMN["z_m"]])) < 0.05


def test_there_may_be_no_room_for_buildings(tmp_path):
    """A loop 31 m across, with pieces too short for a house: walls and shallow houses."""
    turn = "{arc: {radius_m: 15, turn_deg: 90}}"
    path = f"{{line_m: 99.6}}, {{line_m: 0.4}}, {turn}, {{line_m: 1}}, {turn}"
    text = HEAD + f"road: {{start_m: -30, path: [{path}, {path}]}}\n"
    (tmp_path / "thin.yaml").write_text(text.replace("x_m: 20", "x_m: -10"))
    scene = load_scene(str(tmp_path / "thin.yaml"))
    world = build_world(scene)
    assert np.isfinite(world.mesh.points_m).all()
    lateral = world.lane.locate(*np.moveaxis(corners(world), -1, 0)).lateral_m
    assert ((lateral < -1.75) | (lateral > 5.0)).all()
    long = world.colliders[world.colliders[:, 3] > 5.0]
    assert (2 * long[:, 4] < scene.buildings.depth_m - 1.0).any()
    assert np.isclose(2 * world.colliders[:, 4], 0.3).any()


def test_blocks_are_the_pieces_of_the_path(loop):
    scene, world = loop
    layout = lay_out(scene)
    assert len(layout.blocks) == len(scene.road.path)
    assert layout.blocks[-1].end == scene.road.start_m + world.lane.length_m
    for x, y in ((0.0, 2.0), (200.0, -7.0), (400.0, 9.0), (910.0, 5.0)):
        wx, wy, yaw = layout.at(x, y, 0.25)
        place = world.lane.locate(wx, wy)
        assert (place.s_m, place.lateral_m) == pytest.approx((x, y), abs=1e-6)
        assert np.cos(yaw - 0.25 - place.heading_rad) == pytest.approx(1.0)
    # Neighbours are cut at the same places in curves, whatever their pitch.
    bend = layout.blocks[1]
    coarse, fine = (layout.cuts(bend.start, bend.end, count) for count in (1, 50))
    assert coarse.tolist() == fine.tolist()


def test_lamps_are_found_by_cells(loop):
    _, world = loop
    near, corner = nearest_lamps(world.lamps)
    rng = np.random.default_rng(2)
    for _ in range(50):
        row, column = rng.integers(near.shape[0]), rng.integers(near.shape[1])
        middle = np.array(corner) + LAMP_CELL_M * (np.array((column, row)) + 0.5)
        apart = np.hypot(*(world.lamps - middle).T)
        assert sorted(apart[near[row, column]]) == pytest.approx(sorted(apart)[: near.shape[2]])
    few, _ = nearest_lamps(world.lamps[:2])
    assert (few[..., 2:] == -1).all()
    assert nearest_lamps(np.zeros((0, 2)))[0].size == 0


def test_the_dataset_refuses_a_road_that_bends():
    with pytest.raises(UsageError, match="'downtown-loop': it has no straight generated street"):
        streets_of(DatasetRecipe(scene="downtown-loop"), "train")
