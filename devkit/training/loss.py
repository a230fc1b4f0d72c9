"""The losses of YOLOv2 and YOLOv3, dense over all cells and anchors, in shapes known beforehand.

For a cell (i, j) of a grid W_g x H_g, an anchor (p_w, p_h) and raw values t, with the logistic s,
and an object b (centre and size as shares of the image) that they are responsible for:

=============  =====================================  ==========================================
part           YOLOv2 (``softmax``)                   YOLOv3 (``logistic``)
=============  =====================================  ==========================================
x, y           f/2 (s(t_x) - (b_x W_g - i))^2         f BCE(s(t_x), b_x W_g - i)
width, height  f/2 (t_w - ln(b_w W / p_w))^2          the same
objectness     5/2 (s(t_o) - IoU)^2                   BCE(s(t_o), 1)
background     1/2 s(t_o)^2                           BCE(s(t_o), 0)
class          cross-entropy of the softmax           sum over classes of BCE
=============  =====================================  ==========================================

with f = 2 - b_w b_h. Responsible is the cell of the object's centre and the anchor, of all heads
together, that overlaps its shape most. Everything else is background, unless its box overlaps an
object by more than a limit, in which case it has no loss. The recipe's scales (``box_scale`` and so
on) multiply the rows; the sum is divided by the number of images. (Redmon, Farhadi: YOLO9000, 2016;
YOLOv3, 2018; gradients as in Darknet's ``region_layer.c`` and ``yolo_layer.c``,
github.com/pjreddie/darknet.)

An ignored object is neither: boxes that overlap it, and the cell and anchor that would be
responsible for it, have no loss.

With ``box_loss: ciou`` the first two rows are f (1 - CIoU) of the decoded box (Zheng et al.,
Distance-IoU Loss, 2020).

Nothing here waits for the device, and no result depends on the order in which it works: cells are
claimed by the largest index, which is the same in any order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from devkit.darknet.network import DarknetNetwork, Head
from devkit.training.examples import IGNORED, LABEL, Boxes
from devkit.training.parameters import TrainingRecipe

EXPONENT_MAX = 8.0
"""Larger exponents of a box's size are cut in the overlap: no object is e^8 anchors wide."""

OBJECT_SCALE = {"softmax": 5.0, "logistic": 1.0}
"""Factor of the objectness of objects in the papers' cfg files."""

OVERLAP_IGNORED = {"softmax": 0.6, "logistic": 0.7}
"""Boxes that overlap an object more than this are no background, as in the papers' cfg files."""

PARTS = ("box", "objectness", "background", "class")


class Losses(NamedTuple):
    """Scalars, per image."""

    box: Tensor
    objectness: Tensor
    background: Tensor
    class_: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class Claims:
    """The object that each of P places is responsible for.

    A place is an anchor in a cell of a head, counted head by head, anchor by anchor, row by row.
    """

    owner: Tensor
    """int64 [B, P]: index of the object from 1, 0 where there is none."""
    dropped: Tensor
    """bool [B, P]: it would be responsible for an ignored object."""


