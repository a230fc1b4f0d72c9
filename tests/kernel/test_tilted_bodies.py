"""Bodies that pitch and roll, in pictures and LiDARs, beside level ones whose mesh is turned."""

from dataclasses import replace

import numpy as np
import trimesh
import warp as wp
from lidar_rigs import CPU, INSTANCE, pose, profile, scan, sensor, wall, world, yawed
from pictures import Script, camera_in, flat, light_slot, mesh_of, quad, world_of

from schemas.messages import Lights
from schemas.sections.lidar import Lidar
from twin.actors.motion import ObjectKind
from twin.actors.palette import build_palette
from twin.render.trace.geometry import Geometry, RayScene, occluded, trace
from twin.world.meshes import materials

YAW, PITCH, ROLL = 0.6, 0.22, -0.15
ROAD = quad((-50, -300, -1.4), (600, -300, -1.4), (600, 300, -1.4), (-50, 300, -1.4))
PLACE = (9.0, 0.4, -1.1)


def turn(*angles_by_axis):
    """[3, 3] of turns about z, y and x, in this order."""
    about = trimesh.transformations.rotation_matrix
    parts = zip(angles_by_axis, ([0, 0, 1], [0, 1, 0], [1, 0, 0]), strict=True)
    z, y, x = (about(angle, axis)[:3, :3] for angle, axis in parts)
    return z @ y @ x


def leaning(kind, rotation):
    """The same body with its mesh turned."""
    points = (kind.mesh.points_m.astype(float) @ rotation.T).astype(np.float32)
    return replace(kind, mesh=replace(kind.mesh, points_m=points))


def car():
    palette = build_palette()
    return palette.kinds[next(look for look in palette.looks if look.sort == "car").kind]


def tilted_world(kind, *, by_mesh):
    """A road and a body on it that leans: by its pose, or by its mesh."""
    rotation = turn(0.0, PITCH, ROLL)
    angles = {} if by_mesh else {"pitch_rad": PITCH, "roll_rad": ROLL}
    script = Script(position_m=np.array([PLACE]), yaw_rad=YAW, **angles)
    road = mesh_of(*ROAD, material=np.full(2, materials.ASPHALT, np.int32))
    kind = leaning(kind, rotation) if by_mesh else kind
    return world_of(road, kinds=(kind,), motion=script, mover_classes=(0,)), script


def shoot(kind, *, by_mesh):
    """Picture and truth of each pixel."""
    scene, script = tilted_world(kind, by_mesh=by_mesh)
    outputs = ["depth", "instance", "normal"]
    camera = camera_in(scene, size=(160, 90), outputs=outputs, hfov_deg=50.0)
    camera.geometry.place(script.at(np.zeros(1)))
    picture = camera.render(flat((0, 0, 0)))[0].astype(float)
    return picture, {name: camera.outputs[name][0].astype(float) for name in outputs}


def test_a_picture_shows_a_body_that_leans():
    leans, truth = shoot(car(), by_mesh=False)
    turned, expected = shoot(car(), by_mesh=True)
    body = expected["instance"] == 0
    assert body.sum() > 300
    assert ((truth["instance"] == 0) != body).mean() < 0.002
    ground = np.isfinite(expected["depth"]) & np.isfinite(truth["depth"])
    for name in ("depth", "normal"):
        both = truth[name][ground] - expected[name][ground]
        apart = np.abs(both).reshape(len(both), -1).max(axis=-1)
        assert (apart > 0.01).mean() < 0.002, name
    assert (np.abs(leans - turned)[body].max(axis=1) > 6.0).mean() < 0.03


def lit_road(pitch_rad):
    """Values of the road 55 to 85 m ahead of a car with low beams, by night."""
    half = car().half_length_m
    script = Script(
        position_m=np.array([(6.0, 0.0, -1.4)]), pitch_rad=pitch_rad, roll_rad=0.0, lamps=1.0
    )
    road = mesh_of(*ROAD, material=np.full(2, materials.ASPHALT, np.int32))
    scene = world_of(road, kinds=(car(),), motion=script, mover_classes=(0,))
    camera = camera_in(
        scene, mount=(0.0, 0.0, 6.0), size=(160, 90), hfov_deg=50.0, outputs=["depth"]
    )
    light_slot(camera, 0, minute=0, lights=Lights())
    camera.geometry.place(script.at(np.zeros(1)))
    picture = camera.render(flat((0, 0, 0)))[0].astype(float)
    depth = camera.outputs["depth"][0][:, 80].astype(float)
    there = (depth > 61.0 + half) & (depth < 91.0 + half)
    assert there.sum() > 3
    return picture[there, 75:85].mean()


def test_the_low_beam_of_a_body_whose_nose_points_up_reaches_farther():
    level, up, down = lit_road(0.0), lit_road(-0.02), lit_road(0.05)
    assert up > 1.2 * level
    assert down < 0.8 * level


