"""Which tracks are in the way: on the predicted path, or about to cross it, arrays [S, T]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from devkit.fusion.ego_motion import EgoMotion
from devkit.fusion.health import SensorHealth
from devkit.fusion.oncoming import (
    COMES_MPS,
    FOLLOWED_ECHOES,
    PATH_SURE_M,
    doubles,
    lane_of,
    on_foot,
    passes_by,
    ripe_turn,
    straight_to,
)
from devkit.fusion.parameters import StagingParameters
from devkit.fusion.path import CarPath
from devkit.fusion.sightings import LABELS, PERSONS, is_person
from devkit.fusion.tracks import HELD_S, KNOWN_VARIANCE, NAMED_BOXES, VOUCHED_S, TrackStore

INSIDE_MIN = 0.5
"""How much a sensor must say that a track is in the path for it to count [-]."""
ALONE_INSIDE = 0.8
"""How much radar alone must say so of what does not drive on ahead [-]."""
STAYS_MIN = 0.3
"""The same for one that the car brakes for already [-]."""
BESIDE_PATH_M = 1.0
"""Error of a place: what is further beside the path by its own place is not in it [m]."""
MOVING_MPS = 0.8
"""A track that may be slower counts as standing [m/s]."""
SURE_VARIANCES = 4.0
"""Square of a speed over its variance from which on it counts as a speed [-]."""
PERSON_SURE_VARIANCES = 6.25
"""The same across of pedestrians and cyclists: networks name gaps between parked cars, too."""
AWAY_MPS = 2.0
"""Who drives ahead, at least so fast and not slower than the car, is not in the way [m/s]."""
ALONE_SURE_VARIANCES = 25.0
"""The same across of what radar alone sees cross: it sees one end and wheel of a lorry that goes by
after the other."""
WALKS_SURE_VARIANCES = 9.0
"""The same of whom no camera names."""
SLACK_MPS = 0.5
"""Difference of two speeds that counts as none [m/s]."""
BRAKES_MPS2 = 1.5
"""Who slows down less does not count as braking [m/s^2]."""
SIGHTINGS_MIN = 3
"""Fewest sightings by one sensor of what counts: two give no speed."""
BOXES_MIN = 2
"""Fewest boxes of what stands for a camera to agree [-]."""
WALKS_SIGHTINGS = 6
"""LiDAR has to see so often what is taken for walking or crossing, though no camera names it: where
radar saw it first, LiDAR corrects its direction, which looks like a step aside."""
WALKS_ECHOES, WALKED_M = 20, 1.5
"""The same of radar, which alone has to have seen him walk so far too: half the width of a car and
its own error at 50 m [-, m]."""
WALKED_S = 0.06
"""What a vehicle has to have gone further across, per speed of the car above ``BOX_MPS`` [s]."""
LANE_SURE_M = 1.0
"""Deviation of the lane of what comes and no camera has named, up to which it counts [m]."""
STEADY_MIN = 0.7
"""Share of the places across that a way explains from which on its speed across counts [-]."""
PERSON_SWEEPS = 4
"""Sweeps from which on LiDAR places a person [-]."""
WARNED_S = 0.8
"""A driver is warned so long before the brake begins (UN R152, 5.2.1.1) [s]."""
WARNED_ECHOES, WARNED_INSIDE = 30, 0.95
"""For how many frames, and how surely in the path, radar alone has to see what is warned of [-]."""
RIPE_S = 0.6
"""A younger track whose speed is not known might be as fast as the car; and its speed across may be
the step from one corner or thing to the next [s]."""
RECENT_S = 0.5
"""Sensors agree on a track that each of them has seen so lately [s]."""
ECHOED_S = 0.75
"""Many echoes have a say so long: of parked cars in a row radar sees now this one, now that [s]."""
FREE_MARGIN_M = 2.0
"""LiDAR that sees the road so much further than a box says that nothing stands there [m]."""
REACH_RATIO = 1.2
"""LiDAR that sees obstacles so many times further away would see a vehicle."""
BOX_ECHOES, BOX_MPS = 5, 10.0
"""A vehicle that a camera shows and LiDAR does not, radar has to have seen so often where the car
is faster than this: at half a second per 14 m no echo of a vehicle is missed [-, m/s]."""
CROSSES_MPS = 2.0
"""A vehicle that is not so fast across the path stays in its lane [m/s]."""
RUNS_MPS, RUNS_NARROW_MPS, RUNS_SIGHTINGS = 3.5, 5.0, 5
"""What LiDAR alone has seen so often come from the side at this speed crosses, also if it is as
narrow as a motorcycle [m/s, m/s, -]."""
CAME_M, CAME_SIGHT_M = 3.0, 1000.0
"""What has come so far from there crosses, where sight is better than this: in fog and snow LiDAR
goes from one thing to the next [m, m]."""
SIGHT_RATIO = 5.0
"""Where sight ends before so many times the distance, LiDAR is near the end of its own [-]."""
ALONG_SHARE = 0.3
"""What comes, is no faster across than this share of its speed along the path and is hardly seen by
LiDAR goes by in the other lane: radar sees its middle first and its near corner at last [-]."""
BESIDE_M, BESIDE_SIGHTINGS = 9.0, 4
"""What is further aside has a speed across as soon as LiDAR has seen it :data:`RUNS_SIGHTINGS`
times, or so often if it moves by Doppler: there is no lane in which it would drive along the road
[m, -]."""
SLOW_MPS = 4.0
"""A slower vehicle moves only if radar, where it sees it, says so: beside a car that turns, what
stands is seen from other sides, and other parts of it [m/s]."""
CONTRARY_MPS = 3.0
"""Difference of a radial speed from that of a track from which on the latter is wrong [m/s]."""
AGREES_MIN = 0.5
"""Share of radial speeds that have to agree with a velocity for radar to vouch for it: in fog
LiDAR goes from one thing to the next [-]."""
EARLY_LATE_S = 0.25
"""Who would be in the path so shortly before or after the car is there crosses it [s]."""
TOO_LATE_S = 0.3
"""A brake that begins so late changes nothing; a vehicle that seems to cross so near goes by in the
next lane, and its front and flank are seen one after the other [s]."""
FLANK_SHARE = 0.5
"""Who would meet the car's flank may as well meet its front, if he is only so much later as this
share of the time to collision: speeds change until then, and nobody brakes for his flank [-]."""
NARROW_M, WALKS_MPS, WALKS_ALONG_MPS = 1.0, 1.0, 4.0
"""Whom no camera names is a pedestrian if narrower, and faster across, than this, and no faster
along the path [m, m/s, m/s]."""
IMMINENT_S = 0.5
"""Who will be in the path so soon is as good as in it [s]."""
LENGTH_M = 5.2
"""Length of the car, which passes a place for so long [m]."""
TIME_MAX_S = 99.0
"""Time to collision of what does not come nearer [s]."""

_VEHICLES = (LABELS.index("car"), LABELS.index("truck"), LABELS.index("bus"))


@dataclass(frozen=True, slots=True, eq=False)
class Threats:
    """What the stages need of every track, [S, T]."""

    agreed: np.ndarray
    """bool: two sensors say that it is in the path, or one where the other is blind."""
    single: np.ndarray
    """bool: one sensor does, sure enough."""
    foreseen: np.ndarray
    """bool: it is, or will be in the path; the driver is warned."""
    blocking: np.ndarray
    """bool: it keeps a car that brakes from driving on, were it near."""
    gap_m: np.ndarray
    """From the front bumper, along the path."""
    ttc_s: np.ndarray
    """Time to collision, :data:`TIME_MAX_S` of what does not come nearer."""
    needed_mps2: np.ndarray
    """Deceleration that would still end before it."""
    stands: np.ndarray
    """bool: it stands in the path, as far as is known."""


def _is_any(values: np.ndarray, wanted: tuple[int, ...]) -> np.ndarray:
    result: np.ndarray = values == wanted[0]
    for value in wanted[1:]:
        result |= values == value
    return result


def _persons(tracks: TrackStore) -> np.ndarray:
    """Whom a camera names a pedestrian or cyclist. One box does not make one: networks take posts
    for people once in a while, and gaps between parked cars. Nor do three sweeps of something that
    is nowhere else a moment later; and nobody is faster than a cyclist."""
    named: np.ndarray = tracks.named >= NAMED_BOXES
    unseen = tracks.lidar.age_s >= HELD_S
    named &= unseen | (tracks.ends.sweeps >= PERSON_SWEEPS)
    return named & on_foot(tracks)


class PathCrossing(NamedTuple):
    """Who crosses the path, bool [S, T] each."""

    meets: np.ndarray
    """Will be in it when the car is there."""
    comes: np.ndarray
    """Will be in it before the car is."""
    soon: np.ndarray
    """Meets it, and so soon that he is as good as in it."""
    departs: np.ndarray
    """A vehicle that will have left it by then: in a curve who comes along the other lane is
    straight ahead for a while."""
    walks: np.ndarray
    """Nobody has named him, but he moves as a pedestrian does."""


def find_threats(
    tracks: TrackStore, ego: EgoMotion, health: SensorHealth, staging: StagingParameters
) -> Threats:
    """Judge all tracks of all slots."""
    path, straight = ego.path.spread(2), straight_to(tracks, ego)
    speed = ego.speed_mps[:, None]
    vx = np.where(_is_speed(tracks.vx_mps, tracks.p_vv, SURE_VARIANCES), tracks.vx_mps, 0.0)
    doppler, echoed, contrary = _moves_by_doppler(tracks, staging)
    vy = _known_across(tracks, path, doppler, health.sight_m[:, None] > CAME_SIGHT_M)
    closing = speed - vx
    inside, stays = _in_path(tracks, path, staging)
    gap = np.maximum(tracks.x_m + np.where(inside, tracks.path_m, 0.0) - staging.front_m, 0.0)
    nearing = closing > 0.1
    ttc = np.where(nearing, gap / np.where(nearing, closing, 1.0), TIME_MAX_S)
    ttc = np.minimum(ttc, TIME_MAX_S)
    slow = tracks.vx_mps * tracks.vx_mps + tracks.vy_mps * tracks.vy_mps < SLOW_MPS * SLOW_MPS
    driven = doppler | ((vx != 0.0) & ~(echoed & (slow | (tracks.agrees < AGREES_MIN))) & ~contrary)
    shown = health.reach_m[:, None] > REACH_RATIO * tracks.x_m
    clear = health.sight_m[:, None] > SIGHT_RATIO * (tracks.x_m + np.abs(tracks.y_m))
    crosses = _crosses(tracks, path, vx, vy, ttc, speed, doppler, driven, shown, clear, staging)
    departs = crosses.departs | passes_by(tracks, ego, vx, ttc, staging)
    ahead = tracks.live & (tracks.x_m > staging.front_m - 1.0)
    in_way = ahead & ((inside & ~departs) | crosses.meets)
    # Networks see cars where none are, once in a while.
    camera = (tracks.camera.age_s < RECENT_S) & ((tracks.camera.hits >= BOXES_MIN) | (vx != 0.0))
    places = np.minimum(tracks.lidar.age_s, tracks.radar.age_s) < RECENT_S
    sightings = np.maximum(tracks.lidar.hits, np.maximum(tracks.radar.hits, tracks.camera.hits))
    in_way &= sightings >= SIGHTINGS_MIN
    # One echo that a box is near tells no speed with which a vehicle comes.
    measured = np.maximum(tracks.lidar.hits, tracks.radar.hits)
    told = (measured >= SIGHTINGS_MIN) | (measured == 0.0)
    in_way &= told | (vx > -COMES_MPS) | on_foot(tracks)
    # Pedestrians are slow: to take them for standing is no great mistake.
    pedestrian = tracks.label == PERSONS[0]
    in_way &= (tracks.age_s > RIPE_S) | (tracks.p_vv < KNOWN_VARIANCE) | pedestrian
    probable = tracks.probability > staging.single_probability
    # What radar alone sees standing are manhole covers, bridges and mirrors as often as cars.
    trusted = camera | (tracks.lidar.age_s < RECENT_S) | (places & (driven | crosses.walks))
    denied = _contradicted(tracks, shown, health) | _unechoed(tracks, ego, health)
    alone = probable & trusted & ~denied
    blind = health.camera_blind[:, None] | health.range_blind[:, None]
    # One cell of spray or one echo, and a box somewhere behind it, are no agreement.
    places &= tracks.lidar.hits + tracks.radar.hits >= SIGHTINGS_MIN
    # LiDAR and radar agree on what moves; a guard rail has echoes and points along a whole curve.
    both = (tracks.lidar.age_s < RECENT_S) & (tracks.radar.age_s < RECENT_S)
    both &= ((vx != 0.0) | crosses.meets) & (tracks.radar.hits >= SIGHTINGS_MIN)
    agreed = ((camera & places) | both) & (tracks.probability > staging.agree_probability) & ~denied
    room = np.maximum(gap - staging.stop_gap_m, 0.3)
    fast = np.maximum(closing, 0.0)
    away = (vx > AWAY_MPS) & (vx > speed - SLACK_MPS)
    blocking = ahead & (stays | crosses.comes) & (tracks.probability > 0.5) & ~away
    # Who drives ahead and brakes takes room away: in its frame the car brakes by so much more.
    brakes = np.where(
        (vx > MOVING_MPS) & (tracks.accel_mps2 < -BRAKES_MPS2), -tracks.accel_mps2, 0.0
    )
    needed = 0.5 * fast * fast / room + np.where(fast > SLACK_MPS, brakes, 0.0)
    # Who walks towards the path may still stop: time for a warning, and for the brake's last word.
    late = needed > staging.crossing_deceleration_mps2
    by_two, by_one = in_way & (agreed | (alone & blind)), in_way & alone
    # Who drives on may turn off; who is braked for behind them is another track.
    drives_on = (vx > AWAY_MPS) & (brakes == 0.0)
    now = inside | crosses.soon | late
    now &= ~drives_on | (needed > staging.following_deceleration_mps2)
    sure, named = _sure_far_ahead(tracks, vx, gap, straight, late)
    now &= sure
    foreseen = by_two | by_one | (ahead & probable & _echoes_on(tracks, ego, ttc, staging))
    stands = (vx == 0.0) & ~crosses.meets
    return Threats(by_two & now, by_one & now & named, foreseen, blocking, gap, ttc, needed, stands)


def _sure_far_ahead(
    tracks: TrackStore, vx: np.ndarray, gap_m: np.ndarray, straight: np.ndarray, late: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Whether what seems to be in the way far ahead is, and whether one sensor alone may say so."""
    near, comes = gap_m < PATH_SURE_M, vx < -COMES_MPS
    # Where the car turns, nobody knows how the road goes on; one box does not tell, either.
    sure = straight | near | np.where(comes, tracks.named >= NAMED_BOXES, (vx != 0.0) | late)
    # What no camera names and what stands may be beside a curve that has not begun; what comes may
    # be in the other lane of one in which the car is.
    lane_known = straight & (lane_of(tracks)[1] < LANE_SURE_M)
    known = np.where(comes, lane_known, (vx != 0.0) | late)
    return sure, (tracks.label > 0) | near | known


