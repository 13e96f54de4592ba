"""The sheet of a predicted test: intervals of its curves, as a PDF and as AGS4.

Each of a few draws from the posterior of the grains is a specimen that is tested. The interval of 90 % has two parts:
the scatter between the draws, by Student's t, and the deviation from measured tests that no parameters remove.
"""

from __future__ import annotations

import dataclasses
import datetime
import math
import types
from collections.abc import Sequence
from pathlib import Path as File

import numpy as np
import pandas

from labkit.errors import InputError
from labkit.paths.facts import facts_of
from labkit.paths.path import Path
from labkit.plugins.laboratory_data.comparing import curve
from labkit.plugins.laboratory_data.posterior import Posterior
from labkit.plugins.laboratory_data.sampling import GrainTests
from labkit.process.extras import require_library
from labkit.quantities.recorded import quantity
from labkit.results.run import Run
from labkit.version import __version__

POINTS = 40  # of a predicted curve
ROWS = (0.2, 0.5, 1.0)  # rows of the table, as fractions of the strain of the test
LIMITS = (
    "Spheres with rolling resistance. Not predicted: undrained tests from drained ones, another fabric of specimens, "
    "pressures far from those of the tests, fines, cementation, suction, creep, crushing. See docs/predicted_tests.md."
)
TESTS = {"cr": "CID", "cv": "CIU"}  # path -> start of TREG_TYPE
GROUP = "TREP"  # AGS4 has no group for curves of static tests, nor for intervals
OF_GROUP = (  # heading, status, type, meaning, unit
    ("TREP_QNTY", "KEY", "X", "Quantity", ""),
    ("TREP_STRN", "KEY", "2DP", "Axial strain, logarithmic, compression positive", "%"),
    ("TREP_MEAN", "OTHER", "4DP", "Predicted value of the quantity", ""),
    ("TREP_LOW", "OTHER", "4DP", "Lower end of the 90 % interval", ""),
    ("TREP_HIGH", "OTHER", "4DP", "Upper end of the 90 % interval", ""),
)
SPECIMEN = {"LOCA_ID": "GRAINS", "SAMP_TOP": "0.00", "SAMP_REF": "1", "SAMP_TYPE": "", "SAMP_ID": "PREDICTED"}


@dataclasses.dataclass(frozen=True, eq=False)
class Prediction:
    """A predicted test.

    Args:
        path: Path of the test.
        void_ratio: Void ratio of the sand.
        runs: A run for each draw of the parameters.
        scatter: Quantity -> standard deviation between repeated tests.
        misfit: Deviation of the calibration that no parameters remove, in units of the scatter.
        tests: Names of the tests on which the grains were calibrated.
    """

    path: Path
    void_ratio: float
    runs: list[Run]
    scatter: dict[str, float]
    misfit: float
    tests: tuple[str, ...]

    def curves(self, name: str, strain: np.ndarray) -> pandas.DataFrame:
        """Return the columns `predicted`, `low` and `high` of a quantity at strains (n,) of the path."""
        from scipy.stats import t as student

        values, n = np.array([curve(run, name, strain) for run in self.runs]), len(self.runs)
        spread = np.sqrt(values.var(axis=0, ddof=1) * (1.0 + 1.0 / n) + (self.misfit * self.scatter[name]) ** 2)
        mean, half = values.mean(axis=0), student.ppf(0.95, n - 1) * spread
        return pandas.DataFrame({"axial strain": strain, "predicted": mean, "low": mean - half, "high": mean + half})

    def table(self, shares: tuple[float, ...] = ROWS) -> pandas.DataFrame:
        """Return the predicted values and their 90 % intervals at shares of the strain of the path."""
        strain = float(self.path.strain) * (1.0 - 1e-3) * np.array(shares)
        parts = {name: self.curves(name, strain) for name in self.scatter}
        return pandas.concat(parts, names=["quantity"]).droplevel(1).reset_index()

    @property
    def title(self) -> str:
        """What is predicted, in one line."""
        pressure = self.path.start_pressure()
        start = "" if pressure is None else f" at {pressure / 1e3:g} kPa"
        return f"Path {self.path.name}{start}, void ratio {self.void_ratio:g}, from {', '.join(self.tests)}"


