"""Cyclic resistance: CSR against the number of cycles to liquefaction, one point for each undrained cyclic test."""

from __future__ import annotations

import numpy as np
import pandas
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from labkit.errors import InputError
from labkit.figures import frame
from labkit.figures.frame import Runs, colors_for, gray_lines, panel_in, plain, plain_ticks
from labkit.micro.stress import mean_stress
from labkit.paths.cycles import ShearCycles, UndrainedCycles
from labkit.results.figures import register_figure
from labkit.results.undrained import RATIO

CRITERIA = {"cycles_to_ratio": (f"$r_u$ > {RATIO:g}", "o"), "cycles_to_double_amplitude": ("double amplitude 5 %", "s")}
LAST = "no liquefaction up to here"


@register_figure("liquefaction", needs="records", several=True)
def cyclic_resistance(run: xarray.Dataset | Runs, ax: Axes | None = None) -> tuple[Figure, pandas.DataFrame]:
    """Draw CSR against the number of cycles to r_u > 0.95 and to a double amplitude of 5 %, a point for each test.

    CSR is the prescribed amplitude of q over 2 p_0 or, in simple shear, that of sigma_xz over sigma_zz,0; r_u is that
    of p or of sigma_zz. An arrow marks the last cycle of a test that met neither criterion. `ax` is the Axes to draw
    in, by default those of a new figure. Raises InputError for any other test, and for one that goes on from undrained
    loading, whose earlier cycles are in another run.
    """
    runs = frame.name_runs(run)
    table = pandas.DataFrame([{"run": name, **resistance(one)} for name, one in runs.items()])
    figure, axes = panel_in(ax, 4.4, 6.4)
    for color, (_, row) in zip(colors_for(len(runs)), table.iterrows(), strict=True):
        label: str | None = plain(str(row["run"]))
        for name, (_, marker) in CRITERIA.items():
            if np.isfinite(row[name]):
                axes.plot(row[name], row["CSR"], marker, color=color, label=label)
                label = None
        if label is not None:
            axes.plot(row["cycles"], row["CSR"], ">", color=color, mfc="white", label=label)
    axes.set(xlabel="number of cycles N", ylabel="cyclic stress ratio CSR", xscale="log")
    axes.set_xlim(0.7 * axes.dataLim.x0, 1.4 * axes.dataLim.x1)
    plain_ticks(axes.xaxis)
    frame.include_zero(axes, "y")
    markers = gray_lines(dict.fromkeys((label for label, _ in CRITERIA.values()), "")) + gray_lines({LAST: ""})
    for line, marker in zip(markers, (*(each for _, each in CRITERIA.values()), ">"), strict=True):
        line.set(marker=marker, linestyle="")
    markers[-1].set_markerfacecolor("white")
    key = {"handles": [*axes.get_legend_handles_labels()[0], *markers], "frameon": False, "fontsize": "small"}
    axes.legend(**key) if ax else figure.legend(loc="outside lower center", ncols=3, **key)
    return figure, table


def resistance(run: xarray.Dataset) -> dict[str, float]:
    """Return CSR, p_0 (Pa) and the numbers of cycles of an undrained cyclic test by name, NaN for a criterion not met.

    Raises InputError as `cyclic_resistance` does.
    """
    path, start = run.lab.path, run["stress"].values[0]
    shear = isinstance(path, ShearCycles) and not path.drained and path.amplitude is not None
    if not shear and not (isinstance(path, UndrainedCycles) and path.ratio is None):
        allowed = "undrained_cycles, or shear_cycles with drained = false, with an amplitude of stress"
        raise InputError("has no CSR", field="run", value=run.attrs["path"], allowed=allowed)
    before = run.lab.undrained_stress
    if before is not None and not np.allclose(before, start, rtol=1e-3, atol=1e-3 * float(mean_stress(start))):
        problem = "goes on from undrained loading: its earlier cycles are in another run"
        raise InputError(problem, field="run", value=run.attrs["path"], allowed="a test from its first cycle")
    p_0 = float(mean_stress(start))
    liquefaction = run.lab.liquefaction("axial" if shear else None)
    csr = path.amplitude / (start[2, 2] if shear else 2.0 * p_0)
    return {
        "CSR": float(csr),
        "p_0_Pa": p_0,
        "cycles": liquefaction.cycles,
        **{name: getattr(liquefaction, name) for name in CRITERIA},
    }
