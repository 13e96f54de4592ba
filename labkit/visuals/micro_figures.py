"""Figures of grains, contacts and forces in a run, each with the table behind it. Strain in %, see labkit.visuals.plots.

Every function takes a run opened with labkit.open_run and returns (Figure, pandas.DataFrame).
"""

from __future__ import annotations

import time

import matplotlib.pyplot as plt
import numpy as np
import pandas
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.ticker import NullFormatter, ScalarFormatter
from scipy import stats

from labkit.sff import family as sff_family
from labkit.dem import stratified
from labkit.errors import InputError
from labkit.micro.directions import (
    bin_means,
    directional_mean,
    hemisphere_bins,
    normal_density,
    polar_bins,
    tangential_mean,
)
from labkit.micro.normalised import normalised_normal_force, vectors_of_contacts
from labkit.micro.size_groups import diameter_edges, groups_by_diameter
from labkit.micro.stress import deviatoric_stress, mean_stress, relative_error
from labkit.visuals.plots import WIDTH
from labkit.sff.c0 import TERMS
from labkit.sff.budget import PARTS, standard_errors

TERM_NAMES = {"A": "A", "F": "F", "Ft": "F$^t$", "coupled": "A and F coupled"}
DENSITY_BINS, DENSITY_TOP = 30, 6.0  # of the mean force
POLAR_BINS = 12
BANDS, SECTORS = 8, 24


def groups(run, number=5, snapshot=-1):
    """sigma^N(k) and sigma^V(k) over Love by grain size (Fig. 2), and sigma^V(k) Z(k)/Z, the stress of the grains."""
    return group_stresses(run.lab.size_groups(number), run.lab.love_stress())


def group_stresses(found, love, width=WIDTH):
    """`groups` from what the accessor computes: `found` of run.lab.size_groups, `love` of run.lab.love_stress."""
    strain, number = found["axial_strain"].values * 100, found.sizes["group"]
    panels = {
        "per contact, $\\sigma^N(k)/\\sigma$": found["per_contact"].values,
        "per volume, $\\sigma^V(k)/\\sigma$": found["per_volume"].values,
        "of the grains, $\\sigma^V(k)\\,Z(k)/(Z\\sigma)$":
            found["per_volume"].values * found["coordination_ratio"].values[..., None, None],
    }  # fmt: skip
    scalars = {"p": mean_stress, "zz": lambda s: s[..., 2, 2], "q": deviatoric_stress}
    figure, axes = plt.subplots(1, 3, figsize=(width, 0.4 * width), sharey=True, layout="constrained")
    rows = []
    colors = plt.get_cmap("viridis")(np.linspace(0.0, 0.9, number))
    for panel, (title, values) in zip(axes, panels.items()):
        for k, color in enumerate(colors):
            ratio = {name: of(values[:, k]) / of(love.values) for name, of in scalars.items()}
            label = f"{found['diameter'].values[k] * 1e3:.3f}"
            panel.plot(strain, ratio["p"], color=color, label=label)
            panel.plot(strain[1:], ratio["q"][1:], "--", color=color)  # q of the isotropic start is zero
            rows += [
                {"stress": title.split(",")[0], "group": k, "diameter_mm": found["diameter"].values[k] * 1e3,
                 "axial_strain": s / 100, **{name: r[i] for name, r in ratio.items()}}
                for i, s in enumerate(strain)
            ]  # fmt: skip
        panel.set(xlabel="axial strain (%)", title=title)
        panel.axhline(1.0, color="0.5", lw=0.8)
        panel.grid(alpha=0.25)
    axes[0].set_ylabel("over Love: p solid, q dashed")
    figure.legend(*axes[0].get_legend_handles_labels(), title="middle of the size group, D (mm)",
                  loc="outside lower center", ncols=number, frameon=False, fontsize=8)  # fmt: skip
    return figure, pandas.DataFrame(rows)


