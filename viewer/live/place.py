"""The options of commands that look at, or intervene in, the running cases of a conductor."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin.fabric.connection_options import (
    ConnectOption,
    InsecureOption,
    KeyOption,
    NamespaceOption,
)
from twin.fabric.endpoint import NAMESPACE

if TYPE_CHECKING:
    from typing import Any

    from viewer.live.command import LiveOptions


@dataclass(frozen=True, slots=True, kw_only=True)
class LivePlace:
    """Options that say whose cases are meant, also behind a login node; see
    :func:`twin.base.option_record.with_options`."""

    connect: ConnectOption = ""
    run: Annotated[
        Path | None,
        typer.Option(
            *("--run", "--state"), help="Or: campaign or state folder, on a shared file system."
        ),
    ] = None
    namespace: NamespaceOption = NAMESPACE
    key: KeyOption = None
    insecure: InsecureOption = False
    ssh: Annotated[
        str,
        typer.Option(help="Open a tunnel: --run or --connect as this host sees it, e.g. me@login."),
    ] = ""
    node: Annotated[
        str, typer.Option(help="With --ssh: host behind it that the tunnel ends at, e.g. cn042.")
    ] = ""

    def words(self) -> list[str]:
        """Options that mean the same cases for another command of ours."""
        words = ["--connect", self.connect] if self.connect else []
        words += ["--run", str(self.run)] if self.run is not None else []
        words += ["--namespace", self.namespace, *(["--key", str(self.key)] if self.key else [])]
        words += ["--ssh", self.ssh] if self.ssh else []
        words += ["--node", self.node] if self.node else []
        return [*words, *(["--insecure"] if self.insecure else [])]

    def live(self, **more: Any) -> LiveOptions:
        """The options of `viewer live`; ``more``: further fields of :class:`LiveOptions`."""
        from viewer.live.command import LiveOptions

        place: dict[str, Any] = {
            "connect": self.connect,
            "run": self.run,
            "ssh": self.ssh,
            "node": self.node,
        }
        return LiveOptions(**place, namespace=self.namespace, key=self.key, **more)
