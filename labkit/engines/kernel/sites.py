"""Sites: the per-grain rows from which contacts read the motion of the grains."""

from __future__ import annotations

import numpy as np

from labkit.engines.kernel.compiling import kept
from labkit.engines.kernel.layout import WIDTH
from labkit.engines.kernel.steps import write_sites


@kept
def write_all_sites(sites: np.ndarray, grains: np.ndarray) -> None:
    """Write the sites of all blocks of grains."""
    for number in range(len(grains)):
        write_sites(sites, grains[number], number * WIDTH, WIDTH)
