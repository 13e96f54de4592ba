"""Run and state files as xarray objects, and the accessor `.lab` that computes from contacts."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import xarray as xr

from labkit.errors import InputError
from labkit.io.files import open_netcdf
from labkit.micro.contacts import NO_CONTACTS, Contacts
from labkit.micro.fabric import Statistics, statistics
from labkit.micro.networks import follow, network_stress
from labkit.micro.normalised import normalised_normal_force, strong_by_force, strong_by_normalised_force
from labkit.micro.size_groups import diameter_edges, group_stresses, groups_by_diameter
from labkit.micro.stress import deviatoric_stress, love_stress, mean_stress, relative_error
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.dem.paths import travelled
from labkit.dem.scene import Scene
from labkit.sff.c0 import TERMS, sff_stress, strength_shares
from labkit.sff.budget import PARTS, error_budget
from labkit.sff.family import FORMS, stress


def open_run(path):
    """A run file as one lazy xarray.Dataset.

    Dimensions: `time` (records; coordinates `axial_strain`, `time`), `snapshot` (records with contacts),
    `contact` (ragged: `row_size` contacts per snapshot), `grain`, `side`, `i`, `j`. Every variable of the
    groups `contacts` and `grains` is there under its own name with its units. Raises InputError.
    """
    with open_netcdf(path, "run"):
        pass
    parts = [xr.open_dataset(path, group=group, decode_times=False) for group in (None, "contacts", "grains")]
    run = xr.merge(parts, compat="no_conflicts", join="exact", combine_attrs="override")
    starts = np.concatenate([[0], np.cumsum(run["row_size"].values)[:-1]])
    run = run.assign_coords(
        row_start=("snapshot", starts[: run.sizes["snapshot"]], {"units": "1", "long_name": "first contact row"}),
        snapshot_volume=("snapshot", run["volume"].values[run["record"].values], run["volume"].attrs),
        snapshot_strain=("snapshot", run["axial_strain"].values[run["record"].values], run["axial_strain"].attrs),
    )
    run = run.set_coords([name for name in ("time", "axial_strain") if name in run])
    run.encoding["source"] = str(path)
    return run


def require_snapshots(run, file, numbers, instead=""):
    """Raises InputError unless the run has contacts, and snapshots of these numbers, from the end if negative."""
    count = run.sizes["snapshot"]
    if not count:
        raise InputError(f"{file} holds no contacts: give a run with snapshots{instead}")
    for k in numbers:
        if not -count <= k < count:
            raise InputError(
                f"--snapshot {k} is not in {file}: it has {count}, count from 0, or from the end with negative numbers"
            )


def open_state(path):
    """A state file as one lazy xarray.Dataset with the names of labkit.io.schema.STATE. Raises InputError."""
    with open_netcdf(path, "state"):
        pass
    return xr.open_dataset(path, decode_times=False)


@xr.register_dataset_accessor("lab")
class Lab:
    """Computes from the contacts of a run opened with `open_run`, as `run.lab`."""

    def __init__(self, run):
        self._run = run

    @functools.cached_property
    def scene(self):
        """The Scene of the run."""
        return Scene.from_json(self._run.attrs["scene"])

    @functools.cached_property
    def _radius(self):
        return self._run["radius"].values

    @property
    def number_of_snapshots(self):
        return self._run.sizes["snapshot"]

    def at_snapshots(self, name):
        """A recorded variable at the records that are snapshots, dimension `snapshot`."""
        return self._run[name].isel(time=self._run["record"])

    def contacts(self, snapshot):
        """The contacts of one snapshot as a Dataset along `contact`; only these are read.

        `snapshot`: position along the dimension, from the end if negative. The dataset may be a selection of
        records and snapshots, not of contacts.
        """
        names = [n for n, v in self._run.data_vars.items() if "contact" in v.dims]
        start, size = (int(self._run[name].values[snapshot]) for name in ("row_start", "row_size"))
        return self._run[names].isel(contact=slice(start, start + size))

    def contact_arrays(self, snapshot):
        """The same as labkit.micro.contacts.Contacts, for the functions of labkit.micro."""
        found = self.contacts(snapshot)
        return Contacts(
            found["contact_grain"].values, found["normal"].values, found["overlap"].values,
            found["normal_force"].values, found["tangential_force"].values, found["rolling_moment"].values,
        )  # fmt: skip

    def normalised_contacts(self, snapshot):
        """The contacts of one snapshot with Lambda_n (contact, side) and whether a side is strong, either way."""
        contacts = self.contact_arrays(snapshot)
        both = ("contact", "side")
        normalised = normalised_normal_force(self._radius, contacts, self.scene.young_modulus)
        return self.contacts(snapshot).assign(
            normalised_normal_force=(both, normalised, {"units": "1", "long_name": "normalised force Lambda_n"}),
            strong_by_force=(both, strong_by_force(contacts), {"long_name": "normal force above its mean"}),
            strong_by_normalised_force=(
                both, strong_by_normalised_force(self._radius, contacts), {"long_name": "Lambda_n above its mean"},
            ),
        )  # fmt: skip

    def over_snapshots(self, function, attributes=None, coords=None):
        """Any function of contacts over the whole run, a Dataset along `snapshot`. Holds one snapshot at a time.

        `function(contacts, radius, volume, young_modulus)` returns name -> (dimensions, values);
        `attributes`: name -> attributes; `coords` as in xarray.Dataset.
        """
        volume, E = self._run["snapshot_volume"].values, self.scene.young_modulus
        found = [
            function(self.contact_arrays(k), self._radius, float(volume[k]), E) for k in range(self.number_of_snapshots)
        ]
        shapes = found or [function(NO_CONTACTS, self._radius, 1.0, E)]  # names and shapes where there is no snapshot
        columns = {
            name: (("snapshot", *dimensions), np.array([one[name][1] for one in shapes])[: len(found)],
                   (attributes or {}).get(name))
            for name, (dimensions, _) in shapes[0].items()
        }  # fmt: skip
        return xr.Dataset(columns, coords={**self._snapshot_coordinates(), **(coords or {})})

    def statistics(self):
        """Z, A, Lambda, F, F^t from the contacts (Eqs. 10, 24, 25, 27), a Dataset along `snapshot`."""

        def of(contacts, radius, volume, young_modulus):
            values = vars(statistics(contacts, radius, young_modulus))
            return {name: (("i", "j")[: 2 * bool(np.ndim(value))], value) for name, value in values.items()}

        return self.over_snapshots(of, {f.name: {"units": "1"} for f in dataclasses.fields(Statistics)})

    def love_stress(self):
        """Love's stress (Eq. 4) from the contacts, DataArray (snapshot, i, j), Pa, compression positive."""

        def of(contacts, radius, volume, young_modulus):
            return {"stress": (("i", "j"), love_stress(contacts, radius, volume))}

        name = {"units": "Pa", "long_name": "stress after Love from the contacts"}
        return self.over_snapshots(of, {"stress": name})["stress"].rename(None)

    def sff_family(self, forms=tuple(FORMS)):
        """Stress after each of labkit.sff.family.FORMS, DataArray (snapshot, form, i, j), Pa."""

        def of(contacts, radius, volume, young_modulus):
            values = [stress(form, contacts, radius, volume, young_modulus) for form in forms]
            return {"stress": (("form", "i", "j"), np.reshape(values, (-1, 3, 3)))}

        name = {"units": "Pa", "long_name": "stress after a stress-force-fabric relationship"}
        return self.over_snapshots(of, {"stress": name}, {"form": list(forms)})["stress"].rename(None)

    def error_budget(self, **choices):
        """The parts of C0 - Love (labkit.sff.budget), DataArray (snapshot, part, i, j), Pa; they add up to it."""

        def of(contacts, radius, volume, young_modulus):
            parts = error_budget(contacts, radius, volume, young_modulus, **choices)
            return {"error": (("part", "i", "j"), np.array([parts[name] for name in PARTS]))}

        name = {"units": "Pa", "long_name": "part of C0 - Love"}
        return self.over_snapshots(of, {"error": name}, {"part": list(PARTS)})["error"].rename(None)

    def size_groups(self, groups=5, edges=None):
        """Stresses by grain size (Eqs. 13-18), a Dataset along `snapshot` and `group`, as GroupStresses.

        `groups`: number of equal intervals of the diameter; or their `edges`, m. Coordinate `diameter`: the middle
        of each interval, m.
        """
        edges = diameter_edges(self._radius, groups) if edges is None else np.asarray(edges, dtype=float)
        group = groups_by_diameter(self._radius, edges)

        def of(contacts, radius, volume, young_modulus):
            found = group_stresses(contacts, radius, volume, group, len(edges) - 1)
            names = [*vars(found), "by_volume"]
            return {name: (("group", "i", "j")[: getattr(found, name).ndim], getattr(found, name)) for name in names}

        units = {name: {"units": "Pa"} for name in ("per_contact", "per_volume")}
        middle = ("group", 0.5 * (edges[1:] + edges[:-1]), {"units": "m", "long_name": "grain diameter"})
        return self.over_snapshots(of, units, {"diameter": middle})

    def strong_networks(self):
        """Share of the strong contact sides, and of q and p that they carry, a Dataset (snapshot, definition)."""

        def of(contacts, radius, volume, young_modulus):
            masks = strong_by_force(contacts), strong_by_normalised_force(radius, contacts)
            whole = network_stress(contacts, radius, volume, np.ones((len(contacts), 2), dtype=bool))
            parts = [network_stress(contacts, radius, volume, mask) for mask in masks]
            with np.errstate(divide="ignore", invalid="ignore"):
                return {
                    "fraction": (("definition",), [mask.mean() if mask.size else np.nan for mask in masks]),
                    "share_of_q": (
                        ("definition",), np.array([deviatoric_stress(x) for x in parts]) / deviatoric_stress(whole)
                    ),
                    "share_of_p": (("definition",), np.array([mean_stress(x) for x in parts]) / mean_stress(whole)),
                }  # fmt: skip

        units = {name: {"units": "1"} for name in ("fraction", "share_of_q", "share_of_p")}
        return self.over_snapshots(of, units, {"definition": ["force", "normalised force"]})

    def contact_lives(self):
        """Each contact from its birth to its death, as seen at the snapshots: a Dataset along `life`.

        `pair` (life, side): grains; `birth` and `death`: snapshots, `death` the first one without it; `alive`: it is
        there at the last snapshot, and its death is not known; `birth_strain`, `lifetime` (axial strain travelled
        until the last snapshot with it is past).
        """
        lives, way = self._lives, self._travelled()
        alive = lives.death == self.number_of_snapshots
        end = way[np.minimum(lives.death, len(way) - 1)] if len(way) else np.zeros(0)
        return xr.Dataset({
            "pair": (("life", "side"), lives.pair), "birth": ("life", lives.birth), "death": ("life", lives.death),
            "alive": ("life", alive), "birth_strain": ("life", way[lives.birth], {"units": "1"}),
            "lifetime": ("life", end - way[lives.birth], {"units": "1"}),
        })  # fmt: skip

    def contact_changes(self):
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

    def strength_shares(self):
        """What A, F, F^t and the product of A and F add to q/p of C0, DataArray (term, time)."""
        names = ("contact_anisotropy", "normal_force_anisotropy", "mobilisation")
        shares = strength_shares(*(self._run[name].values for name in names))
        return xr.DataArray(
            np.array([shares[term] for term in TERMS]), dims=("term", "time"),
            coords={"term": list(TERMS), "axial_strain": ("time", self._run["axial_strain"].values)},
            attrs={"units": "1", "long_name": "share of q/p after C0"},
        )  # fmt: skip

    def sff_stress(self):
        """Stress after C0 from the contacts, DataArray (snapshot, i, j), Pa, compression positive."""
        found = self.statistics()
        values = sff_stress(
            self.scene.young_modulus,
            found["coordination_number"].values,
            found["mean_normalised_force"].values,
            void_ratio_nominal(self._radius, self._run["snapshot_volume"].values),
            found["contact_anisotropy"].values,
            found["normal_force_anisotropy"].values,
            found["mobilisation"].values,
        )
        return self._stress_array(values, "stress after C0 from the contacts")

    def sff_error(self):
        """Frobenius norm of C0 - Love over that of Love at every record, DataArray (time)."""
        error = relative_error(self._run["stress_sff"].values, self._run["stress"].values)
        return self._run["axial_strain"].copy(data=error).rename("sff_error").assign_attrs(
            units="1", long_name="error of C0 against Love"
        )

    def mean_stress(self, name="stress"):
        """p of a recorded stress, DataArray (time), Pa."""
        return self._scalar(mean_stress(self._run[name].values), "mean stress p")

    def deviatoric_stress(self, name="stress"):
        """q of a recorded stress, DataArray (time), Pa."""
        return self._scalar(deviatoric_stress(self._run[name].values), "deviatoric stress q")

    def _scalar(self, values, long_name):
        return self._run["axial_strain"].copy(data=values).rename(None).assign_attrs(units="Pa", long_name=long_name)

    def _snapshot_coordinates(self):
        return {"axial_strain": ("snapshot", self._run["snapshot_strain"].values)}

    def _stress_array(self, values, long_name):
        values = np.asarray(values, dtype=float).reshape(-1, 3, 3)
        return xr.DataArray(
            values, dims=("snapshot", "i", "j"), coords=self._snapshot_coordinates(),
            attrs={"units": "Pa", "long_name": long_name},
        )  # fmt: skip
