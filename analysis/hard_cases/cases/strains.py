"""Strains so large that the shape of the cell changes completely."""

from __future__ import annotations

import numpy as np

from analysis.hard_cases.checks import agree, below, pressure_text, ratio_text
from analysis.hard_cases.laboratory import Judged, Laboratory


def strain_100(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    state = lab.specimen(500)
    run, reference = lab.run(state), lab.half_step(state)
    strain, wanted = float(run["axial_strain"][-1]), lab.scene.strain * lab.extent
    cell = np.diagonal(run["cell"].values[-1] @ np.linalg.inv(run["cell"].values[0]))
    widths = ", ".join(f"{x:.3f}" for x in cell)
    return f"cell {widths} times its initial size; {pressure_text(run)}; {ratio_text(run)}", [
        below("error of the axial strain", abs(strain - wanted), 1e-4),
        below("relative error of the cell height, exp(-strain) expected", abs(cell[2] / np.exp(-strain) - 1.0), 1e-9),
        below("difference of the cell widths", abs(cell[0] - cell[1]), 1e-9),
        *agree(run, reference, p=0.25, ratio=0.06, Z=0.15),
    ]


def thin_cell(lab: Laboratory) -> Judged:
    """Runs the scene of the same name."""
    run = lab.run(lab.specimen(120))
    width = np.diagonal(run["cell"].values[-1]).min() / (2.0 * run["radius"].values.max())
    return f"cell height at the end {width:.2f} times the largest grain; {pressure_text(run)}", [
        below("height of the cell over the largest diameter", width, 2.2 if lab.extent == 1.0 else np.inf)
    ]
