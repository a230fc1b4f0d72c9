"""The streets of a dataset, and who can appear in them: disjoint between the splits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace

from twin.base.errors import UsageError
from twin.dataset.chance import between, far_and_near, generator, pick
from twin.dataset.recipe import DatasetRecipe
from twin.world.content import SceneObject
from twin.world.scene import Scene, load_scene

CAST = (("car", 14), ("truck", 4), ("bus", 3), ("pedestrian", 8), ("cyclist", 3))
"""Number of looks of each kind in a street."""
PAINT_DISTANCE = 0.06
"""Paints of vehicles outside ``train`` differ by at least this from those of the same body in it:
distance in gamma-corrected RGB [-]."""

_BODIES = {"hatchback": 0.3, "saloon": 0.3, "suv": 0.28, "van": 0.12}
_TRIES = 1000

Paint = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Look:
    """One member of the cast."""

    kind: str
    """Kind as in scene files: car, van, truck, bus, pedestrian, cyclist."""
    body: str
    """Body of a car; otherwise the kind."""
    color: Paint
    """Linear RGB of the paint or coat [-]."""
    seed: int
    """Seed of a person's build and clothes."""

    @property
    def name(self) -> str:
        """Tells looks apart, as in ``suv 0.120 0.300 0.050`` or ``pedestrian 8812``."""
        if self.kind in ("pedestrian", "cyclist"):
            return f"{self.kind} {self.seed}"
        return self.body + "".join(f" {value:.3f}" for value in self.color)

    def item(self) -> SceneObject:
        """The object of a scene that builds its mesh."""
        people = self.kind in ("pedestrian", "cyclist")
        return SceneObject(
            kind=self.kind,  # type: ignore[arg-type]
            waypoints=[[0.0, 0.0]],
            seed=self.seed,
            color=None if people else list(self.color),
            body=self.body if self.kind == "car" else "saloon",  # type: ignore[arg-type]
        )


@dataclass(frozen=True, slots=True)
class Street:
    """A place: one generated street with its cast."""

    split: str
    name: str
    """Name as in ``downtown/train-3``."""
    scene: Scene
    """Scene whose objects are the cast, in order."""
    cast: tuple[Look, ...]
    obstacle: Look


def streets_of(recipe: DatasetRecipe, split: str) -> list[Street]:
    """The streets of one split.

    Raises:
        UsageError: a scene that cannot be used; one line.
    """
    seen = {} if split == "train" else _paints(recipe)
    base = _base(recipe.other_scene if split == "other_scene" else recipe.scene)
    return [_street(recipe, split, k, base, seen) for k in range(getattr(recipe.streets, split))]


def _base(name: str) -> Scene:
    try:
        scene = load_scene(name)
    except ValueError as error:
        raise UsageError(f"dataset: {error}") from None
    if scene.obstacle is None:
        raise UsageError(f"dataset: scene '{name}': it has no obstacle, which datasets are about")
    if not scene.street or scene.terrain is not None or scene.road.path:
        raise UsageError(
            f"dataset: scene '{name}': it has no straight generated street on level ground; "
            "give a scene with street: true, without road.path and terrain"
        )
    return scene


def _paints(recipe: DatasetRecipe) -> dict[str, list[Paint]]:
    """Paints that ``train`` uses, by body."""
    used: dict[str, list[Paint]] = {}
    for k in range(recipe.streets.train):
        looks, obstacle = _looks(recipe, "train", k, {})
        for look in (*looks, obstacle):
            used.setdefault(look.body, []).append(look.color)
    return used


def _street(
    recipe: DatasetRecipe, split: str, index: int, base: Scene, seen: dict[str, list[Paint]]
) -> Street:
    cast, obstacle = _looks(recipe, split, index, seen)
    varied = base if split == "other_scene" and index == 0 else _varied(base, recipe, split, index)
    scene = replace(
        varied,
        objects=[look.item() for look in cast],
        obstacle=replace(varied.obstacle, color=list(obstacle.color)),
        # Parked cars are members of the cast: others with every image.
        furniture=replace(varied.furniture, parked_cars=0.0),
    )
    return Street(split, f"{base.scene}/{split}-{index}", scene, cast, obstacle)


