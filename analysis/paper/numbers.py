"""The numbers of the paper that the campaign measures or takes as input."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas
import xarray as xr

from analysis.paper import lines
from analysis.paper.ends import Runs, main, matching, sheared
from labkit.model import ROOT_3_2
from labkit.results import SHEAR

RELATIVE = 0.02  # difference that would matter, as for C0: nothing that follows from C0 is known more accurately
Statistic = Callable[[pandas.DataFrame], float]  # a function of a table of analysis.paper.ends


@dataclasses.dataclass(frozen=True)
class Number:
    """A number of the paper, measured at the ends of shear tests along `paths` or at the starts of runs.

    `rounding` is half a unit of the last digit that the paper prints, including the rounding of e_cmax. `statistic` is
    a function of a table of analysis.paper.ends, which fits `parameters` parameters; `column` is the table column
    behind the number, if there is only one; `pattern` is a regular expression for the runs whose start is measured. The
    `kind` is `measured`, or `input` or `tuned` for numbers that we set, or adjusted a specimen to, and that cannot
    count as agreement. `judged` is the smallest difference that would matter (default: RELATIVE of the paper's number,
    or its rounding if larger).
    """

    name: str
    label: str
    paper: float
    rounding: float
    statistic: Statistic
    column: str = ""
    parameters: int = 1
    paths: tuple[str, ...] = SHEAR
    pattern: str = ""
    kind: str = "measured"
    judged: float = 0.0

    @property
    def resolution(self) -> float:
        """The smallest difference from the paper that would matter."""
        return self.judged or max(RELATIVE * abs(self.paper), self.rounding)

    @property
    def is_mean(self) -> bool:
        """True if the number is a mean over tests rather than the parameter of a fit."""
        return self.parameters == 1 and self.statistic not in (lines.c_cZ, lines.c_cLambda)

    @property
    def at_start(self) -> bool:
        """True if it is measured at the start of tests rather than at their end."""
        return bool(self.pattern)

    def select(self, runs: Runs) -> dict[str, xr.Dataset]:
        """Runs from which it is measured."""
        return matching(runs, self.pattern) if self.pattern else sheared(main(runs), self.paths)


def _mean(column: str) -> Statistic:
    return lambda table: float(table[column].mean())


def _critical(
    name: str, label: str, paper: float, rounding: float, column: str, paths: tuple[str, ...] = SHEAR
) -> Number:
    return Number(name, label, paper, rounding, _mean(column), column, paths=paths)


def _fit(k: int, name: str, label: str, rounding: float) -> Number:
    paper = dataclasses.astuple(lines.PAPER)[k]
    judged = rounding if k == 0 else 0.0  # 2 % of e_cmax would be a tenth of the range of e

    def parameter(table: pandas.DataFrame) -> float:
        return float(lines.both_lines(table)[k])

    return Number(name, label, paper, rounding, parameter, parameters=4, judged=judged)


def _residual(
    column: str, label: str, rounding: float, line: Callable[[pandas.Series], np.ndarray], of: str = "e"
) -> Number:
    """The mean distance of the ends of tests from a line of the paper, a function of the column `of`."""

    def distance(table: pandas.DataFrame) -> float:
        return float((table[column] - line(table[of])).mean())

    return Number(f"{column} residual", f"mean of {label}", 0.0, rounding, distance, column)


HALF, MIDDLE = 0.005, 0.67  # rounding of e_cmax = 0.76, and the void ratio at which it is converted to other numbers
ROUNDED_Z = float(lines.critical_Z(MIDDLE - HALF) - lines.critical_Z(MIDDLE))  # rounding of Z^c
ROUNDED = HALF / (lines.PAPER.e_cmax - MIDDLE)  # relative rounding of c_cLambda; gamma_cZ times that for c_cZ
NUMBERS = (
    _critical("M", "strength M = q/p at 30 to 40 % strain", 0.92, 0.005, "M"),
    _critical("M CV", "M in CV tests at 30 to 40 % strain", 0.93, 0.005, "M", ("cv",)),
    _critical("A_zz", "A_zz at 30 to 40 % strain", lines.PAPER.A_c / ROOT_3_2, 0.005, "A_zz"),
    _critical("F_zz", "F_zz at 30 to 40 % strain", lines.PAPER.F_c / ROOT_3_2, 0.005, "F_zz"),
    _critical("Ft_zz", "F^t_zz at 30 to 40 % strain", lines.PAPER.Ft_c / ROOT_3_2, 0.0005, "Ft_zz"),
    _residual("Z", "Z - Z^c(e) at the end of tests", ROUNDED_Z, lines.critical_Z),
    _residual("Lambda", "Lambda - Lambda^c(e) at the end of tests", lines.PAPER.c_cLam * HALF, lines.critical_Lambda),
    _residual("e", "e - e^c(p) at the end of tests; e^c(p) from C0 with Table 2", HALF, lines.paper_e, "p_MPa"),
    Number(
        "c_cZ",
        "c_cZ with e_cmax = 0.76 and gamma_cZ = 0.7",
        lines.PAPER.c_cZ,
        0.005 + ROUNDED * lines.PAPER.gamma_cZ * lines.PAPER.c_cZ,
        lines.c_cZ,
    ),
    Number(
        "c_cLambda",
        "c_cLambda with e_cmax = 0.76",
        lines.PAPER.c_cLam,
        0.0005 + ROUNDED * lines.PAPER.c_cLam,
        lines.c_cLambda,
    ),
    _fit(0, "e_cmax free", "e_cmax, joint fit of the four parameters of both lines", 0.005),
    _fit(1, "c_cZ free", "c_cZ, joint fit", 0.005),
    _fit(2, "gamma_cZ free", "gamma_cZ, joint fit", 0.05),
    _fit(3, "c_cLambda free", "c_cLambda, joint fit", 0.0005),
    *(
        Number(statistic=_mean(row["column"]), **row)
        for row in pandas.read_csv(Path(__file__).with_name("inputs.csv")).to_dict("records")
    ),
)
INDEPENDENT = {  # independent numbers among the measured ones; the others follow from the same lines
    "M": "M",
    "A_zz": "A_zz",
    "F_zz": "F_zz",
    "Ft_zz": "F^t_zz",
    "Z residual": "the line of Z",
    "Lambda residual": "the line of Lambda",
}
