"""Figure of the directional functions of contacts and forces in a run: data, and fits of second and fourth order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from labkit.figures.frame import WIDTH, Style, add_heading, new_figure, snapshot_to_draw, where
from labkit.micro.bodies import long_axes
from labkit.micro.contact_sides import vectors_of_contacts
from labkit.micro.directions import bin_means, hemisphere_bins, polar_bins
from labkit.micro.fabric import directional_mean, normal_density, tangential_mean
from labkit.results.figures import register_figure

POLAR_BINS = 12
BANDS, SECTORS = 8, 24
FINE_GRID = 101  # grid points along the radius of the map, for the contour lines of the fit
FUNCTIONS = {  # name in the table: title of the panel
    "4 pi E_PDF": "contact normals\n$4\\pi E_{PDF}$",
    "mean Lambda_n / Lambda": "normal force\n$\\overline{\\Lambda_n}/\\Lambda$",
    "mean -Lambda_t.e_theta / Lambda": "tangential force towards z\n$-\\overline{\\Lambda_t\\cdot e_\\theta}/\\Lambda$",
}

Function = Callable[[np.ndarray], np.ndarray]  # a function of directions (m, 3)


@register_figure("directions")
def directions(run: xarray.Dataset, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """Draw E_PDF(n), mean Lambda_n(n) and mean tangential Lambda_t(n): data, second- and fourth-order fits.

    The top row shows polar diagrams: the functions against the angle to the z axis, averaged about that axis. The
    bottom row shows the functions over the hemisphere of directions. For clumps, the density of the long axes is drawn
    over the density of the contact normals.
    """
    at = snapshot_to_draw(run, snapshot)
    vectors = vectors_of_contacts(at)
    n = vectors.normal
    up = np.where(n[:, 2:] < 0.0, -n, n)
    pull = -vectors.tangential * np.where(n[:, 2:] < 0.0, -1.0, 1.0)  # reversed with the normal
    mean = directional_mean(n, vectors.normal_component, normal_density(n)).mean
    tangential = np.einsum("mi,mi->m", pull, _toward_z(up)) / mean
    values = dict(zip(FUNCTIONS, (None, vectors.normal_component / mean, tangential), strict=True))
    fits = [_directional_fits(vectors, mean, order) for order in (2, 4)]
    figure = new_figure(WIDTH, 7.2)
    rows = []
    for column, (name, data) in enumerate(values.items()):
        polar = figure.add_subplot(2, 3, column + 1, projection="polar")
        if column == 0 and (axes := long_axes(at)) is not None:
            rows += _density_of_axes(polar, axes)
        rows += _polar_diagram(polar, up, data, [fit[column] for fit in fits], name)
        _hemisphere(figure, figure.add_subplot(2, 3, column + 4, projection="polar"), up, data, fits[1][column], name)
    figure.key(4)
    detail = (
        f"at {where(run, snapshot)}, {len(n)} contacts; top: by angle to the z axis;\n"
        "bottom: hemisphere seen along z, means over bins (colours) and fourth-order fit (lines)"
    )
    add_heading(figure, run, detail)
    return figure, pandas.DataFrame(rows)


def _directional_fits(vectors: Any, mean: float, order: int) -> tuple[Function, Function, Function]:
    """Return the fits of this order in the three columns of `directions`, as functions of n (m, 3)."""
    n = vectors.normal
    density = normal_density(n, order)
    normal = directional_mean(n, vectors.normal_component, density)
    tangential = tangential_mean(n, -vectors.tangential / mean, density)
    return (
        density.shape,
        lambda m: normal.at(m) / mean,
        lambda m: np.einsum("mi,mi->m", tangential.at(m), _toward_z(m)),
    )


def _toward_z(n: np.ndarray) -> np.ndarray:
    """Return unit tangents at n (m, 3) that point towards the z axis; zero on the axis."""
    along = np.array([0.0, 0.0, 1.0]) - n[:, 2:] * n
    size = np.linalg.norm(along, axis=1, keepdims=True)
    return np.divide(along, size, out=np.zeros_like(along), where=size > 1e-12)


def _polar_diagram(
    axes: Any, n: np.ndarray, data: np.ndarray | None, fits: Sequence[Function], name: str
) -> list[dict[str, object]]:
    """Draw data in bins of equal solid angle about z, and the fits, mirrored to the full circle; returns table rows."""
    edges, bin_of = polar_bins(n, POLAR_BINS)
    means = _means(data, bin_of, POLAR_BINS)
    angle = np.arccos(edges)  # to the z axis; bin k lies between edges k and k + 1
    middle = 0.5 * (angle[1:] + angle[:-1])
    bars: dict[str, Style] = {"width": angle[:-1] - angle[1:], "color": "0.85", "edgecolor": "0.6", "lw": 0.5}
    for at in _mirror(middle):
        axes.bar(
            at, np.nan_to_num(np.abs(means)), label="contacts" if at is middle else None, **bars
        )  # NaN in a bin without contacts
    theta = np.linspace(0.0, 2 * np.pi, 361)
    averages = [_average_about_z(fit, theta) for fit in fits]
    for average, style, color, order in zip(averages, ("-", "--"), ("C0", "C3"), ("second", "fourth"), strict=True):
        axes.plot(theta, np.abs(average), style, color=color, lw=1.4, label=f"{order}-order fit")
    axes.set_theta_zero_location("N")
    around = np.arange(0, 360, 45)
    axes.set_thetagrids(around, [f"{min(a, 360 - a)}°" for a in around])
    axes.set_rticks(MaxNLocator(4).tick_values(0.0, axes.get_rmax())[1:-1])
    axes.set_rlabel_position(67.5)
    axes.set_title(FUNCTIONS[name] + (" (magnitude)" if np.nanmin(means) < 0 else ""), fontsize="medium")
    axes.tick_params(labelsize=7)
    columns = np.degrees(middle), means, *(_average_about_z(fit, middle) for fit in fits)
    names = ("angle_deg", "data", "order_2", "order_4")
    return [{"function": name, **dict(zip(names, row, strict=True))} for row in zip(*columns, strict=True)]


def _mirror(angle: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the angles to z in each of the four quarters of the circle, the given angles first."""
    return angle, np.pi - angle, np.pi + angle, -angle