def test_flow_of_a_body_that_leans_follows_its_turn():
    """It turned from level while the picture was made: points go where the rotation brings them."""
    box = car()
    before = Script(position_m=np.array([PLACE]), yaw_rad=YAW, pitch_rad=0.0, roll_rad=0.0)
    now = Script(position_m=np.array([PLACE]), yaw_rad=YAW, pitch_rad=PITCH, roll_rad=ROLL)
    road = mesh_of(*ROAD, material=np.full(2, materials.ASPHALT, np.int32))
    scene = world_of(road, kinds=(box,), motion=now, mover_classes=(0,))
    camera = camera_in(scene, size=(160, 90), outputs=["flow", "depth", "instance"], hfov_deg=50.0)
    camera.reset(0)
    light_slot(camera, 0)
    for script in (before, now):
        camera.geometry.place(script.at(np.zeros(1)))
        camera.render(flat((0, 0, 0)))
    focal = 80.0 / np.tan(np.radians(25.0))
    rows, columns = np.nonzero(camera.outputs["instance"][0] == 0)
    depth = camera.outputs["depth"][0][rows, columns].astype(float)
    right, down = (columns + 0.5 - 80.0) / focal, (rows + 0.5 - 45.0) / focal
    rays = np.stack([np.ones_like(right), -right, -down], axis=1)  # depth is along the axis
    points = rays * depth[:, None]
    own = (points - PLACE) @ turn(YAW, PITCH, ROLL)
    then = own @ turn(YAW, 0.0, 0.0).T + PLACE
    expected = np.stack([right + then[:, 1] / then[:, 0], down + then[:, 2] / then[:, 0]], 1)
    flow = camera.outputs["flow"][0][rows, columns]
    assert np.abs(expected * focal).max() > 5.0
    assert np.abs(flow - expected * focal).max() < 0.05


@wp.kernel
def trace_kernel(
    scene: RayScene,
    origin: wp.vec3,
    rays: wp.array(dtype=wp.vec3),
    out: wp.array2d(dtype=wp.float32),
):
    i = wp.tid()
    hit = trace(scene, 0, origin, rays[i], 0.0, 50.0)
    out[i, 0] = hit.t
    for k in range(3):
        out[i, 1 + k] = hit.normal[k]
    out[i, 4] = wp.float32(hit.object)
    out[i, 5] = wp.where(occluded(scene, 0, origin, rays[i], 12.0), 1.0, 0.0)


def test_single_rays_meet_a_body_that_leans():
    rng = np.random.default_rng(4)
    rays = np.array(PLACE) + (0.0, 0.0, 0.7) + rng.normal(size=(4000, 3)) * (2.0, 1.5, 0.8)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    seen = []
    for by_mesh in (False, True):
        scene, script = tilted_world(car(), by_mesh=by_mesh)
        geometry = Geometry(scene, 1, CPU)
        geometry.place(script.at(np.zeros(1)))
        out = wp.zeros((len(rays), 6), dtype=wp.float32, device=CPU)
        inputs = [geometry.scene, wp.vec3(0.0), wp.array(rays, dtype=wp.vec3, device=CPU)]
        wp.launch(trace_kernel, len(rays), inputs, [out], device=CPU)
        seen.append(out.numpy())
    (leans, turned) = seen
    assert (turned[:, 4] == 0).mean() > 0.3
    same = leans[:, 4] == turned[:, 4]
    assert same.mean() > 0.998
    assert (np.abs(leans - turned)[same].max(axis=1) > 1e-3).mean() < 0.003


def test_lidars_see_a_body_that_leans():
    """The kernel of CPUs beside a mesh that is turned; that of GPUs meets the same in
    test_lidar_ranges."""
    mesh = trimesh.creation.box((4.0, 2.0, 1.5))
    color = np.full((len(mesh.faces), 3), 0.5, np.float32)
    built = mesh_of(np.add(mesh.vertices, (0.0, 0.0, 0.75)), mesh.faces, color=color)
    box, rotation = ObjectKind("box", built, 2.0, 1.0), turn(YAW, PITCH, ROLL)
    angles = {"yaw_rad": YAW, "pitch_rad": PITCH, "roll_rad": ROLL}
    kind = profile(theta_res_deg=0.25, phi_res_deg=0.25)
    points = []
    for body, turned in ((box, angles), (leaning(box, rotation), {})):
        script = Script(
            position_m=np.array([(15.0, 0.4, -1.1)]),
            velocity_mps=np.array([(-12.0, 3.0, 1.0)]),
            **turned,
        )
        scene = world(wall(150.0), kinds=(body,), motion=script, mover_classes=(0,))
        eye = sensor(scene, kind, Lidar(noise=False, truth=True))
        eye.geometry.place(script.at(np.zeros(1)))
        eye.reset(0, 3)
        scan(eye, pose((0.0, 0.0, 0.0)))
        points.append(scan(eye, pose((0.5, 0.1, 0.1), yawed(0.02)))[0])
    leans, expected = points
    on_body = expected[:, INSTANCE] == 0
    assert on_body.sum() > 300
    same = (leans[:, INSTANCE] == 0) == on_body
    assert same.mean() > 0.998
    assert (np.abs(leans - expected)[same & on_body, :4].max(axis=1) > 3e-3).mean() < 0.003
