"""Figures of grains and contacts of a run, each with its table. Strain is in % (labkit.figures.plots).

Every function takes a run opened with labkit.open_run and returns (Figure, pandas.DataFrame). Some also take the number
of size groups, or the number of a snapshot, which counts from the end if it is negative.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from labkit.figures.frame import (
    WIDTH,
    add_heading,
    colors_for,
    new_panels,
    ordered_colors,
    snapshot_to_draw,
    strain_axis,
    where,
)
from labkit.micro.contact_sides import normalised_normal_force
from labkit.micro.planes import plane_normal, plane_tractions
from labkit.micro.size_groups import diameter_edges, groups_by_diameter
from labkit.micro.snapshot import love_stress
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.results.figures import register_figure

DENSITY_BINS, DENSITY_TOP = 30, 6.0  # in multiples of the mean force
SHORTEST = 0.1  # fraction of the median interval between snapshots: shorter intervals have no meaningful rate
SMALLEST_Q = 0.1  # fraction of the largest q: ratios to a smaller q have no meaning


@register_figure("groups")
def groups(run: xarray.Dataset, groups: int = 5) -> tuple[Figure, pandas.DataFrame]:
    """Draw sigma^N(k), sigma^V(k) (Fig. 2) and sigma^V(k) Z(k)/Z by grain size, divided by Love's stress."""
    axis = strain_axis(run, at_snapshots=True)
    figure, table = draw_group_stresses(
        run.lab.size_groups(groups), run.lab.love_stress(), axis=axis, part_of_q=run.lab.part_of_q
    )
    add_heading(figure, run)
    return figure, table


def draw_group_stresses(
    stresses: xarray.Dataset,
    love: xarray.DataArray,
    width: float = WIDTH,
    axis: tuple[str, np.ndarray] | None = None,
    part_of_q: Callable[[np.ndarray, np.ndarray], np.ndarray] = lambda stress, love: deviatoric_stress(stress),
) -> tuple[Figure, pandas.DataFrame]:
    """Draw the figure `groups` from results of run.lab that are already computed.

    Args:
        stresses: Result of run.lab.size_groups(number).
        love: Result of run.lab.love_stress().
        width: Width of the figure, inches.
        axis: Label and values of the strain axis (default: axial strain, %).
        part_of_q: Function that returns the contribution to q of a stress (run.lab.part_of_q if the test is not
            triaxial).
    """
    axial, number = stresses["axial_strain"].values, stresses.sizes["group"]
    strain_label, strain = axis or ("axial strain (%)", 100 * axial)
    per_volume, ratio_of_Z = stresses["per_volume"].values, stresses["coordination_ratio"].values
    panels = {
        "per contact, $\\sigma^N(k)/\\sigma$": stresses["per_contact"].values,
        "per volume, $\\sigma^V(k)/\\sigma$": per_volume,
        "grains, $\\sigma^V(k)\\,Z(k)/(Z\\sigma)$": per_volume * ratio_of_Z[..., None, None],
    }
    scalars = {"p": mean_stress, "zz": lambda s: s[..., 2, 2], "q": lambda s: part_of_q(s, love.values)}
    figure, axes = new_panels(1, 3, 0.42 * width, width, sharey=True)
    tables = []
    colors = ordered_colors(number)
    for panel, (title, values) in zip(axes, panels.items(), strict=True):
        for k, color in enumerate(colors):
            ratio = {name: of(values[:, k]) / of(love.values) for name, of in scalars.items()}
            label = f"{stresses['diameter'].values[k] * 1e3:.3f}"
            panel.plot(strain, ratio["p"], color=color, label=label)
            panel.plot(strain[1:], ratio["q"][1:], "--", color=color)  # q is zero at the isotropic start
            group = {"group": k, "diameter_mm": stresses["diameter"].values[k] * 1e3, "axial_strain": axial}
            group["strain"] = stresses["strain"].values
            tables.append(pandas.DataFrame({"stress": title.split(",")[0], **group, **ratio}))
        panel.set(xlabel=strain_label, title=title)
        panel.axhline(1.0, color="0.5", lw=0.8)
    axes[0].set_ylabel("stress over Love's stress: p solid, q dashed")
    figure.key(number, title="mid-size D of the group (mm)")
    return figure, pandas.concat(tables, ignore_index=True)


