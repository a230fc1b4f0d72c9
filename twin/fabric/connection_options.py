"""The options of every command that connects to a conductor, declared once."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.base.command import is_command
from twin.fabric.endpoint import NAMESPACE, allow_plain, demand_keys

if TYPE_CHECKING:  # with it come the session and its keys, for which --help does not wait
    from twin.fabric.discovery import Target
    from twin.fabric.keys.roles import Role

ConnectOption = Annotated[
    str, typer.Option("--connect", help="The conductor's endpoint, e.g. tls/login1:7447.")
]
"""Where a conductor is; or a folder says it."""

NamespaceOption = Annotated[
    str, typer.Option("--namespace", help="Prefix of every key of this conductor's fabric.")
]
"""The namespace of a fabric."""

KeyOption = Annotated[
    Path | None,
    typer.Option(
        "--key",
        envvar="TWIN_KEY",
        help="Key file (mode 0600) or folder of keys, for tls/ endpoints; "
        "default: your own of that conductor, which --state or --run finds.",
    ),
]
"""The option of every command that connects."""


def _allow_plain(value: bool) -> bool:
    if value:
        allow_plain()
    elif is_command():
        demand_keys()
    return value


InsecureOption = Annotated[
    bool,
    typer.Option(
        "--insecure",
        callback=_allow_plain,
        help="Plain TCP without keys: whoever reaches the port, on loopback every user of this "
        "host, may read and command, and so run code as you.",
    ),
]
"""Option beside :data:`KeyOption`; works by itself, for the whole process."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ConductorOptions:
    """Conductor that a command talks to; see :func:`twin.base.option_record.with_options`."""

    connect: ConnectOption = ""
    state: Annotated[
        Path | None, typer.Option(help="Or: the conductor's state folder (holds conductor.json).")
    ] = None
    namespace: NamespaceOption = NAMESPACE
    key: KeyOption = None
    insecure: InsecureOption = False

    def target(self, role: Role) -> Target:
        """Target that the options mean; raises as :func:`choose_target`."""
        from twin.fabric.discovery import choose_target

        return choose_target(self.connect, self.state, self.namespace, self.key, role)
