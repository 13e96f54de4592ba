"""C1 to C5 as increments: what each equation predicts over short intervals of strain, from the recorded state.

No equation is integrated: the recorded e, Z, Lambda, A, F and F^t go into the right-hand side, whose integral over an
interval is compared with the recorded change. An error of one equation therefore does not spread to the others. Tests
are axisymmetric; tensors are given by their zz component.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy import optimize

from analysis.paper.ends import Runs
from analysis.paper.specimens import specimen_of
from labkit.model import ROOT_3_2

LENGTHS = (0.002, 0.005, 0.01)  # strain of an interval
LENGTH = LENGTHS[1]
ISOTROPIC = ("isoc", "isod")
LEAST_PRESSURE = 20e3  # Pa
STEEPEST = 5.0  # largest exponent in the exponentials of a fit


@dataclasses.dataclass(frozen=True)
class Increments:
    """Records of several tests, differences between neighbouring records along `step`, summed over intervals.

    Args:
        state: e, reported (void ratio), Z, L (Lambda), A, F and T (F^t), means of two neighbouring records, (steps,).
        s: Norm of the deviatoric strain increment, (steps,).
        n: Its sign along z, (steps,).
        v: Volumetric strain increment, (steps,).
        first: First step of each interval, (intervals,).
        change: Change of Z, L, A, F and T over each interval, (intervals,).
        run: Run of each interval.
        path: Path of each interval.
        specimen: Specimen of each interval.
        lengths: |dA|, (steps,).
    """

    state: dict[str, np.ndarray]
    s: np.ndarray
    n: np.ndarray
    v: np.ndarray
    first: np.ndarray
    change: dict[str, np.ndarray]
    run: np.ndarray
    path: np.ndarray
    specimen: np.ndarray
    lengths: np.ndarray

    def total(self, rate: np.ndarray) -> np.ndarray:
        """Sum of increments (steps,) over the intervals (intervals,)."""
        return np.add.reduceat(rate, self.first)


def increments(runs: Runs, length: float = LENGTH) -> Increments:
    """Increments of axisymmetric runs (name -> run from analysis.paper.ends.in_memory); length: of an interval."""
    parts, first, start = [], [], 0
    for name, run in runs.items():
        part, ends = _of_run(name, run, length)
        parts.append(part)
        first.append(start + ends[:-1])
        start += len(part.s)
    joined = {
        field.name: _joined([getattr(part, field.name) for part in parts])
        for field in dataclasses.fields(Increments)
        if field.name != "first"
    }
    return Increments(**joined, first=np.concatenate(first))


def _joined(values: Sequence[Any]) -> Any:
    """Arrays, or dictionaries of arrays, one after the other."""
    if isinstance(values[0], dict):
        return {key: np.concatenate([value[key] for value in values]) for key in values[0]}
    return np.concatenate(values)


def _of_run(name, run, length):
    tensors = {"A": "contact_anisotropy", "F": "normal_force_anisotropy", "T": "mobilisation"}
    values = {key: zz_component(run[variable].values) for key, variable in tensors.items()}
    names = {
        "e": "void_ratio_nominal",
        "reported": "void_ratio",
        "Z": "coordination_number",
        "L": "mean_normalised_force",
    }
    values |= {key: run[variable].values.astype(float) for key, variable in names.items()}
    good = np.isfinite(values["A"]) & (values["Z"] > 0.0) & (run.lab.mean_stress().values > LEAST_PRESSURE)
    last = len(good) if good.all() else int(np.argmin(good))
    strain = run["strain"].values[:last].astype(float)
    axial, radial = strain[:, 2, 2], 0.5 * (strain[:, 0, 0] + strain[:, 1, 1])
    deviatoric, volumetric = np.diff(ROOT_3_2 * 2.0 / 3.0 * (axial - radial)), np.diff(axial + 2.0 * radial)
    if run.attrs["path"] in ISOTROPIC:
        deviatoric = np.zeros_like(deviatoric)
    ends = _intervals(deviatoric, volumetric, length)
    values = {key: value[:last] for key, value in values.items()}
    labels = {"run": name, "path": run.attrs["path"], "specimen": specimen_of(name)}
    return Increments(
        {key: 0.5 * (value[1:] + value[:-1]) for key, value in values.items()},
        np.abs(deviatoric),
        np.sign(deviatoric),
        volumetric,
        ends,
        {key: np.diff(values[key][ends]) for key in ("Z", "L", "A", "F", "T")},
        **{key: np.full(len(ends) - 1, label) for key, label in labels.items()},
        lengths=np.abs(np.diff(values["A"])),
    ), ends


def zz_component(tensor: np.ndarray) -> np.ndarray:
    """The zz component of the triaxial deviator (n,)."""
    return (2.0 * tensor[:, 2, 2] - tensor[:, 0, 0] - tensor[:, 1, 1]) / 3.0


def _intervals(deviatoric: np.ndarray, volumetric: np.ndarray, length: float) -> np.ndarray:
    """Records at which intervals of a strain begin and end; none goes across a reversal."""
    travelled = np.concatenate([[0.0], np.cumsum(np.abs(deviatoric) + np.abs(volumetric))])
    sign = np.sign(deviatoric)
    ends = [0]
    for k in range(1, len(travelled)):
        turned = k < len(sign) and sign[k] * sign[k - 1] < 0.0
        if travelled[k] - travelled[ends[-1]] >= length - 1e-9 or turned:
            ends.append(k)
    ends[-1] = len(travelled) - 1
    return np.array(ends)


@dataclasses.dataclass(frozen=True)
class Lines:
    """Critical state lines at the steps: Zc, Lc and e_cmax - e, with c_cLambda and gamma_cZ."""

    Zc: np.ndarray
    Lc: np.ndarray
    distance: np.ndarray
    gamma_cZ: float
    c_cLam: float


def lines_of(data: Increments, fitted: np.ndarray, void_ratio: str = "e") -> Lines:
    """Lines with `fitted` = e_cmax, c_cZ, gamma_cZ, c_cLambda; void_ratio: `e` (nominal) or `reported`."""
    distance = np.maximum(fitted[0] - data.state[void_ratio], 1e-6)
    return Lines(
        4.0 + fitted[1] * distance ** fitted[2], fitted[3] * distance, distance, float(fitted[2]), float(fitted[3])
    )


def _decay(u: float, data: Increments, lines: Lines) -> np.ndarray:
    return np.exp(np.clip(u * (lines.Lc - data.state["L"]), -STEEPEST, STEEPEST))


def _tensor(u: np.ndarray, data: Increments, lines: Lines, name: str) -> np.ndarray:
    """C1 and C3; u: ln c_e, gamma_eA, beta_dA, gamma, ln of the critical zz component."""
    missing = _decay(u[2], data, lines) * np.exp(u[4]) * data.n - data.state[name]
    stiffness = np.exp(u[0]) / data.state["L"] ** u[1]
    return stiffness * (ROOT_3_2 * np.abs(missing) + 1e-12) ** u[3] * missing * data.s


def coordination(u: np.ndarray, data: Increments, lines: Lines) -> np.ndarray:
    """C2 with Eq. 31; u: ln c_eZ, beta_eZ, c_Z, ln c_com, beta_vZ, ln c_vZ."""
    Zcom = 4.0 + np.exp(u[3]) * lines.distance**lines.gamma_cZ
    slope = np.exp(u[3]) * lines.gamma_cZ * lines.distance ** (lines.gamma_cZ - 1.0)
    compressed = np.exp(np.clip(u[4] * (Zcom - data.state["Z"]), -STEEPEST, STEEPEST)) * slope * (1.0 + data.state["e"])
    volumetric = np.where(data.v > 0.0, compressed, np.exp(u[5]) / data.state["L"]) * data.v
    shear = (lines.Zc - data.state["Z"]) * data.s - u[2] * ROOT_3_2 * data.lengths
    return np.exp(u[0]) * _decay(u[1], data, lines) * shear + volumetric


def force(u: np.ndarray, data: Increments, lines: Lines, distance: bool = False) -> np.ndarray:
    """C4 with Eq. 32; u: ln c_eLambda, gamma_eLambda, beta_eZ, ln c_vLambda_d; `distance`: the reading of C4."""
    missing = lines.Lc - data.state["L"]
    base = (np.abs(missing) + 1e-9 if distance else data.state["L"]) ** u[1]
    shear = np.exp(u[0]) * _decay(u[2], data, lines) * base * missing * data.s
    return shear + np.where(data.v > 0.0, lines.c_cLam, np.exp(u[3])) * (1.0 + data.state["e"]) * data.v


def mobilisation(u: np.ndarray, data: Increments, lines: Lines) -> np.ndarray:
    """C5; u: ln c_M, ln F^tc_zz."""
    return np.exp(u[0]) * (np.exp(u[1]) * data.n - data.state["T"]) * data.s


def excess(data: Increments) -> np.ndarray:
    """q/p of Eq. 30 along the strain increment minus its critical value 0.925 (steps,)."""
    state = data.state
    return 1.5 * (0.4 * state["A"] + 0.4 * state["F"] + 3.0 * state["T"]) * data.n - 0.925


def amended(u: np.ndarray, data: Increments, lines: Lines) -> np.ndarray:
    """C4 with the amendment; u: of `force`, then c in c Lambda (q/p - M) |rate| of zz components."""
    return force(u, data, lines) + u[4] * data.state["L"] * excess(data) * data.s


Rate = Callable[[np.ndarray, Increments, Lines], np.ndarray]
# equation -> (rate, variable, initial unknowns)
EQUATIONS: dict[str, tuple[Rate, str, tuple[float, ...]]] = {
    "C1": (functools.partial(_tensor, name="A"), "A", (0.3, 0.55, 31.0, 0.2, np.log(0.46))),
    "C2": (coordination, "Z", (2.0, 20.0, 0.1, np.log(7.1), 3.0, np.log(0.15))),
    "C3": (functools.partial(_tensor, name="F"), "F", (0.8, 0.55, 31.0, 0.1, np.log(0.755))),
    "C4": (force, "L", (2.0, 0.3, 30.0, np.log(0.075))),
    "C5": (mobilisation, "T", (5.0, np.log(0.045))),
}
C4_FORMS: dict[str, tuple[Rate, tuple[float, ...]]] = {
    "paper": (force, EQUATIONS["C4"][2]),
    "by distance": (functools.partial(force, distance=True), (4.0, 0.3, 30.0, np.log(0.075))),
    "amended": (amended, (*EQUATIONS["C4"][2], 4.0)),
}


def fit_rate(
    rate: Rate, variable: str, start: tuple[float, ...], data: Increments, lines: Lines, used: np.ndarray
) -> np.ndarray:
    """Unknowns of a rate fitted to the intervals `used` (intervals,) of bool, by robust least squares (soft l1)."""
    change = data.change[variable]
    scale = change[used].std()

    def misfit(u: np.ndarray) -> np.ndarray:
        return ((data.total(rate(u, data, lines)) - change) / scale)[used]

    size = np.maximum(np.abs(start), 0.1)
    return optimize.least_squares(misfit, start, loss="soft_l1", f_scale=0.2, x_scale=size, max_nfev=80).x
