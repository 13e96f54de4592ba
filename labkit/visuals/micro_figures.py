"""Figures of grains and contacts in a run, each with the table behind it. Strain in %, see labkit.visuals.plots.

Every function takes a run opened with labkit.open_run, a number of size groups and the number of a snapshot, from the
end if negative, and returns (Figure, pandas.DataFrame). Here are sizes and contacts; the others come from the files
beside.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pandas
import xarray
from matplotlib.figure import Figure
from scipy import stats

from labkit.micro.normalised import normalised_normal_force
from labkit.micro.size_groups import diameter_edges, groups_by_diameter
from labkit.micro.stress import deviatoric_stress, mean_stress
from labkit.visuals.direction_figure import directions, percent
from labkit.visuals.layer_figure import stratified_layer
from labkit.visuals.plots import WIDTH
from labkit.visuals.sff_figures import budget, family, shares, stack_shares

__all__ = [
    "budget",
    "contacts",
    "densities",
    "directions",
    "family",
    "group_stresses",
    "groups",
    "shares",
    "stack_shares",
    "stratified_layer",
]

DENSITY_BINS, DENSITY_TOP = 30, 6.0  # of the mean force


def groups(run: xarray.Dataset, number: int = 5, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """sigma^N(k) and sigma^V(k) over Love by grain size (Fig. 2), and sigma^V(k) Z(k)/Z, the stress of the grains."""
    return group_stresses(run.lab.size_groups(number), run.lab.love_stress())


def group_stresses(
    found: xarray.Dataset, love: xarray.DataArray, width: float = WIDTH
) -> tuple[Figure, pandas.DataFrame]:
    """`groups` from what the accessor computes: `found` of run.lab.size_groups, `love` of run.lab.love_stress.

    `width` in inches.
    """
    strain, number = found["axial_strain"].values * 100, found.sizes["group"]
    panels = {
        "per contact, $\\sigma^N(k)/\\sigma$": found["per_contact"].values,
        "per volume, $\\sigma^V(k)/\\sigma$": found["per_volume"].values,
        "of the grains, $\\sigma^V(k)\\,Z(k)/(Z\\sigma)$": found["per_volume"].values
        * found["coordination_ratio"].values[..., None, None],
    }
    scalars = {"p": mean_stress, "zz": lambda s: s[..., 2, 2], "q": deviatoric_stress}
    figure, axes = plt.subplots(1, 3, figsize=(width, 0.4 * width), sharey=True, layout="constrained")
    rows = []
    colors = plt.get_cmap("viridis")(np.linspace(0.0, 0.9, number))
    for panel, (title, values) in zip(axes, panels.items(), strict=True):
        for k, color in enumerate(colors):
            ratio = {name: of(values[:, k]) / of(love.values) for name, of in scalars.items()}
            label = f"{found['diameter'].values[k] * 1e3:.3f}"
            panel.plot(strain, ratio["p"], color=color, label=label)
            panel.plot(strain[1:], ratio["q"][1:], "--", color=color)  # q of the isotropic start is zero
            rows += [
                {
                    "stress": title.split(",")[0],
                    "group": k,
                    "diameter_mm": found["diameter"].values[k] * 1e3,
                    "axial_strain": s / 100,
                    **{name: r[i] for name, r in ratio.items()},
                }
                for i, s in enumerate(strain)
            ]
        panel.set(xlabel="axial strain (%)", title=title)
        panel.axhline(1.0, color="0.5", lw=0.8)
        panel.grid(alpha=0.25)
    axes[0].set_ylabel("over Love: p solid, q dashed")
    figure.legend(
        *axes[0].get_legend_handles_labels(),
        title="middle of the size group, D (mm)",
        loc="outside lower center",
        ncols=number,
        frameon=False,
        fontsize=8,
    )
    return figure, pandas.DataFrame(rows)


def densities(run: xarray.Dataset, number: int = 5, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """Probability densities of f_n and of Lambda_n by grain size, over the mean of all contact sides."""
    of = run.lab.snapshot(snapshot)
    edges = diameter_edges(of, number)
    side_group = groups_by_diameter(of, edges)[of.contacts.grain]
    force = np.stack([of.contacts.normal_force] * 2, axis=1)
    values = {
        "normal force, $f_n/\\langle f_n\\rangle$": force,
        "normalised force, $\\Lambda_n/\\langle\\Lambda_n\\rangle$": normalised_normal_force(of),
    }
    figure, axes = plt.subplots(1, 2, figsize=(WIDTH, 4.2), sharey=True, layout="constrained")
    colors = plt.get_cmap("viridis")(np.linspace(0.0, 0.9, number))
    bins = np.linspace(0.0, DENSITY_TOP, DENSITY_BINS + 1)
    middle = 0.5 * (bins[1:] + bins[:-1])
    rows = []
    for panel, (title, sides) in zip(axes, values.items(), strict=True):
        sides = sides / sides.mean()
        for k, color in enumerate(colors):
            chosen = sides[side_group == k]
            if not len(chosen):
                continue
            density = np.histogram(chosen, bins)[0] / len(chosen) / np.diff(bins)
            label = f"{0.5e3 * (edges[k] + edges[k + 1]):.3f}"
            panel.semilogy(middle, np.where(density > 0, density, np.nan), "o-", ms=2.5, color=color, label=label)
            panel.axvline(chosen.mean(), color=color, lw=0.8, ls=":")
            rows += [
                {
                    "of": title.split(",")[0],
                    "group": k,
                    "diameter_mm": 0.5e3 * (edges[k] + edges[k + 1]),
                    "group_mean": chosen.mean(),
                    "value": m,
                    "density": d,
                }
                for m, d in zip(middle, density, strict=True)
            ]
        panel.set(xlabel=title)
        panel.grid(alpha=0.25)
    axes[0].set_ylabel("probability density")
    figure.suptitle(f"at {percent(run, snapshot)} axial strain; dotted: mean of the group", fontsize=10)
    figure.legend(
        *axes[0].get_legend_handles_labels(),
        title="middle of the size group, D (mm)",
        loc="outside lower center",
        ncols=number,
        frameon=False,
        fontsize=8,
    )
    return figure, pandas.DataFrame(rows)


def contacts(run: xarray.Dataset, number: int = 5, snapshot: int = -1) -> tuple[Figure, pandas.DataFrame]:
    """Contacts gained and lost between snapshots, how long they live, and what the strong network carries."""
    changes, lives, strong = run.lab.contact_changes(), run.lab.contact_lives(), run.lab.strong_networks()
    strain = changes["axial_strain"].values * 100
    travelled = changes["travelled"].values
    figure, axes = plt.subplots(1, 3, figsize=(WIDTH, 4.2), layout="constrained")
    step = np.diff(travelled) * 100
    for name, color in (("gained", "C2"), ("lost", "C3")):
        rate = changes[name].values[1:] / changes["contacts"].values[:-1] / step * 100
        axes[0].plot(strain[1:], rate, "o-", ms=3, color=color, label=name)
    axes[0].set(xlabel="axial strain (%)", ylabel="contacts per 1 % of strain (%)", ylim=(0, None))
    axes[0].legend(frameon=False, fontsize=8)
    for born, label, color in (
        (lives["birth"].values == 0, "of the specimen", "C0"),
        (lives["birth"].values > 0, "born in the test", "C1"),
    ):
        if born.any():
            life, alive = lives["lifetime"].values[born], lives["alive"].values[born]
            survival = stats.ecdf(stats.CensoredData(uncensored=life[~alive], right=life[alive])).sf
            axes[1].step(survival.quantiles * 100, survival.probabilities, where="post", color=color, label=label)
    axes[1].set(xlabel="lifetime, axial strain travelled (%)", ylabel="contacts that live longer", ylim=(0, 1))
    axes[1].legend(frameon=False, fontsize=8)
    for k, definition in enumerate(strong["definition"].values):
        chosen = strong.isel(definition=k)
        axes[2].plot(strain, chosen["fraction"], "--", color=f"C{k}", label=f"strong by {definition}: share of sides")
        axes[2].plot(strain[1:], chosen["share_of_q"][1:], "-", color=f"C{k}", label="their share of q")
    axes[2].set(xlabel="axial strain (%)", ylabel="share", ylim=(0, None))
    axes[2].legend(frameon=False, fontsize=7)
    for panel in axes:
        panel.grid(alpha=0.25)
    table = changes.to_dataframe().reset_index()
    for k, name in enumerate(("force", "normalised")):
        for column in ("fraction", "share_of_q", "share_of_p"):
            table[f"strong_by_{name}_{column}"] = strong[column].values[:, k]
    return figure, table