def _known_across(
    tracks: TrackStore, path: CarPath, doppler: np.ndarray, clear: np.ndarray
) -> np.ndarray:
    """Speed across of the tracks of which it is known, 0 of others [m/s]."""
    person = _persons(tracks)
    sure = np.where(person, PERSON_SURE_VARIANCES, SURE_VARIANCES)
    # What a camera names and LiDAR has seen often enough is where its points are; but a vehicle is
    # no single point of one.
    placed = (tracks.label > 0) & (tracks.lidar.hits >= SIGHTINGS_MIN)
    placed &= is_person(tracks.label) | (tracks.left_m - tracks.right_m > NARROW_M)
    comes = tracks.lidar.hits >= np.where(doppler, BESIDE_SIGHTINGS, RUNS_SIGHTINGS)
    comes &= np.abs(path.beside_circle_m(tracks.x_m, tracks.y_m)) > BESIDE_M
    ripe = person | placed | comes | (tracks.age_s > RIPE_S)
    came = _came_from_aside(tracks, path, clear)
    # A filter that what it sees contradicts, place after place, knows no speed either. But who is
    # followed driving ahead and turns off shows his flank then, bit by bit.
    followed = doppler & (tracks.radar.hits >= FOLLOWED_ECHOES) & (tracks.vx_mps > AWAY_MPS)
    ripe &= (tracks.steady > STEADY_MIN) | followed | came
    both = tracks.ends.go_along() & (tracks.ends.sweeps >= WALKS_SIGHTINGS)
    ripe &= both | ~doubles(tracks)
    # LiDAR that sees now this, now that tells no speed of either.
    ripe &= doppler | (tracks.lidar.age_s >= HELD_S) | (tracks.ends.sweeps >= PERSON_SWEEPS) | came
    known = ripe & _is_speed(tracks.vy_mps, tracks.q_vv, sure)
    return np.where(known, tracks.vy_mps, 0.0)


