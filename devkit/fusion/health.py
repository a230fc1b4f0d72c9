"""Health of the sensors: what each sees against what it ought to see, in arrays [S].

Said in words whenever it changes (:meth:`SensorHealth.words`), and used: where a sensor is blind
the other one decides alone, and earlier.
"""

from __future__ import annotations

import numpy as np

from devkit.fusion.tracks import KNOWN_VARIANCE, TrackStore

SILENT_S = 0.5
"""A sensor without a message for so long is silent [s]."""
RETURNED_MIN = 0.25
"""A LiDAR of which fewer rays come back is blocked or blind [-]."""
REACH_MIN_M = 12.0
"""A LiDAR that sees neither an obstacle nor the road as far as this is blind [m]."""
REACH_KEPT = 0.97
"""Share of the reach that stays from sweep to sweep [-]."""
VIEW_MIN_M = 25.0
"""A camera that sees less far through fog is blind [m]."""
CONTRAST = 3.0
"""Optical depth at which a dark object fades to 5 % contrast (Koschmieder), -ln 0.05 [-]."""
CLEAR_M = 1e4
"""Sight in clear air, which is not told apart from better ones [m]."""
DARK_LX = 0.05
"""Below this illuminance a camera sees only what lamps light: less than a full moon [lx]."""
BOXLESS_S = 8.0
"""A camera without any box for so long, while others saw something drive before it, may be covered
[s]. Walls and guard rails have no boxes."""
VIEW_FROM_M, VIEW_TO_M, VIEW_SLOPE, VIEW_MPS = 8.0, 30.0, 0.3, 3.0
"""What drives faster than this, between these distances and not further aside than this share of
them, is in a camera's picture [m, m, -, m/s]."""
LATELY_S = 0.5
"""Others have seen it so lately [s]."""


