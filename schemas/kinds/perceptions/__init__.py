"""Declarations of the perception variants that are shipped."""

from schemas.kinds.perceptions import ground_truth, network

KINDS = (ground_truth.KIND, network.KIND)
"""Messages about them list them in this order."""
