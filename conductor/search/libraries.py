"""Whether the libraries of a search are there, asked without loading them for anybody else."""

from __future__ import annotations

from schemas.kinds.sampler import EXTRA
from schemas.sections.search import Search


def require(search: Search) -> None:
    """Load what the sampler of a search needs.

    Raises:
        ValueError: a library is missing; one line.
    """
    try:
        # Late: only who searches has the libraries, and waits for them.
        from conductor.search.driver import load
    except ImportError as error:
        raise ValueError(f"a search needs further libraries ({error}); {EXTRA}") from None
    load(search)
