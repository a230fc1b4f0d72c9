"""Variations of a batch of images, all on the device at once: crop, scale, shift, flip, colour.

As in Darknet (``detection`` data): every edge of the picture moves by a random share, so that it is
cropped, enlarged, made smaller, shifted and distorted in one; then mirrored; then hue, saturation
and brightness change. Hue and saturation are turned and stretched in YIQ rather than HSV, which is
one 3 x 3 matrix per image. Random numbers come from the host, once per epoch, so that they are the
same on every device.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from devkit.training.examples import IGNORED, LABEL, NOTHING, Boxes
from devkit.training.parameters import TrainingRecipe

CHANCES = 8
"""Random numbers per image: four edges, flip, hue, saturation, exposure."""

_YIQ_FROM_RGB = (
    (0.299, 0.587, 0.114),
    (0.595716, -0.274453, -0.321263),
    (0.211456, -0.522591, 0.311135),
)
"""NTSC 1953 (Foley et al., Computer Graphics, section 13.3.3)."""


def plan_epoch(seed: int, epoch: int, images: int) -> tuple[np.ndarray, np.ndarray]:
    """Order of the images, int64 [N], and their chances, float32 [N, CHANCES], 0 to 1."""
    rng = np.random.default_rng([seed, epoch])
    return rng.permutation(images), rng.random((images, CHANCES), dtype=np.float32)


class Augmentation:
    """Variations by ``recipe`` of images of one size."""

    def __init__(
        self, recipe: TrainingRecipe, width: int, height: int, device: torch.device
    ) -> None:
        """Sizes in pixels."""
        self._recipe = recipe
        self._size_px = torch.tensor([width, height], dtype=torch.float32, device=device)
        yiq = np.array(_YIQ_FROM_RGB)
        self._yiq = torch.tensor(yiq, dtype=torch.float32, device=device)
        self._rgb = torch.tensor(np.linalg.inv(yiq), dtype=torch.float32, device=device)

    def images(self, images: Tensor, chance: Tensor) -> Tensor:
        """uint8 [B, H, W, 3] -> float32 [B, 3, H, W], 0 to 1; outside the picture it is grey."""
        low, high = self._window(chance)
        mirrored = self._mirrored(chance)
        # Places of the picture, -1 to 1, as a linear function of those of the result.
        scale, centre = high - low, low + high - 1.0
        zero = torch.zeros_like(mirrored)
        sign = torch.where(mirrored, -1.0, 1.0)
        theta = torch.stack(
            [
                torch.stack([scale[:, 0] * sign, zero, centre[:, 0]], dim=1),
                torch.stack([zero, scale[:, 1], centre[:, 1]], dim=1),
            ],
            dim=1,
        )
        values = images.permute(0, 3, 1, 2).float() / 255.0 - 0.5
        grid = functional.affine_grid(theta, list(values.shape), align_corners=False)
        values = functional.grid_sample(values, grid, align_corners=False) + 0.5
        return self._recoloured(values, chance)

    def boxes(self, boxes: Boxes, chance: Tensor) -> Boxes:
        """Boxes of the varied images, cut at their edges; see :class:`TrainingRecipe` for what is
        ignored then."""
        low, high = self._window(chance)
        scale = (high - low)[:, None]
        centre = (boxes.box[..., :2] - low[:, None]) / scale
        mirrored = self._mirrored(chance)[:, None]
        x = torch.where(mirrored, 1.0 - centre[..., 0], centre[..., 0])
        centre = torch.stack([x, centre[..., 1]], dim=2)
        half = 0.5 * boxes.box[..., 2:] / scale
        first, last = (centre - half).clamp(0.0, 1.0), (centre + half).clamp(0.0, 1.0)
        size = last - first
        whole = (4.0 * half[..., 0] * half[..., 1]).clamp(min=1e-12)
        left = size[..., 0] * size[..., 1] / whole
        long_px = (size * self._size_px).amax(dim=2)
        poor = (left < self._recipe.remaining_min) | (long_px < self._recipe.side_px_min)
        gone = (size <= 0.0).any(dim=2) | (boxes.kind == NOTHING)
        kind = torch.where(poor & (boxes.kind == LABEL), IGNORED, boxes.kind)
        kind = torch.where(gone, NOTHING, kind)
        return Boxes(torch.cat([0.5 * (first + last), size], dim=2), boxes.class_id, kind)

    def _window(self, chance: Tensor) -> tuple[Tensor, Tensor]:
        """Corners [B, 2] of the part of the picture that is shown, shares of it."""
        moved = (2.0 * chance[:, :4] - 1.0) * self._recipe.jitter
        return moved[:, :2], 1.0 - moved[:, 2:]

    def _mirrored(self, chance: Tensor) -> Tensor:
        return chance[:, 4] < self._recipe.flip

    def _recoloured(self, values: Tensor, chance: Tensor) -> Tensor:
        recipe = self._recipe
        angle = (2.0 * chance[:, 5] - 1.0) * (2.0 * math.pi * recipe.hue)
        saturation = torch.exp((2.0 * chance[:, 6] - 1.0) * math.log(recipe.saturation))
        exposure = torch.exp((2.0 * chance[:, 7] - 1.0) * math.log(recipe.exposure))
        zero, one = torch.zeros_like(angle), torch.ones_like(angle)
        cos, sin = saturation * torch.cos(angle), saturation * torch.sin(angle)
        turn = torch.stack([one, zero, zero, zero, cos, -sin, zero, sin, cos], dim=1)
        matrix = exposure[:, None, None] * (self._rgb @ turn.view(-1, 3, 3) @ self._yiq)
        # Sums of three channels, written out: the layout of the values stays as it is.
        red, green, blue = values.unbind(dim=1)
        weights = matrix[:, :, :, None, None]
        mixed = [
            weights[:, row, 0] * red + weights[:, row, 1] * green + weights[:, row, 2] * blue
            for row in range(3)
        ]
        return torch.stack(mixed, dim=1).clamp(0.0, 1.0)
