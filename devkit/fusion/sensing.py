"""The sensors of S cars: which there are, what each saw at this tick, and who gets it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from devkit.fusion.camera_objects import BOXES_TAKEN_MAX, place_boxes
from devkit.fusion.ego_motion import EgoMotion
from devkit.fusion.health import SensorHealth
from devkit.fusion.lidar_objects import SweepObjects, find_objects
from devkit.fusion.lidar_points import LidarView
from devkit.fusion.parameters import FusionSensors, TrackingParameters
from devkit.fusion.path import EyePlaces
from devkit.fusion.radar_objects import Mounts, RadarView, group_frames
from devkit.fusion.sightings import Sightings
from devkit.fusion.tracks import TrackStore
from devkit.images import on_host
from devkit.reference.view import CameraView
from devkit.stack import Observation
from schemas.messages import Detection, Episode
from twin.base.errors import UsageError

OBJECTS_MAX = 32
"""Most objects of a LiDAR sweep or a radar frame; the nearest count."""
RADAR = "radar"
"""Name of the radar's messages."""


class Sensing:
    """What S cars look with."""

    def __init__(
        self,
        slots: int,
        sensors: FusionSensors,
        tracking: TrackingParameters,
        corridor_half_m: float,
    ) -> None:
        """Begin without cars."""
        self._sensors = sensors
        self._half_m = corridor_half_m
        self._radar = RadarView((sensors.radar_x_m, 0.0, sensors.radar_z_m), 0.0)
        self._lidar_sigma_m = tracking.lidar_sigma_m
        self.has_lidar, self.has_radar = np.zeros(slots, bool), np.zeros(slots, bool)
        self._cameras: list[CameraView | None] = [None] * slots
        self._lidars: list[LidarView | None] = [None] * slots
        self._messages: list[str] = [""] * slots
        self._eye_x_m, self._eye_y_m = np.zeros(slots), np.zeros(slots)
        self._slots = slots
        self._boxes = self._sweep = self._echoes = Sightings.empty(slots, 1)
        self._pictured, self._swept, self._echoed = (np.zeros(slots, bool) for _ in range(3))

    def reset(self, slot: int, episode: Episode) -> None:
        """Find the sensors of a new case.

        Raises:
            UsageError: it lacks one that ``sensors_used`` names, or a camera; one line.
        """
        used = self._sensors.sensors_used
        if not episode.cameras:
            raise UsageError("devkit.fusion looks with a camera; it cannot run with render: false")
        if used == "camera+lidar" and not episode.lidars:
            raise UsageError(
                "sensors_used: camera+lidar, but the case has no LiDAR; add "
                "`lidars: [{name: roof, hz: 10, deskew: true}]`, or use camera"
            )
        view = CameraView.of_site(episode.cameras[0])
        self._cameras[slot] = view
        self._eye_x_m[slot], self._eye_y_m[slot] = view.forward_m, view.lateral_m
        self.has_radar[slot] = used == "camera+radar"
        self.has_lidar[slot] = bool(episode.lidars) and used in ("camera+lidar", "all")
        if self.has_lidar[slot]:
            self._lidars[slot] = LidarView.of_site(episode.lidars[0])
            self._messages[slot] = episode.lidars[0].message

    def look(
        self,
        slots: Sequence[int],
        observation: Observation,
        detections: Mapping[int, list[Detection]],
        ego: EgoMotion,
        health: SensorHealth,
    ) -> None:
        """Find the objects in everything that came with this tick."""
        self._look_at_boxes(detections, ego, health)
        self._look_at_sweeps(slots, observation, ego, health)
        self._look_at_echoes(slots, observation, ego, health)

    def track(self, tracks: TrackStore, ego: EgoMotion) -> None:
        """Hand what was seen to the tracks: what measures places first."""
        if self._swept.any():
            tracks.update(self._sweep, tracks.lidar, self._swept)
        if self._echoed.any():
            tracks.update(self._echoes, tracks.radar, self._echoed)
        if self._pictured.any():
            eye = EyePlaces(self._eye_x_m, self._eye_y_m, ego.path, self._half_m)
            tracks.take_boxes(self._boxes, eye, self._pictured)

    def _look_at_boxes(
        self, detections: Mapping[int, list[Detection]], ego: EgoMotion, health: SensorHealth
    ) -> None:
        self._pictured[:] = False
        if not detections:
            return
        most = max(len(boxes) for boxes in detections.values())
        self._boxes = Sightings.empty(self._slots, min(most, BOXES_TAKEN_MAX))
        path = ego.path
        for slot, boxes in detections.items():
            view = self._cameras[slot]
            assert view is not None, f"slot {slot} was not reset"
            its = path.of_slot(slot)
            place_boxes(self._boxes, slot, boxes, view, its, self._half_m, self._sensors)
            self._pictured[slot] = True
            health.pictured(slot, len(boxes))

    def _look_at_sweeps(
        self, slots: Sequence[int], observation: Observation, ego: EgoMotion, health: SensorHealth
    ) -> None:
        self._swept[:] = False
        due = [s for s in slots if self.has_lidar[s] and self._messages[s] in observation.sensors]
        if not due:
            return
        path, sweeps = ego.path, dict[int, SweepObjects]()
        for slot in due:
            view = self._lidars[slot]
            assert view is not None, f"slot {slot} was not reset"
            sweeps[slot] = seen = find_objects(
                on_host(observation.sensors[self._messages[slot]])[slot],
                view,
                speed_mps=float(ego.speed_mps[slot]),
                path=path.of_slot(slot),
                corridor_half_m=self._half_m,
                range_m=self._sensors.lidar_range_m,
                points_min=self._sensors.cluster_points_min,
                deskewed=self._sensors.lidar_deskewed,
            )
            health.swept(slot, seen.reach_m, seen.free_to_m, seen.returned)
            self._swept[slot] = True
        most = max(len(seen.x_m) for seen in sweeps.values())
        self._sweep = sweep = Sightings.empty(self._slots, min(most, OBJECTS_MAX))
        for slot, seen in sweeps.items():
            n = min(len(seen.x_m), OBJECTS_MAX)
            sweep.valid[slot, :n] = True
            sweep.x_m[slot, :n], sweep.path_x_m[slot, :n] = seen.x_m[:n], seen.path_x_m[:n]
            sweep.right_m[slot, :n], sweep.left_m[slot, :n] = seen.right_m[:n], seen.left_m[:n]
            sweep.inside[slot, :n], sweep.beside[slot, :n] = seen.inside[:n], seen.beside[:n]
            sweep.sigma_m[slot, :n] = self._lidar_sigma_m

    def _look_at_echoes(
        self, slots: Sequence[int], observation: Observation, ego: EgoMotion, health: SensorHealth
    ) -> None:
        self._echoed[:] = False
        if RADAR not in observation.sensors or self._sensors.sensors_used in (
            "camera",
            "camera+lidar",
        ):
            return
        echoed = list(slots)
        self._echoed[echoed] = self.has_radar[echoed] = True
        detections = on_host(observation.sensors[RADAR])
        counts = observation.counts[RADAR]
        frames = [detections[slot, : int(counts[slot])] for slot in slots]
        mounts = Mounts(ego.speed_mps[echoed], ego.yaw_rate_radps[echoed], ego.dive_rad[echoed])
        objects = group_frames(frames, self._radar, mounts) if frames else []
        most = max(map(len, objects), default=0)
        self._echoes = echoes = Sightings.empty(self._slots, min(most, OBJECTS_MAX))
        for slot, groups in zip(slots, objects, strict=True):
            health.echoed(slot)
            taken = slice(min(len(groups), OBJECTS_MAX))
            rows = np.array(groups[taken]).reshape(-1, 7)
            x, sigma, right, left, speed, speed_sigma, ray_y = rows.T
            echoes.valid[slot, taken] = True
            echoes.beside[slot, taken] = [group.beside for group in groups[taken]]
            echoes.x_m[slot, taken] = echoes.path_x_m[slot, taken] = x
            echoes.sigma_m[slot, taken] = sigma
            echoes.right_m[slot, taken], echoes.left_m[slot, taken] = right, left
            echoes.ray_y[slot, taken], echoes.radial_mps[slot, taken] = ray_y, speed
            echoes.radial_sigma_mps[slot, taken] = speed_sigma
        inside = ego.path.spread(2).holds(echoes.x_m, echoes.right_m, echoes.left_m, self._half_m)
        echoes.inside[...] = echoes.valid & inside