def _came_from_aside(tracks: TrackStore, path: CarPath, clear: np.ndarray) -> np.ndarray:
    """What LiDAR has seen come from far aside, so fast that it is elsewhere sweep by sweep, and of
    which more and more comes into view."""
    from_m = path.beside_circle_m(tracks.from_x_m, tracks.from_y_m)
    way_m = np.abs(from_m) - np.abs(path.beside_circle_m(tracks.x_m, tracks.y_m))
    came: np.ndarray = clear & (tracks.lidar.hits >= RUNS_SIGHTINGS) & (np.abs(from_m) > BESIDE_M)
    return came & (way_m > CAME_M) & (np.abs(tracks.vy_mps) > RUNS_NARROW_MPS)


def _echoes_on(
    tracks: TrackStore, ego: EgoMotion, ttc_s: np.ndarray, staging: StagingParameters
) -> np.ndarray:
    """What radar alone has seen in a straight path for long: too little to brake for, since it may
    be a manhole cover, but the driver is warned as long as rules want before the brake begins."""
    echoes: np.ndarray = (tracks.radar.hits >= WARNED_ECHOES) & (tracks.radar.age_s < RECENT_S)
    echoes &= (tracks.radar.inside > WARNED_INSIDE) & straight_to(tracks, ego)
    return echoes & (ttc_s < staging.single_ttc_s + WARNED_S)


