"""Drives grains to a state (e, Z, Lambda, A, F, F^t), and probes them there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas

import labkit as lk
from analysis.hidden_state.loading import DEVICE, RATE, held_mean_stress
from analysis.hidden_state.records import strain_of_cells
from analysis.hidden_state.table import RATES, STATE, deviatoric, stacked, tensor
from labkit.errors import InputError
from labkit.micro import branch_vectors, symmetric, to_six, void_ratio_nominal

ENOUGH = 0.1  # distance of a twin
STEP, BULK = 1e-3, 0.05  # strain of the finite differences; the same for volumetric strain, as a share
DAMPING, LEAST_DAMPING, EVALUATIONS = 8.0, 1.0, 50
PROBE, ON = 0.002, 0.02  # norm of the deviatoric strain of a probe; axial strain of shearing on
DIGITS = 4  # significant digits that are stored


def directions() -> np.ndarray:
    """Twelve directions of deviatoric strain, (12, 6): shear in three planes, extension and compression, both signs."""
    shear = np.eye(6)[3:]
    axial_strain = np.array([-0.5, -0.5, 1.0, 0.0, 0.0, 0.0]) * np.sqrt(2.0 / 3.0)
    across = np.array([1.0, -1.0, 0.0, 0.0, 0.0, 0.0]) / np.sqrt(2.0)
    mixed = (axial_strain + shear[1]) / np.sqrt(2.0)
    half = np.array([axial_strain, across, *shear, mixed])
    return np.concatenate([half, -half])


def state_of_snapshot(snapshot: lk.Snapshot, like: lk.State) -> lk.State:
    """The grains of a snapshot at rest, with the forces of their contacts; `like` is the specimen."""
    contacts, position = snapshot.contacts, snapshot.position
    if position is None:
        raise InputError("the snapshot has no positions: take one of a run with snapshots")
    bare = branch_vectors(position, snapshot.cell, contacts.grain, np.zeros((len(contacts), 3)))
    shift = np.linalg.solve(snapshot.cell, (contacts.branch(snapshot.radius) - bare).T).T.round()
    zero = np.zeros_like(position)
    return like.at_rest().replace(
        position=position.copy(),
        cell=snapshot.cell.copy(),
        velocity=zero,
        angular_velocity=zero.copy(),
        contact_grain=contacts.grain.astype(like.contact_grain.dtype),
        contact_shift=shift.astype(like.contact_shift.dtype),
        tangential_force=contacts.tangential_force.copy(),
        rolling_moment=contacts.rolling_moment.copy(),
    )


def values_of(state: lk.State) -> dict[str, np.ndarray]:
    """e, Z, Lambda, A, F, F^t of a State."""
    snapshot = state.snapshot()
    found = lk.statistics(snapshot)
    tensors = (found.contact_anisotropy, found.normal_force_anisotropy, symmetric(found.mobilisation))
    scalars = (void_ratio_nominal(snapshot), found.coordination_number, found.mean_normalised_force)
    values = [np.array([value]) for value in scalars] + [to_six(tensor) for tensor in tensors]
    return dict(zip(STATE, values, strict=True))


class Scale:
    """Divides states and rates by their standard deviations over all records of a density."""

    def __init__(self, rows: pandas.DataFrame) -> None:
        """`rows`: the states of a density."""
        columns = {name: stacked(rows, name) for name in (*STATE, *RATES)}
        self.size = {name: np.sqrt(((v - v.mean(axis=0)) ** 2).sum(axis=1).mean()) for name, v in columns.items()}

    def vector(self, values: dict[str, np.ndarray]) -> np.ndarray:
        """The scaled state, (21,); the norm of a difference is the distance."""
        parts = [values[name] / self.size[name] for name in STATE]
        return np.concatenate(parts) / np.sqrt(len(STATE))


def strained(state: lk.State, increments: np.ndarray) -> lk.State:
    """The State after increments of strain (n, 6)."""
    for increment in increments:
        state = lk.Element(state, engine=DEVICE, rate=RATE).strain(tensor(increment)).state
    return state


def shares(x: np.ndarray) -> np.ndarray:
    """Increments of strain (n, 6) of parameters (6 n,), in which volumetric strain counts less by BULK."""
    own = x.reshape(-1, 6)
    off = deviatoric(own)
    return off + BULK * (own - off)


def driven(begin: lk.State, increments: np.ndarray, target: np.ndarray, scale: Scale) -> tuple[lk.State, float, float]:
    """Gauss-Newton with Broyden's update towards a scaled state; (State, distance before, distance reached)."""

    def reached(x: np.ndarray) -> tuple[lk.State, np.ndarray]:
        found = strained(begin, increments + shares(x))
        return found, scale.vector(values_of(found)) - target

    x = np.zeros(increments.size)
    state, off = reached(x)
    before, damping, count = float(np.linalg.norm(off)), DAMPING, 1
    if before < ENOUGH:
        return state, before, before
    slopes = np.stack([(reached(STEP * unit)[1] - off) / STEP for unit in np.eye(x.size)], axis=1)
    count += x.size
    while np.linalg.norm(off) >= ENOUGH and count < EVALUATIONS:
        padded = np.concatenate([slopes, damping * np.eye(x.size)])
        step = np.linalg.lstsq(padded, np.concatenate([-off, np.zeros(x.size)]), rcond=None)[0]
        there, now = reached(x + step)
        count += 1
        slopes = slopes + np.outer(now - off - slopes @ step, step) / max(step @ step, 1e-12)
        if np.linalg.norm(now) < np.linalg.norm(off):
            state, x, off, damping = there, x + step, now, max(damping / 3.0, LEAST_DAMPING)
        else:
            damping *= 4.0
    return state, before, float(np.linalg.norm(off))


