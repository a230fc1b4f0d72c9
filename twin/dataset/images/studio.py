"""Takes the images of one street: many at once, none of them aware of the others."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from schemas.identity import stream_key
from schemas.messages import OBJECT_CLASSES, Lights
from schemas.sections.environment import Environment
from twin.actors.motion import Placement, Still
from twin.dataset.images.cameras import Eye
from twin.dataset.images.cast import Street
from twin.dataset.images.eyepoint import Eyepoint, EyeView, Outline, eyepoint_of, outlines_of
from twin.dataset.images.pose import attitude, quaternion
from twin.dataset.images.shot import Shot
from twin.dataset.images.silhouette import Silhouettes, Subject, bodies_of, sign_fronts
from twin.dataset.images.traffic import PLACES
from twin.dataset.labels import SeenObject, annotation, contrast
from twin.dataset.recipe import DatasetRecipe
from twin.render.camera import RayCamera
from twin.render.lens import ray_table
from twin.render.light.light import advance_light, begin_sky, fill_light, fill_sky, switch_lamps
from twin.render.looks import has_looks
from twin.render.memory import check_free, material_bytes, plan
from twin.render.trace.geometry import Geometry
from twin.vehicle.state import COLUMN
from twin.vehicle.vehicle_file import Vehicle
from twin.world.sky.almanac import Heavens, heavens
from twin.world.sky.environment import wind_towards
from twin.world.sky.sun import daylight_under
from twin.world.sky.weather import parameters
from twin.world.street.build import World, build_world


@dataclass(frozen=True, slots=True)
class Taken:
    """A finished image."""

    shot: Shot
    image: np.ndarray
    """uint8 [H, W, 3]"""
    lights: Lights
    annotations: list[dict[str, Any]]


class _Places(Still):
    """Room for the objects of an image; where they are is the image's."""

    count = sum(PLACES.values())


_PIXELS = 4
"""Column of the number of pixels among :data:`twin.render.boxes.BOX_FIELDS`."""
_FIRST = dict(zip(PLACES, np.cumsum([0, *PLACES.values()]).tolist(), strict=False))
"""Number of the first object of each class."""


