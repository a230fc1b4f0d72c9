"""Names of sites, and where they stand in a worker's id: workers of several clusters that serve one
conductor are told apart by them."""

from __future__ import annotations

import re

SITE_PATTERN = r"[A-Za-z0-9][A-Za-z0-9-]{0,31}"
"""What a site may be called; it becomes a part of keys on the wire and of file names."""

_ID = re.compile(rf"\S+@({SITE_PATTERN})-[a-z]+[0-9]*-[0-9a-f]{{12}}")


def host_at(host: str, site: str) -> str:
    """Name of a host that is told apart from one of the same name at another site, ``n1@north``;
    without a site it is the host's own."""
    return f"{host}@{site}" if site else host


def site_of(worker: str) -> str:
    """Site that a worker's id names; empty: none."""
    match = _ID.fullmatch(worker)
    return match[1] if match else ""
