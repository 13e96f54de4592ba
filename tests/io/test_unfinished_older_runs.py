"""Runs interrupted in version 0.2 are resumed, and end as version 0.2 would have ended them."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

import labkit as lk

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).with_name("version_0_2")
ENDS = json.loads((FOLDER / "ends.json").read_text())


def unpacked(name, folder):
    """A file of version 0.2 in a folder."""
    file = folder / name
    file.write_bytes(gzip.decompress((FOLDER / f"{name}.gz").read_bytes()))
    return file


@pytest.mark.parametrize("name", ENDS)
def test_a_killed_run_of_version_0_2_is_resumed(tmp_path, name):
    state, file = lk.read_state(unpacked("s.state.nc", tmp_path)), unpacked(f"{name}.run.nc", tmp_path)
    begun = lk.Run.open(file)
    with begun.data:
        first = begun.data["stress"].values
    assert not begun.complete and len(first) < ENDS[name]["records"] and begun.path.name == name
    run = lk.run(state, begun.path, file=file, progress=False, record_strain=5e-4, snapshots=2, save_every=1)
    assert run.complete and len(run.data["stress"]) == ENDS[name]["records"]
    np.testing.assert_array_equal(run.data["stress"][: len(first)], first)
    for variable in ("stress", "strain"):  # another processor rounds differently
        expected = np.array(ENDS[name][variable])
        np.testing.assert_allclose(run.data[variable][-1], expected, atol=1e-4 * np.abs(expected).max())
