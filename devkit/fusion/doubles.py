"""Tracks that are second views of what another one shows, arrays [S, T].

LiDAR that sees an oncoming lorry for the first time begins a track of its own where the nose is
wider than radar's group of echoes, or nearer. In that track the corner, the nose and the flank come
one after the other, which looks like a way across.
"""

from __future__ import annotations

import numpy as np

from devkit.fusion.tracks import VOUCHED_S, TrackStore

FOLLOWED_ECHOES = 20
"""Echoes from which on radar knows a track that drives well [-]."""
COMES_MPS = 4.0
"""What comes at least so fast drives [m/s]."""
ALONG_M, ASIDE_M, SLACK_MPS = 3.0, 1.5, 2.0
"""Nearer to each other, and less different in speed along the path, are two views of one vehicle:
its nose and its middle are no further apart [m, m, m/s]."""


def doubles(tracks: TrackStore) -> np.ndarray:
    """bool [S, T]: tracks that come along where radar has followed another one for longer, as fast
    as that. It knows better how fast both are across."""
    comes = tracks.live & (tracks.vx_mps < -COMES_MPS)
    followed = comes & (tracks.radar.hits >= FOLLOWED_ECHOES) & (tracks.radar.age_s < VOUCHED_S)
    if not followed.any():
        return followed

    def between(values: np.ndarray) -> np.ndarray:
        differences: np.ndarray = np.abs(values[:, :, None] - values[:, None, :])
        return differences

    same = (between(tracks.x_m) < ALONG_M) & (between(tracks.y_m) < ASIDE_M)
    same &= between(tracks.vx_mps) < SLACK_MPS
    older = tracks.radar.hits[:, None, :] > tracks.radar.hits[:, :, None]
    older &= tracks.age_s[:, None, :] > tracks.age_s[:, :, None]
    result: np.ndarray = comes & (same & older & followed[:, None, :]).any(axis=2)
    return result
