"""A record from the parts of all ranks: each sums over its own grains and contacts, and only sums are exchanged.

The statistics of each part come from the functions that serve a whole specimen. Their means are weighted with the
number of contacts of the part; those of F and F^t also with the part's Lambda, by which these tensors are divided.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from labkit.dem.energy import drift_velocity, kinetic_energy
from labkit.dem.instant import Instant
from labkit.dem.observed import Observed, record_of
from labkit.dem.recorded import recorded
from labkit.dem.servo import FLOOR, cell_stiffness
from labkit.dem.state import State
from labkit.engines.lammps.parts import Part
from labkit.micro import indicators
from labkit.micro.contacts import Contacts
from labkit.micro.directions import Fit, normal_density
from labkit.micro.fabric import Statistics, series_of
from labkit.micro.normalised import vectors_of_contacts
from labkit.micro.snapshot import Snapshot, contacts_per_grain
from labkit.micro.stress import love_stress
from labkit.micro.void_ratio import grain_volume, lenses

NO_FOURTH = np.zeros((3, 3, 3, 3))


class PartialState:
    """The part of one rank as a State of its grains and a Snapshot of its contacts.

    The Snapshot also lists the grains of other ranks that these contacts touch, after the own ones. `others`: their
    numbers.
    """

    def __init__(self, part: Part, brief: State) -> None:
        """brief: the State without grains and contacts."""
        order = np.argsort(part.number)
        number = part.number[order]
        self.number, self.contacts = number, len(part.pair)
        self.state = brief.replace(
            radius=part.radius[order],
            position=part.position[order],
            velocity=part.velocity[order],
            angular_velocity=part.angular_velocity[order],
        )
        touched, first = np.unique(part.pair, return_index=True)
        foreign = ~np.isin(touched, number)
        self.others = touched[foreign]
        numbers = np.concatenate([number, self.others])
        radius = np.concatenate([self.state.radius, part.radii.ravel()[first[foreign]]])
        by_number = np.argsort(numbers)
        grain = by_number[np.searchsorted(numbers[by_number], part.pair)]
        length = np.sqrt(np.einsum("ci,ci->c", part.branch, part.branch))
        overlap = part.radii.sum(axis=1) - length
        contacts = Contacts(
            grain,
            part.branch / length[:, None],
            overlap,
            brief.scene.normal_force(part.radii[:, 0], part.radii[:, 1], overlap),
            part.tangential_force,
            part.rolling_moment,
        )
        self.snapshot = Snapshot(brief.scene, radius, brief.cell, contacts)


def observe_parts(part: PartialState, brief: State, comm: Any) -> tuple[Observed, np.ndarray]:
    """The quantities of a record and the stiffness of the cell (6, 6), Pa, on every rank.

    brief: the State without grains and contacts, with the radii of all grains.
    """
    snapshot, n = part.snapshot, part.contacts
    mass = brief.scene.mass(part.state.radius).sum()
    resultant, count = _own_sums(part, comm)
    floor = FLOOR * brief.scene.young_modulus * np.eye(6)
    force = snapshot.contacts.force_on_first()
    density = normal_density(snapshot.contacts.normal).second if n else np.zeros((3, 3))
    sums = [
        np.array([n, mass]),
        love_stress(snapshot).ravel(),
        n * density.ravel(),
        (cell_stiffness(snapshot, 6) - floor).ravel(),
        mass * drift_velocity(part.state) if len(part.number) else np.zeros(3),
        np.array(
            [
                lenses(snapshot),
                n * indicators.overlap_ratio(snapshot),
                np.sum(count < 2),
                kinetic_energy(part.state),
                indicators.elastic_energy(snapshot),
                np.linalg.norm(resultant, axis=1).sum(),
                np.linalg.norm(force, axis=1).sum(),
            ]
        ),
    ]
    (contacts, mass), stress, A, stiffness, momentum, others = _summed(sums, comm)
    lens, overlap, rattlers, kinetic, elastic, unbalanced, forces = others
    grains = brief.number_of_grains
    return Observed(
        stress.reshape(3, 3),
        _statistics(part, int(contacts), A.reshape(3, 3), grains, comm),
        grain_volume(brief.radius),
        float(lens),
        float(overlap / contacts) if contacts else 0.0,
        float(rattlers / grains),
        float(kinetic),
        float(elastic),
        float(unbalanced / grains / (forces / contacts)) if forces > 0.0 else 0.0,
        momentum / mass,
    ), stiffness.reshape(6, 6) + floor


def _statistics(part: PartialState, contacts: int, A: np.ndarray, grains: int, comm: Any) -> Statistics:
    """Z, A, Lambda, F and F^t; A: summed over the contacts."""
    undefined = np.full((3, 3), np.nan)
    if not contacts:
        return Statistics(0.0, undefined, 0.0, undefined, undefined)
    density = Fit(0.25 / np.pi, A / contacts, NO_FOURTH)
    sums = [np.zeros(1), np.zeros(9), np.zeros(9)]
    if part.contacts:
        series = series_of(vectors_of_contacts(part.snapshot), density=density)
        weight = part.contacts * series.normal_force.mean
        sums = [np.array([weight]), weight * series.normal_force.second.ravel(), weight * series.mobilisation.ravel()]
    (weight,), F, Ft = _summed(sums, comm)
    return Statistics(
        2 * contacts / grains,
        density.second,
        weight / contacts,
        (F / weight).reshape(3, 3),
        (Ft / weight).reshape(3, 3),
    )


def _summed(values: list[np.ndarray], comm: Any) -> list[np.ndarray]:
    """Each array summed over all ranks."""
    own = np.concatenate(values)
    total = np.empty_like(own)
    comm.Allreduce(own, total)
    return np.split(total, np.cumsum([len(one) for one in values])[:-1])


def _own_sums(part: PartialState, comm: Any) -> tuple[np.ndarray, np.ndarray]:
    """Resultant contact force (g, 3), N, and number of contacts (g,) of each grain of this rank.

    The ranks tell each other what their contacts add to grains of other ranks: as much as their surfaces.
    """
    own = len(part.number)
    force = indicators.resultant_forces(part.snapshot)
    count = contacts_per_grain(part.snapshot).astype(float)
    both = np.column_stack([force, count])
    for sender, (numbers, values) in enumerate(comm.allgather((part.others, both[own:]))):
        if sender != comm.rank and len(numbers) and own:
            place = np.minimum(np.searchsorted(part.number, numbers), own - 1)
            mine = part.number[place] == numbers
            np.add.at(both, place[mine], values[mine])
    return both[:own, :3], both[:own, 3]


class PartialInstant(Instant):
    """An instant whose grains stay on their ranks until someone asks for the State."""

    def __init__(self, brief: State, engine: Any) -> None:
        """brief: the State without grains and contacts; engine: the LammpsEngine."""
        super().__init__(brief)
        self._engine = engine
        self._seen, self._stiffness = engine.observed(brief)

    @functools.cached_property
    def state(self) -> State:
        return self._engine.state()

    def stress(self) -> np.ndarray:
        return self._seen.stress

    def stiffness(self, components: int) -> np.ndarray:
        return self._stiffness[:components, :components]

    def measure(self, first_cell: np.ndarray) -> dict[str, Any]:
        """The variables of a record; statistics of the user need all contacts, which are then gathered."""
        record = record_of(self.brief, self._seen, first_cell)
        return {**record, **{statistic.name: statistic(self.snapshot) for statistic in recorded()}}
