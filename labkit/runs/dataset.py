"""Run and state files as xarray objects, and the accessor `.lab` that computes from contacts."""

from __future__ import annotations

import dataclasses
import functools
import os
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import xarray as xr

from labkit.dem.paths import travelled
from labkit.dem.scene import Scene
from labkit.dem.state import read_state
from labkit.errors import InputError
from labkit.io.files import labkit_kind, open_netcdf
from labkit.io.schema import RECORD
from labkit.micro.contacts import NO_CONTACTS, Contacts
from labkit.micro.fabric import Statistics, statistics
from labkit.micro.networks import follow, network_stress
from labkit.micro.normalised import normalised_normal_force, strong_by_force, strong_by_normalised_force
from labkit.micro.size_groups import diameter_edges, group_stresses, groups_by_diameter
from labkit.micro.snapshot import Snapshot
from labkit.micro.stress import deviatoric_stress, love_stress, mean_stress, relative_error
from labkit.sff.budget import PARTS, error_budget
from labkit.sff.c0 import TERMS, sff_stress, strength_shares
from labkit.sff.family import FORMS, stress


def open_run(path: str | os.PathLike) -> xr.Dataset:
    """A run file as one lazy xarray.Dataset.

    Dimensions: `time` (records; coordinates `axial_strain`, `time`), `snapshot` (records with contacts),
    `contact` (ragged: `row_size` contacts per snapshot), `grain`, `side`, `i`, `j`. Every variable of the
    groups `contacts` and `grains` is there under its own name with its units. Raises InputError.
    """
    with open_netcdf(path, "run") as dataset:
        _require_scene(path, dataset.scene)
    parts = [xr.open_dataset(path, group=group, decode_times=False) for group in (None, "contacts", "grains")]
    run = xr.merge(parts, compat="no_conflicts", join="exact", combine_attrs="override")
    starts, record = np.concatenate([[0], np.cumsum(run["row_size"].values)[:-1]]), run["record"].values
    run = run.assign_coords(
        row_start=("snapshot", starts[: run.sizes["snapshot"]], {"units": "1", "long_name": "first contact row"}),
        snapshot_cell=(("snapshot", "i", "j"), run["cell"].values[record], run["cell"].attrs),
        snapshot_strain=("snapshot", run["axial_strain"].values[record], run["axial_strain"].attrs),
    )
    if "time" in run:
        run = run.assign_coords(snapshot_time=("snapshot", run["time"].values[record], run["time"].attrs))
    for variable in RECORD.values():  # of an earlier version or another program: unknown, not an error
        if variable.name not in run:
            shape = [run.sizes[dimension] for dimension in variable.dimensions]
            known = {"units": variable.units, "long_name": variable.long_name}
            run[variable.name] = (variable.dimensions, np.full(shape, np.nan), known)
    run = run.set_coords(["time", "axial_strain"])
    run.encoding["source"] = str(path)
    return run


def _require_scene(path: str | os.PathLike, text: str) -> None:
    try:
        Scene.from_json(text)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def require_snapshots(run: xr.Dataset, file: str | os.PathLike, numbers: Sequence[int], instead: str = "") -> None:
    """Raises InputError unless the run has contacts, and snapshots of these numbers, from the end if negative.

    `instead`: what else the user may do if the run has no contacts.
    """
    count = run.sizes["snapshot"]
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


def open_state(path: str | os.PathLike) -> xr.Dataset:
    """A state file as one lazy xarray.Dataset with the names of labkit.io.schema.STATE. Raises InputError."""
    with open_netcdf(path, "state"):
        pass
    return xr.open_dataset(path, decode_times=False)


def snapshots(file: str | os.PathLike, numbers: Sequence[int] = ()) -> Iterator[Snapshot]:
    """The Snapshots of a file, one in memory at a time: that of a state file, the chosen or all of a run file.

    `numbers`: of the snapshots, from 0, or from the end if negative. Raises InputError if the file lacks them.
    """
    if labkit_kind(file) == "state":
        if numbers:
            raise InputError(
                f"is for run files, and {file} is a state file: leave it out", field="snapshot", value=numbers[0]
            )
        return (read_state(file).snapshot() for _ in range(1))
    run = open_run(file)
    require_snapshots(run, file, numbers, ", or a state file")
    return run.lab.snapshots(numbers)