def _varied(base: Scene, recipe: DatasetRecipe, split: str, index: int) -> Scene:
    """Another street in the manner of ``base``: other widths, side streets, buildings."""
    rng = generator(recipe.seed, f"{split}/street-{index}", "street")
    road = base.road
    low, high = road.start_m + 200.0, road.end_m - 65.0
    sides = [round(x + between(rng, -14.0, 14.0), 1) for x in road.cross_streets_m]
    height = round(between(rng, 8.0, 14.0), 1)
    return replace(
        base,
        seed=int(rng.integers(1, 2**31)),
        road=replace(
            road,
            lane_width_m=round(between(rng, 3.2, 3.8), 2),
            parking_width_m=round(between(rng, 2.1, 2.5), 2),
            sidewalk_width_m=round(between(rng, 3.4, 5.4), 2),
            kerb_height_m=round(between(rng, 0.10, 0.16), 3),
            cross_street_width_m=round(between(rng, 9.0, 13.0), 1),
            cross_streets_m=sides,
        ),
        buildings=replace(
            base.buildings,
            width_m=[round(between(rng, 8.0, 13.0), 1), round(between(rng, 16.0, 28.0), 1)],
            height_m=[height, round(height + between(rng, 6.0, 22.0), 1)],
        ),
        furniture=replace(
            base.furniture,
            tree_spacing_m=round(between(rng, 13.0, 30.0), 1),
            lamp_spacing_m=round(between(rng, 24.0, 36.0), 1),
            lamp_intensity_cd=round(far_and_near(rng, 300.0, 3000.0)),
        ),
        obstacle=replace(
            base.obstacle,
            x_m=round(between(rng, low, high), 1),
            y_m=round(between(rng, -0.5, 0.5), 2),
            hazard_lights=bool(rng.random() < 0.5),
        ),
    )


def _looks(
    recipe: DatasetRecipe, split: str, index: int, seen: dict[str, list[Paint]]
) -> tuple[tuple[Look, ...], Look]:
    rng = generator(recipe.seed, f"{split}/street-{index}", "cast")
    looks = []
    for kind, number in CAST:
        for _ in range(number):
            body = pick(rng, _BODIES) if kind == "car" else kind
            own = "van" if body == "van" else kind
            # People are odd in train and even elsewhere, so nobody is in both.
            seed = 2 * int(rng.integers(2**20)) + (split == "train")
            looks.append(Look(own, body, _paint(rng, seen.get(body, [])), seed))
    obstacle = Look("car", "hatchback", _paint(rng, seen.get("hatchback", [])), 0)
    return tuple(looks), obstacle


def _paint(rng: np.random.Generator, seen: list[Paint]) -> Paint:
    taken = np.sqrt(np.array(seen, float).reshape(-1, 3))
    for _ in range(_TRIES):
        paint = _any_paint(rng)
        apart = np.linalg.norm(taken - np.sqrt(paint), axis=1)
        if apart.min(initial=np.inf) >= PAINT_DISTANCE:
            return paint
    raise UsageError(
        "dataset: streets.train: so many vehicles leave no paint for the other splits; give fewer"
    )


def _any_paint(rng: np.random.Generator) -> Paint:
    """Half of all cars are white, grey or black, the others have any hue."""
    value = far_and_near(rng, 0.025, 0.75)
    hue, grey = 6.0 * rng.random(), rng.random() < 0.5
    strength = between(rng, 0.0, 0.12) if grey else between(rng, 0.5, 0.95)
    wheel = np.clip(np.abs((hue + np.array((0.0, 4.0, 2.0))) % 6.0 - 3.0) - 1.0, 0.0, 1.0)
    r, g, b = np.round(value * (1.0 - strength + strength * wheel), 3).tolist()
    return max(r, 0.005), max(g, 0.005), max(b, 0.005)
