"""Chains of a search: independent searches side by side, and the one answer that they have.

A chain is a sampler with random numbers and a share of the budget of its own. Generations are
numbered in the order in which they are proposed, and close in this order: when one closes, its
chain proposes the next. So what is proposed, and where a search ends, is decided by the closed
generations in their order, while workers have those of the other chains to work on.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from conductor.search.intervals import lognormal, relative_error
from conductor.search.protocol import Estimate, History
from schemas.files.search_result import ChainEstimate


def history_of(chain: int, whole: History, chains: Sequence[int]) -> History:
    """The history of one chain.

    Args:
        chain: which one.
        whole: all closed generations.
        chains: chain of each of them; empty: there is one.
    """
    if not chains:
        return whole
    own = [place for place, other in enumerate(chains) if other == chain]
    return History([whole.u[place] for place in own], [whole.g[place] for place in own])


def mean_of(chains: int, estimates: Sequence[ChainEstimate]) -> Estimate:
    """The mean of independent estimates, once all of the chains have one: those that have theirs
    early do not stand for all.

    The error is what the chains say of themselves or what their spread says, whichever is larger.
    """
    known = [one for one in estimates if one.probability is not None]
    if len(known) < chains:
        return Estimate(method=f"mean of {chains} chains; {len(known)} of them have an answer")
    method = f"mean of {chains} chains, lognormal interval; each: {known[0].method}"
    each = np.array([one.probability for one in known], np.float64)
    mean = float(np.mean(each))
    if not mean > 0.0:  # none has seen a failure, so the narrowest of them holds for all
        high = min((one.high for one in known if one.high is not None), default=1.0)
        return Estimate(method=method, probability=0.0, low=0.0, high=high)
    errors = [p * relative_error(p, one.low) for p, one in zip(each, known, strict=True)]
    within = float(np.sqrt(np.sum(np.square(errors)))) / chains
    between = float(np.std(each, ddof=1)) / float(np.sqrt(chains))
    low, high = lognormal(mean, max(within, between) / mean)
    return Estimate(method=method, probability=mean, low=low, high=high)
