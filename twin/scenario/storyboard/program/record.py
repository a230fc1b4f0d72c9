"""What all records of a storyboard program have in common."""

from __future__ import annotations

import msgspec


class ProgramRecord(
    msgspec.Struct, frozen=True, tag=True, array_like=True, forbid_unknown_fields=True
):
    """A frozen record that travels between processes.

    Written as a list, its name first and then its fields in their order, so who reads one knows by
    its declaration which records, types and how many fields may stand where.
    """
