"""Links of contacts: what joins two grains besides touching, by cohesion or by a bond.

In memory the links of n contacts are one array (n, 8); a file has a variable for each part of it, named in
labkit.io.schema.LINKS. Files of scenes without such parts, and of earlier versions, have none.
"""

from __future__ import annotations

import netCDF4
import numpy as np

from labkit.io.hashes import values_of
from labkit.io.netcdf import create_variables
from labkit.io.schema import LINKS

JOINED, BOND_LENGTH, BOND_FORCE, BOND_MOMENT = 0, 1, slice(2, 5), slice(5, 8)
WIDTH = 8
PARTS: dict[str, int | slice] = dict(zip(LINKS, (JOINED, BOND_LENGTH, BOND_FORCE, BOND_MOMENT), strict=True))


def no_links(contacts: int, joined: np.ndarray | float = 0.0) -> np.ndarray:
    """Links (n, 8) of contacts that are joined as `joined` (n,) says, and not bonded."""
    links = np.zeros((contacts, WIDTH))
    links[:, JOINED] = joined
    return links


def write_links(group: netCDF4.Dataset, links: np.ndarray | None, rows: slice) -> None:
    """Write links, unless they are None, to the rows of a group, whose variables are created if need be."""
    if links is None:
        return
    contact = group.dimensions["contact"]
    sizes = {} if contact.isunlimited() else {"contact": len(contact)}
    create_variables(group, {name: row for name, row in LINKS.items() if name not in group.variables}, sizes)
    for name, part in PARTS.items():
        group[name][rows] = links[:, part]


def read_links(group: netCDF4.Dataset, rows: slice) -> np.ndarray | None:
    """Return the links in the rows of a group; None if it has none."""
    if not all(name in group.variables for name in LINKS):
        return None
    return np.column_stack([values_of(group[name], rows) for name in LINKS]).astype(float)