@xr.register_dataset_accessor("lab")
class Lab:
    """Computes from the contacts of a run opened with `open_run`, as `run.lab`."""

    def __init__(self, run: xr.Dataset) -> None:
        """xarray makes it when `run.lab` is first used."""
        self._run = run

    @functools.cached_property
    def scene(self) -> Scene:
        """The Scene of the run."""
        return Scene.from_json(self._run.attrs["scene"])

    @functools.cached_property
    def _radius(self):
        return self._run["radius"].values

    @property
    def number_of_snapshots(self) -> int:
        """How many records have contacts."""
        return self._run.sizes["snapshot"]

    def at_snapshots(self, name: str) -> xr.DataArray:
        """A recorded variable at the records that are snapshots, dimension `snapshot`."""
        return self._run[name].isel(time=self._run["record"])

    def contacts(self, snapshot: int) -> xr.Dataset:
        """The contacts of one snapshot as a Dataset along `contact`; only these are read.

        `snapshot`: position along the dimension, from the end if negative. The dataset may be a selection of
        records and snapshots, not of contacts.
        """
        names = [n for n, v in self._run.data_vars.items() if "contact" in v.dims]
        start, size = (int(self._run[name].values[snapshot]) for name in ("row_start", "row_size"))
        return self._run[names].isel(contact=slice(start, start + size))

    def snapshot(self, number: int) -> Snapshot:
        """One Snapshot, the argument of every statistic; only this one is read. `number`: from the end if negative."""
        number = range(self.number_of_snapshots)[number]
        contacts, at = self.contacts(number), self._run.isel(snapshot=number)
        names = ("contact_grain", "normal", "overlap", "normal_force", "tangential_force", "rolling_moment")
        return Snapshot(
            self.scene,
            self._radius,
            at["snapshot_cell"].values,
            Contacts(*(contacts[name].values for name in names)),
            at["position"].values if "position" in at else None,
            float(at["snapshot_time"]) if "snapshot_time" in at else 0.0,
            float(at["snapshot_strain"]),
            number=number,
        )

    def snapshots(self, numbers: Sequence[int] = ()) -> Iterator[Snapshot]:
        """The Snapshots of these numbers, or all, one in memory at a time."""
        return (self.snapshot(k) for k in numbers or range(self.number_of_snapshots))

    def _without_contacts(self):
        """A Snapshot of the grains alone, in a cell of 1 m3."""
        return Snapshot(self.scene, self._radius, np.eye(3), NO_CONTACTS)

    def normalised_contacts(self, snapshot: int) -> xr.Dataset:
        """The contacts of one snapshot with Lambda_n (contact, side) and whether a side is strong, either way."""
        of, both = self.snapshot(snapshot), ("contact", "side")
        return self.contacts(snapshot).assign(
            normalised_normal_force=(
                both,
                normalised_normal_force(of),
                {"units": "1", "long_name": "normalised force Lambda_n"},
            ),
            strong_by_force=(both, strong_by_force(of), {"long_name": "normal force above its mean"}),
            strong_by_normalised_force=(both, strong_by_normalised_force(of), {"long_name": "Lambda_n above its mean"}),
        )

    def over_snapshots(
        self, function: Callable[[Snapshot], dict], attributes: dict | None = None, coords: dict | None = None
    ) -> xr.Dataset:
        """Any function of a Snapshot over the whole run, a Dataset along `snapshot`. Holds one snapshot at a time.

        `function(snapshot)` returns name -> a number or a tensor (3, 3), or name -> (dimensions, values) for other
        shapes; `attributes`: name -> attributes; `coords` as in xarray.Dataset. Raises InputError for a shape without
        dimensions.
        """
        found = [function(snapshot) for snapshot in self.snapshots()]
        shapes = found or [function(self._without_contacts())]  # names and shapes where there is no snapshot
        columns = {}
        for name, first in shapes[0].items():
            dimensions = _with_dimensions(name, first)[0]
            values = np.array([_with_dimensions(name, one[name])[1] for one in shapes])[: len(found)]
            columns[name] = (("snapshot", *dimensions), values, (attributes or {}).get(name))
        return xr.Dataset(columns, coords={**self._snapshot_coordinates(), **(coords or {})})

    def statistics(self) -> xr.Dataset:
        """Z, A, Lambda, F, F^t from the contacts (Eqs. 10, 24, 25, 27), a Dataset along `snapshot`."""
        units = {f.name: {"units": "1"} for f in dataclasses.fields(Statistics)}
        return self.over_snapshots(lambda snapshot: vars(statistics(snapshot)), units)

    def love_stress(self) -> xr.DataArray:
        """Love's stress (Eq. 4) from the contacts, DataArray (snapshot, i, j), Pa, compression positive."""
        return self._stress_of(love_stress, "stress after Love from the contacts")

    def sff_stress(self) -> xr.DataArray:
        """Stress after C0 from the contacts, DataArray (snapshot, i, j), Pa, compression positive."""
        return self._stress_of(sff_stress, "stress after C0 from the contacts")

    def _stress_of(self, function, long_name):
        attributes = {"stress": {"units": "Pa", "long_name": long_name}}
        return self.over_snapshots(lambda snapshot: {"stress": function(snapshot)}, attributes)["stress"].rename(None)

    def sff_family(self, forms: Sequence[str] = tuple(FORMS)) -> xr.DataArray:
        """Stress after each of labkit.sff.family.FORMS, DataArray (snapshot, form, i, j), Pa."""

        def of(snapshot):
            values = [stress(form, snapshot) for form in forms]
            return {"stress": (("form", "i", "j"), np.reshape(values, (-1, 3, 3)))}

        name = {"units": "Pa", "long_name": "stress after a stress-force-fabric relationship"}
        return self.over_snapshots(of, {"stress": name}, {"form": list(forms)})["stress"].rename(None)

    def error_budget(self, e: str = "nominal", with_lambda: bool = True) -> xr.DataArray:
        """The parts of C0 - Love (labkit.sff.budget), DataArray (snapshot, part, i, j), Pa; they add up to it.

        `e`, `with_lambda`: as for labkit.sff.budget.error_budget.
        """

        def of(snapshot):
            parts = error_budget(snapshot, e, with_lambda)
            return {"error": (("part", "i", "j"), np.array([parts[name] for name in PARTS]))}

        name = {"units": "Pa", "long_name": "part of C0 - Love"}
        return self.over_snapshots(of, {"error": name}, {"part": list(PARTS)})["error"].rename(None)

    def size_groups(self, groups: int = 5, edges: np.ndarray | None = None) -> xr.Dataset:
        """Stresses by grain size (Eqs. 13-18), a Dataset along `snapshot` and `group`, as GroupStresses.

        `groups`: number of equal intervals of the diameter; or their `edges`, m. Coordinate `diameter`: the middle
        of each interval, m.
        """
        grains = self._without_contacts()
        edges = diameter_edges(grains, groups) if edges is None else np.asarray(edges, dtype=float)
        group = groups_by_diameter(grains, edges)

        def of(snapshot):
            found = group_stresses(snapshot, group, len(edges) - 1)
            names = [*vars(found), "by_volume"]
            return {name: (("group", "i", "j")[: getattr(found, name).ndim], getattr(found, name)) for name in names}

        units = {name: {"units": "Pa"} for name in ("per_contact", "per_volume")}
        middle = ("group", 0.5 * (edges[1:] + edges[:-1]), {"units": "m", "long_name": "grain diameter"})
        return self.over_snapshots(of, units, {"diameter": middle})

    def strong_networks(self) -> xr.Dataset:
        """Share of the strong contact sides, and of q and p that they carry, a Dataset (snapshot, definition)."""

        def of(snapshot):
            masks = strong_by_force(snapshot), strong_by_normalised_force(snapshot)
            whole = network_stress(snapshot, np.ones((len(snapshot.contacts), 2), dtype=bool))
            parts = [network_stress(snapshot, mask) for mask in masks]
            with np.errstate(divide="ignore", invalid="ignore"):
                shares = {
                    "fraction": [mask.mean() if mask.size else np.nan for mask in masks],
                    "share_of_q": np.array([deviatoric_stress(x) for x in parts]) / deviatoric_stress(whole),
                    "share_of_p": np.array([mean_stress(x) for x in parts]) / mean_stress(whole),
                }
            return {name: (("definition",), values) for name, values in shares.items()}

        units = {name: {"units": "1"} for name in ("fraction", "share_of_q", "share_of_p")}
        return self.over_snapshots(of, units, {"definition": ["force", "normalised force"]})

    def contact_lives(self) -> xr.Dataset:
        """Each contact from its birth to its death, as seen at the snapshots: a Dataset along `life`.

        `pair` (life, side): grains; `birth` and `death`: snapshots, `death` the first one without it; `alive`: it is
        there at the last snapshot, and its death is not known; `birth_strain`, `lifetime` (axial strain travelled
        until the last snapshot with it is past).
        """
        lives, way = self._lives, self._travelled()
        alive = lives.death == self.number_of_snapshots
        end = way[np.minimum(lives.death, len(way) - 1)] if len(way) else np.zeros(0)
        return xr.Dataset(
            {
                "pair": (("life", "side"), lives.pair),
                "birth": ("life", lives.birth),
                "death": ("life", lives.death),
                "alive": ("life", alive),
                "birth_strain": ("life", way[lives.birth], {"units": "1"}),
                "lifetime": ("life", end - way[lives.birth], {"units": "1"}),
            }
        )

    def contact_changes(self) -> xr.Dataset:
        """Contacts gained, lost and kept since the snapshot before, and their mean age, a Dataset along `snapshot`.

        `mean_age`: axial strain travelled since the birth of a contact, mean over the contacts.
        """
        lives, way = self._lives, self._travelled()
        with np.errstate(invalid="ignore", divide="ignore"):
            age = lives.age_sum(way) / lives.contacts
        columns = {name: ("snapshot", getattr(lives, name)) for name in ("contacts", "gained", "lost", "kept")}
        return xr.Dataset(
            {**columns, "mean_age": ("snapshot", age, {"units": "1"})},
            coords={**self._snapshot_coordinates(), "travelled": ("snapshot", way, {"units": "1"})},
        )

    @functools.cached_property
    def _lives(self):
        pairs = (self.contacts(k)["contact_grain"].values for k in range(self.number_of_snapshots))
        return follow(pairs, len(self._radius))

    def _travelled(self):
        """Axial strain travelled until each snapshot; it grows through reversals."""
        return travelled(self._run["axial_strain"].values)[self._run["record"].values]

    def strength_shares(self) -> xr.DataArray:
        """What A, F, F^t and the product of A and F add to q/p of C0, DataArray (term, time)."""
        names = ("contact_anisotropy", "normal_force_anisotropy", "mobilisation")
        shares = strength_shares(*(self._run[name].values for name in names))
        return xr.DataArray(
            np.array([shares[term] for term in TERMS]),
            dims=("term", "time"),
            coords={"term": list(TERMS), "axial_strain": ("time", self._run["axial_strain"].values)},
            attrs={"units": "1", "long_name": "share of q/p after C0"},
        )

    def sff_error(self) -> xr.DataArray:
        """Frobenius norm of C0 - Love over that of Love at every record, DataArray (time)."""
        error = relative_error(self._run["stress_sff"].values, self._run["stress"].values)
        return (
            self._run["axial_strain"]
            .copy(data=error)
            .rename("sff_error")
            .assign_attrs(units="1", long_name="error of C0 against Love")
        )

    def mean_stress(self, name: str = "stress") -> xr.DataArray:
        """p of a recorded stress, DataArray (time), Pa."""
        return self._scalar(mean_stress(self._run[name].values), "mean stress p")

    def deviatoric_stress(self, name: str = "stress") -> xr.DataArray:
        """q of a recorded stress, DataArray (time), Pa."""
        return self._scalar(deviatoric_stress(self._run[name].values), "deviatoric stress q")

    def _scalar(self, values, long_name):
        return self._run["axial_strain"].copy(data=values).rename(None).assign_attrs(units="Pa", long_name=long_name)

    def _snapshot_coordinates(self):
        return {"axial_strain": ("snapshot", self._run["snapshot_strain"].values)}


def _with_dimensions(name, value):
    """(dimensions, values) of a number or of a tensor (3, 3); what has dimensions already stays as it is."""
    if isinstance(value, tuple):
        return value
    shape = np.shape(value)
    if shape not in ((), (3, 3)):
        raise InputError(f"{name} has the shape {shape}: return (dimensions, values), e.g. (('grain',), values)")
    return ("i", "j")[: len(shape)], value
