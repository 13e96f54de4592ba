"""The CF conventions (1.10) beyond units and long names: title, history, comment, standard name.

Of the variables of our files only `time` has a standard name. CF requires a date in the units of a variable with that
name; ours is arbitrary, and labkit.open_run gives the time in s. Records and contacts are not geographical features, so
the files have no `featureType`. The components i and j have no coordinate variables; the comment names them.
"""

from __future__ import annotations

import netCDF4

CONVENTIONS = "CF-1.10"
EPOCH = "1970-01-01"
TIME = {"standard_name": "time", "axis": "T", "units": f"seconds since {EPOCH} 00:00:00", "calendar": "standard"}
COMMENT = "The components i and j are x, y, z, with z axial. Compression is positive."
NO_COMMAND = "created with the Python interface of labkit"


def describe(dataset: netCDF4.Dataset, title: str, history: str) -> None:
    """Write the global attributes that CF requires; `history` holds commands, one per line, or is empty."""
    dataset.Conventions = CONVENTIONS
    dataset.title = title
    dataset.comment = COMMENT
    dataset.history = history or NO_COMMAND
