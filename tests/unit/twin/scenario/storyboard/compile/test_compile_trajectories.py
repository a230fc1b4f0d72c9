"""Trajectories of every shape: pieces lie on the curve, with times and headings."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lxml", reason="lxml is not installed")

from compiled_text import compiled, scenario_text

from twin.scenario.storyboard.program.actions import FollowTrajectoryAction
from twin.scenario.storyboard.program.places import Trajectory

TOLERANCE_M = 1e-5
TOLERANCE_RAD = 1e-6


def follow(shape: str, timing: str = "<None/>", closed: str = "false") -> str:
    """An action that follows a shape."""
    return (
        "<PrivateAction><RoutingAction><FollowTrajectoryAction><TrajectoryRef>"
        f'<Trajectory name="t" closed="{closed}"><Shape>{shape}</Shape></Trajectory>'
        f"</TrajectoryRef><TimeReference>{timing}</TimeReference>"
        '<TrajectoryFollowingMode followingMode="position"/></FollowTrajectoryAction>'
        "</RoutingAction></PrivateAction>"
    )


def _trajectory(folder: Path, shape: str, closed: str = "false") -> Trajectory:
    program = compiled(folder, scenario_text(action=follow(shape, closed=closed))).program
    (trajectory,) = program.trajectories
    return trajectory


def _samples(trajectory: Trajectory, count: int = 7) -> np.ndarray:
    """s, x, y, z, heading at places of all pieces."""
    rows = []
    for piece in trajectory.pieces:
        ahead = np.linspace(0.0, piece.length_m, count)
        columns = [
            c[0] + ahead * (c[1] + ahead * (c[2] + ahead * c[3]))
            for c in (piece.x, piece.y, piece.z, piece.heading)
        ]
        rows.append(np.stack([piece.start_s_m + ahead, *columns], axis=1))
    return np.concatenate(rows)


def vertex(x: float, y: float, *, h: float | None = None, time: float | None = None) -> str:
    """A vertex of a polyline."""
    heading = "" if h is None else f' h="{h}"'
    moment = "" if time is None else f' time="{time}"'
    return (
        f'<Vertex{moment}><Position><WorldPosition x="{x}" y="{y}"{heading}/></Position></Vertex>'
    )


def test_polyline_with_a_corner(tmp_path: Path) -> None:
    corner = vertex(0, 0) + vertex(10, 0) + vertex(10, 5)
    trajectory = _trajectory(tmp_path, f"<Polyline>{corner}</Polyline>")
    assert [piece.length_m for piece in trajectory.pieces] == [10, 5]
    assert [piece.start_s_m for piece in trajectory.pieces] == [0, 10]
    assert [piece.heading[0] for piece in trajectory.pieces] == pytest.approx([0, math.pi / 2])
    assert not trajectory.timed


def test_headings_of_vertices_turn_evenly(tmp_path: Path) -> None:
    line = vertex(0, 0, h=3.0) + vertex(10, 0, h=-3.0)
    (piece,) = _trajectory(tmp_path, f"<Polyline>{line}</Polyline>").pieces
    assert piece.heading[0] == 3.0
    assert piece.heading[1] * 10 == pytest.approx(2 * math.pi - 6.0)


def test_times_of_vertices_and_standing(tmp_path: Path) -> None:
    line = vertex(0, 0, time=1) + vertex(10, 0, time=3) + vertex(10, 0, time=4.5)
    trajectory = _trajectory(tmp_path, f"<Polyline>{line}</Polyline>")
    assert trajectory.timed
    times = [(piece.start_time_s, piece.duration_s) for piece in trajectory.pieces]
    assert times == [(1, 2), (3, 1.5)]
    assert trajectory.pieces[1].length_m == 0.0


def test_closed_polyline_comes_back(tmp_path: Path) -> None:
    corner = vertex(0, 0) + vertex(3, 0) + vertex(3, 4)
    trajectory = _trajectory(tmp_path, f"<Polyline>{corner}</Polyline>", "true")
    assert [piece.length_m for piece in trajectory.pieces] == [3, 4, 5]
    assert trajectory.closed


def test_clothoid_is_its_integral(tmp_path: Path) -> None:
    """The place is the integral of the direction, by Simpson's rule with 20,000 steps."""
    start = '<Position><WorldPosition x="2" y="-3" h="0.4"/></Position>'
    trajectory = _trajectory(
        tmp_path,
        f'<Clothoid curvature="0.02" curvaturePrime="-0.004" length="60">{start}</Clothoid>',
    )
    samples = _samples(trajectory)
    s = np.linspace(0.0, 60.0, 40_001)
    heading = 0.4 + 0.02 * s - 0.002 * s * s
    step = s[2] - s[0]
    truth = []
    for first, function in ((2.0, np.cos), (-3.0, np.sin)):
        value = function(heading)
        parts = step / 6 * (value[:-2:2] + 4 * value[1:-1:2] + value[2::2])
        truth.append(np.interp(samples[:, 0], s[::2], first + np.append(0.0, np.cumsum(parts))))
    assert np.abs(samples[:, 1] - truth[0]).max() < TOLERANCE_M
    assert np.abs(samples[:, 2] - truth[1]).max() < TOLERANCE_M
    angle = 0.4 + 0.02 * samples[:, 0] - 0.002 * samples[:, 0] ** 2
    assert np.abs(samples[:, 4] - angle).max() < TOLERANCE_RAD


