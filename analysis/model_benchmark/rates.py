"""The better model: attractors and rates of A, F and F^t, fitted to these in the training part, not to stress."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas
import xarray as xr
from scipy.optimize import least_squares

from analysis.curves import each_run
from analysis.model_benchmark.attractors import LAST
from analysis.model_benchmark.score import Contestant, errors_of, increments_of, predicted, training_part
from labkit.micro import deviator, to_six
from labkit.model import Model, critical_coordination_number, update
from labkit.sff import c0_stress

TENSORS = {"A": slice(3, 9), "F": slice(9, 15), "Ft": slice(15, 21)}  # place in the state vector
SUBSTEPS = 4  # parts of the interval between two points of a test, at which e, Z and Lambda are those of the grains
OFF_AXIS = ("b", "simple shear", "extension")
AXIS = ("compression", "undrained")  # groups whose ends give A_c and Ft_c as functions of density
STARTS = {("A", "F"): {"c_eA": 1.5, "beta_dA": 45.0, "F_d": 0.4}, ("Ft",): {"c_M": 500.0, "Ft_d": 0.2}}


def changed(model: Model, values: Mapping[str, float]) -> Model:
    """The model with other values of its Parameters and DensityDependence, by name."""
    density = {name: value for name, value in values.items() if hasattr(model.density, name)}
    own = {name: value for name, value in values.items() if name not in density}
    return dataclasses.replace(model.with_parameters(**own), density=dataclasses.replace(model.density, **density))


def followed(model: Model, tests: xr.Dataset) -> np.ndarray:
    """State vectors (run, point, 21) of a model with the e, Z and Lambda of the grains, and its own A, F, F^t."""
    e, Z, Lam = (tests[key].transpose("run", "point").values for key in ("e", "Z", "Lambda"))
    scalars = np.stack([e, Z, Lam], axis=-1)
    sixes = [to_six(tests[key].transpose("run", "point", "i", "j").values) for key in TENSORS]
    states = np.concatenate([scalars, *sixes], axis=-1)
    increments = to_six(np.stack([increments_of(tests.isel(run=k)) for k in range(tests.sizes["run"])])) / SUBSTEPS
    y = states[:, 0].copy()
    for k in range(increments.shape[1]):
        for share in (np.arange(SUBSTEPS) + 0.5) / SUBSTEPS:
            y[:, :3] = (1.0 - share) * scalars[:, k] + share * scalars[:, k + 1]
            y = update(model, y, increments[:, k], tangent=False).state
        states[:, k + 1, 3:] = y[:, 3:]
    return states


def misfit(model: Model, tests: xr.Dataset, key: str) -> np.ndarray:
    """A tensor of `followed` minus that of the grains (run, point, 6), relative to the largest of a test."""
    own = to_six(tests[key].transpose("run", "point", "i", "j").values)
    return (followed(model, tests)[..., TENSORS[key]] - own) / np.linalg.norm(own, axis=-1).max(axis=1)[:, None, None]


def axial_ends(tests: xr.Dataset) -> pandas.DataFrame:
    """e and the norms of A, F and F^t at the ends of axial compression, drained or undrained; a row per run."""
    rows = []
    for name, one in each_run(tests):
        if str(one["group"].values) in AXIS and str(one["path"].values) != "simple_shear_cv":
            last = one["along"].values >= LAST * one["along"].values[-1]
            norms = {key: np.linalg.norm(deviator(one[key].values[last].mean(axis=0))) for key in TENSORS}
            rows.append({"run": name, "e": float(one["e"].values[last].mean()), **norms})
    return pandas.DataFrame(rows)


def of_density(ends: pandas.DataFrame, model: Model) -> dict[str, float]:
    """A_c, A_Z, Ft_c and Ft_Z from lines through the norms of A and F^t of axial_ends against Z^c(e) - 4."""
    Z_c = critical_coordination_number(ends["e"].to_numpy(), model.parameters) - 4.0
    found: dict[str, float] = {}
    for key in ("A", "Ft"):
        slope, size = np.polyfit(Z_c, ends[key], 1)
        found |= {f"{key}_c": float(size), f"{key}_Z": float(slope / size)}
    return found


def fit_rates(model: Model, tests: xr.Dataset) -> Model:
    """The better model: constants of density from ends of tests, those of STARTS by least squares, Eq. 31 parallel."""
    model = changed(model.reading(compression="parallel"), of_density(axial_ends(tests), model))
    for keys, start in STARTS.items():
        model = _fitted(model, start, tests, keys)
    return model


def _fitted(model: Model, start: Mapping[str, float], tests: xr.Dataset, keys: Sequence[str]) -> Model:
    first = np.array(list(start.values()))

    def model_at(x: np.ndarray) -> Model:
        return changed(model, dict(zip(start, (x * first).tolist(), strict=True)))

    found = least_squares(
        lambda x: np.ravel([misfit(model_at(x), tests, key) for key in keys]),
        np.ones(first.size),
        diff_step=1e-3,
        xtol=1e-4,
    )
    return model_at(found.x)


def better_model(amended: Model, data: xr.Dataset | None, file: Path) -> Model:
    """Return the better model stored in `file`; if there is none, fit it first, starting from the amended model."""
    if data is not None and not file.exists():
        file.write_text(fit_rates(amended, training_part(data)).to_json() + "\n", encoding="utf-8")
    return Model.from_json(file.read_text(encoding="utf-8"))


def replacements(contestant: Contestant, data: xr.Dataset) -> pandas.DataFrame:
    """Error of s/p (%) by C0 with the model's A, F and F^t, or one or all of them from the grains; means by group.

    Columns: group, tests, model, `A of grains`, `F of grains`, `Ft of grains`, all. Held-out tests of OFF_AXIS.
    """
    rows = []
    for _, test in each_run(data.astype("f8")):
        if str(test["part"].values) == "held out" and str(test["group"].values) in OFF_AXIS:
            own = {key: deviator(test[key].values) for key in TENSORS}
            found = predicted(contestant, test, "strain")
            swaps = {"model": {}, **{f"{key} of grains": {key: own[key]} for key in TENSORS}, "all": own}
            errors = {label: _error(test, found | swap) for label, swap in swaps.items()}
            rows.append({"group": str(test["group"].values), "tests": 1, **errors})
    table = pandas.DataFrame(rows).groupby("group", sort=False)
    return table.mean().assign(tests=table["tests"].sum()).reset_index()


def _error(test: xr.Dataset, found: dict[str, np.ndarray]) -> float | str:
    """Error of s/p, %, if C0 of A, F and F^t gives the stress."""
    one = np.ones(len(found["A"]))
    return errors_of(test, found | {"stress": c0_stress(1.0, one, one, 0.0 * one, *(found[key] for key in TENSORS))})[
        "stress"
    ]


def rate_errors(models: Mapping[str, Model], tests: xr.Dataset) -> pandas.DataFrame:
    """Root mean square misfit of A, F and F^t (%), a row per model and group: C1, C3 and C5 alone."""
    rows = []
    for name, model in models.items():
        off = {key: np.sqrt((misfit(model, tests, key) ** 2).sum(axis=-1).mean(axis=1)) for key in TENSORS}
        table = pandas.DataFrame(off).mul(100.0).groupby(tests["group"].values).mean()
        rows.append(table.rename_axis("group").reset_index().assign(model=name))
    return pandas.concat(rows, ignore_index=True)
