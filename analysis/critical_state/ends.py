"""Records of all tests as one table, and the state at the end of each test."""

from __future__ import annotations

import numpy as np
import pandas
import xarray as xr

from labkit.micro import equivalent_stress, mean_stress

BEGIN = 0.7  # of the accumulated strain of a test; its end state is the mean from there on
TENSORS = {"A": "contact_anisotropy", "F": "normal_force_anisotropy", "Ft": "mobilisation"}
QUANTITIES = ("M", "A", "F", "Ft", "Z", "Lambda", "e", "p_MPa")
FACTORS = ("path", "density", "stiffness", "size", "cell", "lode")
DENSITIES = ("dense", "medium", "loose")


def factors(test: str, specimen: str) -> dict[str, str]:
    """What a test of the campaign is, by its name: path, density, stiffness rule, size, and shape of the cell."""
    density = next((name for name in DENSITIES if name in specimen), "medium")
    return {
        "path": test.split("_")[0],
        "density": density,
        "stiffness": "series" if "series" in specimen else "paper",
        "size": "full" if specimen.startswith("full") else "4000",
        "cell": "flat" if specimen.startswith("flat") else "cube" if specimen.startswith("cube") else "tall",
    }


def packing(specimen: str) -> str:
    """The specimen from which one was consolidated: tests of both are not independent."""
    return specimen.replace("_500", "")


def along_stress(tensor: np.ndarray, stress: np.ndarray) -> np.ndarray:
    """Part of a deviatoric tensor (n, 3, 3) along the deviatoric stress, so scaled that it is T_zz in compression.

    sqrt(2/3) T : s/|s|, shape (n,); stress (n, 3, 3). In triaxial extension it is -T_zz.
    """
    deviator = stress - np.trace(stress, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) / 3.0
    product = np.einsum("nij,nij->n", tensor, deviator)
    return np.sqrt(2.0 / 3.0) * product / np.linalg.norm(deviator, axis=(-2, -1))


def lode_angle(stress: np.ndarray) -> float:
    """Lode angle of a stress (3, 3) in degrees: 0 in triaxial compression, 60 in extension."""
    s3, s2, s1 = np.linalg.eigvalsh(0.5 * (stress + stress.T))
    return float(np.degrees(np.arctan2(np.sqrt(3.0) * (s2 - s3), 2.0 * s1 - s2 - s3)))


def records(data: xr.Dataset) -> pandas.DataFrame:
    """A row per record: run, test, specimen, the factors, strain (accumulated), and QUANTITIES; p in MPa.

    M = q/p with q = sqrt(3/2)|s|; A, F, Ft: parts along the deviatoric stress (along_stress).
    """
    parts = []
    for name in data["run"].values:
        run = data.sel(run=name)
        stress = run["stress"].values.astype(float)
        test, specimen = str(run["test"].values), str(run["specimen"].values)
        columns = {
            "run": str(name),
            "test": test,
            "specimen": packing(specimen),
            **factors(test, specimen),
            "strain": run["accumulated_strain"].values.astype(float),
            "M": equivalent_stress(stress) / mean_stress(stress),
            **{label: along_stress(run[key].values.astype(float), stress) for label, key in TENSORS.items()},
            "Z": run["coordination_number"].values.astype(float),
            "Lambda": run["mean_normalised_force"].values.astype(float),
            "e": run["void_ratio"].values.astype(float),
            "p_MPa": mean_stress(stress) / 1e6,
        }
        parts.append(pandas.DataFrame(columns))
    return pandas.concat(parts, ignore_index=True)


def end_table(data: xr.Dataset, table: pandas.DataFrame, begin: float = BEGIN, end: float = 1.0) -> pandas.DataFrame:
    """Means between two fractions of the strain of each test, a row per run: QUANTITIES, lode (degrees), factors.

    table: of records().
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
                "lode": lode_angle(stress),
                "strain": last,
                **test.loc[inside, list(QUANTITIES)].mean().to_dict(),
            }
        )
    return pandas.DataFrame(rows)
