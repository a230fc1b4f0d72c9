"""Post-processing of a camera: what lens, shutter and film do to light, in the order it happens.

Works on linear pixels of all slots at once; nothing depends on the slot, and there are no sums
across threads. Effects that are off, or whose amount is 0, cost nothing: their kernels do not run,
or are not in the last one.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import warp as wp

from schemas.sections.lens import EFFECTS, Lens
from schemas.sections.lens_curve import check_lens
from schemas.validation import suggest
from twin.render.post import bloom as post_bloom
from twin.render.post import focus as post_focus
from twin.render.post import motion as post_motion
from twin.render.post.bloom import Bloom, bloom_bytes
from twin.render.post.film import falloff, film_kernel, film_of
from twin.render.post.focus import FocusBlur, focus_bytes, focus_of
from twin.render.post.motion import MotionBlur, motion_bytes
from twin.world.kernel_loading import load_kernels


def check_effects(effects: Iterable[str]) -> tuple[str, ...]:
    """The effects in the order in which they are applied, each once.

    Raises:
        ValueError: one is not known.
    """
    given = list(effects)
    for name in given:
        if name not in EFFECTS:
            raise ValueError(f"unknown effect '{name}'; {suggest(name, list(EFFECTS))}")
    return tuple(name for name in EFFECTS if name in given)


def needs_depth(effects: Iterable[str]) -> bool:
    """Whether these effects read depth."""
    return "depth_of_field" in effects


def needs_flow(effects: Iterable[str]) -> bool:
    """Whether these effects read optical flow."""
    return "motion_blur" in effects


def effective(effects: Iterable[str], lens: Lens) -> tuple[str, ...]:
    """The effects that change a picture: those without an amount are left out."""
    amounts = {
        "motion_blur": lens.shutter_s,
        **{name: getattr(lens, name) for name in EFFECTS if name in Lens.__struct_fields__},
    }
    return tuple(name for name in check_effects(effects) if amounts.get(name, 1.0) > 0.0)


def bytes_needed(slots: int, height: int, width: int, effects: Iterable[str]) -> int:
    """Memory that :class:`PostEffects` allocates on its device [bytes].

    The linear picture (6 bytes per pixel), depth (4) and flow (8) that it reads are not included:
    they belong to the renderer.
    """
    on = check_effects(effects)
    total = slots * 4
    if "depth_of_field" in on or "motion_blur" in on:
        total += slots * height * width * 6
    if "depth_of_field" in on:
        total += focus_bytes(slots, height, width)
    if "motion_blur" in on:
        total += motion_bytes(slots, height, width)
    if "bloom" in on:
        total += bloom_bytes(slots, height, width)
    if "vignette" in on:
        total += height * width * 4
    return total


class PostEffects:
    """The effects of one camera, for all slots; everything is allocated here."""

    def __init__(
        self,
        effects: Iterable[str],
        lens: Lens,
        slots: int,
        height: int,
        width: int,
        device: wp.Device,
        *,
        hfov_deg: float = 70.0,
        hz: float = 20.0,
    ) -> None:
        """``hfov_deg`` and ``hz`` are those of the camera: field of view and frames per second.

        Raises:
            ValueError: an unknown effect, or a lens that does not fit the image.
        """
        check_lens(lens, width, height, hfov_deg)
        self.effects = effective(effects, lens)
        self.needs_depth = needs_depth(self.effects)
        self.needs_flow = needs_flow(self.effects)
        self.gain = wp.ones(slots, dtype=wp.float32, device=device)
        """Factor on the signal of each slot before noise and tone [-]."""
        self._shape = (slots, height, width)
        self._film = film_of(lens, height, width, hfov_deg)
        self._focus: FocusBlur | None = None
        self._motion: MotionBlur | None = None
        self._bloom: Bloom | None = None
        self._scratch: wp.array | None = None
        if self.needs_depth or self.needs_flow:
            self._scratch = wp.zeros((*self._shape, 3), dtype=wp.float16, device=device)
        if self.needs_depth:
            focus = focus_of(lens, height, width, hfov_deg)
            self._focus = FocusBlur(focus, slots, height, width, device)
        if self.needs_flow:
            share = min(1.0, lens.shutter_s * hz)
            self._motion = MotionBlur(share, slots, height, width, device)
        if "bloom" in self.effects:
            self._bloom = Bloom(slots, height, width, device)
        passed = np.ones((1, 1), np.float32)
        if "vignette" in self.effects:
            passed = falloff(lens, height, width, hfov_deg)
        self._passed = wp.array(passed, dtype=wp.float32, device=device)
        self._no_bloom = wp.zeros((1, 1, 1, 3), dtype=wp.float16, device=device)
        self._kernel = film_kernel(
            "chromatic_aberration" in self.effects,
            self._bloom is not None,
            "vignette" in self.effects,
            "grain" in self.effects,
        )
        self._device = device
        self._load()

    def _load(self) -> None:
        """Compile now, not in the first frame."""
        modules = (
            (self.needs_depth, post_focus),
            (self.needs_flow, post_motion),
            (self._bloom is not None, post_bloom),
        )
        wanted = [module for needed, module in modules if needed]
        load_kernels(self._device, [*wanted, self._kernel])

    def apply(
        self,
        hdr: wp.array,
        depth: wp.array | None,
        flow: wp.array | None,
        lights: wp.array,
        table: wp.array,
        image_out: wp.array,
    ) -> None:
        """Launch all effects; slots that are not active keep their image.

        Args:
            hdr: linear signal, float16 [S, H, W, 3]; **overwritten**, it serves as scratch memory.
            depth: distance along the optical axis, float32 [S, H, W] [m], +inf for the sky; may be
                None unless :attr:`needs_depth`; motion blur is better with it.
            flow: way of a pixel's point to where it was in the previous frame, float32
                [S, H, W, 2] (x, y) [px]; None unless :attr:`needs_flow`.
            lights: SlotLight [S]: active, noise, key and tick are read.
            table: of :func:`twin.render.tone.tone_table`.
            image_out: uint8 [S, H, W, 3].
        """
        image, spare = hdr, self._scratch
        if self._focus is not None:
            self._focus.blur(lights, image, depth, spare)
            image, spare = spare, image
        if self._motion is not None:
            self._motion.blur(lights, image, flow, depth, spare)
            image, spare = spare, image
        scattered = self._no_bloom
        if self._bloom is not None:
            scattered = self._bloom.spread(lights, image)
        wp.launch(
            self._kernel,
            self._shape,
            inputs=[self._film, table, self._passed, self.gain, lights, image, scattered],
            outputs=[image_out],
            device=self._device,
        )
