"""The campaign section ``sensors``: which of the vehicle's own sensors there are.

A sensor is there if the section names it: ``sensors: {gnss: {}, imu: {hz: 10}}``. The keys of each
stand in its declaration (:mod:`schemas.kinds.sensor`). Every amplitude is one standard deviation
(1 sigma) unless it says otherwise; 0 switches that error off, ``noise: false`` all errors of the
sensor. Rates divide the control rate.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from msgspec import UNSET, Struct, UnsetType, defstruct

from schemas.kinds.sensor import SensorConfig, SensorKind, sensor_kinds
from schemas.kinds.sensors import FIRST

_KINDS = sensor_kinds()


def field_of(kind: SensorKind) -> tuple[str, Any, Any]:
    """A sensor that is not named is not there. Any but the first is in no message that does not
    name it, so a campaign's digest has the sensors that it uses and no others."""
    if kind.name in FIRST:
        return kind.name, kind.config, kind.config(on=False)
    return kind.name, kind.config | UnsetType, UNSET


def _sections(self: Sensors) -> dict[str, SensorConfig]:
    """Section of every sensor that was named, or is one of the first, by name, in the table's
    order."""
    pairs = ((name, getattr(self, name)) for name in self.__struct_fields__)
    return {name: section for name, section in pairs if section is not UNSET}


def _rates(self: Sensors, control_hz: int) -> dict[str, int]:
    """Name -> rate of every sensor that is on, in the table's order [Hz]."""
    sections = self.sections()
    return {name: section.hz or control_hz for name, section in sections.items() if section.on}


if TYPE_CHECKING:

    class Sensors(Struct, frozen=True, forbid_unknown_fields=True):
        """The section ``sensors``, made of the table."""

        def sections(self) -> dict[str, SensorConfig]:
            """Section of every sensor that was named, or is one of the first."""

        def rates(self, control_hz: int) -> dict[str, int]:
            """Name -> rate of every sensor that is on [Hz]."""

        def __getattr__(self, name: str) -> Any: ...

else:
    Sensors = defstruct(
        "Sensors",
        [field_of(kind) for kind in _KINDS.declared],
        namespace={
            "__doc__": "The section ``sensors``: a sensor that is not named is not there.",
            "sections": _sections,
            "rates": _rates,
        },
        module=__name__,
        frozen=True,
        forbid_unknown_fields=True,
    )
