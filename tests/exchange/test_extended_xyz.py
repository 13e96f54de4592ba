"""Extended XYZ, read back by its documented rules: a count, a line of key=value, and the columns of `Properties`."""

import re

import numpy as np
import pytest

import labkit as lk
from labkit.cli import main


@pytest.fixture(scope="module")
def sheared(soft_specimen):
    """A specimen in a sheared cell, whose vectors are not perpendicular."""
    path = lk.paths.SimpleShear(strain=0.1, rate=100, pressure="100 kPa")
    return lk.run(soft_specimen, path, progress=False, record_strain=0.05).state


def test_grains_radii_and_cell_are_read_back(sheared, tmp_path):
    lk.write_state(tmp_path / "s.state.nc", sheared)
    assert main(["export", str(tmp_path / "s.state.nc"), "-o", str(tmp_path / "s.xyz")]) == 0
    count, head, *rows = (tmp_path / "s.xyz").read_text().splitlines()
    keys = {key: quoted or plain for key, quoted, plain in re.findall(r'(\w+)=(?:"([^"]*)"|(\S+))', head)}
    assert int(count) == len(rows) == sheared.number_of_grains and keys["pbc"] == "T T T"
    a, b, c = np.array(keys["Lattice"].split(), float).reshape(3, 3)  # vectors in rows
    np.testing.assert_array_equal(np.column_stack([a, b, c]), sheared.cell)
    assert abs(sheared.cell[0, 2]) > 0.01 * sheared.cell[0, 0] or abs(sheared.cell[2, 0]) > 0.01 * sheared.cell[0, 0]
    names, values = keys["Properties"].split(":")[::3], [row.split() for row in rows]
    columns = dict(zip(names, np.cumsum([0, *map(int, keys["Properties"].split(":")[2::3])])[:-1], strict=True))
    first = columns["pos"]
    position = np.array([row[first : first + 3] for row in values], float)
    np.testing.assert_array_equal(position, sheared.position)
    np.testing.assert_array_equal(np.array([row[columns["radius"]] for row in values], float), sheared.radius)
    first = columns["velo"]
    np.testing.assert_array_equal(np.array([row[first : first + 3] for row in values], float), sheared.velocity)