class GridLoss:
    """Loss of all heads of a network."""

    def __init__(
        self, network: DarknetNetwork, recipe: TrainingRecipe, device: torch.device
    ) -> None:
        self._recipe = recipe
        self._heads = network.heads()
        size = torch.tensor([network.input.width, network.input.height], dtype=torch.float32)
        self._anchors = [
            (torch.tensor(head.anchors_px, dtype=torch.float32) / size).to(device)
            for head in self._heads
        ]
        self._all_anchors = torch.cat(self._anchors)
        self._places = [len(h.anchors_px) * h.shape.height * h.shape.width for h in self._heads]
        # Rows, columns and first place of every anchor.
        grids, first = [], 0
        for head in self._heads:
            rows, columns = head.shape[1:]
            for _ in head.anchors_px:
                grids.append((rows, columns, first))
                first += rows * columns
        self._grids = torch.tensor(grids, device=device).unbind(dim=1)

    def __call__(self, raw: list[Tensor], truth: Boxes) -> Losses:
        """Losses of a batch.

        Args:
            raw: float32 [B, A (5 + C), H, W] of every head.
            truth: B images.
        """
        claims = self.claim(truth)
        owners = torch.split(claims.owner, self._places, dim=1)
        dropped = torch.split(claims.dropped, self._places, dim=1)
        parts = [
            self._of_head(head, values.float(), anchors, Claims(*claims_of_head), truth)
            for head, values, anchors, *claims_of_head in zip(
                self._heads, raw, self._anchors, owners, dropped, strict=True
            )
        ]
        images = len(truth.box)
        return Losses(*(torch.stack(column).sum() / images for column in zip(*parts, strict=True)))

    @torch.no_grad()
    def claim(self, truth: Boxes) -> Claims:
        """Places that are responsible for the objects.

        An object takes its best anchor in the cell of its centre; of two that want the same place
        the later one gets it. With more than one choice the other one takes its next best anchor
        there, if that is free.
        """
        rows, columns, first = self._grids
        column = torch.minimum((truth.box[..., :1] * columns).long(), columns - 1).clamp(min=0)
        row = torch.minimum((truth.box[..., 1:2] * rows).long(), rows - 1).clamp(min=0)
        place = first + row * columns + column
        overlap = shape_overlap(truth.box[..., 2:], self._all_anchors)
        preference = overlap.argsort(dim=2, descending=True, stable=True)
        number = torch.arange(1, place.shape[1] + 1, device=place.device).expand(place.shape[:2])
        places = sum(self._places)
        label = truth.kind == LABEL
        owner = torch.zeros((len(place), places), dtype=torch.int64, device=place.device)
        placed = torch.zeros_like(label)
        for choice in range(min(self._recipe.anchor_choices, place.shape[2])):
            wanted = place.gather(2, preference[..., choice : choice + 1])[..., 0]
            asks = label & ~placed & (owner.gather(1, wanted) == 0)
            new = _largest(torch.where(asks, wanted, places), torch.where(asks, number, 0), places)
            owner = torch.where(owner > 0, owner, new)
            placed = placed | (asks & (owner.gather(1, wanted) == number))
        best = place.gather(2, preference[..., :1])[..., 0]
        skipped = truth.kind == IGNORED
        dropped = _largest(torch.where(skipped, best, places), skipped.long(), places) > 0
        return Claims(owner, dropped)

    def _of_head(
        self, head: Head, raw: Tensor, anchors: Tensor, claims: Claims, truth: Boxes
    ) -> list[Tensor]:
        recipe = self._recipe
        images, _, rows, columns = raw.shape
        grid = raw.view(images, len(anchors), 5 + head.classes, rows, columns)
        # [B, A, H, W, 5 + C]
        values = grid.permute(0, 1, 3, 4, 2)
        box = decoded(values, anchors, head.scale_xy)
        index = (claims.owner - 1).clamp(min=0)
        target = torch.gather(truth.box, 1, index[..., None].expand(-1, -1, 4)).view_as(box)
        class_id = torch.gather(truth.class_id, 1, index).view(box.shape[:4])
        owned = (claims.owner > 0).view(box.shape[:4])
        dropped = claims.dropped.view(box.shape[:4])
        near = self._near(box.detach(), truth, OVERLAP_IGNORED[head.scores])
        taken, empty = owned.float(), (~(owned | near | dropped)).float()
        scale = taken * (2.0 - _area(target))
        if recipe.box_loss == "ciou":
            offset = 1.0 - complete_overlap(box, target)
        else:
            offset = _squared_offset(values, target, anchors, head)
        wanted = (class_id[..., None] == torch.arange(head.classes, device=raw.device)).float()
        if head.scores == "softmax":
            certain = torch.sigmoid(values[..., 4])
            object_loss = 0.5 * (certain - aligned_overlap(box.detach(), target)) ** 2
            missed = 0.5 * certain**2
            kinds = -(functional.log_softmax(values[..., 5:], dim=4) * wanted).sum(dim=4)
        else:
            object_loss = functional.softplus(-values[..., 4])
            missed = functional.softplus(values[..., 4])
            kinds = functional.binary_cross_entropy_with_logits(
                values[..., 5:], wanted, reduction="none"
            ).sum(dim=4)
        return [
            recipe.box_scale * (scale * offset).sum(),
            recipe.object_scale * OBJECT_SCALE[head.scores] * (taken * object_loss).sum(),
            recipe.background_scale * (empty * missed).sum(),
            recipe.class_scale * (taken * kinds).sum(),
        ]

    @torch.no_grad()
    def _near(self, box: Tensor, truth: Boxes, overlap_ignored: float) -> Tensor:
        """Which boxes [B, A, H, W, 4] overlap an object too much to be background."""
        overlap = pair_overlap(box.flatten(1, 3), truth.box)
        limit = torch.where(
            truth.kind == LABEL,
            overlap_ignored,
            torch.where(truth.kind == IGNORED, self._recipe.overlap_dropped, 2.0),
        )
        return (overlap > limit[:, None]).any(dim=2).view(box.shape[:4])


def _largest(cell: Tensor, rank: Tensor, cells: int) -> Tensor:
    """Largest rank [B, M] that was put into each of ``cells``, int64 [B, cells]; 0 where there is
    none. The cell behind the last one takes what belongs nowhere."""
    largest = torch.zeros((len(cell), cells + 1), dtype=rank.dtype, device=rank.device)
    largest.scatter_reduce_(1, cell, rank, "amax")
    return largest[:, :cells]


