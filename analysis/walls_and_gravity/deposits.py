"""A slab of a deposit as a periodic State, its consolidation, and its fabric along z."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import labkit as lk
from analysis.initial_fabric.states import along
from labkit.grains import grains_in_cell
from labkit.micro import contact_anisotropy

PRESSURE = 500e3  # Pa
CLOSED = "sigma_zz > 5 kPa"
MARGIN = 2.0  # mean diameters left out next to the floor, the surface and, as a check of robustness, the seam
RAISE = 0.02  # step by which the seam is opened, mean diameters
AXIS = np.array([0.0, 0.0, 1.0])


def consolidated(file: Path, scene: lk.Scene, seed: int) -> list[dict[str, Any]]:
    """Fabric of the slab of a deposit: as deposited, with its seam closed, under isotropic stress; a row per stage."""
    with np.load(file) as deposit:
        slab = slab_of(dict(deposit), scene, seed)
    path = lk.paths.Oedometer(strain=0.3, rate="10 1/s")
    closed = lk.run(slab, path, stop_when=CLOSED, progress=False).state.at_rest()
    isotropic = lk.consolidate(closed, PRESSURE, progress=False)
    stages = {"deposit": slab, "closed": closed, "500 kPa": isotropic}
    return [{"stage": name, **fabric_row(state)} for name, state in stages.items()]


def slab_of(deposit: Mapping[str, np.ndarray], scene: lk.Scene, seed: int) -> lk.State:
    """The middle of a deposit, made periodic in z, with the history of its contacts, as a State at rest."""
    diameter, position, first = scene.mean_diameter, deposit["position"], int(deposit["floor"])
    z = position[:, 2]
    low = z[:first].max() + MARGIN * diameter
    high = np.quantile(z[first:], 0.99) - MARGIN * diameter
    inside = (z >= low) & (z < high) & (np.arange(len(z)) >= first)
    width = deposit["cell"][0]
    numbers = np.cumsum(inside) - 1
    radius = deposit["radius"][inside]
    place = position[inside] - (0.0, 0.0, low)
    cell = np.diag([width, width, height_of(place, radius, width, diameter)])
    state = grains_in_cell(scene, radius, place, cell, seed)
    pair = deposit["pair"]
    kept = inside[pair].all(axis=1)
    return state.replace(
        contact_grain=numbers[pair[kept]].astype(np.int32),
        contact_shift=deposit["shift"][kept].astype(np.int32),
        tangential_force=-deposit["tangential_force"][kept],  # YADE's forces act on the second grain
        rolling_moment=-deposit["rolling_moment"][kept],
    )


def height_of(position: np.ndarray, radius: np.ndarray, width: float, diameter: float) -> float:
    """Smallest height, in steps of RAISE, at which no grains touch across the seam."""
    z = position[:, 2]
    bottom, top = (np.flatnonzero(near) for near in (z < 1.5 * diameter, z > z.max() - 1.5 * diameter))
    apart = position[bottom][:, None] - position[top][None]
    apart[..., :2] -= width * np.round(apart[..., :2] / width)
    reach = radius[bottom][:, None] + radius[top][None]
    height = z.max()
    while True:
        gap = np.linalg.norm(apart + height * AXIS, axis=-1) - reach
        if gap.min() > 0.0:
            return float(height)
        height += RAISE * diameter


def fabric_row(state: lk.State) -> dict[str, float]:
    """Fabric of a State along z, with Z, e, p (kPa) and q/p; A_inside: without contacts near the seam."""
    snapshot = state.snapshot()
    found = lk.statistics(snapshot)
    stress = lk.love_stress(snapshot)
    p = float(lk.mean_stress(stress))
    height, contacts = snapshot.cell[2, 2], snapshot.contacts
    middle = snapshot.contact_ends().mean(axis=1)[:, 2] % height
    away = np.minimum(middle, height - middle) > MARGIN * state.scene.mean_diameter
    inner = contact_anisotropy(contacts.normal[away])
    return {
        "grains": state.number_of_grains,
        "p": p / 1e3,
        "ratio": float(lk.deviatoric_stress(stress)) / p,
        "e": state.volume / float((4.0 / 3.0 * np.pi * state.radius**3).sum()) - 1.0,
        "Z": found.coordination_number,
        "Lambda": found.mean_normalised_force,
        "A_inside": AXIS @ inner @ AXIS,
        **along(AXIS, found.contact_anisotropy, found.normal_force_anisotropy, found.mobilisation),
    }