def test_spline_of_clothoids_joins_and_starts_at_the_actor(tmp_path: Path) -> None:
    segments = "".join(
        f'<ClothoidSplineSegment curvatureStart="{a}" curvatureEnd="{b}" length="{length}"/>'
        for a, b, length in ((0, 0, 10), (0, 0.1, 8), (0.1, 0.1, 5), (0.1, 0, 8))
    )
    trajectory = _trajectory(tmp_path, f"<ClothoidSpline>{segments}</ClothoidSpline>")
    assert trajectory.from_actor
    samples = _samples(trajectory)
    jumps = np.abs(np.diff(samples[::7, 1:], axis=0))
    ends = samples[6::7][:-1]
    starts = samples[7::7]
    assert np.abs(ends - starts).max() < 1e-6
    assert jumps.max() < 20
    assert samples[-1, 0] == pytest.approx(31.0)
    assert samples[-1, 4] == pytest.approx(0.4 + 0.5 + 0.4, abs=1e-6)
    assert samples[0, 1:] == pytest.approx([0.0, 0.0, 0.0, 0.0], abs=1e-7)


def test_clothoids_with_times_are_driven_evenly(tmp_path: Path) -> None:
    start = '<Position><WorldPosition x="2" y="-3" z="1.5"/></Position>'
    trajectory = _trajectory(
        tmp_path,
        '<Clothoid curvature="0.02" curvatureDot="0.001" length="60" startTime="2" stopTime="8">'
        f"{start}</Clothoid>",
    )
    first, last = trajectory.pieces[0], trajectory.pieces[-1]
    assert trajectory.timed
    assert first.start_time_s == 2.0
    assert last.start_time_s + last.duration_s == pytest.approx(8.0)
    for piece in trajectory.pieces:
        assert piece.duration_s == pytest.approx(piece.length_m / 10.0)
    samples = _samples(trajectory)
    assert samples[-1, 4] == pytest.approx(0.02 * 60 + 0.0005 * 60**2, abs=TOLERANCE_RAD)
    assert samples[:, 3] == pytest.approx(1.5)


def test_segments_of_clothoids_have_times_and_turn_by_their_offset(tmp_path: Path) -> None:
    segments = "".join(
        f'<ClothoidSplineSegment curvatureStart="0" curvatureEnd="0" length="{length}" '
        f'hOffset="{offset}" timeStart="{begin}"/>'
        for length, offset, begin in ((10, 0.0, 1), (20, 0.5, 3))
    )
    shape = f'<ClothoidSpline timeEnd="8">{segments}</ClothoidSpline>'
    one, other = _trajectory(tmp_path, shape).pieces
    times = [(piece.start_time_s, piece.duration_s) for piece in (one, other)]
    assert times == [(1.0, 2.0), (3.0, 5.0)]
    assert (one.heading[0], other.heading[0]) == pytest.approx((0.0, 0.5))


