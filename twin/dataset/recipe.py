"""What a dataset is made from: every parameter, as it stands in ``dataset.yaml``."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from msgspec import Meta, Struct, field

from schemas.validation import convert_all
from twin.base.errors import UsageError

SPLITS = ("train", "held_out", "other_scene")
"""Splits in the order in which images are numbered."""

Share = Annotated[float, Meta(ge=0, le=1)]


class _Spec(Struct, frozen=True, forbid_unknown_fields=True):
    """Base: frozen, unknown keys are errors."""


class Rules(_Spec, frozen=True):
    """Which boxes are labels; all others with at least one visible pixel are to be ignored."""

    visible_px_min: Annotated[int, Meta(ge=1)] = 24
    """Fewest pixels in which the camera sees the object [px]."""
    long_side_px_min: Annotated[int, Meta(ge=1)] = 7
    """Smallest longer side of the visible box [px]."""
    short_side_px_min: Annotated[int, Meta(ge=1)] = 4
    """Smallest shorter side of the visible box [px]."""
    visibility_min: Share = 0.4
    """Smallest share of the object's pixels that nothing hides [-]."""
    truncation_max: Share = 0.85
    """Largest share of the object outside the image [-]."""
    transmission_min: Share = 0.05
    """Smallest share of contrast that the air lets through, exp(-extinction x distance); at the
    meteorological optical range it is 0.05 [-]."""
    contrast_min: Annotated[float, Meta(ge=0, le=255)] = 5.0
    """Smallest contrast in the image, in steps of 8 bits: the object's mean against that of its
    surroundings, or its own standard deviation, whichever is larger [1/255]."""


class Shares(_Spec, frozen=True):
    """Shares of the images by split."""

    train: Share = 0.8
    held_out: Share = 0.1
    other_scene: Share = 0.1

    def __post_init__(self) -> None:
        if abs(self.train + self.held_out + self.other_scene - 1.0) > 1e-6:
            raise ValueError("the shares of train, held_out and other_scene must add up to 1")


class Streets(_Spec, frozen=True):
    """Number of generated streets of each split; more streets, more places and vehicles."""

    train: Annotated[int, Meta(ge=1, le=64)] = 6
    held_out: Annotated[int, Meta(ge=1, le=64)] = 2
    other_scene: Annotated[int, Meta(ge=1, le=64)] = 1


class DatasetRecipe(_Spec, frozen=True):
    """Everything that decides the bytes of a dataset, beside software and device class."""

    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 1
    count: Annotated[int, Meta(ge=1, le=1_000_000)] = 1000
    """Images of all splits together."""
    width: Annotated[int, Meta(ge=64, le=3840)] = 320
    """[px]"""
    height: Annotated[int, Meta(ge=36, le=2160)] = 192
    """[px]"""
    format: Literal["jpg", "png"] = "jpg"
    quality: Annotated[int, Meta(ge=1, le=100)] = 92
    """Quality of JPEG files."""
    scene: str = "downtown"
    """Shipped scene or scene file: the streets of ``train`` and ``held_out`` are variants of it."""
    other_scene: str = "crossing"
    """Shipped scene or scene file that is absent from the two others."""
    vehicle: str = "opencav"
    """Vehicle whose camera and headlamps are the starting point."""
    camera: str = "front_right"
    """Which of its cameras."""
    cameras: Annotated[int, Meta(ge=1, le=64)] = 8
    """Number of cameras: the vehicle's own with a field of view of 70 degrees, then others
    with random lenses, fields of view and effects."""
    split_shares: Shares = Shares()
    streets: Streets = Streets()
    rules: Rules = field(default_factory=Rules)

    def counts(self) -> dict[str, int]:
        """Images of every split: the largest remainders are rounded up."""
        exact = [getattr(self.split_shares, split) * self.count for split in SPLITS]
        counts = [int(value + 1e-9) for value in exact]
        rest = sorted(range(len(SPLITS)), key=lambda i: (counts[i] - exact[i], i))
        for i in rest[: self.count - sum(counts)]:
            counts[i] += 1
        return dict(zip(SPLITS, counts, strict=True))


def parse_recipe(data: dict[str, Any], name: str) -> DatasetRecipe:
    """Plain data -> recipe.

    Args:
        data: keys of :class:`DatasetRecipe`.
        name: stands before the error.

    Raises:
        UsageError: the first mistake, one line.
    """
    recipe, mistakes = convert_all(data, DatasetRecipe)
    if recipe is None:
        raise UsageError(mistakes[0].line(name))
    if recipe.scene == recipe.other_scene:
        raise UsageError(
            f"{name}: other_scene: given '{recipe.other_scene}', which is also scene; "
            "give a scene that training does not see"
        )
    return recipe
