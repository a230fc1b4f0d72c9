"""Images, masks and materials of a world, collected from the parts of its mesh files."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from twin.world.meshes.details import (
    DIELECTRIC,
    EMISSION,
    MAPS,
    MATT_FROM,
    MIRROR_MIN,
    NORMAL,
    REPEAT,
    SAME,
    SHINE,
    CornerDetails,
    FaceLook,
    Mask,
    sharp_share,
    tangents_of,
    texture_kind,
)
from twin.world.meshes.part import Part, vertex_normals

Turn = np.ndarray
"""World from file, a rotation [3, 3]."""


@dataclass(slots=True)
class WorldLooks:
    """What grows with every part."""

    textures: list[np.ndarray] = field(default_factory=list)
    kinds: list[int] = field(default_factory=list)
    masks: list[Mask] = field(default_factory=list)
    looks: list[FaceLook] = field(default_factory=list)
    _known: dict[tuple[int, int], int] = field(default_factory=dict)
    _known_masks: dict[tuple[int, float, int], int] = field(default_factory=dict)

    def image(self, image: np.ndarray | None, wrap: list[int], *, data: bool = False) -> int:
        """Number of an image; -1: there is none."""
        if image is None:
            return -1
        kind = texture_kind(*wrap, data=data)
        key = (id(image), kind)
        if key not in self._known:
            self._known[key] = len(self.textures)
            self.textures.append(image)
            self.kinds.append(kind)
        return self._known[key]

    def details(
        self, part: Part, turn: Turn, *, own_look: bool, emission_cd_m2: float
    ) -> CornerDetails | None:
        """What the faces of a part have beside a colour and an image; None: nothing.

        Args:
            part: with points in the axes of its file.
            turn: from there to the world.
            own_look: whether its colours and maps count, or only its shape.
            emission_cd_m2: luminance of what emits 1 in the file.
        """
        look = FaceLook(mask=self._mask(part), smooth=part.normals is not None)
        if own_look:
            look = self._own(part, look, emission_cd_m2)
        if look == FaceLook():
            return None
        number = len(self.looks)
        if look in self.looks:
            number = self.looks.index(look)
        else:
            self.looks.append(look)
        normals, tangents = part.normals, None
        if look.maps[NORMAL] >= 0:
            tangents = _unit_tangents(part) @ _with_sign(turn)
        return CornerDetails(
            number,
            None if normals is None else normals @ turn.T,
            part.colors if look.colored else None,
            tangents,
        )

    def _mask(self, part: Part) -> int:
        if part.alpha is None:
            return -1
        kind = texture_kind(*part.wrap)
        key = (id(part.alpha), part.cutoff, kind)
        if key not in self._known_masks:
            self._known_masks[key] = len(self.masks)
            self.masks.append(Mask(part.alpha, part.cutoff, kind))
        return self._known_masks[key]

    def _own(self, part: Part, look: FaceLook, emission_cd_m2: float) -> FaceLook:
        """``look`` with the colours and maps of a part."""
        maps = tuple(
            self.image(part.maps[place], part.map_wraps[place], data=place != EMISSION)
            for place in range(MAPS)
        )
        red, green, blue = (emission_cd_m2 * value for value in part.emission)
        shines = part.roughness < MATT_FROM or maps[SHINE] >= 0
        matrices = [tuple(m.ravel().tolist()) for m in part.map_from_uv]
        return FaceLook(
            mask=look.mask,
            bordered=part.image is not None and part.wrap != [REPEAT, REPEAT],
            smooth=look.smooth,
            colored=part.colors is not None,
            emission=(red, green, blue),
            metallic=part.metallic if shines else 0.0,
            roughness=part.roughness if shines else 1.0,
            normal_scale=part.normal_scale if maps[NORMAL] >= 0 else 1.0,
            maps=(maps[EMISSION], maps[NORMAL], maps[SHINE]),
            map_from_uv=tuple(m if n >= 0 else SAME for m, n in zip(matrices, maps, strict=True)),
            mirrors=shines and _mirror_most(part) >= MIRROR_MIN,
        )


def _unit_tangents(part: Part) -> np.ndarray:
    """Tangents of a part with a normal map [V, 4]: those of the file, or those of its texture
    coordinates."""
    if part.tangents is None:
        assert part.uv is not None
        own = part.normals
        normals = vertex_normals(part.points, part.faces) if own is None else own
        return tangents_of(part.points, part.faces, part.uv, normals)
    length = np.linalg.norm(part.tangents[:, :3], axis=1, keepdims=True)
    unit = part.tangents[:, :3] / np.maximum(length, 1e-12)
    return np.concatenate([unit, np.sign(part.tangents[:, 3:])], axis=1)


def _with_sign(turn: Turn) -> np.ndarray:
    """What turns rows of x, y, z and a sign [4, 4]."""
    found = np.eye(4)
    found[:3, :3] = turn.T
    return found


def _mirror_most(part: Part) -> float:
    """Reflectance at normal incidence of the part's best mirror [-]."""
    least, most = part.roughness, part.metallic
    shine = part.maps[SHINE]
    if shine is not None:
        least *= float(shine[..., 1].min()) / 255.0
        most *= float(shine[..., 2].max()) / 255.0
    bright = float(part.color.max()) if part.image is None else 1.0
    return float(sharp_share(least)) * (DIELECTRIC * (1.0 - most) + bright * most)