def densities(run, number=5, snapshot=-1):
    """Probability densities of f_n and of Lambda_n by grain size, over the mean of all contact sides."""
    of = run.lab.snapshot(snapshot)
    edges = diameter_edges(of, number)
    side_group = groups_by_diameter(of, edges)[of.contacts.grain]
    force = np.stack([of.contacts.normal_force] * 2, axis=1)
    values = {
        "normal force, $f_n/\\langle f_n\\rangle$": force,
        "normalised force, $\\Lambda_n/\\langle\\Lambda_n\\rangle$":
            normalised_normal_force(of),
    }  # fmt: skip
    figure, axes = plt.subplots(1, 2, figsize=(WIDTH, 4.2), sharey=True, layout="constrained")
    colors = plt.get_cmap("viridis")(np.linspace(0.0, 0.9, number))
    bins = np.linspace(0.0, DENSITY_TOP, DENSITY_BINS + 1)
    middle = 0.5 * (bins[1:] + bins[:-1])
    rows = []
    for panel, (title, sides) in zip(axes, values.items()):
        sides = sides / sides.mean()
        for k, color in enumerate(colors):
            chosen = sides[side_group == k]
            if not len(chosen):
                continue
            density = np.histogram(chosen, bins)[0] / len(chosen) / np.diff(bins)
            label = f"{0.5e3 * (edges[k] + edges[k + 1]):.3f}"
            panel.semilogy(middle, np.where(density > 0, density, np.nan), "o-", ms=2.5, color=color, label=label)
            panel.axvline(chosen.mean(), color=color, lw=0.8, ls=":")
            rows += [{"of": title.split(",")[0], "group": k, "diameter_mm": 0.5e3 * (edges[k] + edges[k + 1]),
                      "group_mean": chosen.mean(), "value": m, "density": d}
                     for m, d in zip(middle, density)]  # fmt: skip
        panel.set(xlabel=title)
        panel.grid(alpha=0.25)
    axes[0].set_ylabel("probability density")
    figure.suptitle(f"at {_percent(run, snapshot)} axial strain; dotted: mean of the group", fontsize=10)
    figure.legend(*axes[0].get_legend_handles_labels(), title="middle of the size group, D (mm)",
                  loc="outside lower center", ncols=number, frameon=False, fontsize=8)  # fmt: skip
    return figure, pandas.DataFrame(rows)


def directions(run, number=5, snapshot=-1):
    """E_PDF(n), mean Lambda_n(n) and mean tangential Lambda_t(n): data, second- and fourth-order fits.

    Above over the angle to z, averaged about it (polar diagrams); below over the whole hemisphere of directions.
    """
    vectors = vectors_of_contacts(run.lab.snapshot(snapshot))
    if not len(vectors):
        raise InputError("there are no contacts in this snapshot: choose another --snapshot")
    n = vectors.normal
    up = np.where(n[:, 2:] < 0.0, -n, n)
    pull = -vectors.tangential * np.where(n[:, 2:] < 0.0, -1.0, 1.0)  # t of the contact seen from its other side
    mean = directional_mean(n, vectors.normal_component, normal_density(n)).mean
    along = _toward_z(up)
    values = {
        "$4\\pi E_{PDF}$": None,
        "$\\overline{\\Lambda_n}/\\Lambda$": vectors.normal_component / mean,
        "$\\overline{t_\\theta}$ = mean of $-\\Lambda_t\\cdot e_\\theta/\\Lambda$":
            np.einsum("mi,mi->m", pull, along) / mean,
    }  # fmt: skip
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
    figure.suptitle(f"at {_percent(run, snapshot)} axial strain, {len(n)} contacts; z upwards", fontsize=10)
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
        axes.bar(left, np.abs(means), width=angle[:-1] - angle[1:], color="0.85", edgecolor="0.6", lw=0.5,
                 label="contacts" if quarter == 0 else None)  # fmt: skip
    theta = np.linspace(0.0, 2 * np.pi, 361)
    averages = [_average_about_z(fit, theta) for fit in fits]
    for average, style, order in zip(averages, ("-", "--"), (2, 4)):
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


