"""Ground-truth boxes: what the camera's own rays have hit, so hidden objects are not seen."""

from __future__ import annotations

import numpy as np
import warp as wp

from schemas.messages import BOX_COLUMNS, BOXES_MAX
from twin.world.kernel_loading import load_kernels
from twin.world.mirror import Mirror
from twin.world.relaunch import Relaunch

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

_BOXES_MAX = wp.constant(BOXES_MAX)
_BLOCK = 8
"""Threads of a block: a slot is a thread of its own length, see :mod:`twin.vehicle.fleet`."""


@wp.kernel
def boxes_kernel(
    # model
    classes: wp.array(dtype=wp.int32),
    # state in
    gathered: wp.array3d(dtype=wp.int32),
    # out
    boxes_out: wp.array3d(dtype=wp.float32),
    count_out: wp.array(dtype=wp.int32),
):
    """Gathered pixels [S, I, 6] -> boxes [S, B, 7], most visible pixels first, then instance id."""
    slot = wp.tid()
    count = wp.int32(0)
    last_pixels = wp.int32(2147483647)
    last_instance = wp.int32(-1)
    instances = gathered.shape[1]
    for b in range(_BOXES_MAX):
        best = wp.int32(-1)
        best_pixels = wp.int32(0)
        for i in range(instances):
            pixels = gathered[slot, i, 4]
            # Everything already taken has more pixels, or as many and a lower id.
            left = pixels < last_pixels or (pixels == last_pixels and i > last_instance)
            if left and pixels > best_pixels:
                best = i
                best_pixels = pixels
        for k in range(boxes_out.shape[2]):
            boxes_out[slot, b, k] = 0.0
        if best >= 0:
            low_x = gathered[slot, best, 0]
            low_y = gathered[slot, best, 1]
            boxes_out[slot, b, 0] = wp.float32(classes[best])
            boxes_out[slot, b, 1] = wp.float32(low_x)
            boxes_out[slot, b, 2] = wp.float32(low_y)
            boxes_out[slot, b, 3] = wp.float32(gathered[slot, best, 2] - low_x + 1)
            boxes_out[slot, b, 4] = wp.float32(gathered[slot, best, 3] - low_y + 1)
            boxes_out[slot, b, 5] = wp.float32(best_pixels)
            boxes_out[slot, b, 6] = wp.float32(gathered[slot, best, 5]) * 1.0e-4
            count += 1
            last_pixels = best_pixels
            last_instance = best
        else:
            instances = 0  # none is left
    count_out[slot] = count


class BoxSensor:
    """Boxes of all slots, columns :data:`schemas.messages.BOX_COLUMNS`.

    ``distance_m`` is the distance from the camera to the nearest point a ray has hit.
    """

    def __init__(self, classes: wp.array, slots: int, device: wp.Device) -> None:
        """``classes``: int32 [I], class of every instance, on the device."""
        self._launch = Relaunch(device)
        self._classes = classes
        self._boxes = Mirror((slots, BOXES_MAX, len(BOX_COLUMNS)), wp.float32, device)
        self._count = Mirror((slots,), wp.int32, device)
        load_kernels(device, [(boxes_kernel, _BLOCK)])

    def launch(self, gathered: wp.array) -> None:
        """Make boxes of the camera's gathered pixels."""
        self._launch(
            boxes_kernel,
            gathered.shape[0],
            [self._classes, gathered],
            [self._boxes.device, self._count.device],
            _BLOCK,
        )

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """The last boxes float32 [S, B, 7] and their count int32 [S]."""
        return self._boxes.pull(), self._count.pull()