class Studio:
    """One street with its cast, and the cameras that look at it."""

    def __init__(
        self,
        recipe: DatasetRecipe,
        street: Street,
        vehicle: Vehicle,
        eyes: list[Eye],
        slots: int,
        device: wp.Device,
    ) -> None:
        """Build the street with everything that may stand in it.

        Raises:
            ValueError: a scene or lens that cannot be used, or too many slots; one line.
        """
        self._recipe, self._street, self._vehicle, self._eyes = recipe, street, vehicle, eyes
        self._slots, self._device = slots, device
        built = build_world(street.scene)
        self._kinds = built.motion.at(np.zeros(1)).kind[0]
        movers = [OBJECT_CLASSES.index(name) for name, n in PLACES.items() for _ in range(n)]
        self._world: World = replace(built, motion=_Places(), mover_classes=tuple(movers))
        _check_memory(self._world, eyes, slots, device)
        self._geometry = Geometry(self._world, slots, device)
        self._bodies = bodies_of(self._world)
        self._fronts = sign_fronts(self._world)
        self._silhouettes = Silhouettes(self._bodies, device)
        self._open: tuple[int, RayCamera, wp.array] | None = None

    def take(self, shots: list[Shot]) -> Iterator[Taken]:
        """Images of ``shots``, at most one per slot, all by the same camera."""
        assert len(shots) <= self._slots
        assert all(shot.eye == shots[0].eye for shot in shots)
        camera, rays = self._camera(shots[0].eye)
        lights = self._expose(camera, shots)
        found = self._annotations(shots, camera, rays)
        for slot, shot in enumerate(shots):
            yield Taken(shot, camera.image[slot], lights[slot], found[slot])

    def _expose(self, camera: RayCamera, shots: list[Shot]) -> list[Lights]:
        """Render the images; returns the lamps that were on."""
        rows, lights = camera.lights.host, []
        rows["active"] = 0
        for slot, shot in enumerate(shots):
            camera.clear(slot)
            camera.reset(slot)
            lights.append(self._light(camera, slot, shot))
        camera.sky_stale = True
        advance_light(rows, _padded([shot.time_s for shot in shots], self._slots))
        self._geometry.place(self._placement(shots))
        spec = self._eyes[shots[0].eye].camera
        if "motion_blur" in spec.active_effects():  # it looks at where the camera was before
            camera.launch(self._poses(shots, before_s=1.0 / spec.hz))
        camera.render(self._poses(shots))
        return lights

    def _annotations(
        self, shots: list[Shot], camera: RayCamera, rays: wp.array
    ) -> list[list[dict[str, Any]]]:
        """Annotations of every image, by instance."""
        eye = self._eyes[shots[0].eye]
        spec = eye.camera
        view = EyeView(eye.mount.lens, spec.width, spec.height, spec.hfov_deg)
        boxes = camera.boxes.numpy()
        subjects, outlines, present = [], [], []
        for slot, shot in enumerate(shots):
            seat = eyepoint_of(*attitude(shot.pose), eye.mount)
            there = np.flatnonzero(boxes[slot, :, _PIXELS]).tolist()
            own = [self._subject(shot, instance, seat) for instance in there]
            outlines += outlines_of(view, [subject.shape(self._bodies) for subject in own])
            subjects += own
            present.append(there)
        alone = iter(self._silhouettes.count(subjects, outlines, rays, view))
        around = iter(outlines)
        found = []
        for slot, (shot, there) in enumerate(zip(shots, present, strict=True)):
            extinction = parameters(shot.conditions).extinction_per_m
            seat = eyepoint_of(*attitude(shot.pose), eye.mount)
            picture = camera.image[slot], camera.outputs["instance"][slot]
            rows = []
            for instance in there:
                counted = boxes[slot, instance], next(alone), next(around)
                seen = self._seen(shot, instance, counted, picture, seat)
                rows.append(annotation(seen, self._recipe.rules, extinction))
            found.append(rows)
        return found

    def _camera(self, number: int) -> tuple[RayCamera, wp.array]:
        """The camera, allocated when its first image is due; the last one is let go."""
        if self._open is None or self._open[0] != number:
            self._open = None
            eye = self._eyes[number]
            camera = RayCamera(
                self._geometry,
                self._world,
                self._street.scene.furniture,
                eye.camera,
                eye.mount,
                tuple(self._vehicle.headlamps_m),
            )
            spec = eye.camera
            table = ray_table(eye.mount.lens, spec.width, spec.height, spec.hfov_deg)
            self._open = number, camera, wp.array(table, dtype=wp.vec3, device=self._device)
        return self._open[1:]

    def _light(self, camera: RayCamera, slot: int, shot: Shot) -> Lights:
        place = self._street.scene.origin
        weather = parameters(shot.conditions)
        environment = Environment(date=shot.date)
        bodies = on_steps(heavens(place, shot.date, shot.minute, environment.sun))
        light = daylight_under(bodies, weather, environment.exposure_ev100)
        lamps = shot.lights(light.illuminance_lx)
        row = camera.lights.host[slot]
        fill_light(row, light, weather, wind_towards(environment, place))
        fill_sky(camera.sky_table.host[slot], light)
        switch_lamps(row, lamps)
        row["active"], row["noise"], row["tick"], row["hazard"] = 1, 1, 0, shot.hazard
        row["key"] = stream_key(self._recipe.seed, shot.name, "dataset/noise")
        begin_sky(row, stream_key(self._recipe.seed, shot.name, "dataset/clouds"))
        return lamps

    def _poses(self, shots: list[Shot], before_s: float = 0.0) -> wp.array:
        """Vehicle states, some time before the image is taken."""
        state = np.zeros((self._slots, len(COLUMN)))
        x, y, z, q = (COLUMN[name] for name in ("x_m", "y_m", "z_m", "orientation_x"))
        state[:, q + 3] = 1.0
        for row, shot in zip(state, shots, strict=False):
            pose, way_m = shot.pose, shot.speed_mps * before_s
            row[x] = pose.x_m - way_m * math.cos(pose.yaw_rad)
            row[y] = pose.y_m - way_m * math.sin(pose.yaw_rad)
            row[z] = pose.z_m
            row[q : q + 4] = quaternion(pose)
        return wp.array(state, dtype=wp.float64, device=self._device)

    def _placement(self, shots: list[Shot]) -> Placement:
        size = (self._slots, _Places.count)
        kind = np.full(size, -1, np.int32)
        position, velocity = np.zeros((*size, 3)), np.zeros((*size, 3))
        yaw = np.zeros(size)
        brake, lamps = np.zeros(size, np.float32), np.zeros(size, np.float32)
        for slot, shot in enumerate(shots):
            for column, number in _columns(shot).items():
                one = shot.placed[number]
                walks = self._street.cast[one.look].kind in ("pedestrian", "cyclist")
                phase = 1 + one.phase if walks else 0
                kind[slot, column] = self._kinds[one.look] + phase
                position[slot, column] = one.x_m, one.y_m, one.z_m
                yaw[slot, column] = one.yaw_rad
                ahead = (math.cos(one.yaw_rad), math.sin(one.yaw_rad), 0.0)
                velocity[slot, column] = [one.speed_mps * a for a in ahead]
                brake[slot, column], lamps[slot, column] = one.brake, one.lamps
        return Placement(kind, position, yaw, velocity, np.zeros(size), brake, lamps)

    def _subject(self, shot: Shot, instance: int, view: Eyepoint) -> Subject:
        if instance < self._world.instances:
            return Subject(len(self._world.kinds) + instance, np.zeros(3), 0.0, view)
        one = shot.placed[_columns(shot)[instance - self._world.first_mover]]
        walks = self._street.cast[one.look].kind in ("pedestrian", "cyclist")
        kind = int(self._kinds[one.look]) + (1 + one.phase if walks else 0)
        return Subject(kind, np.array([one.x_m, one.y_m, one.z_m]), one.yaw_rad, view)

    def _look(self, shot: Shot, instance: int) -> str:
        if instance >= self._world.instances:
            one = shot.placed[_columns(shot)[instance - self._world.first_mover]]
            return self._street.cast[one.look].name
        return self._street.obstacle.name if instance == 0 else ""

    def _behind(self, instance: int, seat: Eyepoint) -> bool:
        """Whether the camera sees the back of a traffic sign."""
        if instance not in self._fronts:
            return False
        middle, front = self._fronts[instance]
        return bool(np.dot(seat.eye_m - middle, front) < 0.0)

    def _seen(
        self,
        shot: Shot,
        instance: int,
        counted: tuple[np.ndarray, np.ndarray, Outline],
        picture: tuple[np.ndarray, np.ndarray],
        seat: Eyepoint,
    ) -> SeenObject:
        """``counted``: its pixels in the picture, alone, and where it lies; ``picture``: the image
        [H, W, 3] and its instances [H, W]."""
        here, full, outline = counted
        low_x, low_y, high_x, high_y, pixels = here[: _PIXELS + 1].tolist()
        box = (low_x, low_y, high_x - low_x + 1, high_y - low_y + 1)
        # The picture may draw where it is faster than casting; edges then differ by a pixel.
        x0, y0 = min(int(full[0]), low_x), min(int(full[1]), low_y)
        x1, y1 = max(int(full[2]), high_x), max(int(full[3]), high_y)
        distance_m = int(full[5]) * 1e-4 if full[4] else outline.nearest_m
        return SeenObject(
            class_index=int(self._world.classes[instance]),
            look=self._look(shot, instance),
            instance=instance,
            box=box,
            full_box=(x0, y0, x1 - x0 + 1, y1 - y0 + 1),
            visible_px=pixels,
            unoccluded_px=max(pixels, int(full[4])),
            truncation=outline.truncation,
            distance_m=distance_m,
            contrast=contrast(*picture, instance, box),
            behind=self._behind(instance, seat),
        )


