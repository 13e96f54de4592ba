"""The benchmark of whole commands, on real engines."""

import shutil

import pandas
import pytest

from benchmarks import commands, lammps
from benchmarks.__main__ import main

pytestmark = [pytest.mark.slow, pytest.mark.yade]


def test_whole_commands_and_the_loops_of_other_programs_are_measured(specimen_file, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(commands, "TRIALS", 1)
    monkeypatch.setattr(lammps, "TUNINGS", lammps.TUNINGS[:2])
    file = tmp_path / "commands.csv"
    command = ["bench", str(specimen_file), "--what", "commands", "--strain", "0.003", "--steps", "20", "--rounds", "1"]
    assert main([*command, "--csv", str(file)]) == 0
    speeds = pandas.read_csv(file, comment="#")
    names = " ".join(speeds["variant"])
    assert "stock YADE" in names and "labkit run cv, yade" in names and "labkit run cv, fused" in names
    assert ("LAMMPS" in names) == bool(shutil.which("lmp"))
    whole = speeds[speeds["variant"] == "labkit run cv, fused"]
    assert whole["steps"].item() > 2_000 and whole["seconds"].item() > 0.5  # with the start of Python
    assert "to stock" in capsys.readouterr().out
