"""Strains so large that the cell becomes another one."""

from __future__ import annotations

import numpy as np

from analysis.hard_cases.checks import agree, below, pressure_words, ratio_words
from analysis.hard_cases.laboratory import Judged, Laboratory


def strain_100(lab: Laboratory) -> Judged:
    """See the scene of this name."""
    state = lab.specimen(500)
    run, reference = lab.run(state), lab.half_step(state)
    strain, wanted = float(run["axial_strain"][-1]), lab.scene.strain * lab.extent
    cell = np.diagonal(run["cell"].values[-1] @ np.linalg.inv(run["cell"].values[0]))
    widths = ", ".join(f"{x:.3f}" for x in cell)
    return f"cell {widths} of its first; {pressure_words(run)}; {ratio_words(run)}", [
        below("axial strain", abs(strain - wanted), 1e-4),
        below("height of the cell against exp(-strain)", abs(cell[2] / np.exp(-strain) - 1.0), 1e-9),
        below("equal widths", abs(cell[0] - cell[1]), 1e-9),
        *agree(run, reference, p=0.25, ratio=0.06, Z=0.15),
    ]


def thin_cell(lab: Laboratory) -> Judged:
    """See the scene of this name."""
    run = lab.run(lab.specimen(120))
    width = np.diagonal(run["cell"].values[-1]).min() / (2.0 * run["radius"].values.max())
    return f"cell {width:.2f} of the largest grain high at the end; {pressure_words(run)}", [
        below("height of the cell over the largest diameter", width, 2.2 if lab.extent == 1.0 else np.inf),
    ]
