"""The cameras of a dataset: lens, field of view and effects; where they sit varies per image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from schemas.campaign import Camera
from schemas.sections.lens import CameraMount, Lens
from schemas.sections.lens_curve import check_lens
from twin.base.errors import UsageError
from twin.dataset.chance import between, generator
from twin.dataset.recipe import DatasetRecipe
from twin.vehicle.vehicle_file import Vehicle

OWN_SHARE = 0.4
"""Share of the images that the vehicle's own camera takes; the others share the rest [-]."""
HFOV_DEG = 70.0
"""Field of view of the vehicle's own camera, as in campaigns [deg]."""

# Round and round, so that a few cameras hold all kinds; five and four meet in all combinations.
_MODELS = ("pinhole", "brown_conrady", "fisheye", "pinhole", "brown_conrady")
_EFFECTS = ("none", "film", "none", "all")
_FILM = ["bloom", "chromatic_aberration", "vignette", "grain"]


@dataclass(frozen=True, slots=True)
class Eye:
    """One camera."""

    name: str
    """Name of its number, lens and field of view, as in ``3 fisheye 104 film``."""
    camera: Camera
    mount: CameraMount


def eyes_of(recipe: DatasetRecipe, vehicle: Vehicle) -> list[Eye]:
    """The cameras of ``recipe``; the first is the vehicle's own.

    Raises:
        UsageError: the vehicle has no such camera, or its lens does not fit the size; one line.
    """
    try:
        mount = vehicle.camera(recipe.camera)
        eyes = [_eye(recipe, mount, k) for k in range(recipe.cameras)]
        for eye in eyes:
            camera = eye.camera
            check_lens(eye.mount.lens, camera.width, camera.height, camera.hfov_deg)
    except ValueError as error:
        raise UsageError(f"dataset: {error}") from None
    return eyes


def _eye(recipe: DatasetRecipe, mount: CameraMount, index: int) -> Eye:
    camera = Camera(
        name=recipe.camera,
        width=recipe.width,
        height=recipe.height,
        hfov_deg=HFOV_DEG,
        outputs=["instance"],
    )
    if index == 0:
        return Eye(f"0 {mount.lens.model} {HFOV_DEG:.0f} none", camera, mount)
    rng = generator(recipe.seed, f"camera-{index}", "camera")
    model, effects = _MODELS[(index - 1) % len(_MODELS)], _EFFECTS[index % len(_EFFECTS)]
    hfov = round(between(rng, 90.0, 130.0) if model == "fisheye" else between(rng, 48.0, 92.0), 1)
    chosen = {"none": [], "film": _FILM, "all": ["all"]}[effects]
    camera = replace(camera, hfov_deg=hfov, effects=chosen)
    name = f"{index} {model} {hfov:.0f} {effects}"
    return Eye(name, camera, replace(mount, lens=_lens(model, rng)))


def _lens(model: str, rng: np.random.Generator) -> Lens:
    k1, k2, vignette, focus = rng.random(4).tolist()
    film = {"vignette": round(0.4 + 0.6 * vignette, 2), "focus_m": round(8.0 + 22.0 * focus, 1)}
    if model == "brown_conrady":
        # From a slight pincushion to a clear barrel; the fourth power bends the edge back.
        first = round(-0.16 + 0.2 * k1, 3)
        return Lens(model="brown_conrady", k1=first, k2=round(-0.15 * first, 4), **film)
    if model == "fisheye":
        return Lens(
            model="fisheye", k1=round(-0.04 + 0.06 * k1, 3), k2=round(-0.01 * k2, 4), **film
        )
    return Lens(**film)


def choose_eye(recipe: DatasetRecipe, rng: np.random.Generator) -> int:
    """The camera of an image."""
    own, other = rng.random(), rng.random()
    if recipe.cameras == 1 or own < OWN_SHARE:
        return 0
    return 1 + min(int(other * (recipe.cameras - 1)), recipe.cameras - 2)