def _moves_by_doppler(
    tracks: TrackStore, staging: StagingParameters
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Whether a track that radar has seen moves along the ray from the car's front: who crosses
    has no speed along x; whether radar sees it now; and whether radar measures another speed. What
    it measures has to be nearer to the track's speed than to none: a track's own may come from
    places of other and other things."""
    ahead_m = np.maximum(tracks.x_m - staging.front_m, 0.1)
    square_m2 = ahead_m * ahead_m + tracks.y_m * tracks.y_m
    root_m = np.sqrt(square_m2)
    radial = (ahead_m * tracks.vx_mps + tracks.y_m * tracks.vy_mps) / root_m
    ahead_m, aside_m = ahead_m * ahead_m, tracks.y_m * tracks.y_m
    variance = (ahead_m * tracks.p_vv + aside_m * tracks.q_vv) / square_m2
    moves = _is_speed(radial, variance, SURE_VARIANCES)
    known = tracks.radar.hits >= SIGHTINGS_MIN
    moves &= known & (tracks.agrees >= AGREES_MIN)
    differs = np.abs(tracks.radial_mps - radial)
    moves &= differs < np.abs(tracks.radial_mps)
    sees = tracks.radar.age_s < RECENT_S
    return moves, known & sees, sees & (differs > CONTRARY_MPS)


def _is_speed(
    speed: np.ndarray, variance: np.ndarray, sure_variances: np.ndarray | float
) -> np.ndarray:
    """Whether a track moves along an axis, surely."""
    square = speed * speed
    moves: np.ndarray = (square > MOVING_MPS * MOVING_MPS) & (square > sure_variances * variance)
    return moves


def _in_path(
    tracks: TrackStore, path: CarPath, staging: StagingParameters
) -> tuple[np.ndarray, np.ndarray]:
    """Whether tracks are in the path, to brake for and to stay braked for: LiDAR says so where it
    sees them, then the camera, then radar. Nobody is in it whose place is far beside it."""
    # The camera's directions at the radar's distance are better than the radar's own.
    # One or two boxes are no measurement, where radar has made some, unless both lie beside the
    # path: one wide box of two cars takes their track to the middle between them.
    seen = (tracks.camera.hits >= SIGHTINGS_MIN) | (tracks.radar.hits < SIGHTINGS_MIN)
    seen |= (tracks.camera.hits >= BOXES_MIN) & (tracks.camera.inside < STAYS_MIN)
    seen &= tracks.camera.age_s < RECENT_S
    # A box may be of two parked cars. The latest echoes together know a direction as well.
    often = np.where(_is_any(tracks.label, _VEHICLES), BOX_ECHOES, WALKS_ECHOES)
    echoes = (tracks.radar.hits >= often) & (tracks.radar.age_s < ECHOED_S)
    both = np.minimum(tracks.camera.inside, tracks.radar.inside)
    boxes = np.where(echoes, both, tracks.camera.inside)
    says = np.where(seen, boxes, tracks.radar.inside)
    # Nor are one or two sweeps, where radar has seen it for a second: at 40 m LiDAR misses cars.
    # But all sweeps that lie beside the path say more than radar's directions.
    swept = (tracks.lidar.hits >= SIGHTINGS_MIN) | (tracks.radar.hits < WALKS_ECHOES)
    swept = (swept | (tracks.lidar.inside == 0.0)) & (tracks.lidar.age_s < HELD_S)
    says = np.where(swept, tracks.lidar.inside, says)
    near = path.holds(
        tracks.x_m,
        tracks.y_m + tracks.right_m,
        tracks.y_m + tracks.left_m,
        staging.corridor_half_m + BESIDE_PATH_M,
    )
    # Of what comes along the other lane radar alone sees now this part, now that; and walkers go
    # along the road beside it.
    alone = (tracks.vx_mps < SLOW_MPS) & ~seen & ~swept
    return near & (says > np.where(alone, ALONE_INSIDE, INSIDE_MIN)), near & (says > STAYS_MIN)


def _crosses(
    tracks: TrackStore,
    path: CarPath,
    vx_mps: np.ndarray,
    vy_mps: np.ndarray,
    ttc_s: np.ndarray,
    ego_mps: np.ndarray,
    doppler: np.ndarray,
    driven: np.ndarray,
    shown: np.ndarray,
    clear: np.ndarray,
    staging: StagingParameters,
) -> PathCrossing:
    """Who crosses the path.

    The circle of the path runs at a track's place as (1 - k y, k x) does, so the track crosses it
    by its velocity's part across that, and on the average until the collision by half of what its
    turn adds. The times at which its ends enter and leave the path follow from that; the car is at
    its place from the time to collision on, for as long as its own length takes.
    """
    half = staging.corridor_half_m
    inward, along = 1.0 - path.bend_per_m * tracks.y_m, path.bend_per_m * tracks.x_m
    across = inward * vy_mps - along * vx_mps
    across = across / np.sqrt(np.maximum(inward * inward + along * along, 1e-6))
    across = across + 0.5 * ripe_turn(tracks) * vx_mps * np.minimum(ttc_s, staging.crossing_s)
    place = path.beside_arc_m(tracks.x_m, tracks.y_m)
    right, left = place + tracks.right_m, place + tracks.left_m
    speed = np.abs(across)
    moves = speed > 0.0
    safe = np.where(moves, speed, 1.0)
    leftwards = across > 0.0
    enters = np.where(leftwards, -half - left, right - half) / safe
    leaves = np.where(leftwards, half - right, left + half) / safe
    walked_m = _walked_m(tracks, path, across)
    # Networks miss people; what LiDAR and radar see walk is one.
    both = tracks.ends.go_along()
    walks = (tracks.ends.sweeps >= WALKS_SIGHTINGS) & (tracks.radar.hits >= SIGHTINGS_MIN) & both
    # Of what is wide another part is seen while the car goes by: its middle wanders. Of a guard
    # rail across the road far ahead LiDAR sees one post after the other.
    both = both | (tracks.lidar.age_s >= HELD_S)
    walks |= (tracks.radar.hits >= WALKS_ECHOES) & (walked_m > WALKED_M) & both
    # LiDAR goes on from a post to the parked car before it, and across its tail.
    walks &= tracks.radar.age_s < VOUCHED_S
    narrow = tracks.left_m - tracks.right_m < NARROW_M
    walks &= vy_mps * vy_mps > WALKS_SURE_VARIANCES * tracks.q_vv
    walks &= narrow & (speed > WALKS_MPS) & (np.abs(vx_mps) < WALKS_ALONG_MPS)
    runs = clear & _runs(tracks, path, across, vy_mps, walked_m)
    person = walks & ((tracks.label == 0) | is_person(tracks.label))
    person = (_persons(tracks) | person) & (vy_mps != 0.0)
    # A vehicle that comes along a curve is no crossing one, though it goes aside for a while.
    comes_by = (vx_mps < -COMES_MPS) & (speed < ALONG_SHARE * np.abs(vx_mps))
    comes_by &= tracks.ends.sweeps < WALKS_SIGHTINGS
    aside = (speed > np.abs(vx_mps)) | ((tracks.x_m < PATH_SURE_M) & ~comes_by)
    seen = _may_be_vehicle(tracks, doppler, narrow, shown)
    vehicle = seen | (runs & (speed > RUNS_NARROW_MPS))
    moves &= person | (vehicle & (speed > CROSSES_MPS) & (driven | runs))
    # Braking begins earlier than crossing is foreseen: who turns off has to count until then.
    departs = moves & ~person & (leaves < ttc_s - EARLY_LATE_S)
    moves &= (ttc_s < staging.crossing_s) & (leaves > 0.0)
    # The parts of a vehicle that are seen one after the other look like a step across; a fast car
    # sees other parts sooner.
    moves &= person | (walked_m > WALKED_M + WALKED_S * np.maximum(ego_mps - BOX_MPS, 0.0))
    sure = vy_mps * vy_mps > ALONE_SURE_VARIANCES * tracks.q_vv
    moves &= (tracks.label > 0) | (tracks.lidar.hits >= WALKS_SIGHTINGS) | sure | walks | runs
    passes = np.minimum(LENGTH_M / np.maximum(ego_mps - vx_mps, 1.0), FLANK_SHARE * ttc_s)
    comes = moves & (person | aside) & (enters < ttc_s + passes + EARLY_LATE_S)
    meets = comes & (leaves > ttc_s - EARLY_LATE_S) & (person | (ttc_s > TOO_LATE_S))
    return PathCrossing(meets, comes, meets & (enters < IMMINENT_S), departs, walks)


def _runs(
    tracks: TrackStore,
    path: CarPath,
    across_mps: np.ndarray,
    vy_mps: np.ndarray,
    walked_m: np.ndarray,
) -> np.ndarray:
    """What LiDAR alone has seen come from far aside: at a right angle to the path nothing is fast
    along it, and radar does not look so far aside."""
    runs: np.ndarray = (tracks.lidar.hits >= RUNS_SIGHTINGS) & (np.abs(across_mps) > RUNS_MPS)
    runs &= walked_m > WALKED_M
    runs &= vy_mps * vy_mps > ALONE_SURE_VARIANCES * tracks.q_vv
    # In fog nothing is seen so far aside, and LiDAR goes from one thing to the next.
    runs &= np.abs(path.beside_circle_m(tracks.from_x_m, tracks.from_y_m)) > BESIDE_M
    return runs


def _may_be_vehicle(
    tracks: TrackStore, doppler: np.ndarray, narrow: np.ndarray, shown: np.ndarray
) -> np.ndarray:
    """Whether tracks that cross are wide enough for vehicles, or radar sees them move.

    LiDAR alone goes from one post to the next in fog, and a box behind them may name them. What
    crosses is as wide as it is long; an end and a wheel of a vehicle that goes by are narrow, and
    move by Doppler too. Where LiDAR does not see, nobody knows how wide it is; where it would have
    ``shown`` a vehicle, there is none.
    """
    unseen = tracks.lidar.hits < SIGHTINGS_MIN
    often = tracks.lidar.hits >= WALKS_SIGHTINGS
    # One sweep may be of another thing, and its width too.
    seen: np.ndarray = (~narrow & ~unseen) | (often & doppler)
    seen |= unseen & ~shown & ((tracks.label > 0) | (tracks.radar.hits >= SIGHTINGS_MIN))
    return seen


def _walked_m(tracks: TrackStore, path: CarPath, across_mps: np.ndarray) -> np.ndarray:
    """Way that tracks have been seen to go across the path in the direction in which they seem to
    go now: what is seen of a vehicle goes from one of its ends to the other, and no further. Who
    goes along a curve goes aside in the car's axes, and stays as far from the arc. The way since a
    track was placed last is a guess [m]."""
    way_m = path.beside_circle_m(tracks.x_m, tracks.y_m)
    way_m = way_m - path.beside_circle_m(tracks.from_x_m, tracks.from_y_m)
    way_m = np.where(across_mps > 0.0, way_m, -way_m)
    walked_m: np.ndarray = way_m - np.abs(across_mps) * tracks.placed_s()
    return walked_m


def _contradicted(tracks: TrackStore, shown: np.ndarray, health: SensorHealth) -> np.ndarray:
    """Tracks that LiDAR does not see where it sees the road, or would see them."""
    unswept = tracks.lidar.age_s >= HELD_S
    sees_road = health.free_to_m[:, None] > tracks.x_m + FREE_MARGIN_M
    # How far away a person is whom the camera alone shows nobody measures, and who walks beside a
    # curve that begins is straight ahead.
    alone = is_person(tracks.label) & (tracks.radar.hits < WALKS_ECHOES)
    would_see = (_is_any(tracks.label, _VEHICLES) | alone) & shown
    # What comes near by radar alone is a mirror image of what drives elsewhere.
    mirrored = (tracks.camera.age_s >= RECENT_S) & shown & (tracks.x_m < PATH_SURE_M)
    contradicted: np.ndarray = unswept & (sees_road | would_see | mirrored)
    return contradicted


def _unechoed(tracks: TrackStore, ego: EgoMotion, health: SensorHealth) -> np.ndarray:
    """Vehicles that a camera shows, and neither LiDAR nor radar, at speed: a lorry labelled as a
    car seems half as far away, and one echo of a guard rail in its direction makes it stand."""
    echoes: np.ndarray = (tracks.radar.hits < BOX_ECHOES) | (tracks.radar.age_s > HELD_S)
    unseen = echoes & (tracks.lidar.age_s >= HELD_S) & _is_any(tracks.label, _VEHICLES)
    # A person near by has an echo, too.
    never = (tracks.radar.hits + tracks.lidar.hits == 0.0) & is_person(tracks.label)
    return (unseen | never) & (health.radar_sees & (ego.speed_mps > BOX_MPS))[:, None]