def test_a_timed_trajectory_is_scaled_and_begins_by_the_clock(tmp_path: Path) -> None:
    line = f"<Polyline>{vertex(0, 0, time=1)}{vertex(10, 0, time=3)}</Polyline>"
    timing = '<Timing domainAbsoluteRelative="absolute" scale="2" offset="0.5"/>'
    text = follow(line, timing).replace(
        "<FollowTrajectoryAction>", '<FollowTrajectoryAction initialDistanceOffset="4">'
    )
    action = compiled(tmp_path, scenario_text(action=text)).program.elements[-1].action
    assert action == FollowTrajectoryAction(0, True, True, 2.0, 0.5, False, 4.0)


def nurbs(rows: list[tuple[float, float, float]], knots: list[float], order: int) -> str:
    """A NURBS from x, y and weight of its control points."""
    points = "".join(
        f'<ControlPoint weight="{w!r}"><Position><WorldPosition x="{x}" y="{y}"/></Position>'
        "</ControlPoint>"
        for x, y, w in rows
    )
    values = "".join(f'<Knot value="{knot}"/>' for knot in knots)
    return f'<Nurbs order="{order}">{points}{values}</Nurbs>'


def test_rational_quarter_is_a_circle(tmp_path: Path) -> None:
    """Three control points with weights 1, sqrt(1/2), 1 make an exact quarter of a circle."""
    rows = [(10, 0, 1.0), (10, 10, math.sqrt(0.5)), (0, 10, 1.0)]
    trajectory = _trajectory(tmp_path, nurbs(rows, [0, 0, 0, 1, 1, 1], 3))
    samples = _samples(trajectory)
    assert samples[-1, 0] == pytest.approx(5 * math.pi, abs=1e-6)
    angle = samples[:, 0] / 10
    assert np.abs(samples[:, 1] - 10 * np.cos(angle)).max() < TOLERANCE_M
    assert np.abs(samples[:, 2] - 10 * np.sin(angle)).max() < TOLERANCE_M
    assert np.abs(samples[:, 4] - angle - math.pi / 2).max() < TOLERANCE_RAD


def test_nurbs_with_an_inner_knot_passes_its_ends(tmp_path: Path) -> None:
    rows = [(0, 0, 1.0), (10, 0, 1.0), (20, 10, 2.0), (30, 10, 1.0), (40, 0, 1.0)]
    trajectory = _trajectory(tmp_path, nurbs(rows, [0, 0, 0, 0, 1, 2, 2, 2, 2], 4))
    samples = _samples(trajectory)
    assert samples[0, 1:3] == pytest.approx([0, 0], abs=1e-6)
    assert samples[-1, 1:3] == pytest.approx([40, 0], abs=1e-6)
    # Along the way as long as s says.
    ways = np.hypot(*np.diff(samples[:, 1:3], axis=0).T)
    assert ways.sum() == pytest.approx(samples[-1, 0], rel=1e-3)


def test_a_nurbs_with_times_takes_them_along_the_curve(tmp_path: Path) -> None:
    shape = nurbs([(0, 0, 1.0), (10, 0, 1.0), (20, 0, 1.0)], [0, 0, 0.5, 1, 1], 2)
    times = iter((2, 3, 7))
    shape = re.sub("<ControlPoint", lambda _: f'<ControlPoint time="{next(times)}"', shape)
    trajectory = _trajectory(tmp_path, shape)
    first, last = trajectory.pieces[0], trajectory.pieces[-1]
    assert trajectory.timed
    assert first.start_time_s == pytest.approx(2.0)
    assert last.start_time_s + last.duration_s == pytest.approx(7.0)
    (middle,) = [piece for piece in trajectory.pieces if piece.start_s_m == pytest.approx(10.0)]
    assert middle.start_time_s == pytest.approx(3.0, abs=1e-6)


def test_equal_trajectories_have_one_number(tmp_path: Path) -> None:
    shape = f"<Polyline>{vertex(0, 0)}{vertex(10, 0)}</Polyline>"
    init = follow(shape)
    program = compiled(tmp_path, scenario_text(init=init, action=follow(shape))).program
    assert len(program.trajectories) == 1
    action = program.init[0].action
    assert isinstance(action, FollowTrajectoryAction)
    assert (action.trajectory, action.timed, action.follow) == (0, False, False)
