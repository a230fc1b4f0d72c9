"""What a stack under test consists of, as a digest that stands in every case."""

from __future__ import annotations

from msgspec import UNSET, Struct, UnsetType

IMAGE = "autonomy.image"
"""Name of the part that is the container image."""


class StackIdentity(Struct, frozen=True, forbid_unknown_fields=True):
    """Digest of a stack's code, data and models; filled in at submission."""

    digest: str = ""
    """SHA-256 over the names and contents of everything that the stack consists of. Empty: a
    shipped stack, which is part of the software digest, or a campaign of an older version."""
    parts: dict[str, str] = {}
    """Name of a file, or of a folder where there are many files, and the beginning of the SHA-256
    of its content; to say what differs."""
    named: dict[str, str] = {}
    """SHA-256 of the files and folders whose paths are values of parameters."""
    portable: bool | UnsetType = UNSET
    """Whether its class says that it computes the same on every machine; unset: it does not. It
    stands in no case and in no digest."""


class StackSource(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the files of a stack are found, beside its entry point, command and parameters."""

    files: list[str] = []
    """Absolute paths of further files and folders that it loads."""
    identity: StackIdentity = StackIdentity()
    """What it was at submission, without the files that parameters name."""
    parameters: dict[str, str] = {}
    """Parameter -> SHA-256 of the file or folder that it names."""

    @property
    def is_known(self) -> bool:
        """There is something to compare with."""
        return bool(self.identity.digest or self.parameters)


def difference(submitted: StackIdentity, here: StackIdentity) -> str:
    """What differs, as the beginning of a sentence; empty: nothing does."""
    if submitted.digest == here.digest:
        return ""
    before, now = submitted.parts, here.parts
    shared = sorted(before.keys() & now.keys())
    names = [
        *(f"{name} has changed" for name in shared if before[name] != now[name]),
        *(f"{name} is missing" for name in sorted(before.keys() - now.keys())),
        *(f"{name} is new" for name in sorted(now.keys() - before.keys())),
    ]
    if not before or not now or not names:  # parts are cut off, and may be left out
        return "the files that the stack consists of have changed"
    return names[0] + (f" (and {len(names) - 1} more)" if len(names) > 1 else "")