def _density_of_axes(axes: Axes, direction: np.ndarray) -> list[dict[str, object]]:
    """Draw the density of the long axes of clumps (m, 3) against the angle to z; returns table rows."""
    edges, bin_of = polar_bins(direction, POLAR_BINS)
    density = _means(None, bin_of, POLAR_BINS)
    middle = 0.5 * (np.arccos(edges[1:]) + np.arccos(edges[:-1]))
    for theta in _mirror(middle):
        axes.plot(theta, density, ".", color="C2", label="long axes" if theta is middle else None)
    return [
        {"function": "4 pi PDF of long axes", "angle_deg": angle, "data": value}
        for angle, value in zip(np.degrees(middle), density, strict=True)
    ]


def _means(data: np.ndarray | None, bin_of: np.ndarray, bins: int) -> np.ndarray:
    """Return the mean of the data in each bin; without data, the density of directions over the uniform density."""
    if data is None:
        return np.bincount(bin_of, minlength=bins) / len(bin_of) * bins
    return bin_means(data, bin_of, bins)


def _average_about_z(function: Function, theta: np.ndarray) -> np.ndarray:
    """Return the mean of a function of n over the circle of directions at each angle `theta` to z."""
    azimuth = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
    theta, azimuth = np.meshgrid(theta, azimuth, indexing="ij")
    n = np.stack([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)], axis=-1)
    up = np.where(n[..., 2:] < 0.0, -n, n)
    return function(up.reshape(-1, 3)).reshape(theta.shape).mean(axis=1)


def _hemisphere(figure: Figure, axes: Axes, n: np.ndarray, data: np.ndarray | None, fit: Function, name: str) -> None:
    """Draw an equal-area map seen along z: bins as colours, the fourth-order fit as contour lines."""
    bin_of = hemisphere_bins(n, BANDS, SECTORS)
    means = _means(data, bin_of, BANDS * SECTORS)
    azimuth = np.linspace(0.0, 2 * np.pi, 4 * SECTORS + 1)  # four points per sector give a smooth rim
    sectors = np.repeat(means.reshape(BANDS, SECTORS), 4, axis=1)
    mesh = axes.pcolormesh(azimuth, np.sqrt(1.0 - np.linspace(0.0, 1.0, BANDS + 1)), sectors, cmap="viridis")
    r, a = np.meshgrid(np.linspace(0.0, 1.0, FINE_GRID), azimuth, indexing="ij")
    across = r * np.sqrt(2.0 - r**2)  # sqrt(1 - z^2) with 1 - z = r^2, because the map preserves area
    unit = np.stack([across * np.cos(a), across * np.sin(a), 1.0 - r**2], axis=-1)
    lines = axes.contour(a, r, fit(unit.reshape(-1, 3)).reshape(a.shape), 6, colors="white", linewidths=0.8)
    for label in axes.clabel(lines, fontsize="x-small"):
        label.set_path_effects([withStroke(linewidth=1.5, foreground="0.2")])
    axes.set(xticks=[0.0, 0.5 * np.pi], xticklabels=["x", "y"], yticks=[])
    axes.grid(False)
    bar = figure.colorbar(mesh, ax=axes, shrink=0.75)
    bar.ax.tick_params(labelsize=7)
    bar.set_label(FUNCTIONS[name].split("\n")[1], fontsize="small")
