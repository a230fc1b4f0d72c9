"""What comes along another lane, arrays [S, T]: where it will be when the car is there, and tracks
that are second views of what another one shows.

LiDAR that sees an oncoming lorry for the first time begins a track of its own where the nose is
wider than radar's group of echoes, or nearer. In that track the corner, the nose and the flank come
one after the other, which looks like a way across.
"""

from __future__ import annotations

import numpy as np

from devkit.fusion.ego_motion import EgoMotion
from devkit.fusion.parameters import StagingParameters
from devkit.fusion.sightings import is_person
from devkit.fusion.tracks import VOUCHED_S, TrackStore

COMES_MPS = 2.0
"""A vehicle that comes at least so fast drives along another lane [m/s]."""
PERSON_MPS = 8.0
"""The fastest cyclist's speed [m/s]."""
PATH_SURE_M = 30.0
"""So far the road goes on as the car turns now: in a clothoid of 60 m to a radius of 250 m it is
0.3 m aside after that, but 2.3 m after twice that [m]."""
STRAIGHT_M = 1.0
"""A path that goes aside by no more than this is straight."""
TURN_RIPE_S = 1.0
"""Age of a track from which on its turn rate counts [s]."""
TURN_SIGMA_RADPS = 0.03
"""Deviation of a turn rate [rad/s]."""
FROM_SIGMA_M = 0.6
"""Deviation of the place across from where a track came [m]."""
FOLLOWED_ECHOES = 20
"""Echoes from which on radar knows a track that drives well [-]."""
DRIVES_MPS = 4.0
"""What comes at least so fast drives [m/s]."""
ALONG_M, ASIDE_M, SLACK_MPS = 3.0, 1.5, 2.0
"""Nearer to each other, and less different in speed along the path, are two views of one vehicle:
its nose and its middle are no further apart [m, m, m/s]."""


def doubles(tracks: TrackStore) -> np.ndarray:
    """bool [S, T]: tracks that come along where radar has followed another one for longer, as fast
    as that. It knows better how fast both are across."""
    comes = tracks.live & (tracks.vx_mps < -DRIVES_MPS)
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


def on_foot(tracks: TrackStore) -> np.ndarray:
    """Who is called a pedestrian or cyclist and is not faster than one: networks call oncoming cars
    people, too."""
    slow = np.abs(tracks.radial_mps) < PERSON_MPS
    result: np.ndarray = is_person(tracks.label) & slow
    return result


def ripe_turn(tracks: TrackStore) -> np.ndarray:
    """Turn rates; a young track's is the noise of its first speeds."""
    return np.where(tracks.age_s > TURN_RIPE_S, tracks.turn_radps, 0.0)


def straight_to(tracks: TrackStore, ego: EgoMotion) -> np.ndarray:
    """Whether the path is as good as straight up to the tracks."""
    aside_m = 0.5 * ego.curvature_per_m[:, None] * tracks.x_m * tracks.x_m
    result: np.ndarray = np.abs(aside_m) < STRAIGHT_M
    return result


def passes_by(
    tracks: TrackStore,
    ego: EgoMotion,
    vx_mps: np.ndarray,
    ttc_s: np.ndarray,
    staging: StagingParameters,
) -> np.ndarray:
    """Vehicles that come along another lane: in a curve, or where one begins, they are on the path
    as it is foreseen long before the car is there, and beside it when they meet.

    Two ways to foresee the meeting have to say that it is a collision. The first, in curves: the
    car goes on along its arc, the other one turns as it does now; where the car's path is straight,
    the other one has been seen to follow the road. The second: the other one follows the road, so
    the road at its place runs as its way does, and is half of that times the distance aside.
    """
    comes = (vx_mps < -COMES_MPS) & ~on_foot(tracks)
    ahead_m = staging.front_m + ego.speed_mps[:, None] * ttc_s
    turned = 0.5 * ripe_turn(tracks) * tracks.vx_mps * ttc_s
    beside_m = tracks.y_m + (tracks.vy_mps + turned) * ttc_s
    beside_m = beside_m - 0.5 * ego.curvature_per_m[:, None] * ahead_m * ahead_m
    sideways = np.sqrt(tracks.q_vv)
    beside_sigma_m = (sideways + 0.5 * TURN_SIGMA_RADPS * np.abs(tracks.vx_mps) * ttc_s) * ttc_s
    lane_m, lane_sigma_m = lane_of(tracks)
    # Far ahead the likelier of two lanes counts, near by the one that is not sure to be another.
    lane_sigma_m = np.where(tracks.x_m < PATH_SURE_M, lane_sigma_m, 0.0)
    half_m = staging.corridor_half_m
    came, came_sigma_m = _lane_by_way(tracks)
    passes: np.ndarray = comes & np.where(
        straight_to(tracks, ego),
        _misses(tracks, came, half_m + came_sigma_m),
        _misses(tracks, beside_m, half_m + beside_sigma_m),
    )
    passes |= comes & _misses(tracks, lane_m, half_m + lane_sigma_m)
    return passes


def lane_of(tracks: TrackStore) -> tuple[np.ndarray, np.ndarray]:
    """Distance of the lane of what comes, left of the car's own, and the deviation of that [m]: the
    road at its place runs as its way does, and begins where the car is."""
    slope_x = 0.5 * tracks.x_m / np.minimum(tracks.vx_mps, -1.0)
    return tracks.y_m - tracks.vy_mps * slope_x, np.sqrt(tracks.q_vv) * np.abs(slope_x)


def _lane_by_way(tracks: TrackStore) -> tuple[np.ndarray, np.ndarray]:
    """Distance of that lane, and its deviation, from where it came: the road runs as an arc that
    begins where the car is and goes through both places, beside the lane. A way that is short
    beside its end tells nothing."""
    end_m2 = tracks.x_m * tracks.x_m
    way_m2 = tracks.from_x_m * tracks.from_x_m - end_m2
    long = (tracks.from_x_m > 0.0) & (way_m2 > end_m2)
    share = end_m2 / np.where(long, way_m2, 1.0)
    lane_m = tracks.y_m + share * (tracks.y_m - tracks.from_y_m)
    sigma_m = np.sqrt(tracks.q_xx) * (1.0 + share) + FROM_SIGMA_M * share
    return lane_m, np.where(long, sigma_m, np.inf)


def _misses(tracks: TrackStore, beside_m: np.ndarray, half_m: np.ndarray) -> np.ndarray:
    """Whether tracks whose middle is so far left of the path's are beside it."""
    misses: np.ndarray = (beside_m + tracks.right_m > half_m) | (beside_m + tracks.left_m < -half_m)
    return misses
