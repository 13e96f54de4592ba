"""Figure of the directional functions of contacts and forces in a run: data, and fits of second and fourth order."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pandas
import xarray
from matplotlib.figure import Figure

from labkit.errors import InputError
from labkit.micro.directions import (
    bin_means,
    directional_mean,
    hemisphere_bins,
    normal_density,
    polar_bins,
    tangential_mean,
)
from labkit.micro.normalised import vectors_of_contacts
from labkit.visuals.plots import WIDTH

POLAR_BINS = 12
BANDS, SECTORS = 8, 24


def percent(run: xarray.Dataset, snapshot: int) -> str:
    """The axial strain of a snapshot as text."""
    return f"{float(run['snapshot_strain'].values[snapshot]) * 100:.1f} %"


def directions(run: xarray.Dataset, number: int = 5, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """E_PDF(n), mean Lambda_n(n) and mean tangential Lambda_t(n): data, second- and fourth-order fits.

    Above over the angle to z, averaged about it (polar diagrams); below over the whole hemisphere of directions.
    """
    vectors = vectors_of_contacts(run.lab.snapshot(snapshot))
    if not len(vectors):
        raise InputError("has no contacts", field="snapshot", value=snapshot, allowed="another")
    n = vectors.normal
    up = np.where(n[:, 2:] < 0.0, -n, n)
    pull = -vectors.tangential * np.where(n[:, 2:] < 0.0, -1.0, 1.0)  # t of the contact seen from its other side
    mean = directional_mean(n, vectors.normal_component, normal_density(n)).mean
    along = _toward_z(up)
    values = {
        "$4\\pi E_{PDF}$": None,
        "$\\overline{\\Lambda_n}/\\Lambda$": vectors.normal_component / mean,
        "$\\overline{t_\\theta}$ = mean of $-\\Lambda_t\\cdot e_\\theta/\\Lambda$": np.einsum("mi,mi->m", pull, along)
        / mean,
    }
    fits = [_directional_fits(vectors, mean, order) for order in (2, 4)]
    figure = plt.figure(figsize=(WIDTH, 6.6), layout="constrained")
    rows = []
    for column, (title, data) in enumerate(values.items()):
        rose = figure.add_subplot(2, 3, column + 1, projection="polar")
        rows += _rose(rose, up, data, [fit[column] for fit in fits], title)
        _hemisphere(figure, figure.add_subplot(2, 3, column + 4), up, data, fits[1][column], title)
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8, frameon=False
    )
    figure.suptitle(f"at {percent(run, snapshot)} axial strain, {len(n)} contacts; z upwards", fontsize=10)
    return figure, pandas.DataFrame(rows)


def _directional_fits(vectors, mean, order):
    """Functions of n (m, 3) for the three columns of `directions`."""
    n = vectors.normal
    density = normal_density(n, order)
    normal = directional_mean(n, vectors.normal_component, density)
    tangential = tangential_mean(n, -vectors.tangential / mean, density)
    return (
        density.shape,
        lambda m: normal.at(m) / mean,
        lambda m: np.einsum("mi,mi->m", tangential.at(m), _toward_z(m)),
    )


def _toward_z(n):
    """Unit tangents at n (m, 3) that point to the axis z; zero on the axis."""
    along = np.array([0.0, 0.0, 1.0]) - n[:, 2:] * n
    size = np.linalg.norm(along, axis=1, keepdims=True)
    return np.divide(along, size, out=np.zeros_like(along), where=size > 1e-12)


def _rose(axes, n, data, fits, title):
    """Bins of equal solid angle about z and the fits, mirrored to the whole circle."""
    edges, bin_of = polar_bins(n, POLAR_BINS)
    if data is None:
        means = np.bincount(bin_of, minlength=POLAR_BINS) / len(n) * POLAR_BINS
    else:
        means = bin_means(data, bin_of, POLAR_BINS)
    angle = np.arccos(edges)  # from z; bin k lies between edges k and k + 1
    for quarter in range(4):
        sign, start = ((1, 0), (-1, np.pi), (1, np.pi), (-1, 0))[quarter]
        left = start + sign * 0.5 * (angle[1:] + angle[:-1])
        axes.bar(
            left,
            np.abs(means),
            width=angle[:-1] - angle[1:],
            color="0.85",
            edgecolor="0.6",
            lw=0.5,
            label="contacts" if quarter == 0 else None,
        )
    theta = np.linspace(0.0, 2 * np.pi, 361)
    averages = [_average_about_z(fit, theta) for fit in fits]
    for average, style, order in zip(averages, ("-", "--"), (2, 4), strict=True):
        axes.plot(theta, np.abs(average), style, color=("C0", "C3")[order == 4], lw=1.4, label=f"order {order}")
    axes.set_theta_zero_location("N")
    axes.set_title(title + (" (size)" if np.nanmin(means) < 0 else ""), fontsize=10)
    axes.tick_params(labelsize=7)
    middle = np.degrees(0.5 * (angle[1:] + angle[:-1]))
    at = [_average_about_z(fit, np.radians(middle)) for fit in fits]
    return [
        {"function": title, "angle_deg": middle[k], "data": means[k], "order_2": at[0][k], "order_4": at[1][k]}
        for k in range(POLAR_BINS)
    ]


def _average_about_z(function, theta):
    """Mean of a function of n over the circle at each angle `theta` from z."""
    azimuth = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
    theta, azimuth = np.meshgrid(theta, azimuth, indexing="ij")
    n = np.stack([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)], axis=-1)
    up = np.where(n[..., 2:] < 0.0, -n, n)
    return function(up.reshape(-1, 3)).reshape(theta.shape).mean(axis=1)


def _hemisphere(figure, axes, n, data, fit, title):
    """Equal-area map seen along z: bins in colour, lines of the fourth-order fit on them."""
    bin_of = hemisphere_bins(n, BANDS, SECTORS)
    total = BANDS * SECTORS
    means = np.bincount(bin_of, minlength=total) / len(n) * total if data is None else bin_means(data, bin_of, total)
    z = np.linspace(0.0, 1.0, BANDS + 1)
    azimuth = np.linspace(0.0, 2 * np.pi, 4 * SECTORS + 1)  # four to a sector, so that the rim looks round
    r, a = np.meshgrid(np.sqrt(1.0 - z), azimuth, indexing="ij")
    sectors = np.repeat(means.reshape(BANDS, SECTORS), 4, axis=1)
    mesh = axes.pcolormesh(r * np.cos(a), r * np.sin(a), sectors, cmap="viridis")
    fine_z, fine_a = np.meshgrid(np.linspace(0.0, 1.0, 40), np.linspace(0, 2 * np.pi, 97), indexing="ij")
    rim = np.sqrt(1.0 - fine_z**2)
    directions_ = np.stack([rim * np.cos(fine_a), rim * np.sin(fine_a), fine_z], axis=-1)
    fitted = fit(directions_.reshape(-1, 3)).reshape(fine_z.shape)
    radius = np.sqrt(1.0 - fine_z)
    lines = axes.contour(radius * np.cos(fine_a), radius * np.sin(fine_a), fitted, 6, colors="white", linewidths=0.8)
    axes.clabel(lines, fontsize=6)
    axes.set(aspect="equal", xticks=[], yticks=[], xlabel="x", ylabel="y")
    axes.set_frame_on(False)
    figure.colorbar(mesh, ax=axes, shrink=0.75).ax.tick_params(labelsize=7)
