import numpy as np

from twin.sensors.data import SensorData
from twin.sensors.truth import ROTATION

ROWS_MAX = 32


class Sonar:
    needs_truth = True

    def __init__(self, mount, hz):
        self.every = mount.case.rig.control_hz // hz
        slots = mount.geometry.slots
        self._targets_m = mount.world.colliders[:, :2]
        self._range_m = np.zeros(slots)
        self._active = np.zeros(slots, np.bool_)
        self._truth = None

    def reset(self, slot, case):
        self._range_m[slot] = case.variation.sensors.sonar.range_m
        self._active[slot] = True

    def light(self, slot, light, weather, wind_towards):
        pass

    def clear(self, slot):
        self._active[slot] = False

    def hold(self, slot, *, held):
        self._active[slot] = not held

    def moved(self, slot):
        pass

    def advance(self, now):
        pass

    def launch(self, sight):
        self._truth = sight.truth

    def read(self):
        truth = self._truth.numpy()
        rows = np.zeros((len(truth), ROWS_MAX, 2), np.float32)
        count = np.zeros(len(truth), np.int32)
        for slot in np.flatnonzero(self._active):
            to_x, to_y = (self._targets_m - truth[slot, :2]).T
            _, _, qz, qw = truth[slot, ROTATION : ROTATION + 4]
            bearing = np.arctan2(to_y, to_x) - 2.0 * np.arctan2(qz, qw)
            far = np.hypot(to_x, to_y)
            order = np.argsort(far, kind="stable")
            seen = order[far[order] <= self._range_m[slot]][:ROWS_MAX]
            count[slot] = len(seen)
            rows[slot, : len(seen), 0] = far[seen]
            rows[slot, : len(seen), 1] = np.remainder(bearing[seen] + np.pi, 2 * np.pi) - np.pi
        return {"sonar": SensorData(rows, count)}
