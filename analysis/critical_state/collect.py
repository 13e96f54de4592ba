"""The data kept from a run: records at equal intervals, and the equations related to C0 at the snapshots."""

from __future__ import annotations

import numpy as np
import xarray as xr

from analysis.curves import POINTS, accumulated_strain

KEPT = (
    "axial_strain strain stress stress_sff void_ratio void_ratio_nominal coordination_number mean_normalised_force "
    "contact_anisotropy normal_force_anisotropy mobilisation inertial_number"
).split()


def reduced(run: xr.Dataset) -> xr.Dataset:
    """The records of one run along `point`, with the accumulated strain, and its snapshots along `snapshot`.

    Also the path with its parameters (JSON), as in the run file.
    """
    accumulated = accumulated_strain(run)
    wanted = np.linspace(0.0, accumulated[-1], POINTS)
    chosen = np.abs(accumulated[:, None] - wanted).argmin(axis=0)
    records = run[KEPT].isel(time=chosen).drop_vars("time").rename(time="point")
    records["accumulated_strain"] = ("point", accumulated[chosen], {"units": "1", "long_name": "accumulated strain"})
    at = xr.Dataset({"stress_family": run.lab.sff_family(), "error_budget": run.lab.error_budget()})
    at = at.drop_vars(["row_start", "record", "snapshot"], errors="ignore")
    at["snapshot_stress"] = run.lab.at_snapshots("stress")
    at["snapshot_accumulated"] = ("snapshot", accumulated[run["record"].values])
    merged = xr.merge([records.reset_coords(drop=True), at.reset_coords(drop=True)])
    return merged.assign({name: run.attrs[name] for name in ("path", "path_parameters")})