def decoded(values: Tensor, anchors: Tensor, scale_xy: float) -> Tensor:
    """Raw values [B, A, H, W, 5 + C] -> boxes [B, A, H, W, 4]: centre and size, shares of the
    image; as :mod:`devkit.detector.decode` has it."""
    rows, columns = values.shape[2:4]
    centre = torch.sigmoid(values[..., :2]) * scale_xy - 0.5 * (scale_xy - 1.0)
    y, x = torch.meshgrid(
        torch.arange(rows, device=values.device),
        torch.arange(columns, device=values.device),
        indexing="ij",
    )
    x, y = (x + centre[..., 0]) / columns, (y + centre[..., 1]) / rows
    size = torch.exp(values[..., 2:4].clamp(max=EXPONENT_MAX)) * anchors[:, None, None]
    return torch.cat([torch.stack([x, y], dim=4), size], dim=4)


def _squared_offset(values: Tensor, target: Tensor, anchors: Tensor, head: Head) -> Tensor:
    """Squared distance of the raw values from those that would give ``target``, [B, A, H, W],
    unscaled."""
    rows, columns = values.shape[2:4]
    within = torch.stack([target[..., 0] * columns, target[..., 1] * rows], dim=4)
    stretch = (within - within.floor() - 0.5) / head.scale_xy + 0.5
    if head.scores == "softmax":
        centre = 0.5 * (torch.sigmoid(values[..., :2]) - stretch) ** 2
    else:
        centre = functional.binary_cross_entropy_with_logits(
            values[..., :2], stretch, reduction="none"
        )
    # Where there is no object the size is 0; what comes out is not used, but must be a number.
    wanted = torch.log((target[..., 2:] / anchors[:, None, None]).clamp(min=1e-6))
    extent = 0.5 * (values[..., 2:4] - wanted) ** 2
    return (centre + extent).sum(dim=4)


def shape_overlap(size: Tensor, anchors: Tensor) -> Tensor:
    """IoU of sizes [..., 2] with anchors [K, 2] at the same centre -> [..., K]."""
    shared = torch.minimum(size[..., None, 0], anchors[:, 0]) * torch.minimum(
        size[..., None, 1], anchors[:, 1]
    )
    area = (size[..., 0] * size[..., 1])[..., None]
    return shared / (area + anchors[:, 0] * anchors[:, 1] - shared)


def pair_overlap(left: Tensor, right: Tensor) -> Tensor:
    """IoU of all pairs of boxes [B, P, 4] and [B, M, 4] -> [B, P, M]."""
    return aligned_overlap(left[:, :, None], right[:, None])


def aligned_overlap(left: Tensor, right: Tensor) -> Tensor:
    """IoU of boxes [..., 4] and [..., 4], one by one -> [...]."""
    (left_low, left_high), (right_low, right_high) = _edges(left), _edges(right)
    # Edge by edge: no product over an axis, whose gradient waits for the device.
    width, height = (
        (torch.minimum(a, b) - torch.maximum(c, d)).clamp(min=0.0)
        for a, b, c, d in zip(left_high, right_high, left_low, right_low, strict=True)
    )
    shared = width * height
    return shared / (_area(left) + _area(right) - shared).clamp(min=1e-12)


def complete_overlap(left: Tensor, right: Tensor) -> Tensor:
    """CIoU of boxes, one by one: IoU less the distance of the centres over the diagonal of both,
    less the difference of shapes (Zheng et al., 2020, equation 9)."""
    overlap = aligned_overlap(left, right)
    (left_low, left_high), (right_low, right_high) = _edges(left), _edges(right)
    both = [
        torch.maximum(a, b) - torch.minimum(c, d)
        for a, b, c, d in zip(left_high, right_high, left_low, right_low, strict=True)
    ]
    diagonal = (both[0] ** 2 + both[1] ** 2).clamp(min=1e-12)
    apart = ((left[..., :2] - right[..., :2]) ** 2).sum(dim=-1) / diagonal
    angle = torch.atan2(left[..., 2], left[..., 3]) - torch.atan2(right[..., 2], right[..., 3])
    shape = (4.0 / math.pi**2) * angle**2
    with torch.no_grad():
        share = shape / (1.0 - overlap + shape).clamp(min=1e-9)
    return overlap - apart - share * shape


def _area(box: Tensor) -> Tensor:
    return box[..., 2] * box[..., 3]


def _edges(box: Tensor) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
    """Left and upper edge, right and lower edge."""
    x, y, width, height = box.unbind(dim=-1)
    return (x - 0.5 * width, y - 0.5 * height), (x + 0.5 * width, y + 0.5 * height)
