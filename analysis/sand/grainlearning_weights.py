"""Weights of samples by GrainLearning 2.0.5, in an interpreter that has it: `python grainlearning_weights.py DIR`."""

from __future__ import annotations

import sys

import numpy as np
from grainlearning import BayesianCalibration, DynamicSystem

OFFSET = 1000.0  # GrainLearning's error is relative to the observation: the same for all points

folder = sys.argv[1]
given = np.load(f"{folder}/in.npz")
points = len(given["measured"])
system = {
    "system_type": DynamicSystem,
    "param_names": [f"p{k}" for k in range(given["x"].shape[1])],
    "param_min": [0.0] * given["x"].shape[1],
    "param_max": [1.0] * given["x"].shape[1],
    "num_samples": len(given["x"]),
    "obs_data": (given["measured"] + OFFSET)[None, :].tolist(),
    "ctrl_data": list(range(points)),
    "sim_name": "sand",
}
inference = {"Bayes_filter": {"ess_target": 0.3}, "sampling": {"max_num_components": 1}}
calibration = BayesianCalibration.from_dict(
    {"num_iter": 1, "callback": None, "system": system, "inference": inference, "save_fig": -1}
)
calibration.system.param_data = given["x"]
calibration.system.set_sim_data((given["y"] + OFFSET)[:, None, :])
search = calibration.inference.Bayes_filter
errors = {}
for sigma in np.logspace(-9, -1, 161):  # instead of its bounded search, which stops at 0.01
    error = search.data_assimilation_loop(sigma, calibration.system, None)
    if np.isfinite(error):
        errors[sigma] = error
search.data_assimilation_loop(min(errors, key=lambda sigma: errors[sigma]), calibration.system, None)
np.save(f"{folder}/weights.npy", search.get_posterior_at_time(-1))
