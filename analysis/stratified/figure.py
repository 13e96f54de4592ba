"""Figure of the stratified layer (Fig. 3)."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.figure import Figure

from analysis.stratified import layer
from labkit.figures.frame import WIDTH, new_figure
from labkit.grains.state import State
from labkit.micro.contact_sides import normalised_normal_force


def stratified_layer(state: State) -> Figure:
    """Draw grains, contact forces and normalised contact forces of a layer (Fig. 3)."""
    snapshot, strata = state.snapshot(), layer.strata(state)
    contacts = snapshot.contacts
    across, up = state.cell[0, 0], state.cell[2, 2]
    normalised = normalised_normal_force(snapshot, layer.disc_volume(state))
    figure = new_figure(1.3 * WIDTH, 0.4 * WIDTH * up / across + 1.7)
    axes = figure.subplots(1, 3)
    inside = np.mod(state.position[:, [0, 2]], [across, up]) * 1e3
    discs = [plt.Circle(x, r * 1e3) for x, r in zip(inside, state.radius, strict=True)]
    coarse = layer.stratum_of(state).astype(bool)[:, None]
    colors = np.where(coarse, [[0.80, 0.65, 0.40]], [[0.55, 0.65, 0.75]])
    axes[0].add_collection(PatchCollection(discs, facecolors=colors, edgecolors="0.3", linewidths=0.15))
    start = inside[contacts.grain[:, 0]]
    branch = (contacts.branch_length(state.radius)[:, None] * contacts.normal)[:, [0, 2]] * 1e3
    drawn = {"contact force": contacts.normal_force, "normalised contact force": normalised.mean(axis=1)}
    for panel, values in zip(axes[1:], drawn.values(), strict=True):
        ratio = values / values.mean()
        order = np.argsort(ratio)
        segments, widths = np.stack([start, start + branch], axis=1)[order], 0.2 + 0.8 * np.clip(ratio[order], 0, 4)
        lines = LineCollection(list(segments), linewidths=widths, cmap="inferno_r", norm=plt.Normalize(0, 3))
        lines.set_array(ratio[order])
        panel.add_collection(lines)
        figure.colorbar(lines, ax=panel, shrink=0.7, label="force / mean force", extend="max")
    for panel, title in zip(axes, ("grains", *drawn), strict=True):
        panel.set(xlim=(0, across * 1e3), ylim=(0, up * 1e3), aspect="equal", xlabel="x (mm)", title=title)
    axes[0].set_ylabel("z (mm)")
    summary = (
        rf"{s.name}: $\sigma_{{zz}}/\sigma_{{xx}}$ = {s.stress_ratio:.2f}, mean force {s.mean_force * 1e3:.1f} mN, "
        rf"mean $\Lambda_n$ = {s.mean_normalised_force * 1e4:.2f} $\cdot 10^{{-4}}$"
        for s in strata
    )
    figure.suptitle("\n".join(summary), fontsize=10)
    return figure
