"""Errors that users see: one line, a documented exit code, and the page that says more."""

from __future__ import annotations

import errno
from types import TracebackType

from schemas.escape import escape

EXIT_PASS = 0
"""Done, every case passed."""
EXIT_FAILED = 1
"""Done, at least one verdict is not a pass."""
EXIT_USAGE = 2
"""Usage or bad input."""
EXIT_INFRASTRUCTURE = 3
"""Infrastructure lost: storage, network, processes."""
EXIT_UNFINISHED = 75
"""Unfinished; run the same command again to go on."""
EXIT_INTERRUPTED = 130
"""Stopped by Ctrl-C; run the same command again to go on."""


LINE_MAX = 2000
"""Longest line of an error [characters]."""


class TwinError(Exception):
    """Base of the errors a user sees; ``str()`` is one line: given, allowed, what to do."""

    exit_code = EXIT_INFRASTRUCTURE

    def __init__(self, words: str) -> None:
        # A campaign's refusal has a line per mistake; within a line stands what strangers wrote.
        super().__init__("\n".join(escape(line, LINE_MAX) for line in words.split("\n")))


class UsageError(TwinError):
    """A value that was given cannot be used."""

    exit_code = EXIT_USAGE


class InfrastructureError(TwinError):
    """A disk, a network or a process let us down; nothing that was committed is lost."""

    exit_code = EXIT_INFRASTRUCTURE


class RefusedError(UsageError):
    """A stack, scene, vehicle or model is not what the campaign was submitted with: its rig is
    refused, and no case is charged for it."""


class StackFaultError(InfrastructureError):
    """The stack under test raised, left, or broke the protocol: that is its outcome, which the same
    attempt would have again."""


class UnreachableError(InfrastructureError):
    """An endpoint at which nobody answers (yet)."""


class UnfinishedError(TwinError):
    """Work is left; the same command resumes it."""

    exit_code = EXIT_UNFINISHED


def storage_error(error: OSError, what: str) -> TwinError:
    """An ``OSError`` about the path ``what`` as one line with what to do."""
    elsewhere = "choose a folder that can be written, with --out"
    in_the_way = "a file is where a folder should be; choose another with --out"
    misused = {
        errno.EROFS: elsewhere,
        errno.EACCES: elsewhere,
        errno.EPERM: elsewhere,
        errno.EEXIST: in_the_way,
        errno.ENOTDIR: in_the_way,
    }
    hints = misused | {
        errno.ENOSPC: "free some space and run the same command again",
        errno.EDQUOT: "the quota is used up; free some space and run the same command again",
    }
    reason = error.strerror or str(error)
    hint = hints.get(error.errno or 0, "")
    kind = UsageError if error.errno in misused else InfrastructureError
    return kind(f"{what}: {reason}" + (f"; {hint}" if hint else ""))


PAGES = {
    "conductor.campaigns": "campaign.md",
    "conductor.certify": "audit.md",
    "conductor.commands.audit_command": "audit.md",
    "conductor.commands.client": "security.md",
    "conductor.commands.key_commands": "security.md",
    "conductor.report.compare": "compare.md",
    "conductor.report": "report.md",
    "conductor.run.gpu_sharing": "gpu.md",
    "conductor.run.places": "gpu.md",
    "conductor.run.source": "campaign.md",
    "conductor.search": "search.md",
    "conductor.serve.metrics": "cluster.md",
    "conductor.stored": "result-stores.md",
    "conductor.trust": "verify.md",
    "devkit.bridges.ros2": "ros2.md",
    "devkit.bridges": "bridge.md",
    "devkit.darknet": "detectors.md",
    "devkit.detector": "detectors.md",
    "devkit.detector.integer": "integer-networks.md",
    "devkit.replaying": "stack.md",
    "devkit.stack": "stack.md",
    "devkit.training": "training.md",
    "hpc": "cluster.md",
    "hpc.kubernetes": "kubernetes.md",
    "hpc.sites": "sites.md",
    "hpc.software": "containers.md",
    "schemas.kinds": "kinds.md",
    "twin.base.cache": "containers.md",
    "twin.dataset": "dataset.md",
    "twin.drives": "ros2-recordings.md",
    "twin.fabric.keys": "security.md",
    "twin.road": "roads.md",
    "twin.sandbox": "sandbox.md",
    "twin.scenario.storyboard": "scenarios.md",
    "twin.scenario.storyboard.openscenario": "openscenario.md",
    "twin.sensors": "sensors.md",
    "twin.sensors.lidar": "lidar.md",
    "twin.sensors.radar": "radar.md",
    "twin.stack_identity": "stack.md",
    "twin.stores": "result-stores.md",
    "twin.world.meshes": "scene.md",
    "viewer": "viewer.md",
}
"""Module, or package with all that is in it -> page in ``docs``; the longest name counts."""


def page_of(trace: TracebackType | None) -> str:
    """Page about an error, e.g. ``docs/search.md``; empty: there is none.

    Args:
        trace: of the error. The innermost module that has a page is taken, because what it calls
            reads files and speaks to networks for many.
    """
    modules = []
    while trace is not None:
        modules.append(str(trace.tb_frame.f_globals.get("__name__", "")))
        trace = trace.tb_next
    for module in reversed(modules):
        name = module
        while name:
            if name in PAGES:
                return f"docs/{PAGES[name]}"
            name = name.rpartition(".")[0]
    return ""
