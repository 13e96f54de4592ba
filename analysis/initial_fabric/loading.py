"""The last step of each test, the CR test, as one small data set: the state at its start and the curves after it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

import labkit as lk
from analysis.curves import write_data
from labkit.engines import Progress
from labkit.micro import deviatoric_stress, mean_stress

DATA = "loading.nc"
STRAIN = np.linspace(0.0, 0.15, 151)  # axial strain since the start of the CR test
TENSORS = {
    "A": "contact_anisotropy",
    "F": "normal_force_anisotropy",
    "Ft": "mobilisation",
    "stress": "stress",
    "stress_sff": "stress_sff",
}
SCALARS = {"Z": "coordination_number", "Lambda": "mean_normalised_force", "e": "void_ratio_nominal"}
ANGLES = {"sheared00": 0.0, "sheared45": 45.0, "sheared90": 90.0}  # degrees between z and the axis of the shear before


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
    for name, key in TENSORS.items():
        data[name] = (("i", "j"), test[key].values[0].astype(float))
    return data


def collect(files: Sequence[Path], output: Path, command: str, progress: Progress, title: str) -> None:
    """Reduces run files to one data set, dimensions run, point, i and j, and writes it with its provenance."""
    names, sets = [file.name.removesuffix(".run.nc") for file in files], []
    for k, file in enumerate(files):
        progress(k / len(files), f"reading {names[k]}")
        with lk.open_run(file) as run:
            sets.append(loading_of(run))
    data = xr.concat(sets, "run").assign_coords(run=names)
    write_data(data, files, output, command, title)


def specimen_of(run: str) -> str:
    """The packing that was tested, e.g. `loose-s1` for `sheared45-loose_500-s1`."""
    return run.partition("-")[2].replace("_500", "")