def predict_test(
    tests: GrainTests, posterior: Posterior, path: Path, void_ratio: float, draws: int = 6, grains: int = 300
) -> Prediction:
    """Predict a test that was not carried out. Raises InputError, and PhysicsError if a specimen or test fails.

    Args:
        tests: The tests and the scatter with which the grains were calibrated.
        posterior: The calibration.
        path: Path of the test, with its pressure.
        void_ratio: Void ratio of the sand.
        draws: Number of sets of parameters, at least 2, with a specimen each.
        grains: Number of grains of a specimen.
    """
    if draws < 2:
        raise InputError(field="draws", value=draws, allowed="2 or more")
    chosen = posterior.some(draws)
    runs = [tests.test(parameters, path, void_ratio, grains, seed) for seed, parameters in enumerate(chosen, 1)]
    misfit = float(posterior.draws["misfit"].median())
    return Prediction(path, void_ratio, runs, dict(tests.scatter), misfit, tuple(tests.measured))


def write_pdf(prediction: Prediction, file: str, inputs: Sequence[str] = ()) -> None:
    """Write the sheet: curves with intervals, the table, and what grains of this kind cannot predict.

    Args:
        prediction: The prediction.
        file: PDF to write.
        inputs: Files from which it was made.
    """
    from labkit.figures.frame import new_panels
    from labkit.figures.plots import save

    strain = float(prediction.path.strain) * (1.0 - 1e-3) * np.linspace(0.0, 1.0, POINTS + 1)
    rows = len(prediction.scatter) + 1
    figure, panels = new_panels(rows, 1, 11.69, 8.27)
    for axes, name in zip(panels, prediction.scatter, strict=False):
        values = prediction.curves(name, strain)
        axes.plot(strain, values["predicted"], label="predicted")
        axes.fill_between(strain, values["low"], values["high"], alpha=0.25, label="90 % interval")
        axes.set(xlabel="axial strain", ylabel=quantity(name).label(facts_of(prediction.path)))
        axes.legend()
    panels[-1].axis("off")
    table = prediction.table()
    cells = [[row[0], f"{row[1]:.1%}", *(f"{value:.4g}" for value in row[2:])] for row in table.itertuples(index=False)]
    panels[-1].table(cells, colLabels=list(table), loc="upper center")
    panels[-1].text(0.0, 0.0, LIMITS, wrap=True, fontsize=8, va="bottom")
    figure.suptitle(prediction.title)
    save(figure, file, inputs)


def require_ags4(path: Path) -> types.ModuleType:
    """Return the library that writes AGS4. Raises InputError without it, and for a path without a type in AGS4."""
    if path.name not in TESTS:
        raise InputError("has no type of test", field="ags4", value=path.name, allowed="a test on the path cr or cv")
    return require_library("python_ags4.AGS4", "AGS4 files", "ags4")


def write_ags4(prediction: Prediction, file: str) -> None:
    """Write the prediction as AGS4 4.1.1, with the curves in the group TREP of its own.

    Raises InputError (`require_ags4`).
    """
    ags4 = require_ags4(prediction.path)
    kind = f"{TESTS[prediction.path.name]}{'C' if prediction.path.strain > 0.0 else 'E'}"
    specimen = {**SPECIMEN, "SPEC_REF": "1", "SPEC_DPTH": "0.00"}
    pressure = math.nan if (start := prediction.path.start_pressure()) is None else start / 1e3
    said = {
        **{"TRET_CONP": f"{pressure:.0f}", "TRET_REM": f"predicted, see {GROUP}"},
        "TRET_IVR": f"{prediction.void_ratio:.3f}",
    }
    of = {
        "PROJ": [{"PROJ_ID": "LABKIT", "PROJ_NAME": prediction.title}],
        "TRAN": [
            {
                **{"TRAN_ISNO": "1", "TRAN_DATE": f"{datetime.date.today()}", "TRAN_PROD": f"labkit {__version__}"},
                **{"TRAN_STAT": "Predicted", "TRAN_DESC": "Predicted by grains, not measured", "TRAN_AGS": "4.1.1"},
                **{"TRAN_RECV": "Designer", "TRAN_DLIM": "|", "TRAN_RCON": "+", "TRAN_REM": LIMITS},
            }
        ],
        "LOCA": [{"LOCA_ID": "GRAINS", "LOCA_REM": "no location: grains"}],
        "SAMP": [{**SPECIMEN, "SAMP_REM": "no sample: grains"}],
        "TREG": [{**specimen, "TREG_TYPE": kind, "TREG_REM": "predicted, not measured", "TEST_STAT": "Predicted"}],
        "TRET": [{**specimen, "TRET_TESN": "1", **said}],
        GROUP: [
            {**specimen, "TRET_TESN": "1", **dict(zip((name for name, *_ in OF_GROUP), values, strict=True))}
            for row in prediction.table(tuple(np.linspace(0.1, 1.0, 10))).itertuples(index=False)
            for values in [(row[0], f"{100.0 * row[1]:.2f}", *(f"{value:.4f}" for value in row[2:]))]
        ],
    }
    dictionary, _ = ags4.AGS4_to_dataframe(File(str(ags4.__file__)).with_name("Standard_dictionary_v4_1_1.ags"))
    ags4.dataframe_to_AGS4(*_tables(of, dictionary), file, warnings=False)


