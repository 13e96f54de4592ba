"""Scores of constitutive laws on the tests of the benchmark.

Your own law is a labkit.model.law.RateLaw; `Contestant(name, law)` enters it:

    data = xarray.load_dataset("results/model_benchmark/tests.nc")
    table = score(data, [Contestant("mine", MyLaw())])
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Sequence

import numpy as np
import pandas
import xarray as xr

from analysis.critical_state.ends import TENSORS
from labkit.engines import Progress
from labkit.errors import InputError
from labkit.micro import deviator, equivalent_stress, lode_angle, mean_stress
from labkit.model import Adaptive, ConstitutiveLaw, Failure, Model, ModelState, Point, Problem, RateLaw, strain_control
from labkit.paths import Path, Steps, increments, make_path, path_of

REPEATED = "another packing"
SHEARED = 0.1  # q/p above which angles are compared
WRONG = 0.1  # error of a statistic, divided by its scale, from which it counts as wrong
FAR_ENOUGH = 0.1  # share of a test; a law that stops earlier gets no errors
SCALE_OF_E = 0.01  # least range of e by which its error is divided
NAMES = {**TENSORS, "Z": "coordination_number", "Lambda": "mean_normalised_force"}
Values = dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Contestant:
    """A law that enters the benchmark under a name. labkit's model starts from the measured statistics."""

    name: str
    law: ConstitutiveLaw

    def start(self, test: xr.Dataset) -> np.ndarray:
        """The state vector at the first point of a test: e and the stress, or the measured statistics."""
        first = test.isel(point=0)
        stress = first["stress"].values
        if isinstance(self.law, RateLaw):
            return self.law.start(float(first["e"]), stress)
        if not isinstance(self.law, Model):
            raise InputError(f"the law {self.law.name} is neither a RateLaw nor labkit's model: derive it from RateLaw")
        A, F, Ft = (deviator(first[key].values) for key in ("A", "F", "Ft"))
        state = ModelState(float(first["e"]), float(first["Z"]), float(first["Lambda"]), A, F, Ft)
        factor = mean_stress(stress) / mean_stress(state.stress(self.law))  # C0 and the stress differ by about 1 %
        return dataclasses.replace(state, Lam=state.Lam * float(factor)).vector()


def training_part(data: xr.Dataset) -> xr.Dataset:
    """The tests that models may be fitted to, in double precision."""
    return data.astype("f8").isel(run=np.flatnonzero(data["part"].values == "training"))


def path_of_test(test: xr.Dataset) -> Path:
    """The path of a test, at the mean stress of its first point."""
    name, pressure = str(test["path"].values), float(mean_stress(test["stress"].values[0]))
    if name == "reload":
        axial = float(test["along"].values[-1])
        held = {"xx": 0.0, "yy": 0.0, "yz": 0.0, "xz": 0.0, "xy": 0.0}
        return Steps(steps=(increments(strain={"zz": axial}, stress=held),)).starting_at(pressure)
    path = path_of(name, json.loads(str(test["parameters"].values))) or make_path(name)
    return path.starting_at(pressure)


def increments_of(test: xr.Dataset) -> np.ndarray:
    """Strain increments (m, 3, 3) between the points of a test.

    In simple shear the rate of the strain is that of the path, because the stored strain turns with the cell.
    """
    strain, along = test["strain"].values, test["along"].values
    if str(test["group"].values) == "simple shear" or str(test["path"].values) == "simple_shear_cv":
        increment = np.zeros((along.size - 1, 3, 3))
        increment[:, 0, 2] = increment[:, 2, 0] = 0.5 * np.diff(along)
        increment[:, 2, 2] = -np.diff(np.log1p(test["e"].values))
        return increment
    return np.diff(strain, axis=0)


def follow_strain(law: ConstitutiveLaw, y: np.ndarray, test: xr.Dataset) -> np.ndarray:
    """States (m, n) of a law at the points of a test whose strain it follows; m is smaller if it fails."""
    states, integrator, problem = [y], Adaptive(), Problem(law, strain_control(np.zeros((3, 3))), law.floor(y))
    for step in increments_of(test):
        size = float(np.linalg.norm(step))
        if size > 0.0:
            problem.control = strain_control(step / size)
            try:
                y = integrator.advance(problem, y, size)
            except Failure:
                break
        states.append(y)
    return np.array(states)


