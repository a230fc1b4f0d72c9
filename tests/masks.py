"""Soups of triangles with holes, and a reference of NumPy for what rays meet of them."""

import numpy as np
from pictures import mesh_of, world_of

from twin.world.meshes.details import FaceDetails, FaceLook, Mask, texture_kind


def soup_with_holes(seed, count=400):
    """A world whose faces alternate between whole ones and three masks that repeat, clamp and
    mirror; uv reaches beyond the borders."""
    rng = np.random.default_rng(seed)
    middle = rng.normal(size=(count, 1, 3)) * 9.0
    points = (middle + rng.normal(size=(count, 3, 3)) * 4.0).reshape(-1, 3)
    uv = rng.uniform(-1.5, 2.5, (3 * count, 2)).astype(np.float32)
    masks = tuple(
        Mask(rng.integers(0, 256, (7, 5)).astype(np.uint8), 128.0, texture_kind(u, v))
        for u, v in ((0, 0), (1, 2), (2, 1))
    )
    look = (np.arange(count) % 4).astype(np.int32)
    row = np.where(look < 3, np.cumsum(look < 3) - 1, -1).astype(np.int32)
    empty = [np.zeros((0, 3, n), np.float32) for n in (3, 3, 4)]
    mesh = mesh_of(
        points,
        np.arange(3 * count).reshape(-1, 3),
        uv=uv,
        instance=np.arange(count, dtype=np.int32),
        details=FaceDetails(row, look[look < 3], *empty),
    )
    looks = tuple(FaceLook(mask=n) for n in range(3))
    return world_of(mesh, instances=count, masks=masks, looks=looks)


def alpha_at(mask, uv):
    """Bilinear alpha of a mask at uv [N, 2], as its kind says beyond the borders."""
    low, high, share = [], [], []
    for axis, size in ((0, mask.alpha.shape[1]), (1, mask.alpha.shape[0])):
        mode = mask.kind >> (2 * axis) & 3
        c = uv[:, axis].astype(float)
        if mode == 1:
            c = np.clip(c, 0, 1)
        elif mode == 2:
            c = np.abs((c + 1.0) % 2.0 - 1.0)  # distance from the nearest even number
        else:
            c = c % 1.0
        c = (1.0 - c if axis else c) * size - 0.5
        whole = np.floor(c).astype(int)
        share.append(c - whole)
        pair = [whole, whole + 1]
        pair = [p % size if mode == 0 else np.clip(p, 0, size - 1) for p in pair]
        low.append(pair[0])
        high.append(pair[1])
    a = mask.alpha.astype(float)
    (i, j), (k, m), (x, y) = low, high, share
    top = a[j, i] * (1 - x) + a[j, k] * x
    bottom = a[m, i] * (1 - x) + a[m, k] * x
    return top * (1 - y) + bottom * y


def first_hits(world, origin, rays, far=60.0):
    """Distance and face of the first thing there along each ray [N], and how near the decision
    about a hole was on the way [N] (alpha from its limit, least of all)."""
    mesh = world.mesh
    p, q, r = mesh.points_m[mesh.faces].astype(float).transpose(1, 0, 2)
    best = np.full(len(rays), far)
    face = np.full(len(rays), -1)
    close = np.full(len(rays), np.inf)
    for number in range(len(mesh.faces)):
        e, g = q[number] - p[number], r[number] - p[number]
        h = np.cross(rays, g)
        det = h @ e
        s = origin - p[number]
        with np.errstate(divide="ignore", invalid="ignore"):
            v = h @ s / det
            x = np.cross(s, e)
            w = rays @ x / det
            t = g @ x / det
        hit = (v >= 0) & (w >= 0) & (v + w <= 1) & (t >= 0) & (t < far)
        row = mesh.details.row[number]
        if row >= 0 and hit.any():
            mask = world.masks[world.looks[mesh.details.look[row]].mask]
            corner = mesh.uv[mesh.faces[number]].astype(float)
            weights = np.stack([1 - v - w, v, w], axis=1)[hit]
            apart = alpha_at(mask, weights @ corner) - mask.cutoff
            close[hit] = np.minimum(close[hit], np.abs(apart))
            hit[np.flatnonzero(hit)[apart < 0]] = False
        nearer = hit & (t < best)
        best[nearer], face[nearer] = t[nearer], number
    return best, face, close
