"""Pictures of a specimen at one or more snapshots: the grains on the left, the contacts as sticks on the right.

Both are coloured by the normalised force divided by its mean; the width of a stick is proportional to this ratio.
If contacts are in tension, the mean is taken over the magnitudes, and tension has separate colours.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from labkit.figures.frame import new_figure, plain
from labkit.micro.cells import cell_corners
from labkit.micro.snapshot import Snapshot
from labkit.plugins.pictures.frames import EDGES, STICK, VIEW, caption, contact_ratio, grain_ratio
from labkit.plugins.pictures.render import canvas, draw_spheres, draw_sticks, haze, shade

COLORS, TENSION, TOP = "YlOrRd", "Purples", 3.0  # colour maps, and their upper end: ratio to the mean
RATTLER = (0.62, 0.72, 0.80)
WIDEST = 4.0  # ratio of force to mean force above which sticks grow no wider
PANEL, PIXELS = 5.2, 780  # width of a panel, inches, and of its image, pixels


def draw_grains(snapshots: Iterable[Snapshot], name: str = "") -> Figure:
    """Draw the grains and contacts of Snapshots, one row for each Snapshot, all at the same scale.

    The `name` of the run or specimen is written above the first row.
    """
    snapshots = list(snapshots)
    low, high = _frame(snapshots)
    tall = PANEL * (high[1] - low[1]) / (high[0] - low[0])
    head, foot, top = 0.32, 0.95, 0.3 if name else 0.0
    height = len(snapshots) * (tall + head) + foot + top
    figure = new_figure(2 * PANEL, height, layout=None)
    if name:
        figure.suptitle(plain(name), fontsize=11, y=1.0 - 0.1 / height)
    for row, snapshot in enumerate(snapshots):
        bottom = height - top - (row + 1) * (tall + head)
        for column, image in enumerate(images(snapshot, low, high)):
            axes = figure.add_axes((0.5 * column, bottom / height, 0.5, tall / height))
            axes.imshow(image, origin="lower")
            axes.axis("off")
        figure.text(0.5, (bottom + tall + 0.08) / height, caption(snapshot), ha="center", fontsize=10)
    _scale_bar(figure, (high[0] - low[0]) / PANEL, height)
    _color_bar(figure, height, any((snapshot.contacts.normal_force < 0.0).any() for snapshot in snapshots))
    _directions(figure, height)
    return figure


def images(snapshot: Snapshot, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Render two images, of the grains and of the contacts, (rows, width, 4) each: red, green, blue and opacity.

    `low` and `high` (2,) are the corners of the drawn part of the view, m from the centre of the cell.
    """
    of_contacts, colors, snapshot = contact_ratio(snapshot), grain_colors(snapshot), snapshot.spheres
    centre = VIEW[:2] @ snapshot.cell.sum(axis=1) / 2
    low, high = low + centre, high + centre
    mean = 2.0 * snapshot.radius.mean()
    corners = cell_corners(snapshot.cell)
    edges = np.array([corners[list(edge)] for edge in EDGES])
    ends = snapshot.contact_ends()
    grains = canvas(VIEW, low, high, PIXELS)
    draw_spheres(grains, snapshot.wrapped_position, snapshot.radius, colors)
    network = canvas(VIEW, low, high, PIXELS)
    radius = STICK * mean * np.minimum(np.abs(of_contacts), WIDEST)
    draw_sticks(network, ends[:, 0], ends[:, 1], radius, ratio_colors(of_contacts))
    white = haze(network, snapshot.cell, 2.5 * mean)
    draw_sticks(network, edges[:, 0], edges[:, 1], np.full(12, 8e-4 * (high[0] - low[0])), np.full((12, 3), 0.35))
    return shade(grains, 0.4 * mean), shade(network, 0.4 * mean, white)


def grain_colors(snapshot: Snapshot) -> np.ndarray:
    """Return colours (sphere, 3) for the ratios of the grains; all spheres of a clump have the same colour."""
    ratio = grain_ratio(snapshot)
    return np.where(np.isnan(ratio)[:, None], RATTLER, ratio_colors(ratio))


def ratio_colors(ratio: np.ndarray) -> np.ndarray:
    """Return colours (n, 3) for forces divided by their mean (n,)."""
    maps, share = matplotlib.colormaps, np.clip(np.abs(ratio) / TOP, 0.0, 1.0)
    return np.where((ratio < 0.0)[:, None], maps[TENSION](0.7 + 0.3 * share), maps[COLORS](share))[:, :3]


def _frame(snapshots: Sequence[Snapshot]) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower left and upper right corners of a view of all cells, with the grains at the faces.

    The corners are in m from the centre of the cell.
    """
    corners = [cell_corners(snapshot.cell) for snapshot in snapshots]
    seen = np.concatenate([(x - x.mean(axis=0)) @ VIEW[:2].T for x in corners])
    margin = 1.2 * max(snapshot.radius.max() for snapshot in snapshots)
    return seen.min(axis=0) - margin, seen.max(axis=0) + margin


def _color_bar(figure: Figure, height: float, tension: bool) -> None:
    axes = figure.add_axes((0.32, 0.52 / height, 0.36, 0.14 / height))
    colors = ScalarMappable(Normalize(0.0, TOP), COLORS)
    figure.colorbar(colors, cax=axes, orientation="horizontal", extend="max").ax.tick_params(labelsize=9)
    label = "normalised force $\\Lambda_n$ over its mean (grains: mean over their contacts; blue: no contacts"
    axes.set_xlabel(label + "; purple: tension" * tension + ")", fontsize=9, labelpad=2)


def _scale_bar(figure: Figure, metres_per_inch: float, height: float) -> None:
    """Draw a scale bar of 1, 2 or 5 times a power of ten, at most 1.5 inches long."""
    longest = 1.5 * metres_per_inch
    power = 10.0 ** np.floor(np.log10(longest))
    length = power * max(n for n in (1, 2, 5) if n * power <= longest)
    across = length / metres_per_inch / (2 * PANEL)
    axes = figure.add_axes((0.06, 0.49 / height, across, 0.2 / height))
    axes.plot([0, 1], [0.5, 0.5], color="0.2", lw=2.5, solid_capstyle="butt")
    axes.set(xlim=(0, 1), ylim=(0, 1))
    axes.axis("off")
    figure.text(0.06 + across / 2, 0.46 / height, f"{1e3 * length:g} mm", ha="center", va="top", fontsize=9)


def _directions(figure: Figure, height: float) -> None:
    """Draw the x, y and z directions as arrows at the lower right."""
    size = 0.8  # inches
    place = 0.94 - size / (2 * PANEL), 0.02, size / (2 * PANEL), size / height
    axes = figure.add_axes(place, xlim=(-1.0, 1.4), ylim=(-0.8, 1.6))
    axes.axis("off")
    for name, arrow in zip("xyz", VIEW[:2].T, strict=True):
        axes.annotate("", arrow, (0.0, 0.0), arrowprops={"arrowstyle": "-|>", "lw": 1.2, "color": "0.2"})
        x, y = 1.3 * arrow
        axes.text(x, y, name, ha="center", va="center", fontsize=9, color="0.2")
