"""What a campaign says about a stack that is not a Python class of this installation."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from msgspec import Meta, Struct

from schemas.kinds.bridge import NONE, BridgeChoice

Word = Annotated[str, Meta(min_length=1, max_length=4096)]
"""One word of a command line."""

Runtime = Literal["auto", "apptainer", "charliecloud", "podman"]
"""What runs a container; ``auto``: the first of them that is installed."""


class Repository(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the files of a stack come from; the command runs in them."""

    url: Word
    """What `git clone` takes: a URL, or the path of a clone, bare or not."""
    ref: Word = "HEAD"
    """Branch, tag or commit; replaced by the commit when the campaign is loaded."""
    setup: str = ""
    """Shell command that is run in the files once, such as a build; read-only afterwards."""


PASSWORD = "has a user or password in it; leave it out, git's credential helper or ssh knows it"


def holds_password(url: str) -> bool:
    """Whether a repository's address has a password or token in it, which all logs would show.

    The user of ``ssh`` is none.
    """
    match = re.match(r"([a-z+]+)://([^/@]*)@", url, re.IGNORECASE)
    return match is not None and (match[1].lower().startswith("http") or ":" in match[2])


class ContainerImage(Struct, frozen=True, forbid_unknown_fields=True):
    """The container in which the command runs."""

    path: Word
    """Absolute path of a SIF or of an image folder; with podman a name."""
    runtime: Runtime = "auto"
    """What runs it; ``auto``: the first of them that is installed."""
    binds: list[Word] = []
    """Absolute folders that are seen inside under the same path."""
    gpus: bool = False
    """Let the host's NVIDIA driver in."""


class Foreign(Struct, frozen=True, forbid_unknown_fields=True):
    """How the stack of a case is started; part of :class:`schemas.case.RigSpec`."""

    command: list[Word]
    """Words of the command line."""
    bridge: BridgeChoice = NONE
    """``none``: the command speaks the drive plane itself."""
    repository: Repository | None = None
    image: ContainerImage | None = None
