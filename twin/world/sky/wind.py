"""Wind of every slot: a mean and gusts along and across it, as a vehicle in the street feels them.

Gusts after Dryden's model of MIL-F-8785C near the ground: at 3 m above it sigma_u = sigma_v =
0.2 W and L_u = L_v = 23 m for a wind of W. The spectrum of the longitudinal component is that of a
first-order Gauss-Markov process of correlation time L / W (frozen turbulence blown past); the
lateral one is taken alike. Sampled once per control period so that its statistics do not depend on
the rate. The numbers of a case follow from its stream and tick alone.
"""

from __future__ import annotations

import numpy as np

LENGTH_M = 23.0
"""Scale of turbulence [m]."""
_SLOWEST_MPS = 0.5

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_A = np.uint64(0xBF58476D1CE4E5B9)
_MIX_B = np.uint64(0x94D049BB133111EB)
_S27, _S30, _S31 = (np.uint64(n) for n in (27, 30, 31))
_SHIFTS = tuple(np.uint64(n) for n in (0, 16, 32, 48))
_SIXTEEN = np.uint64(0xFFFF)
_SUM_MEAN = 12 * 65535 / 2
_SUM_SIGMA = 65535.999992370605  # sqrt(12 (2^32 - 1) / 12)


class Winds:
    """Wind of all slots, advanced together; ``now`` float64 [S, 2], world x and y [m/s]."""

    def __init__(self, slots: int, period_s: float) -> None:
        """``period_s``: between calls of :meth:`advance` [s]."""
        self.now = np.zeros((slots, 2))
        self._period_s = period_s
        self._key = np.zeros(slots, np.uint64)
        self._gust = np.zeros((slots, 2))  # along and across, over their standard deviation
        self._mean = np.zeros(slots)
        self._sigma = np.zeros(slots)
        self._toward = np.zeros((slots, 2))
        self._held: dict[int, np.ndarray] = {}
        """Gusts of slots that stand still."""

    def reset(self, slot: int, key: int, toward: tuple[float, float]) -> None:
        """Begin a case: the key of its stream, and the unit vector along its wind."""
        self.clear(slot)
        self._key[slot] = np.uint64(key)
        self._toward[slot] = toward

    def redraw(self, slot: int, key: int) -> None:
        """Draw by another key from the next period on; the gusts go on from what they are."""
        self._key[slot] = np.uint64(key)

    def set(self, slot: int, mean_mps: float, gust_mps: float) -> None:
        """Strength of a slot's wind from now on: mean and standard deviation of its gusts."""
        self._mean[slot], self._sigma[slot] = mean_mps, gust_mps

    def turn(self, slot: int, toward: tuple[float, float]) -> None:
        """Direction of a slot's wind from now on, a unit vector along it."""
        self._toward[slot] = toward

    def clear(self, slot: int) -> None:
        """Calm a slot."""
        for array in (self.now, self._gust, self._toward):
            array[slot] = 0.0
        self._held.pop(slot, None)
        self._mean[slot] = self._sigma[slot] = 0.0

    def hold(self, slot: int, *, held: bool) -> None:
        """A slot stands still, or goes on as if nothing had been advanced since."""
        if held:
            self._held[slot] = self._gust[slot].copy()
        else:
            self._gust[slot] = self._held.pop(slot)

    def save(self, slot: int) -> dict[str, np.ndarray]:
        """The stream and the gusts of a slot; strength and direction are set from outside."""
        names = ("_key", "_gust", "now")
        return {name: getattr(self, name)[slot].copy() for name in names}

    def restore(self, slot: int, saved: dict[str, np.ndarray]) -> None:
        """Go on from saved gusts."""
        for name, values in saved.items():
            getattr(self, name)[slot] = values

    def advance(self, tick: np.ndarray) -> np.ndarray:
        """Wind during the control period that begins at each slot's case ``tick`` [S]: ``now``.

        Call once per tick, from tick 0 on.
        """
        fresh = gaussian_pairs(self._key, tick)
        # e^-h by its Pade approximant, right to h^3 / 12; the variance is exact whatever it is.
        half = 0.5 * self._period_s * np.maximum(self._mean, _SLOWEST_MPS) / LENGTH_M
        keep = np.where(tick == 0, 0.0, (1.0 - half) / (1.0 + half))
        self._gust[...] = keep[:, None] * self._gust + np.sqrt(1.0 - keep * keep)[:, None] * fresh
        along = self._mean + self._sigma * self._gust[:, 0]
        across = self._sigma * self._gust[:, 1]
        x, y = self._toward[:, 0], self._toward[:, 1]
        self.now[:, 0] = along * x - across * y
        self.now[:, 1] = along * y + across * x
        return self.now


def gaussian_pairs(key: np.ndarray, tick: np.ndarray) -> np.ndarray:
    """Two nearly normal numbers per stream ``key`` uint64 [S] and case ``tick`` [S]: [S, 2].

    The counter-based generator of :mod:`twin.render.noise`, on the host. Each is the sum of twelve
    uniform 16-bit numbers, so up to 6 sigma: sums and products of integers, the same bits on every
    host, where logarithms and cosines differ between instruction sets.
    """
    out = np.zeros((len(key), 2))
    with np.errstate(over="ignore"):
        base = _mixed(key + _GOLDEN * (tick.astype(np.uint64) + np.uint64(1)))
        for element in range(6):
            bits = _mixed(base + _GOLDEN * np.uint64(element + 1))
            for shift in _SHIFTS:
                out[:, element % 2] += (bits >> shift) & _SIXTEEN
    return (out - _SUM_MEAN) / _SUM_SIGMA


def _mixed(x: np.ndarray) -> np.ndarray:
    x = (x ^ (x >> _S30)) * _MIX_A
    x = (x ^ (x >> _S27)) * _MIX_B
    return x ^ (x >> _S31)
