"""The accessor `run.lab`: tables of records and statistics computed from the contacts of a run."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas
import xarray as xr

from labkit.bodies.kinds import bodies_in_run
from labkit.errors import ImpossibleError, InputError
from labkit.files.netcdf import name_damage
from labkit.files.schema import ECCENTRICITY, RECORD
from labkit.grains.scene import Scene
from labkit.micro.bodies import snapshot_of_bodies
from labkit.micro.fabric import Statistics, statistics
from labkit.micro.networks import Lives, follow, network_stress, strong_by_force, strong_by_normalised_force
from labkit.micro.size_groups import diameter_edges, group_stresses, groups_by_diameter
from labkit.micro.snapshot import NO_CONTACTS, Contacts, Snapshot, love_stress, require_contacts
from labkit.micro.stress import mean_stress
from labkit.results import tables
from labkit.results.endings import path_and_origin
from labkit.results.of_records import OfRecords
from labkit.results.selections import find_records, require_records
from labkit.sff.budget import PARTS, error_budget
from labkit.sff.c0 import sff_stress, sff_stress_by_volume
from labkit.sff.family import FORMS, stress


@xr.register_dataset_accessor("lab")
class Lab(OfRecords):
    """Statistics of a run that was opened with `open_run`, available as `run.lab`."""

    @functools.cached_property
    def scene(self) -> Scene:
        """Scene of the run."""
        return Scene.from_json(self._run.attrs["scene"])

    @functools.cached_property
    def _radius(self) -> np.ndarray:
        return self._run["radius"].values

    @functools.cached_property
    def body_radius(self) -> np.ndarray:
        """Radii of the grains, or of spheres with the same volumes as the clumps, (body,), m."""
        bodies = bodies_in_run(self._run.isel(snapshot=slice(0)))  # volumes are constant: no snapshot is read
        return self._radius if bodies is None else bodies.equivalent_radius(self._radius)

    @property
    def has_clumps(self) -> bool:
        """True if some grains are clumps of several spheres."""
        return len(self.body_radius) < len(self._radius)

    def _require_grains(self) -> None:
        """Raise InputError for a prediction of the model or a measured test."""
        if not self.number_of_grains:
            raise InputError(f"{path_and_origin(self._run.attrs)}, has no grains: give the run of a simulation")

    @property
    def contents(self) -> str:
        """What the cell holds, as text: `400 grains` or `302 clumps`."""
        return f"{self.number_of_grains} {'clumps' if 'clump' in self._run.sizes else 'grains'}"

    @property
    def number_of_snapshots(self) -> int:
        """Number of snapshots, the records with contacts."""
        return self._run.sizes["snapshot"]

    def at_snapshots(self, name: str) -> xr.DataArray:
        """Return the values of a recorded variable at the snapshots, dimension `snapshot`."""
        return self._run[name].isel(time=self._run["record"].copy(data=self.snapshot_records()))

    def snapshot_records(self) -> np.ndarray:
        """Return the index along `time` of each snapshot's record, (snapshot,). Raises InputError if one is missing."""
        return require_records(self._run)

    def to_dataframe(self, units: bool = False) -> pandas.DataFrame:
        """Return the records as a pandas.DataFrame, one row per record; contacts and grains are not read.

        Columns: `time`, `axial_strain`, `p`, `q`, `q_over_p`, then every recorded variable; vectors and tensors have
        one column per component (`stress_xx`, `stress_xy`, ...). SI units; `units=True` appends the unit to each
        column name, e.g. `p [Pa]`. Use this method instead of xarray's `run.to_dataframe()`, which builds a
        row for every combination of record, contact and grain and runs out of memory.
        """
        derived = {"p": self.mean_stress(), "q": self.q(), "q_over_p": self.stress_ratio()}
        first = {name: self._run[name] for name in ("time", "axial_strain")}
        recorded = {str(name): self._run[name] for name, v in self._run.variables.items() if v.dims[:1] == ("time",)}
        return tables.table({**first, **derived, **recorded}, units)

    def contacts_table(self, snapshot: int, units: bool = False) -> pandas.DataFrame:
        """Return the contacts of one snapshot as a pandas.DataFrame, one row each; columns as in `to_dataframe`.

        `contact_grain_1` and `contact_grain_2` are the indices of the two grains, from 0.
        """
        contacts = self.contacts(snapshot)
        return tables.table({str(name): contacts[name] for name in contacts.data_vars}, units)

    def contacts(self, snapshot: int) -> xr.Dataset:
        """Return the contacts of one snapshot, a Dataset along `contact`; only these contacts are read.

        A negative `snapshot` counts from the end. The run may be a selection of records and snapshots, but not of
        contacts.
        """
        self.require_snapshots([snapshot])
        names = [n for n, v in self._run.data_vars.items() if "contact" in v.dims]
        start, size = (int(self._run[name].values[snapshot]) for name in ("row_start", "row_size"))
        return self._run[names].isel(contact=slice(start, start + size))

    def snapshot(self, number: int) -> Snapshot:
        """Return one Snapshot, the argument of every statistic; no other snapshot is read.

        A negative `number` counts from the end. Raises InputError if the run has no such snapshot.
        """
        self.require_snapshots([number])
        number = range(self.number_of_snapshots)[number]
        stored, at = self.contacts(number), self._run.isel(snapshot=number)
        names = ("contact_grain", "normal", "overlap", "normal_force", "tangential_force", "rolling_moment")
        file = self._run.encoding.get("source", "this run")
        with name_damage(file):
            further = [name for name in self.scene.contact_law.columns if name not in names and name in stored]
            columns = {name: tables.in_double(stored[name].values) for name in further}
            values = {name: tables.in_double(stored[name].values) for name in names}
            contacts = Contacts(values.pop("contact_grain"), **values, columns=columns)
        try:
            require_contacts(contacts, len(self._radius))
            bodies = bodies_in_run(at)
        except ValueError as error:
            wrong = error.finding if isinstance(error, ImpossibleError) else error
            raise InputError(f"{file} is damaged ({wrong} in snapshot {number}): repeat the run") from None
        of_grains = Snapshot(
            self.scene,
            self._radius,
            at["snapshot_cell"].values,
            contacts,
            tables.in_double(at["position"].values) if "position" in at else None,
            float(at["snapshot_time"]) if "snapshot_time" in at else 0.0,
            float(at["snapshot_strain"]),
            number=number,
        )
        return snapshot_of_bodies(of_grains, bodies)

    def snapshots(self, numbers: Iterable[int] | None = None) -> Iterator[Snapshot]:
        """Yield the Snapshots with these numbers, by default all; only one is in memory at a time.

        Raises InputError if the run has no such snapshot.
        """
        return (self.snapshot(k) for k in (range(self.number_of_snapshots) if numbers is None else numbers))

    def require_snapshots(self, numbers: Iterable[int] = (-1,), instead: str = "") -> None:
        """Raise InputError unless the run has snapshots with these numbers, counted from the end if negative.

        `instead` is an alternative to suggest to the user if the run has no snapshot.
        """
        count, file = self.number_of_snapshots, self._run.encoding.get("source", "this run")
        if not count:
            raise InputError(f"{file} holds no contacts: give a run with snapshots{instead}")
        for k in numbers:
            if not -count <= k < count:
                raise InputError(
                    f"is not in {file}, which has {count}",
                    field="snapshot",
                    value=k,
                    allowed=f"a number from 0 to {count - 1}, or from -{count} to -1, counted from the end",
                )

    def _without_contacts(self) -> Snapshot:
        """Return a Snapshot of the grains without contacts, in a cell of 1 m3."""
        return Snapshot(self.scene, self.body_radius, np.eye(3), NO_CONTACTS)

    def over_snapshots(
        self,
        function: Callable[[Snapshot], Mapping[str, object]],
        attributes: Mapping[str, Mapping[str, object]] | None = None,
        coords: Mapping[str, object] | None = None,
    ) -> xr.Dataset:
        """Apply a function to every snapshot, one in memory at a time; returns a Dataset along `snapshot`.

        The function has the signature

            def function(snapshot: labkit.Snapshot) -> dict[str, float | np.ndarray | tuple]:

        and returns the same names for every snapshot. A value is a number, a tensor (3, 3), or, for any other shape,
        a tuple (dimensions, array), e.g. `{"size": (("grain",), snapshot.radius)}`. For a run without snapshots the
        variables have length 0; the function is then called once, without contacts, to find their names and shapes.
        Raises InputError for an array of any other shape without its dimensions, and for a run without grains.

        Args:
            function: The function to apply.
            attributes: Attributes of the variables, e.g. `{"size": {"units": "m"}}`.
            coords: Coordinates, as for xarray.Dataset.
        """
        self._require_grains()
        results = [function(snapshot) for snapshot in self.snapshots()]
        shapes = results or [function(self._without_contacts())]
        columns = {}
        for name, first in shapes[0].items():
            dimensions = _with_dimensions(name, first)[0]
            values = np.array([_with_dimensions(name, each[name])[1] for each in shapes])[: len(results)]
            columns[name] = (("snapshot", *dimensions), values, (attributes or {}).get(name))
        result = xr.Dataset(columns, coords={**self._snapshot_coordinates(), **(coords or {})})
        return tables.with_axes(result)

    def statistics(self) -> xr.Dataset:
        """Return Z, A, Lambda, F and F^t from the contacts (Eqs. 10, 24, 25, 27), a Dataset along `snapshot`.

        For grains that are not spheres, G, M and X are included (labkit.micro.eccentricity).

        F^t, the `mobilisation`, is the tangential counterpart of F: the mean of normal (x) tangential force over all
        directions, relative to the mean normal force. It grows as the contacts approach their friction limit.
        """
        names = [*(f.name for f in dataclasses.fields(Statistics)), *ECCENTRICITY]
        attributes = {name: (RECORD | ECCENTRICITY)[name].attributes for name in names}
        return self.over_snapshots(lambda snapshot: statistics(snapshot).by_name(), attributes)

    def love_stress(self) -> xr.DataArray:
        """Return Love's stress (Eq. 4) from the contacts, DataArray (snapshot, i, j), Pa, compression positive."""
        return self._stress_of(love_stress, "Love's stress from the contacts")

    def sff_stress(self) -> xr.DataArray:
        """Return the C0 stress of the contacts as a DataArray (snapshot, i, j) in Pa; compression is positive."""
        return self._stress_of(sff_stress, "stress according to C0 from the contacts")

    def sff_stress_by_volume(self) -> xr.DataArray:
        """Return the stress by the equation by volume from the contacts, DataArray (snapshot, i, j), Pa."""
        return self._stress_of(sff_stress_by_volume, "stress according to the equation by volume from the contacts")

    def _stress_of(
        self, function: Callable[[Snapshot], np.ndarray], long_name: str, **along: Sequence[str]
    ) -> xr.DataArray:
        """Return a stress of every snapshot; `along` is the dimension of several of them, with its labels."""
        attributes = {"stress": {"units": "Pa", "long_name": long_name}}
        stresses = self.over_snapshots(lambda s: {"stress": ((*along, "i", "j"), function(s))}, attributes, along)
        return stresses["stress"].rename(None)

    def sff_family(self, forms: Sequence[str] = tuple(FORMS)) -> xr.DataArray:
        """Return the stress according to each of labkit.sff.family.FORMS, DataArray (snapshot, form, i, j), Pa."""
        long_name = "stress according to a stress-force-fabric relationship"
        return self._stress_of(
            lambda s: np.reshape([stress(form, s) for form in forms], (-1, 3, 3)), long_name, form=list(forms)
        )

    def error_budget(self, e: str = "nominal", with_lambda: bool = True) -> xr.DataArray:
        """Return the contributions to C0 - Love, which add up to it, DataArray (snapshot, part, i, j), Pa.

        The arguments are the same as for labkit.sff.budget.error_budget.
        """

        def errors(snapshot: Snapshot) -> np.ndarray:
            parts = error_budget(snapshot, e, with_lambda)
            return np.array([parts[name] for name in PARTS])

        return self._stress_of(errors, "part of C0 - Love", part=list(PARTS))

    def size_groups(self, groups: int = 5, edges: np.ndarray | None = None) -> xr.Dataset:
        """Return stresses by grain size (Eqs. 13-18): the fields of GroupStresses along `snapshot` and `group`.

        Give the number of equal diameter intervals (`groups`) or the limits of the intervals, m (`edges`). The
        coordinate `diameter` is the middle of each interval, m.
        """
        self._require_grains()
        grains = self._without_contacts()
        edges = diameter_edges(grains, groups) if edges is None else edges
        group, edges = groups_by_diameter(grains, edges), np.asarray(edges, dtype=float)

        def stresses(snapshot: Snapshot) -> dict[str, object]:
            values = group_stresses(snapshot, group, len(edges) - 1)
            names = [*vars(values), "by_volume"]
            return {name: (("group", "i", "j")[: getattr(values, name).ndim], getattr(values, name)) for name in names}

        units = {name: {"units": "Pa"} for name in ("per_contact", "per_volume")}
        middle = ("group", 0.5 * (edges[1:] + edges[:-1]), {"units": "m", "long_name": "grain diameter"})
        return self.over_snapshots(stresses, units, {"diameter": middle})

    def strong_networks(self) -> xr.Dataset:
        """Return fractions of strong contact sides, and of q and p that these carry, (snapshot, definition)."""

        def shares(snapshot: Snapshot) -> dict[str, object]:
            masks = strong_by_force(snapshot), strong_by_normalised_force(snapshot)
            whole = network_stress(snapshot, np.ones((len(snapshot.contacts), 2), dtype=bool))
            parts = [network_stress(snapshot, mask) for mask in masks]
            with np.errstate(divide="ignore", invalid="ignore"):
                values = {
                    "fraction": [mask.mean() if mask.size else np.nan for mask in masks],
                    "share_of_q": self.part_of_q(np.array(parts), whole) / self.part_of_q(whole, whole),
                    "share_of_p": np.array([mean_stress(x) for x in parts]) / mean_stress(whole),
                }
            return {name: (("definition",), value) for name, value in values.items()}

        units = {name: {"units": "1"} for name in ("fraction", "share_of_q", "share_of_p")}
        return self.over_snapshots(shares, units, {"definition": ["force", "normalised force"]})

    def contact_lives(self) -> xr.Dataset:
        """Return birth and death of each contact as observed at the snapshots, a Dataset along `life`.

        `pair` (life, side) holds the two grains, `birth` the first snapshot with the contact and `death` the first
        snapshot without it. `alive` is True if the contact still exists at the last snapshot, so its death is
        unknown. `birth_strain` is the strain at birth, and `lifetime` the strain accumulated until death, or until the
        last snapshot if alive.
        """
        lives, strain = self._lives, self.accumulated_strain().values[self.snapshot_records()]
        alive = lives.death == self.number_of_snapshots
        end = strain[np.minimum(lives.death, len(strain) - 1)] if len(strain) else np.zeros(0)
        return xr.Dataset(
            {
                "pair": (("life", "side"), lives.pair),
                "birth": ("life", lives.birth),
                "death": ("life", lives.death),
                "alive": ("life", alive),
                "birth_strain": ("life", strain[lives.birth], {"units": "1"}),
                "lifetime": ("life", end - strain[lives.birth], {"units": "1"}),
            }
        )

    def contact_changes(self) -> xr.Dataset:
        """Return contacts gained, lost and kept since the previous snapshot, and their mean age, along `snapshot`."""
        lives, strain = self._lives, self.accumulated_strain().values[self.snapshot_records()]
        with np.errstate(invalid="ignore", divide="ignore"):
            age = lives.age_sum(strain) / lives.contacts
        columns = {name: ("snapshot", getattr(lives, name)) for name in ("contacts", "gained", "lost", "kept")}
        return xr.Dataset(
            {**columns, "mean_age": ("snapshot", age, {"units": "1"})},
            coords={**self._snapshot_coordinates(), "accumulated_strain": ("snapshot", strain, {"units": "1"})},
        )

    @functools.cached_property
    def _lives(self) -> Lives:
        pairs = (self.contacts(k)["contact_grain"].values for k in range(self.number_of_snapshots))
        return follow(pairs, len(self._radius))

    def _snapshot_coordinates(self) -> dict[str, object]:
        records = find_records(self._run)
        coordinates: dict[str, object] = {"axial_strain": ("snapshot", self._run["snapshot_strain"].values)}
        if (records >= 0).all():
            coordinates["strain"] = ("snapshot", np.atleast_1d(self.strain())[records])
        return coordinates


def _with_dimensions(name: str, value: Any) -> tuple[tuple[str, ...], object]:
    """Return (dimensions, values) of a number or tensor (3, 3); a value with dimensions is returned unchanged."""
    if isinstance(value, tuple):
        return value
    shape = np.shape(value)
    if shape not in ((), (3, 3)):
        raise InputError(f"{name} has the shape {shape}: return (dimensions, values), e.g. (('grain',), values)")
    return ("i", "j")[: len(shape)], value
