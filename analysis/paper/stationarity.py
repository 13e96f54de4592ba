"""Are the ends of the shear tests stationary? Slopes of each quantity over the last quarter of the strain."""

from __future__ import annotations

import numpy as np
import pandas

from analysis.paper.ends import Runs, recorded_numbers
from analysis.paper.lines import off_the_lines
from analysis.paper.numbers import NUMBERS
from analysis.paper.specimens import density_of, specimen_of, specimens_of
from analysis.statistics import Tested, jackknife
from analysis.statistics.one_line import one_line
from analysis.statistics.stationarity import slope_table, stationarity_table
from labkit.results import WINDOW

QUANTITIES = ("M", "A_zz", "F_zz", "Ft_zz", "Z", "Lambda", "e", "p_MPa", "Z_off", "Lambda_off")
JUDGED = {number.column: number.rounding for number in NUMBERS if number.column in QUANTITIES and not number.at_start}
JUDGED |= {"Z_off": JUDGED["Z"], "Lambda_off": JUDGED["Lambda"]}
CONTROLLED = {"cv": ("e",), "cp": ("p_MPa",)}  # quantities that a path prescribes cannot drift
REFERENCE = 0.67  # void ratio at which the components are given
LINEAR = ("M", "A_zz", "F_zz", "Ft_zz")


def stationarity(runs: Runs) -> tuple[pandas.DataFrame, pandas.DataFrame]:
    """(slopes of every test, slopes over specimens by path) over the last quarter of the strain, per 10 % strain.

    Tables of slope_table and stationarity_table; Z_off and Lambda_off are the distances from the
    lines of Table 2. A slope matters if over 10 % strain it changes a quantity by half a unit of the last digit that
    the paper prints (for Z, Lambda and e, by the uncertainty from the rounding of e_cmax; for p, by 1 %).
    """
    tables = [pandas.DataFrame(columns=["run", "specimen", "strain", "path", *QUANTITIES], dtype=float)]
    for name, run in runs.items():
        strain = run["axial_strain"].values.astype(float)
        labels = {"run": name, "specimen": specimen_of(name), "path": run.attrs["path"]}
        numbers = off_the_lines(recorded_numbers(run)).assign(**labels, strain=strain)
        numbers = numbers.assign(**dict.fromkeys(CONTROLLED.get(run.attrs["path"], ()), np.nan))
        tables.append(numbers[strain >= (1.0 - WINDOW) * strain[-1]])
    slopes = slope_table(pandas.concat(tables[1:] or tables), QUANTITIES, 0.0, by=["path"])
    every = stationarity_table(slopes.assign(path="all"), ["path"], JUDGED)
    both = pandas.concat([every, stationarity_table(slopes, ["path"], JUDGED)], ignore_index=True)
    return slopes, both[both["tests"] > 0]


def components(ends: pandas.DataFrame) -> pandas.DataFrame:
    """M, A_zz, F_zz and F^t_zz at the ends of the tests as lines in e, a pandas.DataFrame with a row per quantity.

    `value` is that at REFERENCE and `slope` is against e; `within` and `slope_within` are their 95 % half-widths, found
    by leaving out one specimen at a time. `p_path` and `p_density` are the p-values of the tests that all paths, or
    all densities, lie on one such line.
    """
    rows = []
    e = ends["e"].to_numpy(dtype=float) - REFERENCE
    specimens, line = specimens_of(ends["run"]), np.column_stack([np.ones(len(ends)), e])
    for name in LINEAR if len(ends) > 4 and np.ptp(e) > 0.02 else ():
        y = ends[name].to_numpy(dtype=float)

        def fitted(k: int, y: np.ndarray = y) -> Tested:
            return jackknife(lambda rows: np.linalg.lstsq(line[rows], y[rows], rcond=None)[0][k], len(y), 2, specimens)

        value, slope = fitted(0), fitted(1)
        path = one_line(y, line, ends["path"].to_numpy(dtype=str), specimens)
        density = one_line(y, line, np.array([density_of(str(run)) for run in ends["run"]]), specimens)
        found = value.value, value.within, slope.value, slope.within, path.scatter
        rows.append((name, REFERENCE, *found, len(ends), value.n, path.p_value, density.p_value))
    columns = "quantity e value within slope slope_within scatter tests specimens p_path p_density".split()
    return pandas.DataFrame(rows, columns=columns)
