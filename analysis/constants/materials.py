"""Constants of Table 2 of each material, and their differences from those of Table 1's grains.

Every constant is a function of the mean states of two cells, the dense and the loose specimens of a material. Its
variance follows from the scatter of the specimens within the cells (delta method), which is pooled over the materials
at each density: with three specimens, the scatter of a single cell is poorly known.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
import pandas
from scipy import linalg
from statsmodels.tools.numdiff import approx_fprime

from analysis.statistics import NOTHING, Tested, corrected, with_verdict

PAPER = "paper"
VARIED = {  # parameter -> {material: value}; `paper` is Table 1
    "mu": {"mu020": 0.2, "mu030": 0.3, PAPER: 0.4, "mu060": 0.6},
    "mu_r": {"rolling002": 0.02, PAPER: 0.1, "rolling020": 0.2},
    "kappa": {"kappa1": 1.0, PAPER: 2.0, "kappa4": 4.0},
    "spread": {"spread005": 0.05, PAPER: 0.2, "spread040": 0.4},
}
MEASURED = ("e", "Lambda", "Z", "M", "A", "F", "Ft")
DENSITIES = ("dense", "loose")
REFERENCE = 0.009  # Lambda at which M, A, F and Ft are compared; it lies between the two cells of every material
AT = 0.67  # void ratio at which the lines of Lambda are compared
CONSTANTS = ("M", "A", "F", "Ft", "e_cmax", "c_cLam", "c_cZ", "gamma_cZ", "Lambda_067")
JUDGED = 0.02  # smallest relative change of a constant that matters
LOOSEST = 0.005  # smallest change of e_cmax that matters


@dataclasses.dataclass(frozen=True)
class Cell:
    """Mean of MEASURED over the specimens of a material at one density, its covariance, and the degrees of freedom."""

    mean: np.ndarray
    covariance: np.ndarray
    specimens: int
    freedom: int


Cells = Mapping[str, tuple[Cell, Cell]]  # material -> dense, loose


def material_of(specimen: str) -> tuple[str, str]:
    """Material and density of a specimen of the campaign, e.g. ('mu020', 'dense') for `mu020_dense-s1`."""
    material, density = specimen.partition("-")[0].removesuffix("_more").split("_")
    return material, density


def cells_of(ends: pandas.DataFrame) -> dict[str, tuple[Cell, Cell]]:
    """The two cells of each material that has specimens at both densities. ends: a row per test with MEASURED."""
    groups = ends.groupby(["material", "density"], sort=False)[list(MEASURED)]
    samples = {key: group.to_numpy(dtype=float) for key, group in groups}
    pooled = {}
    for density in DENSITIES:
        known = [sample for (_, at), sample in samples.items() if at == density]
        freedom = sum(len(sample) - 1 for sample in known)
        centred = np.vstack([sample - sample.mean(axis=0) for sample in known])
        pooled[density] = centred.T @ centred / max(freedom, 1), freedom
    cells = {}
    for material in dict.fromkeys(ends["material"]):
        pair = []
        for density in DENSITIES:
            if (sample := samples.get((material, density))) is not None:
                covariance, freedom = pooled[density]
                pair.append(Cell(sample.mean(axis=0), covariance / len(sample), len(sample), freedom))
        if len(pair) == len(DENSITIES):
            cells[material] = (pair[0], pair[1])
    return cells


def constants(states: np.ndarray) -> np.ndarray:
    """CONSTANTS (9,) from the mean states (2, 7) of the dense and the loose specimens, MEASURED in columns.

    M, A, F and Ft (components zz) at Lambda = REFERENCE, linear in Lambda between the two states; the others are the
    parameters of Z^c = 4 + c_cZ (e_cmax - e)^gamma_cZ and Lambda^c = c_cLam (e_cmax - e) through both states, and
    Lambda^c at e = AT.
    """
    (e_dense, e_loose), (f_dense, f_loose), (Z_dense, Z_loose) = states[:, :3].T
    share = (REFERENCE - f_loose) / (f_dense - f_loose)
    at = states[1, 3:] + share * (states[0, 3:] - states[1, 3:])
    c_cLam = (f_dense - f_loose) / (e_loose - e_dense)
    e_cmax = e_loose + f_loose / c_cLam
    gamma = math.log((Z_dense - 4.0) / (Z_loose - 4.0)) / math.log(f_dense / f_loose)
    c_cZ = (Z_dense - 4.0) / (e_cmax - e_dense) ** gamma
    return np.array([*at, e_cmax, c_cLam, c_cZ, gamma, c_cLam * (e_cmax - AT)])


def with_variance(cells: tuple[Cell, Cell]) -> tuple[np.ndarray, np.ndarray]:
    """(CONSTANTS, their variances), by the delta method."""
    states = np.concatenate([cell.mean for cell in cells])

    def values(x: np.ndarray) -> np.ndarray:
        return constants(x.reshape(2, -1))

    slopes = approx_fprime(states, values, 2e-5 * np.abs(states), centered=True)
    covariance = linalg.block_diag(*(cell.covariance for cell in cells))
    return values(states), np.einsum("ij,jk,ik->i", slopes, covariance, slopes)


def freedom_of(cells: Cells) -> int:
    """Degrees of freedom of the pooled scatter: the fewer of the two densities."""
    return min(cell.freedom for pair in cells.values() for cell in pair)


def constant_table(cells: Cells) -> pandas.DataFrame:
    """CONSTANTS of every material and their differences from Table 1's grains; a row per material and constant.

    Columns: parameter, value (of the parameter), constant, estimate, within, difference, difference_within, specimens,
    p_value (of the difference), corrected (Holm, all rows), verdict: differs, agrees (the whole interval is within 2 %,
    of e_cmax within 0.005), or not resolved.
    """
    known = {material: with_variance(pair) for material, pair in cells.items()}
    freedom = freedom_of(cells)
    rows = []
    for parameter, materials in VARIED.items():
        for material, at in materials.items():
            if material not in known or (material == PAPER and parameter != "mu"):
                continue
            values, variances = known[material]
            own, n = material == PAPER, sum(cell.specimens for cell in cells[material])
            label = (PAPER, math.nan) if own else (parameter, at)
            for k, constant in enumerate(CONSTANTS):
                found = Tested.of(values[k], math.sqrt(variances[k]), freedom, n)
                error = math.sqrt(variances[k] + known[PAPER][1][k])
                other = NOTHING if own else Tested.of(values[k] - known[PAPER][0][k], error, freedom, n)
                judged = LOOSEST if constant == "e_cmax" else JUDGED * abs(known[PAPER][0][k])
                difference = other.value, other.within
                rows.append((*label, constant, found.value, found.within, *difference, n, other.p_value, judged))
    columns = "parameter value constant estimate within difference difference_within specimens p_value judged".split()
    table = with_verdict(corrected(rows, columns), "difference", "difference_within")
    table["verdict"] = table["verdict"].where(table["parameter"] != PAPER, "")
    return table.sort_values("parameter", key=lambda names: names != PAPER, kind="stable", ignore_index=True)


def scale(parameter: str, value: float) -> float:
    """Distance of a parameter from Table 1: value - value of Table 1; of kappa, log2 of their ratio."""
    base = VARIED[parameter][PAPER]
    return math.log2(value / base) if parameter == "kappa" else value - base


def slope_table(cells: Cells) -> pandas.DataFrame:
    """Slopes of the constants at Table 1's grains, from a parabola through the materials; a row per parameter.

    The slope is per unit of mu, mu_r and spread, and per doubling of kappa. Columns: parameter, constant, slope,
    within, materials, p_value, corrected (Holm, all rows).
    """
    known = {material: with_variance(pair) for material, pair in cells.items()}
    freedom, rows = freedom_of(cells), []
    for parameter, materials in VARIED.items():
        present = [material for material in materials if material in known]
        if len(present) < 3 or PAPER not in present:
            continue
        x = np.array([scale(parameter, materials[material]) for material in present])
        design = np.column_stack([np.ones_like(x), x, x**2])
        for k, constant in enumerate(CONSTANTS):
            y, variance = (np.array([known[material][part][k] for material in present]) for part in (0, 1))
            covariance = np.linalg.inv(design.T @ (design / variance[:, None]))
            slope = (covariance @ design.T @ (y / variance))[1]
            found = Tested.of(float(slope), math.sqrt(covariance[1, 1]), freedom, len(present))
            rows.append((parameter, constant, found.value, found.within, len(present), found.p_value))
    return corrected(rows, ["parameter", "constant", "slope", "within", "materials", "p_value"])
