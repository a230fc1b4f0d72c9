"""Which class of devices a result depends on: its last bits may be others on another one."""

from __future__ import annotations

import re

from msgspec import UNSET

from schemas.campaign import Campaign
from schemas.files.software import hardware_of
from schemas.kinds.perception import perception_kind

PORTABLE = "portable"
"""Class of results that depend on no device; machines of different classes may mix."""

_PROVEN = re.compile(r"cpu:x86_64\+avx2\+fma|cuda:[^@]+")
"""Classes of machines whose bytes were compared (docs/decisions/0033-the-same-bytes-on-every-device
.md); behind an ``@`` stands the host of a GPU whose processor is another one."""


def result_class(portable: bool, machine: str) -> str:
    """The class of devices that results of a campaign depend on if a machine computes them.

    Args:
        portable: what :func:`is_portable` says of the campaign.
        machine: the machine's own class (:func:`schemas.files.software.machine_class`).

    Returns:
        :data:`PORTABLE`, or ``machine``.
    """
    return PORTABLE if portable and _PROVEN.fullmatch(hardware_of(machine)) else machine


def is_portable(campaign: Campaign) -> bool:
    """Whether results of ``campaign`` are the same on all machines of proven classes.

    All that computes them is ours, or says of itself that it is portable: no plug-ins, no stack on
    a host that nobody here sees or that says nothing, no network in floating point, no wall clock.
    All cases of a campaign are alike: one float network among its variants is enough.

    Args:
        campaign: as it was submitted, the identity of its stack filled in.
    """
    autonomy = campaign.autonomy
    return (
        campaign.clock == "lockstep"
        and campaign.stack_identity.portable is not UNSET
        and campaign.stack_identity.portable
        and not autonomy.command
        and autonomy.placement != "node"
        and not campaign.plugins
        and all(
            perception_kind(variant).portable(variant) for variant in autonomy.perception.values()
        )
    )