def shares(run, number=5, snapshot=-1):
    """What A, F, F^t and their product add to q/p of C0 over strain, stacked, with q/p of Love."""
    found = run.lab.strength_shares()
    strain = found["axial_strain"].values * 100
    love = (run.lab.deviatoric_stress() / run.lab.mean_stress()).values
    figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 4.2), layout="constrained")
    colors = stack_shares(left, run)
    left.set(xlabel="axial strain (%)", ylabel="q/p", title="stacked: they add up to C0")
    total = found.values.sum(axis=0)
    grown = np.abs(total) > 0.1 * np.nanmax(np.abs(total))
    for term, color, values in zip(TERMS, colors, found.values):
        right.plot(strain[grown], 100 * values[grown] / total[grown], color=color)
    right.set(xlabel="axial strain (%)", ylabel="share of the strength (%)", ylim=(0, None))
    for axes in (left, right):
        axes.grid(alpha=0.25)
    figure.legend(loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    table = {"axial_strain": strain / 100, "q_over_p_love": love, **dict(zip(TERMS, found.values))}
    return figure, pandas.DataFrame(table)


def stack_shares(axes, run):
    """Stacks what the terms of C0 add to q/p of a run, with q/p of Love over them; the colours of the terms."""
    found, colors = run.lab.strength_shares(), plt.get_cmap("tab10").colors[: len(TERMS)]
    strain, love = found["axial_strain"].values * 100, run.lab.deviatoric_stress() / run.lab.mean_stress()
    axes.stackplot(strain, *found.values, colors=colors, alpha=0.75, labels=[TERM_NAMES[t] for t in TERMS])
    axes.plot(strain, love.values, "k-", lw=1.2, label="Love")
    return colors


def family(run, number=5, snapshot=-1, rounds=25):
    """Error of every stress-force-fabric relationship against Love over strain, and its cost."""
    found, love = run.lab.sff_family(), run.lab.love_stress().values
    error = {form: relative_error(found.sel(form=form).values, love) for form in sff_family.FORMS}
    cost = _costs(run, snapshot, rounds)
    strain = found["axial_strain"].values * 100
    figure, (left, right) = plt.subplots(1, 2, figsize=(WIDTH, 4.6), layout="constrained")
    colors = dict(zip(sff_family.FORMS, plt.get_cmap("tab10").colors))
    rows = []
    for form, values in error.items():
        left.semilogy(strain, 100 * values, color=colors[form], label=form)
        mean = float(np.nanmean(values[1:])) if len(values) > 1 else float(values[0])
        right.loglog(cost[form] * 1e3, 100 * mean, "o", color=colors[form])
        rows.append({
            "form": form, "mean_error": mean, "worst_error": float(np.nanmax(values)),
            "first_error": float(values[0]), "milliseconds": cost[form] * 1e3,
            "cost_over_c0": cost[form] / cost["c0"],
        })  # fmt: skip
    left.set(xlabel="axial strain (%)", ylabel="error against Love (%)")
    number_of_contacts = int(run["row_size"].values[snapshot])
    right.set(xlabel=f"time for {number_of_contacts} contacts (ms)", ylabel="mean error after the start (%)")
    right.xaxis.set_major_formatter(ScalarFormatter())
    right.xaxis.set_minor_formatter(NullFormatter())
    low, high = 0.7e3 * min(cost.values()), 1.5e3 * max(cost.values())
    right.set_xticks([x for x in (0.5, 1, 2, 5, 10, 20, 50) if low < x < high])
    for axes in (left, right):
        axes.grid(alpha=0.25, which="both")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    return figure, pandas.DataFrame(rows)


def _costs(run, snapshot, rounds):
    """Median seconds of each form on one snapshot, measured in turn."""
    of = run.lab.snapshot(snapshot)
    taken = {form: [] for form in sff_family.FORMS}
    for _ in range(rounds):
        for form, times in taken.items():
            begin = time.perf_counter()
            sff_family.stress(form, of)
            times.append(time.perf_counter() - begin)
    return {form: float(np.median(times)) for form, times in taken.items()}


def budget(run, number=5, snapshot=-1):
    """The parts of C0 - Love in p and q over the p of Love, over strain, with standard errors at one snapshot."""
    parts, love = run.lab.error_budget(), run.lab.love_stress().values
    strain, p = parts["axial_strain"].values * 100, mean_stress(love)
    shown = [name for name in PARTS if np.abs(parts.sel(part=name).values).max() > 0.0]
    figure, axes = plt.subplots(1, 2, figsize=(WIDTH, 4.6), layout="constrained")
    for panel, of, name in zip(axes, (mean_stress, deviatoric_stress), "pq"):
        for color, part in zip(plt.get_cmap("tab10").colors, shown):
            panel.plot(strain, 100 * of(parts.sel(part=part).values) / p, color=color, label=PARTS[part])
        panel.plot(strain, 100 * of(parts.sum("part").values) / p, "k-", lw=2, label="C0 - Love")
        panel.axhline(0.0, color="0.5", lw=0.8)
        panel.set(xlabel="axial strain (%)", ylabel=f"error in {name} over p (%)")
        panel.grid(alpha=0.25)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=6, frameon=False, fontsize=8)
    of = run.lab.snapshot(snapshot)
    scatter = standard_errors(of) if len(of.contacts) else {}
    rows = [
        {"axial_strain": strain[k] / 100, "part": part, "p_error": mean_stress(parts.values[k, i]) / p[k],
         "q_error": deviatoric_stress(parts.values[k, i]) / p[k],
         "norm": np.linalg.norm(parts.values[k, i]) / np.linalg.norm(love[k])}
        for k in range(len(strain)) for i, part in enumerate(PARTS)
    ]  # fmt: skip
    table = pandas.DataFrame(rows)
    last = {part: np.linalg.norm(error) / np.linalg.norm(love[snapshot]) for part, error in scatter.items()}
    table["norm_standard_error"] = np.where(
        table["axial_strain"] == strain[snapshot] / 100, table["part"].map(last), np.nan
    )
    return figure, table


