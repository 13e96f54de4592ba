"""Figure of the tractions on plane cuts through a specimen, beside Love's stress."""

from __future__ import annotations

import numpy as np
import pandas
import xarray
from matplotlib.figure import Figure

from labkit.errors import InputError
from labkit.figures.frame import WIDTH, add_heading, colors_for, new_figure, where
from labkit.micro.planes import plane_normal, plane_tractions
from labkit.micro.stress import love_stress, mean_stress
from labkit.runs.figures import register_figure

PLANES = 400  # per cell vector: several in each branch


@register_figure("planes")
def planes(run: xarray.Dataset, number: int = 5, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """Difference of the tractions on planes parallel to the faces of the cell from Love's stress (section 2).

    At rest the traction is the same on all parallel planes, because each layer between two of them is in equilibrium:
    what is left is the unbalanced force.
    """
    grains = run.lab.snapshot(snapshot)
    love = love_stress(grains)
    p = float(mean_stress(love))
    if p == 0.0:
        raise InputError("carries no stress", field="snapshot", value=snapshot, allowed="another")
    position = (np.arange(PLANES) + 0.5) / PLANES
    figure = new_figure(WIDTH, 3.6)
    rows = []
    for axis, panel in enumerate(figure.panels(1, 3, sharey=True)):
        n = plane_normal(grains, axis)
        traction, mean = plane_tractions(grains, axis, PLANES), n @ love
        for color, k in zip(colors_for(3), range(3), strict=True):
            panel.plot(position, (traction[:, k] - mean[k]) / p, color=color, lw=0.9, label=f"$t_{'xyz'[k]}$")
            rows.append(
                {
                    "axis": "xyz"[axis],
                    "component": "xyz"[k],
                    "mean_Pa": traction[:, k].mean(),
                    "love_Pa": mean[k],
                    "scatter_over_p": traction[:, k].std() / p,
                }
            )
        panel.set_title(f"planes cut cell vector {'xyz'[axis]}", fontsize=10)
        panel.set_xlabel("position along the cell vector")
    figure.axes[0].set_ylabel("traction - $n\\cdot\\sigma$, divided by p")
    figure.key(3)
    add_heading(figure, run, where(run, snapshot))
    return figure, pandas.DataFrame(rows)
