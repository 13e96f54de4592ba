"""Run and state files as xarray objects, and the accessor `.lab` that computes from contacts."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import xarray as xr

from labkit.files import open_netcdf
from labkit.micro.contacts import Contacts
from labkit.micro.fabric import Statistics, statistics
from labkit.micro.stress import deviatoric_stress, love_stress, mean_stress, relative_error
from labkit.micro.void_ratio import void_ratio_nominal
from labkit.scene import Scene
from labkit.sff import sff_stress


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
    ).set_coords(["time", "axial_strain"])
    run.encoding["source"] = str(path)
    return run


def open_state(path):
    """A state file as one lazy xarray.Dataset with the names of labkit.schema.STATE. Raises InputError."""
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

    def statistics(self):
        """Z, A, Lambda, F, F^t from the contacts (Eqs. 10, 24, 25, 27), a Dataset along `snapshot`."""
        found = [
            statistics(self.contact_arrays(k), self._radius, self.scene.young_modulus)
            for k in range(self.number_of_snapshots)
        ]
        columns = {
            field.name: np.array([getattr(s, field.name) for s in found]).reshape(
                (-1, 3, 3) if "ndarray" in str(field.type) else -1
            )
            for field in dataclasses.fields(Statistics)
        }
        tensor = ("snapshot", "i", "j")
        return xr.Dataset(
            {name: (tensor[: values.ndim], values, {"units": "1"}) for name, values in columns.items()},
            coords=self._snapshot_coordinates(),
        )

    def love_stress(self):
        """Love's stress (Eq. 4) from the contacts, DataArray (snapshot, i, j), Pa, compression positive."""
        volume = self._run["snapshot_volume"].values
        values = [
            love_stress(self.contact_arrays(k), self._radius, volume[k]) for k in range(self.number_of_snapshots)
        ]
        return self._stress_array(values, "stress after Love from the contacts")

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
