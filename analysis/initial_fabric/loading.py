"""The last step of each test, the CR test, as one small data set: the state at its start and the curves after it."""

from __future__ import annotations

import numpy as np
import xarray as xr

from analysis.critical_state.ends import TENSORS
from labkit.micro import deviatoric_stress, mean_stress

STRAIN = np.linspace(0.0, 0.15, 151)  # axial strain since the start of the CR test
STATE = {**TENSORS, "stress": "stress", "stress_sff": "stress_sff"}
SCALARS = {"Z": "coordination_number", "Lambda": "mean_normalised_force", "e": "void_ratio_nominal"}
ANGLES = {"sheared00": 0.0, "sheared45": 45.0, "sheared90": 90.0}  # degrees from z to the axis of the previous shear


def loading_of(run: xr.Dataset) -> xr.Dataset:
    """The CR test of a run. Dimensions point, i, j.

    ratio (q/p), volumetric (strain, compression positive), Z, Lambda and e (nominal) at the axial strains STRAIN; A, F,
    Ft, stress and stress_sff (C0, Pa) at its start.
    """
    step = run["path_step"].values
    first = max(int(np.flatnonzero(step == step.max())[0]) - 1, 0) if step.max() > 1 else 0
    test = run.isel(time=slice(first, None))
    strain = test["strain"].values.astype(float)
    stress = test["stress"].values.astype(float)
    axial = strain[:, 2, 2] - strain[0, 2, 2]
    volumetric = np.trace(strain - strain[0], axis1=1, axis2=2)
    curves = {
        "ratio": deviatoric_stress(stress) / mean_stress(stress),
        "volumetric": volumetric,
        **{name: test[key].values.astype(float) for name, key in SCALARS.items()},
    }
    data = xr.Dataset({name: ("point", np.interp(STRAIN, axial, values)) for name, values in curves.items()})
    for name, key in STATE.items():
        data[name] = (("i", "j"), test[key].values[0].astype(float))
    return data


def specimen_of(run: str) -> str:
    """The packing that was tested, e.g. `loose-s1` for `sheared45-loose_500-s1`."""
    return run.partition("-")[2].replace("_500", "")
