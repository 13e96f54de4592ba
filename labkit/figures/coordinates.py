"""Coordinates of diagrams: what an axis shows of the records of a run, with its label; and how runs are drawn."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal

import numpy as np
import xarray
from matplotlib.axes import Axes

from labkit.figures.frame import Runs, as_axis, colors_for, common_label
from labkit.micro.stress import equivalent_stress
from labkit.micro.tensors import symmetric

Line = Literal["-", "--"]
STYLES: dict[str, tuple[str, Line]] = {"Love": ("stress", "-"), "C0": ("stress_sff", "--")}
MODEL_STYLES: dict[str, tuple[str, Line]] = {"C0 (model)": ("stress", "-")}


def has_grains(run: xarray.Dataset) -> bool:
    """False for a prediction of the constitutive model, whose stress is C0."""
    return run.attrs.get("engine") != "model"


def styles_of(run: xarray.Dataset) -> dict[str, tuple[str, Line]]:
    """Name of each stress of a run -> its variable and line style."""
    return STYLES if has_grains(run) else MODEL_STYLES


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """Label of the axis, and values of a run's records, a function of (run, name of a stress).

    of_stress: whether Love's stress and C0 give different values.
    """

    label: str | Callable[[xarray.Dataset], str]
    values: Callable[[xarray.Dataset, str], np.ndarray]
    of_stress: bool = False

    def labelled(self, label: str) -> Coordinate:
        """The same values under another label."""
        return dataclasses.replace(self, label=label)

    def common_label(self, runs: Iterable[xarray.Dataset]) -> str:
        """The label for several runs, with the alternatives where they differ."""
        label = self.label
        return label if isinstance(label, str) else common_label([label(run) for run in runs])


def _of_path(of: Callable[[xarray.Dataset], xarray.DataArray]) -> Coordinate:
    return Coordinate(lambda run: as_axis(of(run))[0], lambda run, stress: as_axis(of(run))[1])


def volumetric_strain(run: xarray.Dataset) -> np.ndarray:
    """Volumetric strain of the records, compression positive, (n,)."""
    return np.trace(run["strain"].values, axis1=1, axis2=2)


def percent(run: xarray.Dataset) -> np.ndarray:
    """Axial strain of the records, %."""
    return run["axial_strain"].values * 100


def _component(label: str, i: int, j: int) -> Coordinate:
    return Coordinate(label, lambda run, stress: symmetric(run[stress].values)[:, i, j] / 1e6, True)


STRAIN = _of_path(lambda run: run.lab.strain())
ABSCISSA = _of_path(lambda run: run.lab.abscissa())
P = Coordinate("mean stress p (MPa)", lambda run, stress: run.lab.mean_stress(stress).values / 1e6, True)
Q = Coordinate("deviatoric stress q (MPa)", lambda run, stress: run.lab.q(stress).values / 1e6, True)
INVARIANT = Coordinate(
    "deviatoric stress, invariant q (MPa)", lambda run, stress: equivalent_stress(run[stress].values) / 1e6, True
)
SHEAR_STRESS = _component("shear stress $\\sigma_{xz}$ (MPa)", 0, 2)
NORMAL_STRESS = _component("normal stress $\\sigma_{zz}$ (MPa)", 2, 2)
VOID_RATIO = Coordinate("void ratio e", lambda run, stress: run["void_ratio"].values)
VOLUMETRIC = Coordinate("volumetric strain (%)", lambda run, stress: 100 * volumetric_strain(run))
ERROR = Coordinate("error of C0, Frobenius norm (%)", lambda run, stress: 100.0 * run.lab.sff_error().values)


def draw_runs(
    panels: Sequence[Axes], runs: Runs, pairs: Sequence[tuple[Coordinate, Coordinate]], both: bool = True, **style: Any
) -> None:
    """Draw runs, each in its own colour, in panels of (x, y); Love's stress is solid and C0 dashed.

    both: False to draw Love's stress alone; style: of the lines.
    """
    for axes, (x, y) in zip(panels, pairs, strict=True):
        for color, (label, run) in zip(colors_for(len(runs)), runs.items(), strict=True):
            stresses = list(styles_of(run).values()) if both and y.of_stress else [("stress", "-")]
            for stress, line in stresses:
                values = x.values(run, stress), y.values(run, stress)
                axes.plot(*values, line, color=color, label=label if line == "-" else None, **style)
        axes.set(xlabel=x.common_label(runs.values()), ylabel=y.common_label(runs.values()))
