"""Published figures that reports draw as marks: Romeres et al., ICRA 2019 (MERL TR2019-028).

The authors measured them on their rig. A simulated rig is easier in some ways and harder in others.
"""

from __future__ import annotations

# ring 1 to 5 on hardware, s
RUNS, ARRIVED = 10, 7
TIMES = {"best": 6.2, "mean": 7.71, "worst": 10.13}

# test nRMSE of theta_dd, rings 1 to 4
NRMSE = {
    "rf": (0.49, 0.59, 0.53, 0.67),
    "pi": (0.48, 0.63, 0.65, 0.81),
    "np": (0.38, 0.45, 0.42, 0.71),
    "sp": (0.35, 0.43, 0.40, 0.65),
}
# mean absolute theta error after 20 and 40 steps at 30 Hz, rad, rings 1 to 3 (the row of ring 4 looks like a misprint)
ROLLOUT = {
    "sp": ((0.11, 0.25), (0.15, 0.33), (0.18, 0.32)),
    "npd": ((1.36, 3.01), (0.87, 2.09), (0.99, 2.26)),
}