@register_figure("densities")
def densities(run: xarray.Dataset, groups: int = 5, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """Draw probability densities of f_n and Lambda_n by grain size, divided by their means over all contact sides.

    If some contacts are in tension, the means are taken over the magnitudes.
    """
    at = snapshot_to_draw(run, snapshot)
    edges = diameter_edges(at, groups)
    side_group = groups_by_diameter(at, edges)[at.contacts.grain]
    force = np.stack([at.contacts.normal_force] * 2, axis=1)
    values = {
        "normal force, $f_n/\\langle f_n\\rangle$": force,
        "normalised force, $\\Lambda_n/\\langle\\Lambda_n\\rangle$": normalised_normal_force(at),
    }
    figure, axes = new_panels(1, 2, 4.5, sharey=True)
    colors = ordered_colors(groups)
    pull = (force < 0.0).any()  # tension is drawn to the left of zero
    bins = np.linspace(-DENSITY_TOP * pull, DENSITY_TOP, (1 + pull) * DENSITY_BINS + 1)
    middle = 0.5 * (bins[1:] + bins[:-1])
    tables = []
    for panel, (title, sides) in zip(axes, values.items(), strict=True):
        sides = sides / np.abs(sides).mean()
        for k, color in enumerate(colors):
            chosen = sides[side_group == k]
            if not len(chosen):
                continue
            density = np.histogram(chosen, bins)[0] / len(chosen) / np.diff(bins)
            size = 0.5e3 * (edges[k] + edges[k + 1])
            seen = np.where(density > 0, density, np.nan)
            panel.semilogy(middle, seen, "o-", ms=2.5, color=color, label=f"{size:.3f}")
            panel.axvline(chosen.mean(), color=color, lw=0.8, ls=":")
            group = {"of": title.split(",")[0], "group": k, "diameter_mm": size, "group_mean": chosen.mean()}
            tables.append(pandas.DataFrame({**group, "value": middle, "density": density}))
        panel.set(xlabel=title)
    axes[0].set_ylabel("probability density")
    add_heading(figure, run, f"at {where(run, snapshot)}; dotted: mean of the group")
    figure.key(groups, title="mid-size D of the group (mm)")
    return figure, pandas.concat(tables, ignore_index=True)


@register_figure("contacts")
def contacts(run: xarray.Dataset) -> tuple[Figure, pandas.DataFrame]:
    """Draw contacts gained and lost between snapshots, their lifetimes, and the share of q of strong contacts."""
    changes, lives, strong = run.lab.contact_changes(), run.lab.contact_lives(), run.lab.strong_networks()
    figure, panels = new_panels(1, 3, 4.8)
    left, middle, right = panels
    strain = run.lab.strain_measure.name
    _draw_rates(left, changes, strain)
    _draw_lifetimes(middle, lives, strain)
    q = np.abs(run.lab.q().values[run.lab.snapshot_records()])
    _draw_strong(right, 100 * changes["accumulated_strain"].values, strong, q, strain)
    for panel in panels:
        panel.legend(loc="upper center", bbox_to_anchor=(0.5, -0.15), frameon=False, fontsize="small")
    add_heading(figure, run)
    table = changes.to_dataframe().reset_index()
    for k, name in enumerate(("force", "normalised")):
        for column in ("fraction", "share_of_q", "share_of_p"):
            table[f"strong_by_{name}_{column}"] = strong[column].values[:, k]
    return figure, table


def _draw_rates(axes: Axes, changes: xarray.Dataset, strain: str) -> None:
    """Draw contacts gained and lost per 1 % strain, in % of the contacts at the previous snapshot."""
    accumulated = changes["accumulated_strain"].values * 100
    step = np.diff(accumulated)
    long = step > SHORTEST * np.median(step) if len(step) else step > 0.0
    for color, line, name in zip(colors_for(2), ("o-", "s--"), ("gained", "lost"), strict=True):
        before = changes["contacts"].values[:-1]
        rate = np.divide(changes[name].values[1:], before * step / 100, where=long, out=step * np.nan)
        axes.plot(accumulated[1:], rate, line, ms=3, color=color, label=name)
    label = "contacts gained or lost\nper 1 % strain (% of all contacts)"
    axes.set(xlabel=f"accumulated {strain} (%)", ylabel=label, ylim=(0, None))


def _draw_lifetimes(axes: Axes, lives: xarray.Dataset, strain: str) -> None:
    """Draw the survival function of the contacts present at the start and of those formed later."""
    later = lives["birth"].values > 0
    for chosen, label, color in ((~later, "present at the start", "C0"), (later, "formed during the test", "C1")):
        if chosen.any():
            life, alive = lives["lifetime"].values[chosen], lives["alive"].values[chosen]
            survival = stats.ecdf(stats.CensoredData(uncensored=life[~alive], right=life[alive])).sf
            axes.step(survival.quantiles * 100, survival.probabilities, where="post", color=color, label=label)
    axes.set(xlabel=f"lifetime, accumulated {strain} (%)", ylabel="fraction that survives", ylim=(0, 1))


def _draw_strong(axes: Axes, accumulated: np.ndarray, strong: xarray.Dataset, q: np.ndarray, strain: str) -> None:
    """Draw the fraction of contact sides that are strong and the fraction of q that they carry, by two definitions."""
    enough = q > SMALLEST_Q * q.max(initial=0.0)
    for k, definition in enumerate(strong["definition"].values):
        chosen = strong.isel(definition=k)
        label = f"strong ({definition}): fraction of contact sides"
        axes.plot(accumulated, chosen["fraction"], "--", color=f"C{k}", label=label)
        share = np.where(enough, chosen["share_of_q"], np.nan)
        axes.plot(accumulated, share, "-", color=f"C{k}", label=f"strong ({definition}): share of q")
    axes.set(xlabel=f"accumulated {strain} (%)", ylabel="fraction", ylim=(0, None))


PLANES = 400  # planes per cell vector, so that each branch vector crosses several of them


@register_figure("planes")
def planes(run: xarray.Dataset, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """Draw the differences of tractions on planes parallel to the faces of the cell from Love's stress (section 2).

    At rest the traction is the same on all parallel planes, because each layer between two of them is in equilibrium;
    a difference comes from the unbalanced force.
    """
    grains = snapshot_to_draw(run, snapshot)
    love = love_stress(grains)
    p = float(mean_stress(love))
    position = (np.arange(PLANES) + 0.5) / PLANES
    figure, panels = new_panels(1, 3, 3.6, sharey=True)
    rows = []
    for axis, panel in enumerate(panels):
        n = plane_normal(grains, axis)
        traction, mean = plane_tractions(grains, axis, PLANES), n @ love
        for color, k in zip(colors_for(3), range(3), strict=True):
            panel.plot(position, (traction[:, k] - mean[k]) / p, color=color, lw=0.9, label=f"$t_{'xyz'[k]}$")
            place = {"axis": "xyz"[axis], "component": "xyz"[k]}
            values = {"mean_Pa": traction[:, k].mean(), "love_Pa": mean[k], "scatter_over_p": traction[:, k].std() / p}
            rows.append(place | values)
        panel.set_title(f"planes cut cell vector {'xyz'[axis]}", fontsize="medium")
        panel.set_xlabel("position along the cell vector")
    figure.axes[0].set_ylabel("traction - $n\\cdot\\sigma$, divided by p")
    figure.key(3)
    add_heading(figure, run, where(run, snapshot))
    return figure, pandas.DataFrame(rows)
