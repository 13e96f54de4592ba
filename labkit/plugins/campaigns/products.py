"""Statistics of each run of a campaign, as a netCDF file. Paths are relative to the campaign folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from labkit.files.netcdf import write_xarray
from labkit.files.provenance import provenance_json
from labkit.files.schema import RECORD
from labkit.plugins.campaigns.layout import RUNS, STATISTICS
from labkit.records.limits import exceeded_limits
from labkit.results.critical import critical_states, is_shear, why_not_critical
from labkit.results.dataset import open_run
from labkit.results.verify import SFF_PRESSURE
from labkit.specimens.recipe import Recipe

Numbers = dict[str, tuple[float, str, str]]  # name -> (value, units, long name)


def write_statistics(name: str) -> None:
    """Write the statistics of a run: one value per variable, with units."""
    file = Path(RUNS) / f"{name}.run.nc"
    output = Path(STATISTICS) / f"{name}.nc"
    run = open_run(file)
    values = {**numbers(run), "grains": (run.lab.number_of_grains, "1", "number of grains")}
    statistics = xr.Dataset(
        {key: ((), value, {"units": units, "long_name": name}) for key, (value, units, name) in values.items()}
    )
    statistics.attrs = {
        "labkit_file": "statistics",
        "run": name,
        "run_data_sha256": run.attrs.get("data_sha256", ""),
        "path": run.attrs["path"],
        "engine": run.attrs["engine"],
        "outside_limits": "; ".join(
            map(str, exceeded_limits(run.lab.records_with_limits(), run.lab.scene, run.lab.path))
        ),
        "provenance": provenance_json(inputs=[file], output=output, seed=run.attrs.get("seed")),
    }
    run.close()
    write_xarray(output, statistics)


def numbers(run: xr.Dataset) -> Numbers:
    """Compute statistics of a run, opened with labkit.open_run, from its records: name -> (value, units, long name).

    User-defined statistics that the run recorded are included with their final value.
    """
    p = run.lab.mean_stress().values
    strain, aim = run.lab.strain(), Recipe.made_at(run.attrs.get("recipe", ""))
    aim = np.nan if aim is None else aim
    by_volume = "stress_sff_by_volume", p, "error of the equation by volume against Love"  # not in older files
    values = {
        "strain_reached": (float(strain[-1]), "1", f"{strain.attrs['long_name']} at the end"),
        **_at_ends("mean_stress", p, "Pa"),
        **_at_peak(run),
        **_at_ends("void_ratio", run["void_ratio"]),
        "initial_void_ratio_nominal": (float(run["void_ratio_nominal"][0]), "1", "nominal void ratio at the start"),
        "made_void_ratio_nominal": (aim, "1", "nominal void ratio at which the specimen was made"),
        **_at_ends("coordination_number", run["coordination_number"]),
        "largest_sff_error": _largest_error(run, "stress_sff", p, "relative error of C0 against Love's stress"),
        **({"largest_sff_error_by_volume": _largest_error(run, *by_volume)} if by_volume[0] in run else {}),
        "steps": (float(run.attrs.get("steps", np.nan)), "1", "number of time steps"),
        "wall_time": (float(run.attrs.get("wall_time", np.nan)), "s", "wall time of the run"),
    }
    values |= _cyclic(run)
    if is_shear(run):
        end = critical_states({"run": run}).iloc[0]
        long = why_not_critical(run) is None
        for key, long_name in CRITICAL.items():
            values[f"critical_{key}"] = float(end[key]) if long else np.nan, "1", f"{long_name}; see critical_shown"
        shown = float(end["critical"] == "yes") if long else np.nan
        values["critical_shown"] = shown, "1", "1 if e, q/p and p are shown to be stationary there, 0 if they are not"
    others = {name: each for name, each in run.data_vars.items() if each.dims == ("time",) and name not in RECORD}
    return values | {f"final_{name}": _at_end(each) for name, each in others.items()}


def _at_ends(name: str, values: np.ndarray | xr.DataArray, units: str = "1") -> Numbers:
    """Return the first and last value of a variable."""
    ends = ("initial", 0, "start"), ("final", -1, "end")
    return {
        f"{key}_{name}": (float(values[k]), units, f"{name.replace('_', ' ')} at the {end}") for key, k, end in ends
    }


def _at_peak(run: xr.Dataset) -> Numbers:
    """Return the largest |q/p|, and the angles and volumetric strain there and at the end."""
    peak, ratio = run.lab.peak(), np.abs(run.lab.stress_ratio().values)
    angle = run.lab.friction_angle()
    values = {
        "peak_stress_ratio": (float(ratio[peak]), "1", "largest magnitude of q/p"),
        "strain_at_peak": (float(run.lab.strain()[peak]), "1", "strain at the largest q/p"),
        "peak_friction_angle": (float(angle.max()), "degree", "largest mobilised friction angle"),
        "final_friction_angle": (float(angle[-1]), "degree", "mobilised friction angle at the end"),
    }
    for name in ("dilation_angle", "volumetric_strain"):
        quantity = run.lab.quantity(name)
        for key, record, where in (("peak", peak, "at the largest q/p"), ("final", -1, "at the end")):
            values[f"{key}_{name}"] = (
                float(quantity[record]),
                quantity.attrs["units"],
                f"{quantity.attrs['long_name']}, {where}",
            )
    return values


def _largest_error(run: xr.Dataset, variable: str, p: np.ndarray, words: str) -> tuple[float, str, str]:
    """Return the largest error of a stress where p is large enough."""
    error = run.lab.sff_error(variable).values[p > SFF_PRESSURE]
    return float(error.max()) if error.size else np.nan, "1", f"largest {words}"


def _cyclic(run: xr.Dataset) -> Numbers:
    """Compute the numbers of a cyclic test, and of its liquefaction if it is undrained."""
    if run.lab.path is None or not run.lab.path.cyclic:
        return {}
    values: Numbers = {"cycles": (float(run.lab.cycles()[-1]), "1", "number of cycles")}
    if run.lab.is_undrained:
        end = run.lab.liquefaction()
        values["largest_pore_pressure_ratio"] = end.largest_ratio, "1", "largest pore pressure ratio r_u"
        values["cycles_to_pressure"] = end.cycles_to_ratio, "1", "cycles to r_u > 0.95"
        values["cycles_to_strain"] = end.cycles_to_double_amplitude, "1", "cycles to a double amplitude of 5 % strain"
    return values


def _at_end(variable: xr.DataArray) -> tuple[float, str, str]:
    attributes = variable.attrs
    long_name = attributes.get("long_name", variable.name)
    return float(variable[-1]), attributes.get("units", "1"), f"{long_name}, at the end"


CRITICAL = {
    "M": "q/p over the last quarter of the strain",
    "Z": "coordination number over the last quarter of the strain",
    "Lambda": "mean normalised contact force over the last quarter of the strain",
    "A_zz": "contact anisotropy over the last quarter of the strain",
    "F_zz": "normal-force anisotropy over the last quarter of the strain",
    "Ft_zz": "mobilisation over the last quarter of the strain",
}
