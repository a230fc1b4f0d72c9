import math

import numpy as np
from msgspec import UNSET


class Thermometer:
    def __init__(self, mount):
        self.every = mount.every
        self._period_s = 1.0 / mount.hz
        self._now_c = np.zeros(mount.slots)
        self._air_c = np.zeros(mount.slots)
        self._share = np.zeros(mount.slots)
        self._active = np.zeros(mount.slots, np.bool_)

    def reset(self, slot, case):
        air_c = case.variation.scenario.air_c
        self._now_c[slot], self._air_c[slot] = 20.0, 20.0 if air_c is UNSET else air_c
        lag_s = case.variation.sensors.thermometer.lag_s
        self._share[slot] = -math.expm1(-self._period_s / lag_s)
        self._active[slot] = True

    def clear(self, slot):
        self._active[slot] = False

    def hold(self, slot, *, held):
        self._active[slot] = not held

    def modulate(self, slot, errors):
        pass

    def read(self, truth, tick):
        seen = np.where(self._active, self._now_c, 0.0)[:, None]
        self._now_c += np.where(self._active, self._share * (self._air_c - self._now_c), 0.0)
        return seen