def _tables(
    of: dict[str, list[dict[str, str]]], dictionary: dict[str, pandas.DataFrame]
) -> tuple[dict[str, pandas.DataFrame], dict[str, list[str]]]:
    """Return groups as tables, and their headings; units, types and descriptions are those of the dictionary."""
    standard = dictionary["DICT"].query("DICT_TYPE == 'HEADING'").drop_duplicates("DICT_HDNG").set_index("DICT_HDNG")
    unit, kind, meaning = (standard[f"DICT_{field}"].to_dict() for field in ("UNIT", "DTYP", "DESC"))
    unit |= {name: each for name, *_, each in OF_GROUP}
    kind |= {name: each for name, _, each, *_ in OF_GROUP}
    own = {name for name, *_ in OF_GROUP}
    keys = [
        (name, "KEY", kind[name], " ".join(meaning[name].split()), unit[name])
        for name in of[GROUP][0]
        if name not in own
    ]
    columns = ("DICT_TYPE", "DICT_GRP", "DICT_HDNG", "DICT_STAT", "DICT_DTYP", "DICT_DESC", "DICT_UNIT", "DICT_PGRP")
    rows = [("GROUP", GROUP, "", "", "", "Triaxial Tests - Predicted Curves with Intervals", "", "TRET")]
    rows += [("HEADING", GROUP, *row, "") for row in (*keys, *OF_GROUP)]
    of = {**of, "DICT": [dict(zip(columns, row, strict=True)) for row in rows]}
    cells = {(name, value) for records in of.values() for row in records for name, value in row.items() if value}
    codes = dictionary["ABBR"].set_index(["ABBR_HDNG", "ABBR_CODE"])["ABBR_DESC"].to_dict()
    of["ABBR"] = [
        {"ABBR_HDNG": name, "ABBR_CODE": code, "ABBR_DESC": codes[name, code]}
        for name, code in sorted(cells)
        if kind[name] == "PA"
    ]
    names = {
        *(name for records in of.values() for name in records[0]),
        "UNIT_UNIT",
    }  # headings of TYPE and UNIT are X too
    for group, used, listed in (("TYPE", kind, "PT"), ("UNIT", unit, "PU")):
        words = {used[name] for name in names} | {value for name, value in cells if kind[name] == listed}
        described = dictionary[group].set_index(f"{group}_{group}")[f"{group}_DESC"].to_dict()
        of[group] = [
            {f"{group}_{group}": word, f"{group}_DESC": " ".join(described[word].split())}
            for word in sorted(words - {""})
        ]
    tables = {}
    for group, records in of.items():
        top = [["UNIT", *map(unit.get, records[0])], ["TYPE", *map(kind.get, records[0])]]
        data = [["DATA", *record.values()] for record in records]
        tables[group] = pandas.DataFrame([*top, *data], columns=["HEADING", *records[0]])
    return tables, {group: list(table) for group, table in tables.items()}
