"""The campaign section ``scenario``: what the ego is asked to do, and when that counts as done.

Keys of all families stand side by side in it (:mod:`schemas.kinds.scenario`); a family reads its
own as :meth:`~schemas.kinds.scenario.ScenarioKind.config_of`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from msgspec import UNSET, Meta, Struct, UnsetType, defstruct
from msgspec.structs import FieldInfo, fields

from schemas.kinds.scenario import kind_of, scenario_kinds
from schemas.words import agree

_KINDS = scenario_kinds()

SCENE = "downtown"
"""Scene of a scenario that names none."""

if TYPE_CHECKING:
    _Type = str
else:  # A family that cannot be used is named, too: who asks for it is told why.
    _Type = Literal[(*(kind.name for kind in _KINDS.declared), *_KINDS.broken)]


class _Common(Struct, frozen=True):
    """Keys that every family has."""

    type: _Type = _KINDS.declared[0].name
    """What the ego is asked to do."""
    scene: str = SCENE
    """Name of a shipped scene, or the path of a scene file."""
    vehicle: str = "opencav"
    """Name of a shipped vehicle, or the path of a vehicle file."""
    ego_speed_mps: Annotated[float, Meta(ge=0, le=30)] = 0.0
    """Speed of the ego at the start [m/s]."""
    duration_s: Annotated[float, Meta(ge=0.1, le=3600)] = 60.0
    """Longest sim time of a case [s]."""
    standstill_s: Annotated[float, Meta(ge=0, le=60)] = 2.0
    """The case ends this long after the ego has come to rest [s]."""
    # In no message that does not set them, as keys of families.
    load_kg: Annotated[float, Meta(ge=0, le=100_000)] | UnsetType = UNSET
    """Load of the ego beside the mass in its vehicle file: its mass, centre of gravity and inertia
    change, its springs and brakes do not [kg]."""
    load_x_m: Annotated[float, Meta(ge=-20, le=40)] | UnsetType = UNSET
    """Place of the load ahead of the rear axle; not given: 1 [m]."""
    load_y_m: Annotated[float, Meta(ge=-5, le=5)] | UnsetType = UNSET
    """Place of the load to the left of the middle; not given: 0 [m]."""
    load_z_m: Annotated[float, Meta(ge=0, le=10)] | UnsetType = UNSET
    """Height of the load above the ground; not given: 0.7 [m]."""


_FIRST = (
    *("type", "scene", "vehicle", "ego_start_m", "ego_speed_mps"),
    *("duration_s", "standstill_s", "false_braking_m"),
    *("distance_m", "lateral_limit_m", "lateral_rms_limit_m"),
)
"""Keys that stand in every message and file, in this order, as in the first version."""


def _field(key: FieldInfo) -> tuple[str, Any, Any]:
    """A key of a family. Any but the first is in no message that does not set it, so a campaign's
    digest has the families that it uses and no others."""
    if key.name in _FIRST:
        return key.name, key.type, key.default
    return key.name, key.type | UnsetType, UNSET


def _check(self: Scenario) -> None:
    """Refuse keys that the family would not look at."""
    if reason := _KINDS.broken.get(self.type):
        raise ValueError(reason)
    for kind in _KINDS.declared:
        if kind.name == self.type:
            continue
        names = kind.config.__struct_fields__
        foreign = [name for name in names if getattr(self, name) != _DEFAULTS[name]]
        if foreign:
            raise ValueError(
                f"{' and '.join(foreign)} {agree(len(foreign), 'is', 'are')} set, but "
                f"{agree(len(foreign), 'it belongs', 'they belong')} to type {kind.name} and this "
                f"is {self.type}"
            )
    # The types of the keys have been looked at, what is missing not.
    kind_of(self).config_of(self)


_FIELDS = [
    *((key.name, key.type, key.default) for key in fields(_Common)),
    *(_field(key) for kind in _KINDS.declared for key in fields(kind.config)),
]
_FIELDS.sort(key=lambda field: _FIRST.index(field[0]) if field[0] in _FIRST else len(_FIRST))
_DEFAULTS = {name: default for name, _, default in _FIELDS}

if TYPE_CHECKING:

    class Scenario(_Common, frozen=True):
        """What the ego is asked to do, where, and when that counts as done."""

        def __getattr__(self, name: str) -> Any:
            """A key of a family."""

else:
    Scenario = defstruct(
        "Scenario",
        _FIELDS,
        namespace={
            "__doc__": "What the ego is asked to do, where, and when that counts as done.",
            "__post_init__": _check,
            "__sources__": (_Common, *(kind.config for kind in _KINDS.declared)),
            "__meanings__": {
                "type": " ".join(f"`{kind.name}`: {kind.doc}." for kind in _KINDS.declared)
            },
        },
        module=__name__,
        frozen=True,
        forbid_unknown_fields=True,
    )
