"""Figs. 4 to 10 of the paper from the model alone, with Table 2 and the initial states in the legends.

In the paper these are the dotted lines of Figs. 4 to 8. The paper gives neither the initial pressures of Fig. 4 nor Z
and Lambda of any initial state: the pressures here are chosen, Z is on the compression line and Lambda follows from C0
(labkit.model.isotropic_state). Tests that start at e0 = 0.77 need beyond_e_cmax = flat.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from analysis.paper.drawing import curves
from analysis.pictures import save
from labkit.files import make_folder
from labkit.model import Model, as_run, drive, isotropic_state, model_path, with_inherent_anisotropy
from labkit.paths import REVERSALS

FLAT = Model().reading(beyond_e_cmax="flat")
MPA = 1e6
DENSITIES = (0.77, 0.724, 0.670, 0.606)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `./lab model-figures`."""
    parser.add_argument(
        "-o", "--output", default="model_figures", help="folder for the figures (default: model_figures)"
    )


def main(options: argparse.Namespace, command: str) -> None:
    """Draws every figure into the folder."""
    for file in draw_all(make_folder(options.output, "--output")):
        print(f"figure: {file}")


def run_of(
    name: str,
    void_ratio: float,
    pressure: float,
    Z: float | None = None,
    a1: float = 0.0,
    angle: float = 0.0,
    **parameters: Any,
) -> tuple[str, xr.Dataset]:
    """(label, run) of the model with Table 2 along a path; the label gives the initial state.

    The pressure is in MPa. `a1` is the size of the inherent anisotropy, whose axis is at `angle` (degrees) from the
    axial direction; `parameters` are passed to labkit.model.model_path.
    """
    state = isotropic_state(FLAT, void_ratio, pressure * MPA, Z)
    state = with_inherent_anisotropy(FLAT, state, a1, math.radians(angle))
    result = drive(FLAT, model_path(name, pressure * MPA, **parameters), state).require()
    label = f"$e_0$ {state.e:g}, $p_0$ {pressure:g} MPa,\n$Z_0$ {state.Z:.2f}, $\\Lambda_0$ {state.Lam:.5f}"
    return label, as_run(result)


def fig_4() -> Figure:
    """CV at three void ratios."""
    starts = {0.724: (0.1, 0.3, 0.6, 1.0), 0.670: (0.1, 0.5, 1.0, 1.5), 0.606: (0.21, 1.0, 2.0, 2.9)}
    rows = {
        f"CV, e = {e:.3f}": dict(run_of("cv", e, p, strain=0.4) for p in pressures) for e, pressures in starts.items()
    }
    return curves(rows, ("q-p", "q-strain"))


def _drained(name: str, held: str) -> Figure:
    rows = {
        f"{name.upper()}, {held} = {p:g} MPa": dict(run_of(name, e, p, strain=0.4) for e in DENSITIES)
        for p in (0.5, 1.0)
    }
    return curves(rows, ("q-strain", "e-strain"))


def fig_5() -> Figure:
    """CR at 0.5 and 1 MPa, four densities."""
    return _drained("cr", "radial stress")


def fig_6() -> Figure:
    """CP at 0.5 and 1 MPa, four densities."""
    return _drained("cp", "mean stress")


def fig_7() -> Figure:
    """ISOC from 0.1 and 0.5 MPa, and ISOD from 0.5 and 1 MPa, two densities."""
    rows = {}
    for e in (0.724, 0.606):
        runs = [(f"ISOC, {label}", run) for label, run in [run_of("isoc", e, 0.1), run_of("isoc", e, 0.5)]]
        runs += [(f"ISOD, {label}", run) for label, run in [run_of("isod", e, p) for p in (0.5, 1.0)]]
        rows[f"isotropic, e0 = {e:g}"] = dict(runs)
    return curves(rows, ("e-p", "Z-strain"))


def fig_8() -> Figure:
    """Cyclic CP at 0.5 MPa, loose and dense, with the monotonic test for comparison."""
    rows = {}
    for e in (0.77, 0.60):
        label, cyclic = run_of("cyclic_cp", e, 0.5, reversals=REVERSALS)
        monotonic = run_of("cp", e, 0.5, strain=0.04)[1]
        rows[f"cyclic CP, p = 0.5 MPa, e0 = {e:g}"] = {f"cyclic: {label}": cyclic, "monotonic": monotonic}
    return curves(rows, ("q-strain", "e-strain"))


def fig_9() -> Figure:
    """CR at 0.5 MPa with a1 = 0.3, its axis at several angles from the axial direction, loose and dense."""
    rows = {}
    for density, e in (("loose", 0.77), ("dense", 0.606)):
        runs = {}
        for angle in (0, 30, 45, 60, 90):
            _label, run = run_of("cr", e, 0.5, a1=0.3, angle=angle, strain=0.2)
            runs[f"$\\theta$ {angle}°, $\\Lambda_0$ {run['mean_normalised_force'].values[0]:.5f}"] = run
        runs["isotropic"] = run_of("cr", e, 0.5, strain=0.2)[1]
        Z = runs["isotropic"]["coordination_number"].values[0]
        rows[f"CR, 0.5 MPa, a1 = 0.3, {density}: e0 = {e:g}, Z0 = {Z:.2f}, F0 from C0"] = runs
    return curves(rows, ("q-strain", "e-strain"))


def fig_10() -> Figure:
    """CR at 0.5 MPa from the same e and p with Z0 from 4.2 to 6."""
    rows = {
        f"CR, 0.5 MPa, {density}: e0 = {e:g}": dict(
            run_of("cr", e, 0.5, Z=float(Z), strain=0.4) for Z in np.linspace(4.2, 6.0, 4)
        )
        for density, e in (("loose", 0.77), ("dense", 0.67))
    }
    return curves(rows, ("q-strain", "e-strain"))


FIGURES = {
    f"model_{draw.__name__.replace('_', '')}": draw for draw in (fig_4, fig_5, fig_6, fig_7, fig_8, fig_9, fig_10)
}


def draw_all(folder: str | Path) -> Iterator[Path]:
    """Writes every figure into the folder and yields its file."""
    for name, figure in FIGURES.items():
        file = Path(folder) / f"{name}.png"
        save(figure(), file)
        yield file
