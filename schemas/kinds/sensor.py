"""The table of the vehicle's own sensors: what they read, how often, and who implements them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Literal

from msgspec import Meta, Struct

from schemas.kinds.registry import Kinds, read_kinds

GROUP = "drivetwin.sensors"
"""Entry points that bring sensors."""

OURS = {"shipped": "schemas.kinds.sensors:KINDS"}
"""Sensors that are shipped; the same as in pyproject.toml."""

ControlRate = Annotated[int, Meta(ge=0, le=500)]
Share = Annotated[float, Meta(ge=0, le=0.5)]
CorrelationTime = Annotated[float, Meta(ge=0.1, le=1_000_000)]
Point = Annotated[list[Annotated[float, Meta(ge=-20, le=20)]], Meta(min_length=3, max_length=3)]
"""x forward of the vehicle's reference point, y left, z up [m]."""


class SensorConfig(Struct, frozen=True, forbid_unknown_fields=True):
    """Keys that every sensor has. Which sensors there are and their rates are the rig's, all other
    keys the case's."""

    on: bool = True
    """Whether the sensor is there."""
    hz: ControlRate = 0
    """Readings per second, a divisor of the control rate; 0: the control rate [Hz]."""


@dataclass(frozen=True, slots=True)
class MadeUpDrive:
    """A moment of the made-up drive that ``devkit check`` shows to stacks."""

    seed: int
    tick: int
    time_s: float
    speed_mps: float
    """Speed, constant and straight on."""


class PointsLook(Struct, frozen=True):
    """How viewers draw a sensor's rows as points in its axes: names of columns."""

    range_m: str
    """Distance from the sensor."""
    azimuth_rad: str
    """To the left of forward."""
    elevation_rad: str
    """Upwards; empty: all lie level."""
    color: str
    """Colours the points: blue at the end of :attr:`span`, grey at 0, red at its beginning."""
    span: tuple[float, float]
    """Values of the full colours, below and above 0."""


class GridLook(Struct, frozen=True):
    """How viewers draw a sensor's grid as a picture: its largest values along the last axis, the
    first axis upwards, in decibels."""

    low_db: float
    """Shown black."""
    high_db: float
    """Shown white."""


@dataclass(frozen=True, slots=True)
class Ros2Form:
    """Standard ROS 2 message that a sensor's row, or its rows, become."""

    type_name: str
    """``sensor_msgs/msg/Imu``, ``sensor_msgs/msg/NavSatFix`` or ``radar_msgs/msg/RadarScan``: those
    that :mod:`twin.ros2.sensing` makes."""
    fields: Mapping[str, str]
    """Field of the message, or of each return in it -> column. ``status``: of a fix, 1 where there
    is one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorKind:
    """Declaration of a sensor that gives rows of numbers, or a grid of them."""

    name: str
    """Name of its section in ``sensors``, and of its message."""
    doc: str
    """One sentence for ``--help`` and docs."""
    config: type[SensorConfig]
    """Keys of its section, with types, ranges, defaults and meanings."""
    columns: tuple[str, ...]
    """Names of the numbers of a row, unit last."""
    columns_name: str
    """How pages call the list of columns."""
    dtype: Literal["<f8", "<i8", "<f4"]
    rows_max: int = 0
    """Most rows of a slot; 0: a row per slot [S, K]. With any other number it looks at the world
    and has as many rows as it sees [S, N, K], with the number of valid ones per slot."""
    grid: tuple[int, ...] = ()
    """Cells of a slot along each axis; with it, the sensor looks at the world and has a value per
    cell [S, ...], and :attr:`columns` name its axes."""
    implementation: str
    """``module:attribute`` of its :class:`twin.sensors.mount.Sensor`; if it looks at the world, of
    its :class:`twin.sensors.ray_sensor.RaySensor`."""
    part_of: str = ""
    """Another sensor of this table, declared before it, whose measurements it is made of: it is
    there only beside that one, and that one's rate is a multiple of its own."""
    no_axes: tuple[str, ...] = ()
    """Keys that no matrix may vary."""
    points: PointsLook | None = None
    """With ``rows_max``: how viewers draw its rows; None: not at all."""
    picture: GridLook | None = None
    """With ``grid``: how viewers draw it; None: not at all."""
    ros2: Ros2Form | None = None
    """Its message of ROS 2; None: it has only one of the drive plane's arrays."""
    site: str = ""
    """With :attr:`points`: ``module:attribute`` of a function of a case and its vehicle that says
    where the sensor sits: x forward of the vehicle's reference point, y left, z up [m]; and its
    roll, pitch and yaw, as of :class:`schemas.sections.lidar.LidarMount` [deg]."""
    memory: str = ""
    """If it looks at the world: ``module:attribute`` of a function of a case and its world that
    says what a slot takes of a GPU besides its values [bytes]; empty: nothing."""
    made_up: Callable[[MadeUpDrive], list[float] | list[list[float]]]
    """A row of the made-up drive; with ``rows_max``, rows; with ``grid``, cells, each as its place
    along the axes and its value, all others being 0."""

    @property
    def looks(self) -> bool:
        """Whether it looks at the world."""
        return bool(self.rows_max or self.grid)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of a slot's values."""
        if self.grid:
            return self.grid
        return (self.rows_max, len(self.columns)) if self.rows_max else (len(self.columns),)


@cache
def sensor_kinds() -> Kinds[SensorKind]:
    """All sensors of this table, the shipped ones first."""
    return read_kinds(GROUP, SensorKind, OURS)


def drawn_kinds(names: Iterable[str]) -> list[SensorKind]:
    """The sensors among ``names`` whose rows viewers draw as points."""
    kinds = (sensor_kinds().find(name) for name in names)
    return [kind for kind in kinds if kind.points is not None]


def shown_columns(names: Iterable[str]) -> dict[str, list[str]]:
    """Columns of those sensors that give a row per slot, which viewers plot."""
    kinds = (sensor_kinds().find(name) for name in names)
    return {kind.name: list(kind.columns) for kind in kinds if not kind.looks}


def pictured_kinds(names: Iterable[str]) -> list[SensorKind]:
    """The sensors among ``names`` whose grids viewers draw as pictures."""
    kinds = (sensor_kinds().get(name) for name in names)
    return [kind for kind in kinds if kind is not None and kind.picture is not None]
