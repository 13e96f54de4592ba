"""The benchmark on real engines: every engine is measured."""

import re
import shutil

import pytest

from benchmarks.__main__ import main
from benchmarks.engines import bench

pytestmark = pytest.mark.slow


@pytest.mark.yade
def test_every_engine_is_measured(specimen_file):
    results = bench(specimen_file, 20, 1, lambda fraction, text: None)
    names = " ".join(results)
    assert "stock YADE" in names and "labkit on YADE" in names and "fused" in names
    assert ("LAMMPS" in names) == bool(shutil.which("lmp"))
    assert {len(turns) for turns in results.values()} == {1}


def test_one_and_several_threads_are_measured_on_free_and_busy_cores(specimen_file, capsys):
    assert main(["bench", str(specimen_file), "--what", "threads", "--steps", "2", "--rounds", "1"]) == 0
    rows = re.findall(
        r"^(\d+) threads?, other cores (free|busy) +([\d.]+) +([\d.]+)", capsys.readouterr().out, re.MULTILINE
    )
    assert {("1", "free"), ("1", "busy")} <= {row[:2] for row in rows}
    assert all(float(ratio) == 1.0 for count, _, _, ratio in rows if count == "1")