def contacts(run, number=5, snapshot=-1):
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
    for born, label, color in ((lives["birth"].values == 0, "of the specimen", "C0"),
                               (lives["birth"].values > 0, "born in the test", "C1")):  # fmt: skip
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


def stratified_layer(state):
    """Grains, contact forces and normalised contact forces of the layer of labkit.dem.stratified side by side (Fig. 3)."""
    snapshot, strata = state.snapshot(), stratified.strata(state)
    found = snapshot.contacts
    across, up = state.cell[0, 0], state.cell[2, 2]
    normalised = normalised_normal_force(snapshot, stratified.disc_volume(state))
    figure, axes = plt.subplots(1, 3, figsize=(1.3 * WIDTH, 0.4 * WIDTH * up / across + 1.7), layout="constrained")
    inside = np.mod(state.position[:, [0, 2]], [across, up]) * 1e3
    discs = [plt.Circle(x, r * 1e3) for x, r in zip(inside, state.radius)]
    coarse = stratified.stratum_of(state).astype(bool)[:, None]
    colors = np.where(coarse, [[0.80, 0.65, 0.40]], [[0.55, 0.65, 0.75]])
    axes[0].add_collection(PatchCollection(discs, facecolors=colors, edgecolors="0.3", linewidths=0.15))
    start = inside[found.grain[:, 0]]
    branch = (found.branch_length(state.radius)[:, None] * found.normal)[:, [0, 2]] * 1e3
    drawn = {"contact force": found.normal_force, "normalised contact force": normalised.mean(axis=1)}
    for panel, (name, values) in zip(axes[1:], drawn.items()):
        ratio = values / values.mean()
        order = np.argsort(ratio)
        lines = LineCollection(
            np.stack([start, start + branch], axis=1)[order], array=ratio[order], cmap="inferno_r",
            norm=plt.Normalize(0, 3), linewidths=0.2 + 0.8 * np.clip(ratio[order], 0, 4),
        )  # fmt: skip
        panel.add_collection(lines)
        figure.colorbar(lines, ax=panel, shrink=0.7, label="over the mean", extend="max")
    for panel, title in zip(axes, ("grains", *drawn)):
        panel.set(xlim=(0, across * 1e3), ylim=(0, up * 1e3), aspect="equal", xlabel="x (mm)", title=title)
    axes[0].set_ylabel("z (mm)")
    said = (
        rf"{s.name}: $\sigma_{{zz}}/\sigma_{{xx}}$ = {s.stress_ratio:.2f}, mean force {s.mean_force * 1e3:.1f} mN, "
        rf"mean $\Lambda_n$ = {s.mean_normalised_force * 1e4:.2f} $\cdot 10^{{-4}}$"
        for s in strata
    )
    figure.suptitle("\n".join(said), fontsize=10)
    return figure


def _percent(run, snapshot):
    return f"{float(run['snapshot_strain'].values[snapshot]) * 100:.1f} %"
