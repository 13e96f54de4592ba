"""Records of all tests as one table, and the state at the end of each test."""

from __future__ import annotations

import numpy as np
import pandas
import xarray as xr

from labkit.micro import along_deviator, equivalent_stress, lode_angle, mean_stress

BEGIN = 0.7  # share of the accumulated strain of a test beyond which its end state is averaged
TENSORS = {"A": "contact_anisotropy", "F": "normal_force_anisotropy", "Ft": "mobilisation"}
QUANTITIES = ("M", "A", "F", "Ft", "Z", "Lambda", "e", "p_MPa")
FACTORS = ("path", "density", "stiffness", "size", "cell", "lode")
ALONG = 2.0 / 3.0  # factor of along_deviator that gives T_zz of a traceless, axisymmetric tensor
DENSITIES = ("dense", "medium", "loose")


def factors(test: str, specimen: str) -> dict[str, str]:
    """A test of the campaign, from its name: path, density, stiffness rule, size, and shape of the cell."""
    density = next((name for name in DENSITIES if name in specimen), "medium")
    return {
        "path": test.split("_")[0],
        "density": density,
        "stiffness": "series" if "series" in specimen else "paper",
        "size": "full" if specimen.startswith("full") else "4000",
        "cell": "flat" if specimen.startswith("flat") else "cube" if specimen.startswith("cube") else "tall",
    }


def packing(specimen: str) -> str:
    """The specimen from which another was consolidated: tests of the two are not independent."""
    return specimen.replace("_500", "")


def records(data: xr.Dataset) -> pandas.DataFrame:
    """A row per record: run, test, specimen, the factors, strain (accumulated), and those of quantities_of."""
    parts = []
    for name in data["run"].values:
        run = data.sel(run=name)
        test, specimen = str(run["test"].values), str(run["specimen"].values)
        columns = {
            "run": str(name),
            "test": test,
            "specimen": packing(specimen),
            **factors(test, specimen),
            "strain": run["accumulated_strain"].values.astype(float),
            **quantities_of(run),
        }
        parts.append(pandas.DataFrame(columns))
    return pandas.concat(parts, ignore_index=True)


def quantities_of(run: xr.Dataset) -> dict[str, np.ndarray]:
    """QUANTITIES at the records of one run, each (time,); p in MPa.

    M = q/p with q = sqrt(3/2)|s|; A, F, Ft: components along the deviatoric stress, which are T_zz in compression and
    -T_zz in extension.
    """
    stress = run["stress"].values.astype(float)
    return {
        "M": equivalent_stress(stress) / mean_stress(stress),
        **{label: ALONG * along_deviator(run[key].values.astype(float), stress) for label, key in TENSORS.items()},
        "Z": run["coordination_number"].values.astype(float),
        "Lambda": run["mean_normalised_force"].values.astype(float),
        "e": run["void_ratio"].values.astype(float),
        "p_MPa": mean_stress(stress) / 1e6,
    }


def end_table(data: xr.Dataset, table: pandas.DataFrame, begin: float = BEGIN, end: float = 1.0) -> pandas.DataFrame:
    """Means between two fractions of the strain of each test, a row per run: QUANTITIES, lode (degrees), factors.

    table: Result of records().
    """
    rows = []
    for name, test in table.groupby("run", sort=False):
        last = test["strain"].max()
        inside = (test["strain"] >= begin * last) & (test["strain"] <= end * last)
        first = test.iloc[0]
        stress = data.sel(run=name)["stress"].values.astype(float)[inside.to_numpy()].mean(axis=0)
        rows.append(
            {
                **{key: first[key] for key in ("run", "test", "specimen", *FACTORS[:-1])},
                "lode": float(lode_angle(stress)),
                "strain": last,
                **test.loc[inside, list(QUANTITIES)].mean().to_dict(),
            }
        )
    return pandas.DataFrame(rows)
