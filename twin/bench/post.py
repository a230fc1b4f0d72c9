"""Time of the post-processing per effect and of the whole chain, on a made-up street.

Times are the best of several rounds: other load on the machine only ever slows a round down.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import warp as wp

from schemas.sections.lens import EFFECTS, Lens
from twin.render.light.light import SlotLight
from twin.render.post.chain import PostEffects, bytes_needed
from twin.render.tone import tone_table
from twin.world.mirror import Mirror

OUT_OF_FOCUS = Lens(sensor_width_mm=36.0, f_number=1.4, focus_m=8.0, shutter_s=0.025)
"""A full-frame lens, wide open, and a slow shutter: the dearest pictures in daily use."""
_ROUNDS = 5
_REPEATS = {"cpu": 1, "cuda": 10}


def measure(device: str, slots: int, width: int, height: int) -> dict[str, Any]:
    """Milliseconds for one frame of all ``slots``.

    Returns:
        ``effects_ms``: the last step alone (``tone``) and what every effect adds to it;
        ``chain_ms``: all effects, :data:`OUT_OF_FOCUS`; ``chain_default_ms``: the default lens;
        ``frames_per_s`` of ``chain_ms``; ``bytes``: memory besides the pictures that are read.
    """
    warp_device = wp.get_device(device)
    frame = _Frame(slots, width, height, warp_device)
    tone = frame.milliseconds([], OUT_OF_FOCUS)
    effects = {name: frame.milliseconds([name], OUT_OF_FOCUS) - tone for name in EFFECTS}
    chain = frame.milliseconds(EFFECTS, OUT_OF_FOCUS)
    return {
        "device": device,
        "slots": slots,
        "width": width,
        "height": height,
        "effects_ms": {"tone": tone, **effects},
        "chain_ms": chain,
        "chain_default_ms": frame.milliseconds(EFFECTS, Lens()),
        "frames_per_s": slots * 1e3 / chain,
        "bytes": bytes_needed(slots, height, width, EFFECTS),
    }


class _Frame:
    """A street of sky, ground and a row of cars; the camera drives at 14 m/s."""

    def __init__(self, slots: int, width: int, height: int, device: wp.Device) -> None:
        self._slots, self._width, self._height, self._device = slots, width, height, device
        rows, columns = np.mgrid[:height, :width]
        down = (rows + 0.5 - height / 2) / height
        depth = np.where(down > 0.0, 1.0 / np.maximum(down, 1e-3), np.inf)
        cars = (np.abs(down - 0.05) < 0.1) & (columns // max(1, width // 8) % 2 == 0)
        depth[cars] = 3.0 + 2.0 * (columns[cars] * 8 // width)
        nearer = np.where(np.isfinite(depth), 0.7 / np.minimum(depth, 1e6), 0.0)
        flow = np.stack([(columns - width / 2) * nearer, (rows - height / 2) * nearer], axis=-1)
        pattern = 0.2 + 0.1 * ((rows // 4 + columns // 4) % 2)
        light = np.repeat(pattern[..., None], 3, axis=-1)
        self._hdr = self._filled(light.astype(np.float16), wp.float16)
        self._depth = self._filled(depth.astype(np.float32), wp.float32)
        self._flow = self._filled(flow.astype(np.float32), wp.float32)
        self._image = wp.zeros((slots, height, width, 3), dtype=wp.uint8, device=device)
        self._lights = Mirror((slots,), SlotLight, device)
        self._lights.host["active"], self._lights.host["noise"] = 1, 1
        self._lights.push()
        self._table = wp.array(tone_table(), dtype=wp.uint8, device=device)

    def _filled(self, one: np.ndarray, dtype: Any) -> wp.array:
        """``one`` in every slot."""
        picture = wp.array(one, dtype=dtype, device=self._device)
        every = wp.empty((self._slots, *one.shape), dtype=dtype, device=self._device)
        for slot in range(self._slots):
            wp.copy(every, picture, dest_offset=slot * picture.size, count=picture.size)
        return every

    def milliseconds(self, effects: Any, lens: Lens) -> float:
        """One frame with ``effects``."""
        post = PostEffects(effects, lens, self._slots, self._height, self._width, self._device)
        repeats = _REPEATS["cpu" if self._device.is_cpu else "cuda"]
        best = float("inf")
        for _ in range(_ROUNDS):
            wp.synchronize_device(self._device)
            started = time.perf_counter()
            for _ in range(repeats):
                post.apply(
                    self._hdr,
                    self._depth,
                    self._flow,
                    self._lights.device,
                    self._table,
                    self._image,
                )
            wp.synchronize_device(self._device)
            best = min(best, (time.perf_counter() - started) / repeats * 1e3)
        return best
