"""Love's stress in a box of walls, and the terms that balance the forces on the walls."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas

import labkit as lk
from labkit.micro import plane_tractions

AXES = {"xx": 0, "zz": 2}
Arrays = Mapping[str, np.ndarray]


def instants_of(arrays: Arrays) -> list[dict[str, np.ndarray]]:
    """The instants of a box, whose arrays scenes.py numbers."""
    found = dict[int, dict[str, np.ndarray]]()
    for name, values in arrays.items():
        key, _, number = name.rpartition("_")
        found.setdefault(int(number), {})[key] = values
    return [found[number] for number in sorted(found)]


def box_rows(one: Arrays, density: float) -> list[dict[str, float]]:
    """A row per component of the stress in a box at one instant.

    Columns: strain, component, love and force (Pa), and, in per cent of the force, kinetic (sum m v v/V), unbalanced
    (moment of the unbalanced forces on the grains over V) and friction (moment of the forces along the other walls over
    V). The stress of the walls and the last two add up to Love's.
    """
    radius, pair, faces = one["radius"], one["pair"], one["faces"]
    size = faces[:, 1] - faces[:, 0]
    volume, grains = size.prod(), len(radius)
    force = one["normal_force"] + one["tangential_force"]  # the force on the second grain
    of_wall = pair[:, 0] >= grains  # YADE lists the wall first
    if (pair[~of_wall] >= grains).any():
        raise ValueError("a wall is the second body of a contact")
    branch = one["position"][pair[~of_wall, 1]] - one["position"][pair[~of_wall, 0]]
    grain, wall = pair[of_wall, 1], pair[of_wall, 0] - grains
    arm = -one["normal"][of_wall] * (radius[grain] - one["overlap"][of_wall])[:, None]  # to the face of the wall
    love = (branch.T @ force[~of_wall] - arm.T @ force[of_wall]) / volume
    at_wall = one["position"][grain] + arm
    centre = faces.mean(axis=1)
    unbalanced = (one["position"] - centre).T @ one["force"] / volume
    mass = density * 4.0 / 3.0 * np.pi * radius**3
    kinetic = (mass[:, None] * one["velocity"]).T @ one["velocity"] / volume
    rows = []
    for component, axis in AXES.items():
        push = 0.5 * (one["wall_force"][axis, 1, axis] - one["wall_force"][axis, 0, axis])
        stress = push * size[axis] / volume
        other = wall // 2 != axis
        friction = float((at_wall[other, axis] - centre[axis]) @ -force[of_wall][other, axis]) / volume
        row = {"strain": float(one["strain"]), "component": component, "love": love[axis, axis], "force": stress}
        parts = {"kinetic": kinetic[axis, axis], "unbalanced": unbalanced[axis, axis], "friction": friction}
        rows.append(row | {name: 100.0 * float(value) / stress for name, value in parts.items()})
    return rows


def plane_rows(run: lk.Run) -> list[dict[str, float]]:
    """The same for a periodic cell and the plane through its middle; kinetic is twice the kinetic energy over V."""
    rows = []
    data = run.data
    for snapshot in run.snapshots:
        nearest = int(np.abs(data["time"].values - snapshot.time).argmin())
        kinetic = 2.0 * float(data["kinetic_energy"][nearest]) / snapshot.volume
        love = lk.love_stress(snapshot)
        for component, axis in AXES.items():
            force = float(plane_tractions(snapshot, axis, 1)[0, axis])
            row = {"strain": snapshot.axial_strain or 0.0, "component": component, "love": love[axis, axis]}
            rows.append(row | {"force": force, "kinetic": 100.0 * kinetic / force})
    return rows


def errors_of(values: pandas.DataFrame) -> pandas.DataFrame:
    """Error of Love's stress in %, means over instants, a row per scene, state (rest or shear), component, specimen."""
    values = values.assign(
        error=100.0 * (values["love"] / values["force"] - 1.0),
        state=np.where(values["strain"] < 1e-6, "rest", "shear"),
    )
    keys = ["scene", "state", "component", "specimen"]
    return values.groupby(keys, as_index=False, sort=False)[["error", "kinetic", "unbalanced", "friction"]].mean()
