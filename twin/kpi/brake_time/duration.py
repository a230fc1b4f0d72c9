"""``brake_time_s``: sim time during which the stack's command brakes."""

from __future__ import annotations

import numpy as np

from twin.scenario.protocol import Rows


def brake_time_s(rows: Rows) -> float | None:
    """Sum of the control periods whose command brakes [s]; None: there was no command."""
    asked = rows.valid("brake")[:-1]
    if not asked.any():
        return None
    periods_ns = np.diff(rows.column("sim_time_ns"))
    return float(periods_ns[asked & (rows.column("brake")[:-1] > 0.0)].sum() / 1e9)
