import numpy as np


def jerk(rows):
    time_s = rows.column("sim_time_ns") / 1e9
    return np.append(np.nan, np.diff(rows.column("accel_mps2")) / np.diff(time_s))


def jerk_peak(rows):
    known = rows.column("jerk_mps3")[rows.valid("jerk_mps3")]
    return float(np.abs(known).max()) if len(known) else None