class SensorHealth:
    """Health of S cars' sensors."""

    def __init__(self, slots: int) -> None:
        """Begin with healthy sensors."""
        self.free_to_m = np.zeros(slots)
        """LiDAR sees the road in the path up to here."""
        self.reach_m = np.zeros(slots)
        """LiDAR has seen obstacles as far as this lately."""
        self.sight_m = np.full(slots, CLEAR_M)
        """Distance up to which a dark object is seen through air, fog and rain."""
        self.camera_blind = np.zeros(slots, bool)
        self.range_blind = np.zeros(slots, bool)
        """Whether all sensors of distance (LiDAR, radar) are blind; not where there are none."""
        self.radar_sees = np.zeros(slots, bool)
        """Whether there is a radar and it is not silent."""
        self._returned = np.ones(slots)
        self._camera_s, self._lidar_s, self._radar_s = (np.zeros(slots) for _ in range(3))
        self._boxless_s = np.zeros(slots)
        self._foggy, self._dark, self._covered = (np.zeros(slots, bool) for _ in range(3))
        self._lidar_blind = np.zeros(slots, bool)
        self._words: list[tuple[str, ...]] = [()] * slots
        self._limited_s: list[dict[str, float]] = [{} for _ in range(slots)]

    def reset(self, slot: int) -> None:
        """A new case begins in ``slot``."""
        for values in (
            *(self.free_to_m, self.reach_m, self.camera_blind, self.range_blind, self._camera_s),
            *(self._lidar_s, self._radar_s, self._boxless_s, self._foggy, self._dark),
            *(self._covered, self._lidar_blind, self.radar_sees),
        ):
            values[slot] = 0
        self._returned[slot] = 1.0
        self.sight_m[slot] = CLEAR_M
        self._words[slot] = ()
        self._limited_s[slot] = {}

    def swept(self, slot: int, reach_m: float, free_to_m: float, returned: float) -> None:
        """A LiDAR sweep of ``slot``: how far it saw obstacles and road, the share that returned."""
        self.reach_m[slot] = max(reach_m, REACH_KEPT * self.reach_m[slot])
        self.free_to_m[slot] = free_to_m
        self._returned[slot] = returned
        self._lidar_s[slot] = 0.0

    def pictured(self, slot: int, boxes: int) -> None:
        """A picture of ``slot`` with so many boxes."""
        self._camera_s[slot] = 0.0
        if boxes:
            self._boxless_s[slot] = 0.0

    def echoed(self, slot: int) -> None:
        """Radar detections of ``slot`` came in."""
        self._radar_s[slot] = 0.0

    def update(
        self,
        environment: np.ndarray,
        period_s: np.ndarray,
        has_lidar: np.ndarray,
        has_radar: np.ndarray,
        in_view: np.ndarray,
    ) -> None:
        """One control tick.

        Args:
            environment: light and visibility sensor, float64 [S, 2].
            period_s: since the last tick [s].
            has_lidar: bool [S]: the stack looks at one.
            has_radar: bool [S]: likewise.
            in_view: bool [S]: others see something drive where the camera looks.
        """
        for clock in (self._camera_s, self._lidar_s, self._radar_s):
            clock += period_s
        self._boxless_s += np.where(in_view, period_s, 0.0)
        illuminance, extinction = environment[:, 0], environment[:, 1]
        self._foggy = extinction * VIEW_MIN_M > CONTRAST
        self.sight_m = CONTRAST / np.maximum(extinction, CONTRAST / CLEAR_M)
        self._dark = illuminance < DARK_LX
        self._covered = self._boxless_s > BOXLESS_S
        silent = self._camera_s > SILENT_S
        self.camera_blind = self._foggy | self._covered | silent
        self._lidar_blind = has_lidar & (
            (self._lidar_s > SILENT_S)
            | (self._returned < RETURNED_MIN)
            | ((self.reach_m < REACH_MIN_M) & (self.free_to_m < REACH_MIN_M))
        )
        self.free_to_m = np.where(self._lidar_s > SILENT_S, 0.0, self.free_to_m)
        radar_blind = has_radar & (self._radar_s > SILENT_S)
        self.radar_sees = has_radar & ~radar_blind
        has_range = has_lidar | has_radar
        sees = (has_lidar & ~self._lidar_blind) | self.radar_sees
        self.range_blind = has_range & ~sees

    def words(
        self, slot: int, period_s: float, *, has_lidar: bool, has_radar: bool
    ) -> tuple[str, ...] | None:
        """What limits the sensors of ``slot`` now, in words; None: the same as at the last call,
        ``period_s`` before."""
        words = []
        if self._camera_s[slot] > SILENT_S:
            words.append("camera silent")
        if self._foggy[slot]:
            words.append("camera blind by fog")
        if self._dark[slot]:
            words.append("camera in the dark")
        if self._covered[slot]:
            words.append("camera sees nothing, its lens may be covered")
        if has_lidar:
            if self._lidar_s[slot] > SILENT_S:
                words.append("lidar silent")
            elif self._returned[slot] < RETURNED_MIN:
                words.append("lidar blocked, few rays come back")
            elif self._lidar_blind[slot]:
                words.append("lidar blind, nothing within its reach")
        if has_radar and self._radar_s[slot] > SILENT_S:
            words.append("radar silent")
        limited_s = self._limited_s[slot]
        for limit in words:
            limited_s[limit] = limited_s.get(limit, 0.0) + period_s
        if tuple(words) == self._words[slot]:
            return None
        self._words[slot] = tuple(words)
        return self._words[slot]

    def limited(self, slot: int) -> dict[str, float]:
        """How long what limited the sensors of a slot, since this was asked last [s]."""
        limited_s, self._limited_s[slot] = self._limited_s[slot], {}
        return limited_s


def drives_in_view(tracks: TrackStore) -> np.ndarray:
    """bool [S]: LiDAR or radar see something drive that a camera would show, so near and straight
    ahead that any has it in its picture."""
    seen = np.minimum(tracks.lidar.age_s, tracks.radar.age_s) < LATELY_S
    near = (tracks.x_m > VIEW_FROM_M) & (tracks.x_m < VIEW_TO_M)
    near &= np.abs(tracks.y_m) < VIEW_SLOPE * tracks.x_m
    drives = (tracks.vx_mps * tracks.vx_mps > VIEW_MPS * VIEW_MPS) & (tracks.p_vv < KNOWN_VARIANCE)
    shown: np.ndarray = (tracks.live & seen & near & drives & (tracks.age_s > 1.0)).any(axis=1)
    return shown