def _check_memory(world: World, eyes: list[Eye], slots: int, device: wp.Device) -> None:
    """Refuse slots that do not fit on a GPU; one camera is open at a time."""
    meshes = [world.mesh, *(kind.mesh for kind in world.kinds)]
    for eye in eyes:
        found = plan(
            [eye.camera],
            [],
            slots,
            triangles=sum(len(mesh.faces) for mesh in meshes),
            texture_bytes=material_bytes(world),
            instances=len(world.classes),
            objects=world.motion.count,
            details=has_looks(world),
        )
        check_free(found, device)


def _columns(shot: Shot) -> dict[int, int]:
    """Column of every object of an image -> its number in ``shot.placed``."""
    nxt = dict(_FIRST)
    columns = {}
    for number, one in enumerate(shot.placed):
        columns[nxt[one.class_name]] = number
        nxt[one.class_name] += 1
    return columns


def _padded(values: list[float], slots: int) -> np.ndarray:
    return np.array([*values, *([0.0] * (slots - len(values)))])


SUN_STEP_DEG = 0.5
"""[deg]"""
MOON_STEP_DEG = 2.0
"""Step of the moon's height; its sky is faint [deg]."""


def on_steps(bodies: Heavens) -> Heavens:
    """The heavens with both bodies at the nearest height of their grids, in the same direction.

    The sky of one height and haze costs 10 ms; a day holds some hundred heights, and a dataset
    asks for each of them many times. Nothing but the height moves, by half a step at most.
    """
    sun = _raised(bodies.sun, bodies.sun_elevation_rad, SUN_STEP_DEG)
    return replace(
        bodies, sun=sun, moon=_raised(bodies.moon, bodies.moon_elevation_rad, MOON_STEP_DEG)
    )


def _raised(direction: np.ndarray, elevation_rad: float, step_deg: float) -> np.ndarray:
    steps = round(math.degrees(elevation_rad) / step_deg)
    elevation = math.radians(steps * step_deg)
    flat = math.cos(elevation) / max(math.hypot(direction[0], direction[1]), 1e-9)
    return np.array([direction[0] * flat, direction[1] * flat, math.sin(elevation)])
