"""The bench on real engines: every engine is measured, in turn."""

import shutil

from labkit.bench.engines import bench


def test_every_engine_is_measured(specimen_file):
    found = bench(specimen_file, 20, 1, lambda fraction, text: None)
    names = " ".join(found)
    assert "stock YADE" in names and "labkit on YADE" in names and "fused" in names
    assert ("LAMMPS" in names) == bool(shutil.which("lmp"))
    for turns in found.values():
        assert len(turns) == 1 and turns[0]["steps_per_second"] > 0.0
        assert all(value > 0.0 for value in turns[0].values())