def probed(state: lk.State) -> dict[str, np.ndarray]:
    """The six rates in the twelve directions at held mean stress, (12,) or (12, 6)."""
    pressure = float(lk.mean_stress(lk.love_stress(state.snapshot())))
    start, rows = values_of(state), []
    for n in directions():
        path = held_mean_stress(tensor(n), PROBE, pressure)
        run = lk.run(state.at_rest(), path, engine=DEVICE, progress=False, record_strain=PROBE / 4.0, snapshots=0)
        strain = to_six(strain_of_cells(run.data["cell"].values))[-1]
        size, end = np.linalg.norm(deviatoric(strain)), values_of(run.state)
        row = {f"d{name}": (end[name] - start[name]) / size for name in STATE[1:]}
        rows.append(row | {"D": np.array([strain[:3].sum() / size])})
    return {name: np.array([row[name] for row in rows]) for name in RATES}


def sheared_on(state: lk.State) -> np.ndarray:
    """Volumetric strain at 0, 0.5, 1 and 2 % of axial strain at held mean stress, (2, 4): compression, extension."""
    pressure = float(lk.mean_stress(lk.love_stress(state.snapshot())))
    found = []
    for sign in (1.0, -1.0):
        path = held_mean_stress(sign * tensor(directions()[0]), ON * np.sqrt(1.5), pressure)
        interval = ON * np.sqrt(1.5) / 20.0
        run = lk.run(state.at_rest(), path, engine=DEVICE, progress=False, record_strain=interval, snapshots=0)
        strain = strain_of_cells(run.data["cell"].values)
        volume = np.trace(strain, axis1=1, axis2=2)
        found.append(np.interp([0.0, 0.005, 0.01, 0.02], np.abs(strain[:, 2, 2]), volume))
    return np.array(found)


def with_digits(values: np.ndarray) -> list[Any]:
    """Nested lists of numbers with DIGITS significant digits."""
    made: list[Any] = np.vectorize(lambda value: float(f"{value:.{DIGITS - 1}e}"))(values).tolist()
    return made
