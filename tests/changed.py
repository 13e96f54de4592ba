"""Files whose content a test changes, with the hash that labkit would give to the new content."""

import contextlib
from pathlib import Path

import netCDF4

from labkit.files.netcdf import set_hash


@contextlib.contextmanager
def changed(file):
    """Context with a netCDF file open for changes, or a new one; afterwards its hash is that of its content."""
    with netCDF4.Dataset(file, "a" if Path(file).exists() else "w") as dataset:
        yield dataset
        if "data_sha256" in dataset.ncattrs():
            set_hash(dataset)


def without(old, new, names):
    """A copy of a run file without some variables, `name` or `group/name`, or without a group, `group/`."""
    with netCDF4.Dataset(old) as source, changed(new) as target:
        for group in (source, *source.groups.values()):
            prefix = "" if group is source else f"{group.name}/"
            if prefix in names or prefix == "checkpoint/":
                continue
            into = target.createGroup(group.name) if prefix else target
            into.setncatts({name: group.getncattr(name) for name in group.ncattrs()})
            for name, dimension in group.dimensions.items():
                into.createDimension(name, len(dimension))
            for name, variable in group.variables.items():
                if prefix + name not in names:
                    made = into.createVariable(name, variable.dtype, variable.dimensions)
                    made.setncatts({key: variable.getncattr(key) for key in variable.ncattrs()})
                    made[...] = variable[...]
    return new
