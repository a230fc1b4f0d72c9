"""The table of result stores: where a campaign's results and journal are kept beside the conductor.

A store is named by a URL; its scheme says of which kind it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from schemas.kinds.registry import Kinds, read_kinds

GROUP = "drivetwin.stores"
"""Entry points that bring result stores."""

OURS = {"shipped": "schemas.kinds.result_store:KINDS"}
"""Result stores that are shipped; the same as in pyproject.toml."""

EXTRA = "pip install 'drivetwin[store]'"
"""What brings the libraries of stores behind URLs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ResultStoreKind:
    """Declaration of a result store."""

    name: str
    title: str
    """The name in sentences."""
    schemes: tuple[str, ...]
    """Schemes of its URLs; empty: a path without a scheme."""
    implementation: str
    """``module:attribute`` of what opens it: URL -> :class:`twin.stores.protocol.ResultStore`."""
    example: str
    """How a user names one, for messages and ``--help``."""
    apart: bool = False
    """Whether a conductor runs it in a process of its own, because its libraries are large."""


KINDS = (
    ResultStoreKind(
        name="folder",
        title="folder",
        schemes=("", "file"),
        implementation="twin.stores.folder:open_folder",
        example="/shared/results",
    ),
    ResultStoreKind(
        name="fsspec",
        title="object store",
        schemes=("s3", "gs", "sftp", "ssh"),
        implementation="twin.stores.url:open_url",
        example="s3://bucket/prefix",
        apart=True,
    ),
)
"""The result stores that are shipped."""


@cache
def result_stores() -> Kinds[ResultStoreKind]:
    """All result stores, the shipped ones first."""
    return read_kinds(GROUP, ResultStoreKind, OURS)
