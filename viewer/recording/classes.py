"""Classes of objects and surfaces, as Rerun shows them: names and colours by id."""

from __future__ import annotations

import functools

import rerun as rr

from schemas.messages import SEMANTIC_CLASSES

# The colours of the Cityscapes data set where it has the class: people know them.
_COLORS = {
    "unlabelled": (110, 110, 110),
    "road": (128, 64, 128),
    "marking": (255, 255, 255),
    "sidewalk": (244, 35, 232),
    "building": (70, 70, 70),
    "wall": (102, 102, 156),
    "vegetation": (107, 142, 35),
    "terrain": (152, 251, 152),
    "pole": (153, 153, 153),
    "lamp": (250, 170, 30),
    "traffic_sign": (220, 220, 0),
    "car": (90, 200, 220),
    "truck": (120, 150, 255),
    "bus": (0, 200, 140),
    "pedestrian": (220, 20, 60),
    "bicycle": (240, 90, 160),
    "sky": (70, 130, 180),
}

_IDS = {name: index for index, name in enumerate(SEMANTIC_CLASSES)}


def class_id(name: str) -> int:
    """Id of a class, as semantic images have it; 0, ``unlabelled``, of one that is not ours."""
    return _IDS.get(name, 0)


@functools.cache
def contexts() -> rr.AnnotationContext:
    """Names and colours of all classes; holds for what lies below the entity it is logged at."""
    return rr.AnnotationContext(
        [(index, name, _COLORS[name]) for index, name in enumerate(SEMANTIC_CLASSES)]
    )
