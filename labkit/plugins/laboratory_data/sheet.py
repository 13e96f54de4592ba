"""The sheet of a predicted test: intervals of its curves, as a PDF.

Each of a few draws from the posterior of the grains is a specimen that is tested. The interval of 90 % has two parts:
the scatter between the draws, by Student's t, and the deviation from measured tests that no parameters remove.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pandas

from labkit.errors import InputError
from labkit.paths.facts import facts_of
from labkit.paths.path import Path
from labkit.plugins.laboratory_data.comparing import curve
from labkit.plugins.laboratory_data.posterior import Posterior
from labkit.plugins.laboratory_data.sampling import GrainTests
from labkit.quantities.recorded import quantity
from labkit.results.run import Run

POINTS = 40  # of a predicted curve
ROWS = (0.2, 0.5, 1.0)  # rows of the table, as fractions of the strain of the test
LIMITS = (
    "Spheres with rolling resistance. Not predicted: undrained tests from drained ones, another fabric of specimens, "
    "pressures far from those of the tests, fines, cementation, suction, creep, crushing. See docs/predicted_tests.md."
)


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