def follow_path(law: ConstitutiveLaw, y: np.ndarray, test: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """(accumulated strain (m,), states (m, n)) of a law along the path of a test."""
    interval = float(test["along"].values[-1]) / 400.0
    result = Point(law, path_of_test(test), y, Adaptive(), interval).result(None)
    return result.accumulated_strain, result.vector


def predicted(contestant: Contestant, test: xr.Dataset, drive: str) -> Values:
    """The variables of a contestant at the first points of a test, as many as it reaches, name -> values."""
    law, y = contestant.law, contestant.start(test)
    along = test["along"].values
    if drive == "strain":
        states = follow_strain(law, y, test)
    else:
        accumulated_strain, vectors = follow_path(law, y, test)
        reached = along <= accumulated_strain[-1] * (1.0 + 1e-6)
        states = np.stack([np.interp(along[reached], accumulated_strain, column) for column in vectors.T], axis=1)
    stress = np.array([law.stress(state) for state in states])
    found = law.variables(states, stress)
    own = {key: found[name] for key, name in NAMES.items() if name in found}
    return {"stress": stress, "strain": found["strain"], "e": found["void_ratio_nominal"], **own}


def errors_of(test: xr.Dataset, found: Values) -> dict[str, float | str]:
    """The errors of a prediction (see the plan), NaN where the test has no value; `reached`: share of the points.

    stress, p, e, strain and those of NAMES in %, lode and direction in degrees; `first` is the statistic that is wrong
    first, and `first_at` the accumulated strain there.
    """
    points = len(found["e"])
    reached = points / test.sizes["point"]
    row: dict[str, float | str] = {"reached": reached}
    if reached < FAR_ENOUGH:
        return row
    sigma = test["stress"].values
    ratio = deviator(sigma) / mean_stress(sigma)[:, None, None]
    own = deviator(found["stress"]) / mean_stress(found["stress"])[:, None, None]
    row["stress"] = _percent(own - ratio[:points], _largest(ratio))
    p = mean_stress(sigma)
    row["p"] = _percent(mean_stress(found["stress"]) - p[:points], p.mean())
    e = test["e"].values
    row["e"] = _percent(found["e"] - e[:points], max(np.ptp(e), SCALE_OF_E))
    strain = test["strain"].values
    if str(test["group"].values) == "rotation":
        row["strain"] = _percent(found["strain"] - strain[:points], _largest(strain))
    sheared = equivalent_stress(sigma[:points]) > SHEARED * p[:points]
    sheared &= equivalent_stress(found["stress"]) > SHEARED * mean_stress(found["stress"])
    if sheared.any():
        row["lode"] = float((lode_angle(found["stress"]) - lode_angle(sigma[:points]))[sheared].mean())
        which = np.where(lode_angle(sigma[:points][sheared]) < 30.0, 2, 0)  # the axis that differs from the other two
        axes = [
            np.take_along_axis(np.linalg.eigh(s[:points][sheared])[1], which[:, None, None], axis=2)[..., 0]
            for s in (sigma, found["stress"])
        ]
        between = np.abs(np.einsum("ni,ni->n", *axes)).clip(0.0, 1.0)
        row["direction"] = float(np.degrees(np.arccos(between)).mean())
    wrong = {}
    for key in NAMES:
        values = test[key].values
        if key not in found or not np.isfinite(values).all():
            continue
        scale = _largest(values) if values.ndim == 3 else float(values.mean())
        off = found[key] - values[:points]
        row[key] = _percent(off, scale)
        size = np.linalg.norm(off, axis=(1, 2)) if off.ndim == 3 else np.abs(off)
        if (size > WRONG * scale).any():
            wrong[key] = float(test["along"].values[np.argmax(size > WRONG * scale)])
    if wrong:
        row["first"] = min(wrong, key=lambda key: wrong[key])
        row["first_at"] = wrong[str(row["first"])]
    return row


def _largest(tensors: np.ndarray) -> float:
    return float(np.linalg.norm(tensors, axis=(1, 2)).max())


def _percent(off: np.ndarray, scale: float) -> float:
    return 100.0 * float(np.sqrt(np.mean(np.sum(off.reshape(len(off), -1) ** 2, axis=1)))) / scale


def score(data: xr.Dataset, contestants: Sequence[Contestant], progress: Progress | None = None) -> pandas.DataFrame:
    """Errors of all contestants on all tests, a row per test, contestant and drive (columns: see errors_of)."""
    tests = data.astype("f8")
    rows = []
    for k, name in enumerate(map(str, tests["run"].values)):
        test = tests.sel(run=name)
        labels = {"run": name, **{key: str(test[key].values) for key in ("group", "part", "packing")}}
        for contestant in contestants:
            for drive in _drives(test):
                row = {**labels, "model": contestant.name, "drive": drive}
                try:
                    rows.append({**row, **errors_of(test, predicted(contestant, test, drive))})
                except InputError:  # the law is undefined at the first point
                    rows.append({**row, "reached": 0.0})
        if progress:
            progress(k / tests.sizes["run"], name)
    return pandas.DataFrame(rows)


def repeated(data: xr.Dataset) -> pandas.DataFrame:
    """Errors of the next packing of the same kind, taken as predictions of each test; columns as in score(), by stress.

    These are the errors that a law exact for one packing would make in another. Tests that no other packing repeats are
    left out.
    """
    tests = data.astype("f8")
    kinds = pandas.Series(map(str, tests["run"].values)).str.replace(r"-?s\d+$", "", regex=True)
    rows = []
    for _, runs in kinds.groupby(kinds):
        for k, at in enumerate(runs.index):
            if len(runs) > 1:
                test, other = tests.isel(run=at), tests.isel(run=runs.index[(k + 1) % len(runs)])
                keys = [key for key in ("stress", "strain", "e", *NAMES) if np.isfinite(other[key].values).all()]
                row = {"run": str(test["run"].values), "model": REPEATED, "drive": "stress"}
                row |= {key: str(test[key].values) for key in ("group", "part", "packing")}
                rows.append({**row, **errors_of(test, {key: other[key].values for key in keys})})
    return pandas.DataFrame(rows)


def _drives(test: xr.Dataset) -> Iterator[str]:
    if str(test["path"].values) != "reload":  # its lateral strains are not stored separately
        yield "strain"
    yield "stress"
