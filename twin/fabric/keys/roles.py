"""Roles on the fabric, and the names of certificates that hold them.

What a role may do is in :mod:`twin.fabric.keys.rights`.
"""

from __future__ import annotations

from enum import StrEnum


class Role(StrEnum):
    """What a certificate stands for."""

    conductor = "conductor"
    """Does everything; relays are conductors, too."""
    worker = "worker"
    """Leases and commits, drives and shows its rigs: worker, simulator and recorder."""
    stack = "stack"
    """Drives in its rig, which has a fabric of its own; there are no others of this role."""
    viewer = "viewer"
    """Watches, and changes nothing."""
    admin = "admin"
    """Looks, cancels, stops and steers."""
    submitter = "submitter"
    """Looks, and submits campaigns: what they name is run by workers, as the workers' user."""


INVITED = (Role.viewer, Role.worker, Role.admin, Role.submitter)
"""Roles that somebody may be invited as, the least first; there is one conductor, and a stack gets
its key from its rig."""

MEMBERS = (Role.conductor, *INVITED)
"""Roles of which a conductor's folder of keys has one."""

IN_WORDS = {
    Role.conductor: "may do everything, also in the name of others",
    Role.worker: "may lease cases, run what they name, and deliver results",
    Role.stack: "may drive in its rig",
    Role.viewer: "may look, and change nothing",
    Role.admin: "may look, cancel, pause, stop and steer, but submit nothing",
    Role.submitter: (
        "may look, and submit campaigns: the commands and code that they name run on every "
        "worker, as its user"
    ),
}
"""What the holder of a key may do, for whoever gives or gets one."""


def common_name(fabric: str, role: Role) -> str:
    """What a certificate of ``role`` is called; no two fabrics share it."""
    return f"{fabric} {role}"


_RIG = "drivetwin rig "


def fabric_of_rig(rig: str) -> str:
    """The fabric that the simulator and the stack of ``rig`` are of, and nobody else."""
    return f"{_RIG}{rig}"


def rig_of(fabric: str) -> str:
    """The rig whose fabric this is; empty: it is that of a conductor."""
    return fabric.removeprefix(_RIG) if fabric.startswith(_RIG) else ""


def split_name(name: str) -> tuple[str, Role]:
    """Fabric and role of a certificate called ``name``; raises ValueError if it has none."""
    fabric, _, role = name.rpartition(" ")
    return fabric, Role(role)
