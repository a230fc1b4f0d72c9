"""The network that ``learn_lane.py`` has taught, as a stack; NumPy is all it needs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from devkit.stack import Observation, Stack
from schemas.messages import VEHICLE_COLUMNS, Command, Episode

SPEED_MPS = 8.0
STEERING_MAX_RAD = 0.6
ROWS, COLUMNS = 36, 64
"""Size of the pictures that the network looks at."""
SPEED = VEHICLE_COLUMNS.index("speed_mps")


def shrunk(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """A camera picture, uint8 [H, W, 3], as the network takes it: means of rectangles, [3, 36, 64].

    They come from sums of whole numbers over all above and to the left of each corner.
    """
    sums = np.zeros((picture.shape[0] + 1, picture.shape[1] + 1, 3), np.int64)
    sums[1:, 1:] = picture.cumsum(0, dtype=np.int64).cumsum(1)
    top, bottom = _edges(picture.shape[0], ROWS)
    left, right = _edges(picture.shape[1], COLUMNS)
    inside = sums[bottom][:, right] - sums[top][:, right]
    inside += sums[top][:, left] - sums[bottom][:, left]
    areas = np.outer(bottom - top, right - left)[..., None]
    return np.moveaxis(inside / areas / 255.0 - 0.5, 2, 0).astype(np.float32)


def _edges(size: int, parts: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First pixel of each part, and the one behind its last; parts may share a pixel."""
    numbers = np.arange(parts)
    return numbers * size // parts, -(-(numbers + 1) * size // parts)


def pedals(speed_mps: float) -> tuple[float, float]:
    """Throttle and brake that hold the speed."""
    wish = 0.15 + 0.2 * (SPEED_MPS - speed_mps)
    return min(max(wish, 0.0), 1.0), min(max(-wish, 0.0), 0.3)


class LearnedLane(Stack):
    """It steers with every picture, holds the speed, and brakes for nothing."""

    drives_by_camera = True
    reads = ("vehicle", "camera")

    def __init__(self, slots: int, *, model: str = "") -> None:
        """``model``: file that the script has written."""
        super().__init__(slots)
        if not model:
            raise ValueError("model: none given; give the path of lane.npz")
        with np.load(model) as file:
            self.layers = [(file[f"weight{i}"], file[f"bias{i}"]) for i in range(5)]
        self.answers = [(0.0, 0.0, 0.0)] * slots

    def reset(self, slot: int, episode: Episode) -> None:  # noqa: ARG002 - nothing to know
        """A case begins."""
        self.answers[slot] = (0.0, 0.0, 0.0)

    def step(self, observation: Observation) -> list[Command]:
        """Picture by picture: what is asked of a car does not depend on others."""
        camera, commands = observation.sensors.get("camera"), []
        for slot in observation.active_slots():
            if camera is not None:
                speed_mps = float(observation.sensors["vehicle"][slot, SPEED])
                self.answers[slot] = (*pedals(speed_mps), self.angle_rad(camera[slot]))
            token, tick = int(observation.token[slot]), int(observation.tick[slot])
            commands.append(Command(slot, token, tick, *self.answers[slot]))
        return commands

    def angle_rad(self, picture: NDArray[np.uint8]) -> float:
        """Road-wheel angle for a picture."""
        values = shrunk(picture)
        for weight, bias in self.layers[:3]:  # 3 x 3, every other pixel
            padded = np.pad(values, ((0, 0), (1, 1), (1, 1)))
            windows = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), (1, 2))[:, ::2, ::2]
            values = np.einsum("oikl,ihwkl->ohw", weight, windows) + bias[:, None, None]
            values = np.maximum(values, 0.0)
        (hidden, hidden_bias), (last, last_bias) = self.layers[3:]
        known = np.maximum(hidden @ values.reshape(-1) + hidden_bias, 0.0)
        return STEERING_MAX_RAD * float(np.tanh(last @ known + last_bias)[0])
