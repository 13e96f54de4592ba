"""A strip footing under one cycle of load in scikit-fem, with the model as material.

python -m examples.boundary_value.footing, with labkit[fem], writes footing.csv and footing.png: the pressure under the
footing, and the residuals of every iteration of Newton's method. A rigid, rough footing settles, is raised by a fifth
of its settlement, and settles as far again. Half of it is modelled.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from examples.boundary_value.scikit_fem import Law, PlaneStrain
from labkit.model import MEASURED_REVERSALS, Model, update

BREADTH, WIDTH, DEPTH = 1.0, 2.5, 2.0  # of the footing, of half the ground, m
SURCHARGE, VOID_RATIO = 100e3, 0.64  # Pa
CYCLE = (0.01, -0.002, 0.002)  # settlement over breadth: first loading, unloading, reloading
MODELS = {"paper": Model(), "reversals": Model(reversals=MEASURED_REVERSALS)}


class Footing(PlaneStrain):
    """The footing on elements of BREADTH/`parts`."""

    breadth, pressure, height = 0.5 * BREADTH, SURCHARGE, BREADTH

    def __init__(self, parts: int, law: Law, model: Model) -> None:
        """Mesh, boundary conditions and initial states."""
        x, y = (np.linspace(0.0, size, round(size * parts / BREADTH) + 1) for size in (WIDTH, DEPTH))
        super().__init__(x, y, law, model, lambda x, y: np.full_like(x, VOID_RATIO))
        edge = 0.5 * BREADTH + 1e-9

        def under(p):
            return np.isclose(p[1], DEPTH) & (p[0] < edge)

        def beside(p):
            return np.isclose(p[1], DEPTH) & (p[0] > edge)

        sides, base = (lambda p: np.isclose(p[0] % WIDTH, 0.0)), (lambda p: np.isclose(p[1], 0.0))
        self.bind(beside, under, (under, "u^1"), (sides, "u^1"), (base, "u^1"), (base, "u^2"))

    def uniform(self, strain: float) -> np.ndarray:
        """First estimate: the settlement falls to zero at the base and at one breadth beside the footing."""
        x, y = self.basis.doflocs
        displacement, axial = np.zeros(self.basis.N), self.basis.get_dofs(elements=True).all("u^2")
        shape = np.clip(1.5 - x / BREADTH, 0.0, 1.0) * y / DEPTH
        displacement[axial] = -strain * BREADTH * shape[axial]
        return displacement


def cycle(parts: int = 4, increments: int = 10) -> pd.DataFrame:
    """Load, unload and reload; a row per model and increment.

    Columns: model, part of the cycle, settlement (of the breadth), pressure (kPa), iterations, residuals (as text).
    """
    rows = []
    for name, model in MODELS.items():

        def law(state, increment, model=model):
            return update(model, state, increment)

        footing, settlement = Footing(parts, law, model), 0.0
        for part, strain in zip(("loading", "unloading", "reloading"), CYCLE, strict=True):
            history = footing.run(strain, increments, lambda done, text: None)
            for now, stress, found in zip(history.strain[1:], history.stress[1:], history.residuals, strict=True):
                residuals = " ".join(f"{r:.0e}" for r in found)
                rows.append((name, part, settlement + now, stress / 1e3, len(found) - 1, residuals))
            settlement += history.strain[-1]
            footing.pressure = history.stress[-1]
            most, reached = history.iterations.max(initial=0), history.strain[-1] / strain
            print(f"{name}, {part}: {history.stress[-1] / 1e3:.1f} kPa, at most {most} iterations, "
                  f"{history.cuts} increments halved, {reached:.0%} of the settlement reached")  # fmt: skip
            if reached < 1.0 - 1e-6:
                break  # a point beside the edge of the footing reaches p = 0
    return pd.DataFrame(rows, columns="model part settlement pressure iterations residuals".split())


def figure(table: pd.DataFrame) -> plt.Figure:
    """Pressure against settlement, and the residuals of each iteration."""
    made, (left, right) = plt.subplots(1, 2, figsize=(7.0, 2.8), layout="constrained")
    for name, own in table.groupby("model", sort=False):
        settlement = 100.0 * np.array([0.0, *own["settlement"]])
        left.plot(settlement, [SURCHARGE / 1e3, *own["pressure"]], label=name)
        for residuals in own["residuals"].str.split():
            right.semilogy(np.array(residuals, float), f"C{list(MODELS).index(name)}-", lw=0.5)
    left.set(xlabel="settlement (% of the breadth)", ylabel="pressure (kPa)")
    right.set(xlabel="iteration", ylabel="residual over load")
    left.legend()
    return made


if __name__ == "__main__":
    table = cycle()
    table.to_csv("footing.csv", index=False, float_format="%.6g")
    figure(table).savefig("footing.png", dpi=80)
